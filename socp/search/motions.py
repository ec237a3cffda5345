"""Controls that do what they claim: the motion of a direct solution's own control, in place of what
its grid makes of it, and controls held over every interval.
"""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from socp.errors import LateError, SolveError
from socp.methods import solve_collocated
from socp.model import (
    APPROXIMATE,
    FEASIBLE,
    Arc,
    Problem,
    Solution,
    Stop,
    Watch,
    legendre_coefficients,
    once,
    silent,
)
from socp.process import in_time
from socp.solvers import Backend
from socp.transcription import Mesh, equidistributed, knotted, radau_iia, single_phase
from socp.verdict import moved, verify

# Intervals with held controls, and points on each: what is lost goes with an interval's square, and
# the motion is integrated to the digits of what it is compared with; where it is not, as it is
# stiff or unstable, as many in all on intervals of higher order that are short where it is fast
_HELD, _FAST = (200, 3), (120, 5)
_TOLERANCE = 1e-7  # a direct solution is compared by its re-integration
_ITERATIONS = 150  # from a solution nearby it takes some ten


def held_solution(
    problem: Problem, known: Solution, backend: Backend, watch: Watch = silent
) -> Solution | None:
    """Return a direct solution whose controls are held over every interval of a grid, from one that
    is known; None where that fails.

    It does what it claims, as its motion is of high order and its controls have no slopes, and does
    not ring along singular arcs. Where equal intervals do not, as motion is fast at times or
    unstable, they are chosen by how much it moves.
    """
    how = problem, backend, watch
    (count, points), (fewer, more) = _HELD, _FAST
    found = _held_on(how, knotted(problem, radau_iia(points), count), known)
    if found is not None:
        if found.stop is Stop.INTERRUPTED:
            return found
        if found.stop.ok and verify(problem, found)[0].off <= APPROXIMATE:
            return found
    start = found if found is not None and found.stop.ok else known
    again = _held_on(how, equidistributed(problem, radau_iia(more), fewer, start), start)
    better = again is not None and (again.stop.ok or again.stop is Stop.INTERRUPTED)
    return again if better else found


def _held_on(how: tuple[Problem, Backend, Watch], mesh: Mesh, known: Solution) -> Solution | None:
    problem, backend, watch = how
    patient = backend.within(_TOLERANCE).limited(_ITERATIONS).nearby()
    phased = single_phase(problem).with_phases(held=True)
    try:
        return solve_collocated(phased, [mesh], patient, known, watch)
    except SolveError:
        return None


def own_motion(problem: Problem, direct: Solution) -> Solution:
    """Return a verified direct solution; where its control meets all but its box or its claim, with
    the motion and the objective of that control.

    A polynomial control that jumps leaves its box between its nodes: it is held at its mean on
    every interval then, which does as much and stays inside. What is found is kept; where the time
    allowed ends first, the solution comes back as it is, not verified.
    """
    try:
        return _own(direct, problem)
    except LateError:
        return direct


@once
def _own(direct: Solution, problem: Problem) -> Solution:
    seen = verify(problem, direct)[0]
    in_time("its own motion")
    found = direct
    if seen.box > FEASIBLE and not direct.lawful:
        found = moved(problem, replace(direct, arcs=tuple(_held(each) for each in direct.arcs)))
    elif seen.worst <= FEASIBLE < seen.off:
        found = moved(problem, direct)
    if found is not direct:
        told = f"the objective is that of its own control, its grid claims {direct.objective:.8g}"
        found = replace(found, message="; ".join(filter(None, (direct.message, told))))
    found = found.with_judgement(verified=verify(problem, found))
    in_time("its own motion")
    return found


def _held(arc: Arc) -> Arc:
    """Return an arc with the mean of its control on every interval."""
    ends = arc.mesh
    spans = [(float(arc.t[a]), float(arc.t[b])) for a, b in pairwise(ends)]
    means = np.empty((arc.u.shape[0], len(spans)))
    for k, span in enumerate(spans):
        nodes = arc.nodes(k, "u")
        for i, row in enumerate(arc.u[:, nodes]):
            # the first Legendre coefficient of the polynomial through the nodes
            means[i, k] = legendre_coefficients(arc.t[nodes], row, span)[0]
    return replace(
        arc,
        t=arc.t[ends],
        x=arc.x[:, ends],
        u=np.hstack([means[:, :1], means]),
        costate=arc.costate[:, ends],
        mesh=np.arange(ends.size),
        side="right",
        multipliers={name: row[ends] for name, row in arc.multipliers.items()},
    )

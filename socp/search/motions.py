"""Controls that do what they claim: the motion of a direct solution's own control, in place of what
its grid makes of it, and controls held over every interval.
"""

from collections.abc import Iterator
from dataclasses import replace

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
    on_intervals,
    once,
    silent,
)
from socp.process import in_time, seconds_left
from socp.solvers import Backend
from socp.transcription import Mesh, equidistributed, knotted, radau_iia, single_phase
from socp.verdict import box_miss, error_shares, judge, moved, verify, verify_in_time

# Intervals with held controls, and points on each: what is lost goes with an interval's square, and
# the motion is integrated to the digits of what it is compared with; where it is not, as it is
# stiff or unstable, as many in all on intervals of higher order that are short where it is fast
_HELD, _FAST = (200, 3), (120, 5)
# The first of the grids that are cut where it is worth it: coarse, as it tells little but where
_ADAPTED = 60, 3
# Of the mean of all intervals: the error at which an interval is left as it is, and aimed at. Where
# all have the same, all are halved
_AIM = 0.25
_PARTS = 4  # of an interval at most: what a coarse grid says of one is rough
_MOST = 400  # intervals: where so many do not do, no grid does that is solved in some seconds
# The controls of short intervals weigh as little in the objective as their bounds in a barrier of
# more: they would be left anywhere
_SHARP = 1e-10
_TOLERANCE = 1e-7  # a direct solution is compared by its re-integration
_ITERATIONS = 150  # from a solution nearby it takes some ten
# Of an interval: where a polynomial control is looked at, its ends among them
_SHARES = np.linspace(0.0, 1.0, 9)
# With a barrier from the beginning, where the controls of a solution in hand are not to be trusted:
# they have left the box, or ring
_FAR = 500


def held_solution(
    problem: Problem, known: Solution, backend: Backend, watch: Watch = silent
) -> Solution | None:
    """Return a direct solution whose controls are held over every interval of a grid, from one that
    is known; None where that fails.

    It does what it claims, as its motion is of high order and its controls have no slopes, and does
    not ring along singular arcs. Where equal intervals do not, as motion is fast at times or
    unstable, they are chosen by how much it moves.
    """
    how = problem, backend.within(_TOLERANCE).limited(_ITERATIONS).nearby(), watch
    (count, points), (fewer, more) = _HELD, _FAST
    found = _held_on(how, knotted(problem, radau_iia(points), count), known)
    if found is not None:
        if found.stop is Stop.INTERRUPTED:
            return found
        if found.stop.ok and verify_in_time(problem, found).off <= APPROXIMATE:
            return found
    start = found if found is not None and found.stop.ok else known
    again = _held_on(how, equidistributed(problem, radau_iia(more), fewer, start), start)
    better = again is not None and (again.stop.ok or again.stop is Stop.INTERRUPTED)
    return again if better else found


def adapted(
    problem: Problem, known: Solution, backend: Backend, watch: Watch = silent
) -> Iterator[Solution]:
    """Yield direct solutions with held controls from one that is known, judged, each on the grid of
    the one before with those intervals cut that most of its objective's error comes from.

    A treatment that is over in the first minutes of a season, switches that crowd at an end: a grid
    that is fine there has few intervals. It ends where a solve fails, where nothing tells where to
    cut, and where what is stated of the error falls no more: short intervals weigh so little then
    that the solver leaves their controls anywhere.
    """
    patient = backend.within(_SHARP).limited(_FAR)
    scheme = radau_iia(_ADAPTED[1])
    mesh: Mesh | None = equidistributed(problem, scheme, _ADAPTED[0], known)
    error = float("inf")
    while mesh is not None:
        found = _held_on((problem, patient, watch), mesh, known)
        if found is None or not found.stop.ok:
            return
        patient = patient.nearby()  # what was solved on one grid is near what is on the next
        known = judge(problem, found)
        yield known
        before, error = error, stated_error(known)
        if before <= error < np.inf or seconds_left() <= 0.0:
            return
        mesh = _cut_where_worth(problem, known, mesh)


def stated_error(solution: Solution) -> float:
    """Return the error of the objective that a verdict states, infinite where it states none."""
    verdict = solution.verdict
    if verdict is None or verdict.grade is None or not verdict.approximate:
        return float("inf")
    return verdict.grade.error


def _cut_where_worth(problem: Problem, solution: Solution, mesh: Mesh) -> Mesh | None:
    """Return the mesh of a solution with those intervals cut that add more than others to the error
    of its objective, None where that is not known or takes too many.
    """
    with np.errstate(all="ignore"):
        try:
            found = error_shares(problem, solution)
        except (np.linalg.LinAlgError, ValueError, ArithmeticError):
            return None
    if found is None:
        return None
    edges, shares = found
    ends = solution.arcs[0].t[solution.arcs[0].mesh]
    of = np.searchsorted(ends, 0.5 * (edges[1:] + edges[:-1])) - 1
    error = np.bincount(of, shares, minlength=ends.size - 1)
    if not 0.0 < error.sum() < np.inf:
        return None
    # what controls that are held miss of a switch falls with the square of an interval's length
    wanted = np.sqrt(error / (_AIM * error.mean()))
    parts = np.ceil(np.clip(wanted, 1.0, _PARTS)).astype(int)
    if parts.sum() > _MOST:
        return None
    return [
        (share / count, scheme)
        for (share, scheme), count in zip(mesh, parts.tolist(), strict=True)
        for _ in range(count)
    ]


def _held_on(how: tuple[Problem, Backend, Watch], mesh: Mesh, known: Solution) -> Solution | None:
    problem, backend, watch = how
    phased = single_phase(problem).with_phases(held=True)
    try:
        return solve_collocated(phased, [mesh], backend, known, watch)
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
    seen = verify_in_time(problem, direct)
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


def leaves_box(problem: Problem, direct: Solution) -> bool:
    """Tell whether the control of a direct solution leaves its box between the nodes, by more than
    is feasible, without a look at where it leads.
    """
    edges = np.concatenate([arc.t[arc.mesh[:-1]] for arc in direct.arcs])
    lengths = np.concatenate([np.diff(arc.t[arc.mesh]) for arc in direct.arcs])
    t = (edges[:, None] + lengths[:, None] * _SHARES).ravel()
    interval = np.repeat(np.arange(edges.size), _SHARES.size)
    return box_miss(on_intervals(direct.arcs, "u", t, interval), problem.box) > FEASIBLE


def _held(arc: Arc) -> Arc:
    """Return an arc with the mean of its control on every interval."""
    ends = arc.mesh
    means = np.array([arc.means(row) for row in arc.u])
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

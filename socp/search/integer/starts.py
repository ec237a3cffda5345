"""Layouts of arcs to start mixed-integer solvers from: what a direct solution shows, and short arcs
it cannot show.
"""

from dataclasses import replace

import numpy as np

from socp.methods import scouts, solve_collocated, split
from socp.model import Mode, Problem, Solution, Stop, Watch, silent
from socp.search.candidate import Candidate
from socp.search.reading import read
from socp.solvers import Backend, default_backend
from socp.transcription import radau_iia, single_phase, uniform

_SCOUTS = (
    12  # guesses of coarse solves, as many as scouting needs to meet an extremal several times
)
_STEPS = 50  # intervals of the solve whose stretches give the arcs their first lengths
_TOLERANCE, _ITERATIONS = 1e-6, 300  # of that solve: lengths take no digits
_SHORT = 0.01  # of the horizon: a first length for an arc that the grid is too coarse to show


def starts(
    problem: Problem,
    switches: int,
    guess: Solution,
    watch: Watch = silent,
    backend: Backend | None = None,
) -> list[Solution]:
    """Return layouts of `switches` + 1 arcs to start from, best first.

    A direct solution shows the modes of the arcs and how long they are. Those that are too short
    for its grid get a short length and unknown modes, where they may be: at the ends first, since
    given ends are seldom on a singular surface.
    """
    backend = backend or default_backend()
    found = scouts(problem, guess, _SCOUTS, watch, backend)
    if found and found[0].stop is Stop.INTERRUPTED:
        return found
    mesh = uniform(radau_iia(2), _STEPS)
    rough = backend.within(_TOLERANCE).limited(_ITERATIONS)
    direct = solve_collocated(
        single_phase(problem), [mesh], rough, found[0] if found else guess, watch
    )
    if direct.stop is Stop.INTERRUPTED:
        return [direct]
    direct = direct if direct.stop.ok else (found[0] if found else guess)
    seen = _fitted(read(problem, direct), switches + 1)
    return [_cut(direct, seen, edges) for edges in _layouts(list(seen.edges), switches + 2)]


def _cut(direct: Solution, seen: Candidate, edges: list[float]) -> Solution:
    """Return a solution cut at edges, arcs that were seen with their modes; a short arc put in may
    be anything.
    """
    cut = split(direct, np.diff(edges).tolist())
    unknown = (Mode("free"),) * len(direct.control_names)
    arcs = []
    for arc in cut.arcs:
        middle = float(arc.t[[0, -1]].mean())
        k = min(int(np.searchsorted(seen.edges[1:-1], middle)), len(seen.arcs) - 1)
        known = np.ptp(arc.t) >= 0.5 * (seen.edges[k + 1] - seen.edges[k])
        arcs.append(replace(arc, modes=seen.arcs[k] if known else unknown))
    return replace(cut, arcs=tuple(arcs))


def _fitted(given: Candidate, count: int) -> Candidate:
    """Return a candidate with so many arcs at most: the shortest ones are left out."""
    while len(given.arcs) > count:
        lengths = np.diff(given.edges)
        k = int(np.argmin(lengths))
        before = k == len(lengths) - 1 or (
            k > 0 and lengths[k - 1] > lengths[k + 1]
        )  # it goes to the longer neighbour
        cut = k if before else k + 1
        edges = (*given.edges[:cut], *given.edges[cut + 1 :])
        given = Candidate((*given.arcs[:k], *given.arcs[k + 1 :]), edges, given.source)
    return given


def _layouts(edges: list[float], count: int) -> list[list[float]]:
    """Return edges with short arcs put in until there are so many: at both ends in turn, at the
    start, at the end.
    """
    if len(edges) == count:
        return [edges]
    found: list[list[float]] = []
    for order in ((0, 1), (0, 0), (1, 1)):
        new = list(edges)
        for k in range(count - len(edges)):
            first, last = (new[1] - new[0], new[-1] - new[-2])
            short = _SHORT * (new[-1] - new[0])
            if order[k % 2] == 0:
                new.insert(1, new[0] + min(short, first / 2.0))
            else:
                new.insert(-1, new[-1] - min(short, last / 2.0))
        if new not in found:
            found.append(new)
    return found

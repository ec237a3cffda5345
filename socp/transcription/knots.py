"""Knots: times at which a problem itself changes its course, such as those of a table of prices.

Grids have nodes there, and arcs along a word are cut there from the beginning: unlike other kinks
they are known before anything is solved.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise

import casadi
import numpy as np

from socp.model import SAME_TIME, TINY, Arc, Problem, Solution, column, numbers, once, time
from socp.transcription.cutting import part
from socp.transcription.kinks import crossing, decided, kinks
from socp.transcription.mesh import Mesh, uniform
from socp.transcription.phases import Phase, PhasedProblem
from socp.transcription.schemes import Scheme

# Looks at a fixed horizon: a table by the hour over a season has as many knots, and each is one
# zero
_LOOKS = 5000
# Times the intervals asked for: with more knots than that a grid of so many intervals cannot tell
# them apart, and has none of them
_MORE = 4


@once
def knot_times(problem: Problem) -> tuple[float, ...]:
    """Return the times inside a fixed horizon at which the dynamics, the running cost or a state
    constraint have a kink or a jump whatever the states are; none where the horizon is free.
    """
    (first, latest), (last, end) = problem.initial_time_box, problem.final_time_box
    if first != latest or last != end:
        return ()
    others = casadi.vertcat(problem.x, problem.p, problem.u)
    given = casadi.vertcat(others, time)
    path = column(constraint.expression for constraint in problem.constraints)
    every = casadi.vertsplit(kinks(casadi.vertcat(problem.rate, problem.lagrangian, path), given))
    of_time = [each for each in every if not casadi.depends_on(each, others)]
    if not of_time:
        return ()
    values = casadi.Function("knots", [time], [column(of_time)])
    grid = np.linspace(first, end, _LOOKS + 1)
    sampled = numbers(values, grid)[0]
    apart = SAME_TIME * (end - first)
    found: list[float] = []
    for i, row in enumerate(sampled):
        found += grid[row == 0.0].tolist()  # a table by the hour has its knots on the grid
        for k in np.flatnonzero(row[:-1] * row[1:] < 0.0):
            found.append(crossing(partial(_row, values, i), grid[k], grid[k + 1]))
    inside = [t for t in sorted(found) if first + apart < t < end - apart]
    return tuple(t for k, t in enumerate(inside) if k == 0 or t - inside[k - 1] > apart)


def _row(function: casadi.Function, row: int, t: np.ndarray) -> np.ndarray:
    found: np.ndarray = numbers(function, t)[0][row]
    return found


def knotted(problem: Problem, scheme: Scheme, intervals: int) -> Mesh:
    """Return a mesh of about so many equal intervals of the whole horizon, with a node at every
    knot.

    It is `uniform` where there are no knots, or too many of them for so few intervals.
    """
    inside = knot_times(problem)
    if not inside or len(inside) >= _MORE * intervals:
        return uniform(scheme, intervals)
    first, last = problem.initial_time_box[0], problem.final_time_box[0]
    shares = np.diff([first, *inside, last]) / (last - first)
    mesh: list[tuple[float, Scheme]] = []
    for share in shares.tolist():
        count = max(1, round(share * intervals))
        mesh += [(share / count, scheme)] * count
    return mesh


def equidistributed(problem: Problem, scheme: Scheme, intervals: int, solution: Solution) -> Mesh:
    """Return a mesh of the horizon of a solution with about so many intervals, each of which holds
    as much of its time, of what its controls vary and of what its states do, a third each, with a
    node at every knot.

    It is fine where a solution moves fast and switches (de Boor, Lecture Notes in Mathematics 363,
    1974, doi:10.1007/BFb0069121).
    """
    t, x, u = solution.t, solution.rows("x"), solution.rows("u")
    spans = np.diff(t)
    mass = sum(each / max(each.sum(), TINY) for each in (spans, _varied(x), _varied(u)))
    total = np.append(0.0, np.cumsum(mass))
    ends = np.interp(np.linspace(0.0, total[-1], intervals + 1), total, t)
    inside = [time for time in knot_times(problem) if t[0] < time < t[-1]]
    ends = np.union1d(ends, inside)
    shares = np.diff(ends) / (t[-1] - t[0])
    return [(share, scheme) for share in shares.tolist() if share > SAME_TIME]


def _varied(rows: np.ndarray) -> np.ndarray:
    """Return how much rows (k, n) vary between nodes (n - 1,), each relative to its range, with
    half of it beside: a switch is somewhere near where a grid shows it.
    """
    size = np.maximum(np.ptp(rows, axis=1, keepdims=True), TINY)
    steps = np.abs(np.diff(rows, axis=1) / size).max(axis=0)
    found: np.ndarray = np.convolve(steps, (0.25, 0.5, 0.25), mode="same")
    return found


def cut_at_knots(
    phased: PhasedProblem, solution: Solution, mesh: Callable[[Arc, tuple[float, float]], Mesh]
) -> tuple[PhasedProblem, Solution, list[int]]:
    """Return a phased problem with its arcs cut at knots, its solution or guess, and the number of
    pieces of every arc.

    `mesh` tells the mesh of an arc's piece between two times. A piece begins at its knot whatever
    the lengths before it: an arc that ends before the knot leaves its last piece without length. A
    switch that falls on a knot stays there: where a price jumps, so does the switching function.
    """
    times = knot_times(phased.of)
    apart = SAME_TIME * (solution.final_time - solution.initial_time)
    if not times or len(solution.arcs) != len(phased.phases):
        return phased, solution, [1] * len(phased.phases)
    phases: list[Phase] = []
    arcs: list[Arc] = []
    pieces: list[int] = []
    for k, (phase, arc) in enumerate(zip(phased.phases, solution.arcs, strict=True)):
        first, last = float(arc.t[0]), float(arc.t[-1])
        on = [t for t in times if k and abs(t - first) <= apart and last - first > apart]
        inside = [t for t in times if first + apart < t < last - apart]
        spans = list(pairwise([first, *inside, last]))
        when = [_between(times, 0.5 * (a + b), solution) for a, b in spans]
        begins = (*phase.entry, *(time - t for t in on))
        cut = [
            replace(phase, entry=begins, when=when[0]),
            *(
                replace(
                    phase, entry=(time - t,), touched=frozenset(), length=(0.0, np.inf), when=at
                )
                for t, at in zip(inside, when[1:], strict=True)
            ),
        ]
        cut = [replace(e, control=decided(e.control, at)) for e, at in zip(cut, when, strict=True)]
        phases += [*(replace(each, exit=()) for each in cut[:-1]), cut[-1]]
        arcs += [part(arc, span, mesh(arc, span)) for span in spans]
        pieces.append(len(inside) + 1)
    return PhasedProblem(phased.of, tuple(phases)), replace(solution, arcs=tuple(arcs)), pieces


def _between(times: tuple[float, ...], t: float, solution: Solution) -> float:
    """Return the middle between the two knots, or ends of the horizon, that are next to a time."""
    known = [solution.initial_time, *times, solution.final_time]
    k = int(np.clip(np.searchsorted(known, t), 1, len(known) - 1))
    return 0.5 * (known[k - 1] + known[k])

"""What a solution keeps clear of: figures that are positive while its word holds, and pass through
zero where the word changes.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from typing import final

import casadi
import numpy as np

from socp.model import (
    Arc,
    Problem,
    Solution,
    constraint_function,
    evaluate,
    of_motion,
    once,
    parameters_of,
    switching_function,
    time,
)

Along = Callable[[Arc, np.ndarray], np.ndarray]  # values (n,) at times (n,) of an arc

_SAMPLES = 101  # points an arc: what a polynomial of degree 10 does between two of them is smooth
_ROUNDS = 4  # of finer samples around a dip: each narrows it to a fiftieth
# Of the largest value along the way: a dip has walls of this height; less is rounding
_WALL = 1e-7


@final
@dataclass(frozen=True)
class Clue:
    """What passes through zero: its kind, the control, constraint or arc that it belongs to, and
    its number among those of that kind.
    """

    kind: str
    of: str
    number: int = 0


@final
@dataclass(frozen=True)
class Margin:
    """How far a figure is from zero, relative to its own size, and at which time."""

    value: float
    time: float


Margins = dict[Clue, Margin]
CURVATURE = Clue("curvature", "")  # the least one of the objective among controls of the word


def lengths(solution: Solution) -> Margins:
    """Return the length of every arc, in horizons; Newton goes on through zero, where an arc that
    has gone has a negative one.
    """
    horizon = abs(solution.final_time - solution.initial_time)
    return {
        Clue("length", str(k + 1), k): Margin(
            float(arc.t[-1] - arc.t[0]) / horizon, float(arc.t[0])
        )
        for k, arc in enumerate(solution.arcs)
    }


def margins(problem: Problem, solution: Solution) -> Margins:
    """Return all figures of a judged solution: lengths of arcs, switching functions inside bang
    arcs, laws inside the box, state constraints off their arcs and their multipliers along them.
    """
    found = lengths(solution)
    found |= dict(_switching(problem, solution))
    found |= dict(_box(problem, solution))
    found |= dict(_constraints(problem, solution))
    found |= dict(_multipliers(solution))
    order = solution.verdict.second_order if solution.verdict else None
    if order is not None and order.word is not None and order.word.free:
        found[CURVATURE] = Margin(order.word.least, solution.initial_time)
    return found


def _scaled(f: Along, factor: float) -> Along:
    return lambda arc, t: factor * f(arc, t)


@of_motion
@once
def _slope(problem: Problem) -> casadi.Function:
    """Return the rate of the switching functions, off state constraints, of x, u, costate, t, p."""
    along = [problem.x, problem.costate, time]
    adjoint = -casadi.gradient(problem.hamiltonian, problem.x)
    rates = [problem.rate, adjoint, casadi.SX(1)]
    parts = [casadi.jtimes(problem.switching, z, r) for z, r in zip(along, rates, strict=True)]
    given = [problem.x, problem.u, problem.costate, time, problem.p]
    return casadi.Function("slope", given, [casadi.densify(sum(parts, casadi.SX(0)))])


def _switching(problem: Problem, solution: Solution) -> Iterator[tuple[Clue, Margin]]:
    """Yield the lowest point of the switching function inside every bang stretch, on its side, and
    its value where a stretch begins or ends the horizon.
    """
    p, function = parameters_of(problem, solution), switching_function(problem)
    for i, name in enumerate(problem.control_names):

        def sigma(arc: Arc, t: np.ndarray, i: int = i) -> np.ndarray:
            """Return the switching function at times (n,) of an arc."""
            row: np.ndarray = evaluate(function, arc.at(t), arc.at(t, "costate"), t, p)[0][i]
            return row

        size = max(float(np.abs(sigma(arc, arc.t)).max()) for arc in solution.arcs) or 1.0
        runs = list(_runs(solution, i))
        for number, (mode, arcs) in enumerate(runs):
            if mode not in {"+", "-"}:
                continue
            sign = (1.0 if mode == "-" else -1.0) / size
            ends = _open(solution, arcs)
            yield from _clues("switching", name, number, arcs, _scaled(sigma, sign), ends)
            if number and runs[number - 1][0] in {"+", "-"}:
                yield (
                    Clue("switching slope", name, number),
                    _crossing(problem, solution, arcs[0], i, sign),
                )


def _crossing(problem: Problem, solution: Solution, arc: Arc, control: int, scale: float) -> Margin:
    """Return how fast a switching function leaves zero where a bang follows a bang, in its size
    over horizons: it turns round where another arc comes in between.
    """
    t, horizon = arc.t[:1], solution.final_time - solution.initial_time
    given = (arc.at(t), arc.at(t, "u"), arc.at(t, "costate"), t, parameters_of(problem, solution))
    rate = float(evaluate(_slope(problem), *given)[0][control, 0])
    return Margin(scale * rate * horizon, float(t[0]))


def _box(problem: Problem, solution: Solution) -> Iterator[tuple[Clue, Margin]]:
    """Yield how far laws stay from either bound on every stretch, its ends included."""
    for i, name in enumerate(problem.control_names):
        low, high = problem.box[:, i]
        for number, (mode, arcs) in enumerate(_runs(solution, i)):
            if mode in {"+", "-"}:
                continue
            width = float(high - low)
            for kind, bound, size in (("lower", low, width), ("upper", high, -width)):
                room = _room(i, float(bound), size)
                yield from _clues(kind, name, number, arcs, room, (True, True))


def _room(control: int, bound: float, width: float) -> Along:
    """Return how far a control is from a bound, in widths of the box, which are negative for an
    upper one.
    """
    return lambda arc, t: (arc.at(t, "u")[control] - bound) / width


def _constraints(problem: Problem, solution: Solution) -> Iterator[tuple[Clue, Margin]]:
    """Yield how far every state constraint is from its limit, off the arcs that follow it."""
    p = parameters_of(problem, solution)
    for constraint in problem.constraints:
        function = constraint_function(problem, constraint)

        def slack(arc: Arc, t: np.ndarray, f: casadi.Function = function) -> np.ndarray:
            """Return how far a constraint is from holding with equality at times (n,) of an arc."""
            row: np.ndarray = -evaluate(f, arc.at(t), t, p)[0].ravel()
            return row

        size = max(float(np.abs(slack(arc, arc.t)).max()) for arc in solution.arcs) or 1.0
        on = [
            (any(mode.constraint == constraint.name for mode in arc.modes), arc)
            for arc in solution.arcs
        ]
        for number, (along, group) in enumerate(groupby(on, key=lambda pair: pair[0])):
            if along:
                continue
            arcs = [arc for _, arc in group]
            yield from _clues(
                "constraint",
                constraint.name,
                number,
                arcs,
                _scaled(slack, 1.0 / size),
                _open(solution, arcs),
            )


def _multipliers(solution: Solution) -> Iterator[tuple[Clue, Margin]]:
    """Yield the lowest dip of the multiplier's density along every arc on a state constraint, and
    its values where the arc begins and ends.
    """
    for k, arc in enumerate(solution.arcs):
        for name in {mode.constraint for mode in arc.modes} - {None}:
            density = arc.multipliers.get(str(name))
            if density is not None and np.isfinite(density).all():
                along = replace(arc, costate=density[None] / (float(np.abs(density).max()) or 1.0))
                yield from _clues("multiplier", str(name), k, [along], _density, (True, True))


def _density(arc: Arc, t: np.ndarray) -> np.ndarray:
    row: np.ndarray = arc.at(t, "costate")[0]
    return row


def _runs(solution: Solution, control: int) -> Iterator[tuple[str, list[Arc]]]:
    """Yield the stretches of one control: its mode and the arcs."""
    for mode, group in groupby(solution.arcs, key=lambda arc: str(arc.modes[control])):
        yield mode, list(group)


def _open(solution: Solution, arcs: Sequence[Arc]) -> tuple[bool, bool]:
    """Tell whether arcs begin and end the horizon: elsewhere their ends are switches."""
    return arcs[0] is solution.arcs[0], arcs[-1] is solution.arcs[-1]


def _clues(
    kind: str, of: str, number: int, arcs: Sequence[Arc], f: Along, ends: tuple[bool, bool]
) -> Iterator[tuple[Clue, Margin]]:
    """Yield the lowest dip of a figure along arcs, and its values at the ends that count."""
    dip = lowest(arcs, f)
    if dip is not None:
        yield Clue(kind, of, number), dip
    for here, arc, k, name in ((ends[0], arcs[0], 0, "begin"), (ends[1], arcs[-1], -1, "end")):
        if here:
            value = float(f(arc, arc.t[[k]])[0])
            yield Clue(f"{kind} {name}", of, number), Margin(value, float(arc.t[k]))


def lowest(arcs: Sequence[Arc], f: Along) -> Margin | None:
    """Return the lowest dip of a figure along arcs, None where it has none inside: a minimum with
    walls on either side.
    """
    t, v = _sampled(arcs, f, (-np.inf, np.inf), _SAMPLES)
    wall = _WALL * float(np.abs(v).max(initial=0.0))
    left, right = np.maximum.accumulate(v), np.maximum.accumulate(v[::-1])[::-1]
    inner = (v[1:-1] <= v[:-2]) & (v[1:-1] <= v[2:])
    inner &= (left[1:-1] - v[1:-1] > wall) & (right[1:-1] - v[1:-1] > wall)
    places = np.flatnonzero(inner) + 1
    if not places.size:
        return None
    k = int(places[np.argmin(v[places])])
    best = Margin(float(v[k]), float(t[k]))
    span = float(t[k - 1]), float(t[k + 1])
    for _ in range(_ROUNDS):
        t, v = _sampled(arcs, f, span, _SAMPLES)
        k = int(np.argmin(v))
        best = Margin(float(v[k]), float(t[k]))
        span = float(t[max(k - 1, 0)]), float(t[min(k + 1, t.size - 1)])
    return best


def _sampled(
    arcs: Sequence[Arc], f: Along, span: tuple[float, float], count: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return times and values of a figure along arcs within a span of time, joints from both
    sides.
    """
    times, values = [], []
    for arc in arcs:
        a, b = max(float(arc.t[0]), span[0]), min(float(arc.t[-1]), span[1])
        if a <= b:
            times.append(np.linspace(a, b, count))
            values.append(f(arc, times[-1]))
    return np.concatenate(times), np.concatenate(values)

"""A control integrated again by itself, and how far the motion misses what a problem asks for: its
ends, its state constraints and its box, relative to sizes.
"""

import math
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from socp.errors import LateError, MethodError
from socp.model import (
    EXTREMAL,
    FEASIBLE,
    TINY,
    Feasibility,
    Problem,
    Solution,
    condition_function,
    condition_slopes,
    end_values,
    evaluate,
    lately,
    magnitude,
    mayer_function,
    numbers,
    parameters_of,
    running_costs,
    sizes,
)
from socp.verdict.motion import FINE, RTOL, Log, magnitude_along, travel
from socp.verdict.simulation.pieces import Piece, piece_of_law, pieces_in_time
from socp.verdict.structure import constraint_curvature, constraints_function

# Solutions of a problem whose motions are kept: a search goes to and fro between two at most
_KEPT = 4


def box_miss(u: np.ndarray, box: np.ndarray) -> float:
    """Return the worst excess of controls (nu, n) over their box, relative to its width."""
    low, high = box[0][:, None], box[1][:, None]
    return float(np.max(np.maximum(low - u, u - high) / (high - low), initial=0.0))


def end_miss(
    problem: Problem, solution: Solution, x: np.ndarray, scale: np.ndarray
) -> tuple[float, str]:
    """Return the worst relative violation of the end conditions by the end state x (nx,), and which
    condition it is.
    """
    low, high = problem.end_box
    excess = np.maximum(np.maximum(low - x, x - high), 0.0) / scale
    found = dict(zip(problem.state_names, excess.tolist(), strict=True))
    values = [x, *end_values(problem, solution)[1:]]
    sizes = np.concatenate([scale, scale, np.abs(np.hstack(values[2:]))])
    for condition in problem.conditions:
        value = float(numbers(condition_function(problem, condition), *values)[0][0, 0])
        slope = np.hstack(numbers(condition_slopes(problem, condition), *values)).ravel()
        violation = abs(value) if condition.equation else max(value, 0.0)
        found[condition.name] = float(violation / (np.abs(slope) @ sizes or 1.0))
    for name, at, (first, last) in (
        ("initial time", solution.initial_time, problem.initial_time_box),
        ("final time", solution.final_time, problem.final_time_box),
    ):
        found[name] = max(first - at, at - last, 0.0) / max(
            solution.final_time - solution.initial_time, TINY
        )
    worst = max(found, key=lambda name: np.inf if np.isnan(found[name]) else found[name])
    return found[worst], worst


def path_miss(
    problem: Problem,
    p: np.ndarray,
    scale: np.ndarray,
    motion: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> tuple[float, str]:
    """Return the worst relative violation of the state constraints at the points of a motion, and
    which it is: the share of their magnitudes that states have to change by there, to second order.

    By its slopes at their largest along the way alone, a constraint that keeps off a small obstacle
    would be hardly violated in the midst of it.
    """
    if not problem.constraints:
        return 0.0, ""
    t, x, _ = motion
    values, slopes = evaluate(constraints_function(problem), x, t, p)
    # a constraint's magnitude is how much it changes when every state changes by its own
    magnitudes = np.abs(slopes.reshape(len(values), t.size, -1)) @ scale
    largest = magnitudes.max(axis=1)
    relative = values.max(axis=1) / np.where(largest > 0, largest, 1.0)
    for k in np.flatnonzero((relative > 0) & (magnitudes.min(axis=1) < largest)):
        # the share by the slope alone, which is no less, has to be more than what is known
        at = np.flatnonzero(values[k] > relative[k] * magnitudes[k])
        bent = evaluate(constraint_curvature(problem, int(k)), scale, x[:, at], t[at], p)[0][0]
        shares = _share(values[k, at], magnitudes[k, at], bent)
        relative[k] = max(relative[k], shares.max(initial=0.0))
    worst = int(np.argmax(relative))
    return max(float(relative[worst]), 0.0), problem.constraints[worst].name


def _share(value: np.ndarray, slope: np.ndarray, curve: np.ndarray) -> np.ndarray:
    """Return the shares m > 0 (n,) at which slope m + curve m^2 is a value > 0, 0 where none is."""
    terms = slope + np.sqrt(slope**2 + 4.0 * curve * value)
    found: np.ndarray = np.divide(2.0 * value, terms, out=np.zeros(value.size), where=terms > 0)
    return found


def objective_of(
    problem: Problem,
    solution: Solution,
    motion: tuple[np.ndarray, np.ndarray, np.ndarray],
    scale: np.ndarray,
    running: float,
) -> tuple[float, float]:
    """Return the objective of a motion, and how far the returned one is from it, relative.

    The motion is times (n,), states (nx, n) and controls (nu, n) from start to end, with the
    integral of the running cost. The magnitude is the sum of all terms by absolute value, and of
    what they change by when every state changes by its own: a cost that the best motion takes to
    zero is not measured by its rounding. What is further off than an extremal's may be is measured
    by the terms themselves: against what a motion comes from, any claim about what is left of it
    would hold.
    """
    (t, x, u), p = motion, parameters_of(problem, solution)
    ends = solution.initial_time, solution.final_time
    mayer = mayer_function(problem)

    def last(states: np.ndarray) -> np.ndarray:
        return numbers(mayer, states, x[:, 0], p, *ends)[0].ravel()

    value = running + float(last(x[:, -1])[0])

    def whole(terms: np.ndarray, end: np.ndarray) -> float:
        return float(np.sum(0.5 * (terms[1:] + terms[:-1]) * np.diff(t)) + end[0])

    terms = magnitude_along(problem, motion, p, scale)
    size = whole(terms, magnitude(last, x[:, -1], scale))
    off = abs(solution.objective - value)
    if off != off:  # noqa: PLR0124
        return value, np.inf  # nan is far from everything
    if not off <= EXTREMAL * size:
        terms = np.abs(running_costs(problem, x, u, t, p))
        # what is just beyond that is feasible at least, whatever is left of the terms
        size = max(whole(terms, np.abs(last(x[:, -1]))), EXTREMAL / FEASIBLE * size)
    return value, off / max(size, TINY)


def verify(problem: Problem, solution: Solution, rtol: float = RTOL) -> tuple[Feasibility, ...]:
    """Integrate the control as a function of time and, where every arc has a law of the state, as
    feedback too, with steps of a relative tolerance.

    A problem keeps what was found for the last solutions, by their values: the same motion is asked
    for more than once on the way to a certified word. Where the time allowed ends first, nothing is
    known, and it may be asked again.
    """
    try:
        first = _in_time(problem, solution, rtol)[0]
        make = partial(_as_feedback, problem, solution, rtol)
        return first, *lately(problem, verify, (rtol, *_key(solution)), make, _KEPT)
    except LateError as error:
        return (_unknown(str(error)),)


def verify_finely(problem: Problem, solution: Solution) -> tuple[Feasibility, ...]:
    """Return what is found of a verified solution with steps as exact as they may be, where it is
    off by so little that this can tell; what was found where it is not.

    A motion that runs away from its neighbours enlarges what steps leave, at the same rate for all
    tolerances: what shrinks with these is off by the steps, not by the solution.
    """
    known = solution.verified
    if not EXTREMAL < _worst(known) <= EXTREMAL * RTOL / FINE:
        return known
    found = verify(problem, solution, FINE)
    return found if _worst(found) < _worst(known) else known


def _worst(found: tuple[Feasibility, ...]) -> float:
    return max((max(each.off, each.drift) for each in found), default=math.inf)


def verify_in_time(problem: Problem, solution: Solution) -> Feasibility:
    """Return what `verify` does of the control as a function of time alone."""
    try:
        return _in_time(problem, solution)[0]
    except LateError as error:
        return _unknown(str(error))


def _unknown(error: str) -> Feasibility:
    """Return what is known of a control that was not integrated: nothing."""
    off = math.inf
    return Feasibility(
        miss=off,
        miss_at="",
        path=off,
        path_at="",
        box=off,
        drift=off,
        feedback=False,
        error=error,
    )


def _key(solution: Solution) -> tuple[Any, ...]:
    """Return all values of a solution that its motions depend on."""
    arcs = (
        (arc.modes, arc.side, *(each.tobytes() for each in (arc.t, arc.x, arc.u, arc.mesh)))
        for arc in solution.arcs
    )
    return solution.objective, *solution.parameters.items(), *arcs


def _in_time(
    problem: Problem, solution: Solution, rtol: float = RTOL
) -> tuple[Feasibility, np.ndarray]:
    """Return what is found of the control in time, and its states (nx, n) at the nodes, as far as
    it leads.
    """

    def integrated() -> tuple[Feasibility, np.ndarray]:
        log, pieces = Log(), [pieces_in_time(arc) for arc in solution.arcs]
        found = _verify(problem, solution, pieces, log, rtol, feedback=False)
        return found, np.hstack(log.nodes) if log.nodes else np.empty((0, 0))

    return lately(problem, _in_time, (rtol, *_key(solution)), integrated, _KEPT)


def _as_feedback(problem: Problem, solution: Solution, rtol: float) -> tuple[Feasibility, ...]:
    """Return what is found of the laws as feedback, nothing where an arc has none."""
    if not solution.lawful:
        return ()
    try:
        pieces = [[piece_of_law(problem, arc)] for arc in solution.arcs]
    except MethodError:
        # the word was read off a solution of a problem without such laws
        return ()
    return (_verify(problem, solution, pieces, Log(), rtol, feedback=True),)


def moved(problem: Problem, solution: Solution) -> Solution:
    """Return a solution with the states and the objective that its control reaches by
    re-integration in place of those that were claimed; as it is where that breaks down. Raises
    LateError where the time allowed is over first.
    """
    seen, x = _in_time(problem, solution)
    ends = np.cumsum([arc.t.size for arc in solution.arcs])
    if seen.error or x.shape[1] != ends[-1] or not np.isfinite(seen.objective):
        return solution
    states = np.split(x, ends[:-1], axis=1)
    arcs = tuple(replace(arc, x=own) for arc, own in zip(solution.arcs, states, strict=True))
    found = replace(solution, arcs=arcs, objective=seen.objective)
    return found.with_judgement(verified=(), verdict=None)


def _verify(
    problem: Problem,
    solution: Solution,
    pieces: list[list[Piece]],
    log: Log,
    rtol: float,
    *,
    feedback: bool,
) -> Feasibility:
    with np.errstate(all="ignore"):  # what overflows on the way ends as an error of the integration
        ended = travel(problem, solution, pieces, log, rtol)
        return measured(problem, solution, log, ended, feedback=feedback)


def measured(
    problem: Problem,
    solution: Solution,
    log: Log,
    ended: tuple[np.ndarray, str],
    *,
    feedback: bool,
) -> Feasibility:
    """Return how far a motion misses its problem: the points of its log, and where and why it
    ended.
    """
    (y, error), p, motion = ended, parameters_of(problem, solution), log.motion
    scale = sizes(problem, motion[0], motion[1], p)
    objective, gap = objective_of(problem, solution, motion, scale, float(y[-1]))
    miss, miss_at = end_miss(problem, solution, y[:-1], scale)
    path, path_at = path_miss(problem, p, scale, motion)
    box = box_miss(np.hstack([motion[2], *(arc.u for arc in solution.arcs)]), problem.box)
    return Feasibility(
        miss=miss,
        miss_at=miss_at,
        path=path,
        path_at=path_at,
        box=box,
        drift=float(np.max(log.off / scale)),
        feedback=feedback,
        end=tuple(y[:-1].tolist()),
        error=error,
        objective=math.nan if error else objective,
        gap=gap,
    )

"""How far a motion misses what a problem asks for: its ends, its state constraints and its box, relative to sizes."""

from collections.abc import Callable, Sequence

import casadi
import numpy as np

from socp.problem import Problem
from socp.solution import Solution
from socp.symbols import column, final_time, initial_time, time


def parameters_of(problem: Problem, solution: Solution) -> np.ndarray:
    """Return the values of the parameters (np,) in the problem's order."""
    return np.array([solution.parameters[name] for name in problem.parameter_names], dtype=float)


def box_miss(u: np.ndarray, box: np.ndarray) -> float:
    """Return the worst excess of controls (nu, n) over their box, relative to its width."""
    low, high = box[0][:, None], box[1][:, None]
    return float(np.max(np.maximum(low - u, u - high) / (high - low), initial=0.0))


def end_miss(problem: Problem, solution: Solution, x: np.ndarray, scale: np.ndarray) -> tuple[float, str]:
    """Return the worst relative violation of the end conditions by the end state x (nx,), and which condition it is."""
    low, high = problem.end_box
    excess = np.maximum(np.maximum(low - x, x - high), 0.0) / scale
    found = dict(zip(problem.state_names, excess.tolist(), strict=True))
    symbols = casadi.vertcat(problem.x, problem.x0, problem.p, initial_time, final_time)
    times = [solution.initial_time, solution.final_time]
    values = np.concatenate([x, solution.arcs[0].x[:, 0], parameters_of(problem, solution), times])
    sizes = np.concatenate([scale, scale, np.abs(values[2 * x.size :])])
    for condition in problem.conditions:
        psi = condition.expression
        function = casadi.Function("psi", [symbols], [psi, casadi.jacobian(psi, symbols)])
        value, slope = (each.full().ravel() for each in function(values))
        violation = abs(value[0]) if condition.equation else max(value[0], 0.0)
        found[condition.name] = float(violation / (np.abs(slope) @ sizes or 1.0))
    for name, at, (first, last) in (
        ("initial time", solution.initial_time, problem.initial_time_box),
        ("final time", solution.final_time, problem.final_time_box),
    ):
        found[name] = max(first - at, at - last, 0.0) / max(solution.final_time - solution.initial_time, 1e-300)
    worst = max(found, key=lambda name: np.inf if np.isnan(found[name]) else found[name])
    return found[worst], worst


def path_miss(
    problem: Problem, p: np.ndarray, scale: np.ndarray, t: Sequence[float], x: Sequence[np.ndarray]
) -> tuple[float, str]:
    """Return the worst relative violation of the state constraints at the points looked at, and which it is."""
    if not problem.constraints:
        return 0.0, ""
    stack = column(c.expression for c in problem.constraints)
    slopes = casadi.mtimes(casadi.fabs(casadi.jacobian(stack, problem.x)), scale)
    function = casadi.Function("c", [problem.x, time, problem.p], [stack, slopes])
    given = np.array(x).T, np.array(t)[None, :], np.repeat(p[:, None], len(t), axis=1)
    values, sizes = (each.full() for each in function.map(len(t))(*given))
    # a constraint's magnitude is how much it changes when every state changes by its own, at worst along the way
    relative = values.max(axis=1) / np.where((largest := sizes.max(axis=1)) > 0, largest, 1.0)
    worst = int(np.argmax(relative))
    return max(float(relative[worst]), 0.0), problem.constraints[worst].name


def objective_of(
    problem: Problem, solution: Solution, motion: tuple[np.ndarray, np.ndarray, np.ndarray], scale: np.ndarray,
    running: float,
) -> tuple[float, float]:  # fmt: skip
    """Return the objective of a motion, and how far the returned one is from it, relative to its magnitude.

    The motion is times (n,), states (nx, n) and controls (nu, n) from start to end, with the integral of the running
    cost. The magnitude is the sum of all terms by absolute value, and of what they change by when every state changes
    by its own: a cost that the best motion takes to zero is not measured by its rounding.
    """
    (t, x, u), p = motion, parameters_of(problem, solution)
    ends = solution.initial_time, solution.final_time
    mayer = casadi.Function("mayer", [problem.x, problem.x0, problem.p, initial_time, final_time], [problem.mayer])
    cost = casadi.Function("cost", [problem.x, problem.u, time, problem.p], [problem.lagrangian])

    def last(states: np.ndarray) -> np.ndarray:
        return np.array(mayer(states, x[:, 0], p, *ends).full().ravel())

    def along(states: np.ndarray) -> np.ndarray:
        return np.array(cost.map(t.size)(states, u, t[None, :], np.repeat(p[:, None], t.size, axis=1)).full().ravel())

    value = running + float(last(x[:, -1])[0])
    terms = _magnitude(along, x, scale[:, None])
    size = float(np.sum(0.5 * (terms[1:] + terms[:-1]) * np.diff(t)) + _magnitude(last, x[:, -1], scale)[0])
    off = abs(solution.objective - value)
    return value, off / max(size, 1e-300) if off == off else np.inf  # noqa: PLR0124 - nan is far from everything


def running_size(problem: Problem, solution: Solution) -> float:
    """Return the integral of the running cost's absolute value at the returned nodes, 1 where that is none."""
    cost, n = casadi.Function("cost", [problem.x, problem.u, time, problem.p], [problem.lagrangian]), solution.t.size
    given = np.repeat(parameters_of(problem, solution)[:, None], n, axis=1)
    values = cost.map(n)(solution.rows("x"), solution.rows("u"), solution.t[None, :], given).full().ravel()
    found = float(np.nansum(0.5 * np.abs(values[1:] + values[:-1]) * np.diff(solution.t)))
    return found if 0.0 < found < np.inf else 1.0


def _magnitude(function: Callable[[np.ndarray], np.ndarray], x: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return a function's absolute value and, added, the least change when the states go up or down by their own.

    The lesser of the two: towards a pole, or where it grows exponentially, a function may change by any amount.
    """
    here = function(x)
    change = np.fmin(np.abs(function(x + scale) - here), np.abs(function(x - scale) - here))
    return np.array(np.abs(here) + np.where(np.isfinite(change), change, 0.0))

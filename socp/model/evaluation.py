"""A problem along a solution: its functions, each built once, the values they take, and sizes."""

from collections.abc import Callable
from functools import partial
from typing import Any

import casadi
import numpy as np

from socp.model.calling import evaluate, numbers
from socp.model.keeping import lately, of_motion, once
from socp.model.parts import Constraint, EndCondition
from socp.model.problem import Problem
from socp.model.result.solution import Solution
from socp.model.symbols import Expr, final_time, identity, initial_time, time
from socp.model.tolerances import ROUNDED

_EXPRESSIONS = 16  # of a problem whose functions are kept: what is looked at along its arcs

# -- functions


def end_symbols(problem: Problem) -> list[Expr]:
    """Return what end conditions and the Mayer term depend on: x(tf), x(t0), p, t0, tf."""
    return [problem.x, problem.x0, problem.p, initial_time, final_time]


def end_values(problem: Problem, solution: Solution) -> list[Any]:
    """Return the values that a solution gives to the symbols of the ends, in their order."""
    first, last = solution.arcs[0].x[:, 0], solution.arcs[-1].x[:, -1]
    times = solution.initial_time, solution.final_time
    return [last, first, parameters_of(problem, solution), *times]


@of_motion
@once
def mayer_function(problem: Problem) -> casadi.Function:
    """Return the Mayer term as a function of the symbols of the ends."""
    return casadi.Function("mayer", end_symbols(problem), [problem.mayer])


@of_motion
@once
def mayer_slopes(problem: Problem) -> casadi.Function:
    """Return the slopes of the Mayer term, one a symbol of the ends, as a function of these."""
    return _slopes(problem, problem.mayer)


@of_motion
@once
def condition_function(problem: Problem, condition: EndCondition) -> casadi.Function:
    """Return an end condition as a function of the symbols of the ends."""
    return casadi.Function("psi", end_symbols(problem), [condition.expression])


@of_motion
@once
def condition_slopes(problem: Problem, condition: EndCondition) -> casadi.Function:
    """Return the slopes of an end condition, one a symbol of the ends, as a function of these."""
    return _slopes(problem, condition.expression)


def _slopes(problem: Problem, expression: Expr) -> casadi.Function:
    symbols = end_symbols(problem)
    slopes = [casadi.densify(casadi.jacobian(expression, each)) for each in symbols]
    return casadi.Function("slopes", symbols, slopes)


@of_motion
@once
def rate_function(problem: Problem) -> casadi.Function:
    """Return the rate as a function of x, u, t, p."""
    return casadi.Function("rate", [problem.x, problem.u, time, problem.p], [problem.rate])


@of_motion
@once
def switching_function(problem: Problem) -> casadi.Function:
    """Return the switching functions (nu, 1) as a function of x, costate, t, p."""
    given = [problem.x, problem.costate, time, problem.p]
    return casadi.Function("sigma", given, [casadi.densify(problem.switching)])


def running_costs(
    problem: Problem, x: np.ndarray, u: np.ndarray, t: np.ndarray, p: np.ndarray
) -> np.ndarray:
    """Return the running cost (n,) at states (nx, n), controls (nu, n), times (n,) and parameters,
    (np,) or (np, n). Where it is a number, as where there is none, nothing is evaluated.
    """
    if problem.lagrangian.is_constant():
        return np.full(t.size, float(problem.lagrangian))
    return evaluate(running_function(problem), x, u, t, p)[0].ravel()


@of_motion
@once
def running_function(problem: Problem) -> casadi.Function:
    """Return the running cost as a function of x, u, t, p."""
    return casadi.Function("running", [problem.x, problem.u, time, problem.p], [problem.lagrangian])


@of_motion
@once
def constraint_function(problem: Problem, constraint: Constraint) -> casadi.Function:
    """Return a state constraint as a function of x, t, p."""
    return casadi.Function("c", [problem.x, time, problem.p], [constraint.expression])


@of_motion
def function_of(problem: Problem, given: list[Expr], expression: Expr) -> casadi.Function:
    """Return an expression as a function of given symbols, built once for as long as it is among
    those that were asked for last.
    """
    key = len(given), *identity(expression)  # which stays with its function

    def make() -> tuple[Expr, casadi.Function]:
        return expression, casadi.Function("e", given, [casadi.densify(expression)])

    return lately(problem, function_of, key, make, _EXPRESSIONS)[1]


# -- values and sizes


def parameters_of(problem: Problem, solution: Solution) -> np.ndarray:
    """Return the values of the parameters (np,) in the problem's order."""
    return np.array([solution.parameters[name] for name in problem.parameter_names], dtype=float)


def scales(problem: Problem, solution: Solution) -> np.ndarray:
    """Return the magnitude of every state (nx,): the largest of its bounds, its ends and its size
    on the solution.

    It serves to scale; what a solution claims is not measured by it, since a claimed state may be
    of any size.
    """
    return _scales(solution, problem)


@once
def _scales(solution: Solution, problem: Problem) -> np.ndarray:
    return sizes(problem, solution.t, solution.rows("x"), parameters_of(problem, solution))


def sizes(problem: Problem, t: np.ndarray, x: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Return the magnitude of every state (nx,): the largest of its bounds, its ends and its size
    on states (nx, n) at times t (n,), under parameters p (np,).

    One that stays at zero, but for rounding, has the size of how far the box of the controls could
    take it, at the rate where it begins.
    """
    magnitude = shown_sizes(problem, x)
    rates = numbers(rate_function(problem), x[:, 0], problem.box.T, t[0], p)[0]
    reach = np.nan_to_num(np.abs(rates).max(axis=1) * (t[-1] - t[0]), posinf=0.0)
    here = (magnitude > 0) & (magnitude > ROUNDED * reach)
    return np.where(here, magnitude, np.where(reach > 0, reach, 1.0))


def shown_sizes(problem: Problem, x: np.ndarray) -> np.ndarray:
    """Return the magnitude of every state (nx,): the largest of its bounds, its ends and its size
    on states (nx, n); 0 where all are.
    """
    given = np.vstack([problem.state_box, problem.start_box, problem.end_box])
    given = np.where(np.isfinite(given), np.abs(given), 0.0).max(axis=0)
    magnitude: np.ndarray = np.maximum(given, np.nanmax(np.abs(x), axis=1, initial=0.0))
    return magnitude


def objective_size(problem: Problem, solution: Solution, states: np.ndarray | None = None) -> float:
    """Return a magnitude of the objective near a solution, 1 where it has none, with magnitudes of
    the states (nx,), those of `scales` where none are given.

    It is the horizon times the typical running cost, at the bounds of the controls, and the Mayer
    term, each by its absolute value and by what it changes when all states change by their own
    magnitude, up or down, whichever changes it less: a cost that vanishes on a guess has a
    magnitude all the same, and one near a pole no infinite one.
    """
    scale = (scales(problem, solution) if states is None else states)[:, None]
    x, t, p = solution.rows("x"), solution.t, parameters_of(problem, solution)
    x = np.where(np.isfinite(x), x, 0.0)
    mayer = mayer_function(problem)
    bounds = [np.repeat(u[:, None], t.size, axis=1) for u in problem.box]
    costs = [partial(running_costs, problem, u=u, t=t, p=p) for u in bounds]
    running = [magnitude(cost, x, scale) for cost in costs]
    ends = solution.initial_time, solution.final_time
    last = magnitude(lambda xf: numbers(mayer, xf, x[:, 0], p, *ends)[0].ravel(), x[:, -1:], scale)
    typical = np.nanmedian(np.max(running, axis=0)) if np.isfinite(running).any() else 0.0
    size = float(typical) * (ends[1] - ends[0]) + float(last[0])
    return size if 0.0 < size < np.inf else 1.0


def magnitude(
    function: Callable[[np.ndarray], np.ndarray], x: np.ndarray, scale: np.ndarray
) -> np.ndarray:
    """Return a function's absolute value (n,) at states and, added, the least change when all of
    them go up or down by their own magnitude.

    The lesser of the two: towards a pole, or where it grows exponentially, a function may change by
    any amount.
    """
    with np.errstate(all="ignore"):
        here = function(x)
        change = np.fmin(np.abs(function(x + scale) - here), np.abs(function(x - scale) - here))
        return np.array(np.abs(here) + np.where(np.isfinite(change), change, 0.0))

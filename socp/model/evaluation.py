"""A problem along a solution: its functions, each built once, the values they take, and sizes."""

from collections.abc import Callable
from functools import partial, wraps
from typing import Any, Concatenate, ParamSpec, TypeVar, final

import casadi
import numpy as np

from socp.model.parts import Constraint, EndCondition
from socp.model.problem import Problem
from socp.model.result.solution import Solution
from socp.model.symbols import Expr, final_time, initial_time, time
from socp.model.tolerances import ROUNDED

Owner = TypeVar("Owner")
Given = ParamSpec("Given")
Found = TypeVar("Found")
Work = TypeVar("Work", bound=Callable[..., Any])
# properties of a problem, and functions, that ends, times and bounds of parameters do not change
_OF_MOTION = {
    *("x", "u", "p", "x0", "costate", "state_names", "control_names", "parameter_names"),
    *("rate", "fields", "drift", "lagrangian", "mayer", "hamiltonian", "switching"),
    *("box", "state_box", "constraints", "conditions"),
}


def once(
    function: Callable[Concatenate[Owner, Given], Found],
) -> Callable[Concatenate[Owner, Given], Found]:
    """Decorate a function to be worked out once for each owner, its first argument, and others.

    What it returns stands beside the owner's cached properties: it goes when the owner goes, and
    neither a copy nor a pickle of a problem takes it along. An error is not kept.
    """
    place = _place(function)

    @wraps(function)
    def kept(owner: Owner, /, *args: Given.args, **kwargs: Given.kwargs) -> Found:
        known: dict[tuple[Any, ...], Found] = vars(owner).setdefault(place, {})
        key = (*args, *kwargs.items())
        if key not in known:
            known[key] = function(owner, *args, **kwargs)
        return known[key]

    return kept


def of_motion(function: Work) -> Work:
    """Decorate a function whose results for a problem, worked out `once` or `cached`, hold for any
    other of the same motion: of the same dynamics, costs, bounds, constraints and conditions.
    """
    _OF_MOTION.add(_place(function))
    return function


def hand_on(known: Problem, other: Problem) -> None:
    """Let a problem have all that was worked out for one of the same motion, whose dynamics, costs,
    bounds, constraints and conditions are the same. What either works out later, both have.

    It saves what a problem costs before anything is solved: laws, brackets and compiled functions.
    """
    for name in _OF_MOTION:
        if "." in name:  # of a function, to whose results either may add from now on
            vars(other)[name] = vars(known).setdefault(name, {})
        else:  # the same symbols, of costates among them, in what is added later
            vars(other)[name] = getattr(known, name)


def _place(function: Callable[..., Any]) -> str:
    """Return the name under which a function's results stand beside an owner's properties."""
    return f"{function.__module__}.{function.__qualname__}"


def cached(owner: object, function: Callable[..., Found]) -> dict[tuple[Any, ...], Found]:
    """Return what a function worked out `once` for an owner, by the arguments after the owner."""
    known: dict[tuple[Any, ...], Found] = vars(owner).setdefault(_place(function), {})
    return known


def lately(
    owner: object,
    function: Callable[..., Any],
    key: tuple[Any, ...],
    make: Callable[[], Found],
    most: int = 1,
) -> Found:
    """Return what is made for a key, kept in the place of a function for as many keys as were asked
    for last.
    """
    known: dict[tuple[Any, ...], Found] = vars(owner).setdefault(_place(function), {})
    found = known.pop(key) if key in known else make()
    while len(known) >= most:
        del known[next(iter(known))]
    known[key] = found
    return found


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
    # the expression stays with its function: it is told by its entries' places in memory
    key = len(given), *expression.shape, *(each.element_hash() for each in expression.elements())

    def make() -> tuple[Expr, casadi.Function]:
        return expression, casadi.Function("e", given, [casadi.densify(expression)])

    return lately(problem, function_of, key, make, _EXPRESSIONS)[1]


def evaluate(function: casadi.Function, *given: np.ndarray) -> list[np.ndarray]:
    """Evaluate a function of columns (rows, n), times and parameters at n points.

    The last two of what is given are times (n,) and parameters, (np,) where they are the same
    everywhere. A result of k columns has k n of them, a point's next to one another.
    """
    *columns, t, p = given
    return numbers(function, *columns, t[None, :], p if p.ndim == 2 else p[:, None])


def numbers(function: casadi.Function, *given: np.ndarray | float) -> list[np.ndarray]:
    """Return the results (r, c n) of a casadi function at n points, one beside the other.

    What is given is (rows, k n) where the function asks for (rows, k), the same everywhere where it
    is (rows, k), as (rows,) and numbers are. Both sides work on the same memory: what casadi's own
    conversions of arrays cost is several evaluations' worth. ValueError refuses other sizes.
    """
    asked, told = _ports(function)
    columns, counts = [], {1}
    for each, (size, _, entries) in zip(given, asked, strict=True):
        if size:
            value = np.asarray(each, dtype=float)
            whole = value.ndim == 2 and len(value) == size
            if not whole and value.size % size:
                raise _sized(function, given)
            value = value.T if whole else value.ravel("F").reshape(-1, size)
            columns.append(value if entries is None else value[:, entries])
            counts.add(len(value))
    count = 0 if 0 in counts else max(counts)
    if not counts <= {0, 1, count}:
        raise _sized(function, given)
    if not count:  # casadi maps over one column at least
        return [np.empty((rows, 0)) for rows, *_ in told]
    desks: dict[tuple[int], _Desk] = vars(function).setdefault(_DESK, {})
    desk = desks.pop((count,), None) or _Desk(function, count)  # nobody else works on it meanwhile
    for own, column in zip(desk.asked, columns, strict=True):
        own[:] = column
    desk.trigger()
    found = []
    for (rows, width, _, entries), at in zip(told, desk.found, strict=True):
        if entries is None:
            filled = at.copy()
        else:
            filled = np.zeros((count, rows * width))
            filled[:, entries] = at
        found.append((filled if width == 1 else filled.reshape(count * width, rows)).T)
    while len(desks) >= _DESKS:
        del desks[next(iter(desks))]
    desks[(count,)] = desk
    return found


def _sized(function: casadi.Function, given: tuple[np.ndarray | float, ...]) -> ValueError:
    return ValueError(f"{function}: given {', '.join(str(np.shape(each)) for each in given)}")


_EXPRESSIONS = 16  # of a problem whose functions are kept: what is looked at along its arcs
_DESK = "desk"  # where they stand beside what a function has of its own
_DESKS = 8  # of a function, for as many counts of points: solves in turns keep to a few


@final
class _Desk:
    """The memory on which a function works at so many points: what is given and what is found,
    (count, entries) each; `asked` is what is given where it has a size.
    """

    def __init__(self, function: casadi.Function, count: int) -> None:
        asked, told = _ports(function)
        self.function = function.map(count) if count > 1 else function
        self.buffer, self.trigger = self.function.buffer()
        self.given = [np.zeros((count, kept)) for _, kept, _ in asked]
        self.found = [np.zeros((count, kept)) for *_, kept, _ in told]
        self.asked = [each for each, (size, *_) in zip(self.given, asked, strict=True) if size]
        for place, arrays in ((self.buffer.set_arg, self.given), (self.buffer.set_res, self.found)):
            for i, each in enumerate(arrays):
                if each.size:
                    place(i, each.reshape(-1).data)


@once
def _ports(
    function: casadi.Function,
) -> tuple[list[tuple[int, int, np.ndarray | None]], list[tuple[int, int, int, np.ndarray | None]]]:
    """Return the size of every argument and the rows and columns of every result, each with how
    many of its entries casadi keeps, and which, None for all of them. To ask casadi costs as much
    as many evaluations.
    """
    asked = [function.sparsity_in(i) for i in range(function.n_in())]
    told = [function.sparsity_out(i) for i in range(function.n_out())]

    def kept(sparsity: casadi.Sparsity, size: int) -> tuple[int, np.ndarray | None]:
        count = sparsity.nnz()
        return count, None if count == size else np.array(sparsity.find(), dtype=int)

    given = [(each, each.numel()) for each in asked]
    found = [(each, each.size1(), each.size2()) for each in told]
    return (
        [(size, *kept(each, size)) for each, size in given],
        [(rows, width, *kept(each, rows * width)) for each, rows, width in found],
    )


def fast(function: casadi.Function) -> Callable[..., np.ndarray]:
    """Return a function of numpy arrays for a casadi function of one dense output column, quick to
    call at one point after another.
    """
    desk = _Desk(function, 1)
    places = [(i, each[0]) for i, each in enumerate(desk.given) if each.size]
    trigger, found = desk.trigger, desk.found[0][0]

    def call(*arguments: np.ndarray | float) -> np.ndarray:
        for i, place in places:
            place[:] = arguments[i]
        trigger()
        return np.array(found)

    call.__dict__["keep"] = desk  # the buffer must outlive the call
    return call


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
    cost, mayer = running_function(problem), mayer_function(problem)
    running = [magnitude(partial(_running, cost, u[:, None], t, p), x, scale) for u in problem.box]
    ends = solution.initial_time, solution.final_time
    last = magnitude(lambda xf: numbers(mayer, xf, x[:, 0], p, *ends)[0].ravel(), x[:, -1:], scale)
    typical = np.nanmedian(np.max(running, axis=0)) if np.isfinite(running).any() else 0.0
    size = float(typical) * (ends[1] - ends[0]) + float(last[0])
    return size if 0.0 < size < np.inf else 1.0


def _running(
    cost: casadi.Function, u: np.ndarray, t: np.ndarray, p: np.ndarray, x: np.ndarray
) -> np.ndarray:
    return evaluate(cost, x, np.repeat(u, t.size, axis=1), t, p)[0].ravel()


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

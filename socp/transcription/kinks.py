"""Kinks: where |x|, sign, min, max or a case distinction of the dynamics switches, and which branch
of it holds, where that is known.
"""

from collections.abc import Callable

import casadi
import numpy as np

from socp.model import (
    Expr,
    Problem,
    Solution,
    column,
    evaluate,
    fold,
    nodes,
    numbers,
    of_motion,
    once,
    parameters_of,
    time,
)

# Random points at which expressions are compared: in more dimensions chance makes none parallel
_DRAWS = 6
_ALIKE = (
    1e-14  # by which two rows of values, of length 1, differ where they are parallel up to rounding
)

BINARY = {casadi.OP_FMIN, casadi.OP_FMAX, casadi.OP_LT, casadi.OP_LE}
UNARY = {casadi.OP_FABS, casadi.OP_SIGN}


def kinks(expression: Expr, given: Expr) -> Expr:
    """Return the expressions (k, 1) of symbols `given` at whose zeros an expression (m, n) is not
    smooth.

    Constants are left out, and so is what is a multiple of another, such as -a beside a: it
    vanishes where that does.
    """
    distinct: list[Expr] = []
    for each in _turns(expression, given):
        if not each.is_constant() and not any(
            casadi.is_equal(each, other, 50) for other in distinct
        ):
            distinct.append(each)
    return column(_apart(distinct, given))


def _turns(expression: Expr, given: Expr) -> list[Expr]:
    """Return what vanishes where parts of an expression are not smooth, as often as it has them."""
    if _operations(expression, given).isdisjoint(BINARY | UNARY):
        return []
    found = (kink(node.op(), *map(node.dep, range(node.n_dep()))) for node in nodes(expression))
    return [each for each in found if each is not None]


def _operations(expression: Expr, given: Expr) -> set[int]:
    """Return the codes of an expression's operations, which cost less to look at than its parts."""
    traced = casadi.Function("traced", [given], [expression])
    return {traced.instruction_id(k) for k in range(traced.n_instructions())}


def _apart(expressions: list[Expr], given: Expr) -> list[Expr]:
    """Return expressions without those that are multiples of one before them, as their values at
    random points tell.
    """
    at = np.random.default_rng(0).uniform(0.5, 1.5, (given.numel(), _DRAWS))
    (rows,) = numbers(casadi.Function("rows", [given], [column(expressions)]), at)
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    unit = rows / np.where(size > 0, size, 1.0)
    kept: list[int] = []
    for k in range(len(expressions)):  # where values are not finite nothing is alike
        if not any(
            min(np.abs(unit[k] - unit[j]).max(), np.abs(unit[k] + unit[j]).max()) <= _ALIKE
            for j in kept
        ):
            kept.append(k)
    return [expressions[k] for k in kept]


def smooth(problem: Problem, solution: Solution) -> bool:
    """Tell whether dynamics and running cost have no kink anywhere where a solution goes."""
    function = _kinks(problem)
    if not function.numel_out():
        return True
    p = parameters_of(problem, solution)
    values = evaluate(function, solution.rows("x"), solution.rows("u"), solution.t, p)[0]
    return bool((values.min(axis=1) * values.max(axis=1) > 0.0).all())


@of_motion
@once
def linear_tables(problem: Problem) -> bool:
    """Tell whether dynamics or running cost look into a table between whose entries lines are
    drawn: it has a kink at every one.
    """
    expression = casadi.vertcat(problem.rate, problem.lagrangian)
    given = casadi.vertcat(problem.x, problem.u, time, problem.p)
    if casadi.OP_CALL not in _operations(expression, given):
        return False
    called = (node.which_function() for node in nodes(expression) if node.is_call())
    return any(
        each.class_name() == "LinearInterpolant"
        for function in called
        for each in (function, *function.find_functions())
    )


@of_motion
@once
def _kinks(problem: Problem) -> casadi.Function:
    """Return what vanishes at kinks of the dynamics or the running cost as a function of x, u, t,
    p.
    """
    given = [problem.x, problem.u, time, problem.p]
    found = kinks(casadi.vertcat(problem.rate, problem.lagrangian), casadi.vertcat(*given))
    return casadi.Function("kinks", given, [casadi.densify(found)])


# -- branches


def _build(operation: int, *arguments: Expr) -> Expr:
    """Return what an operation, by casadi's number of it, makes of expressions; nan, of which
    nothing is known, of the value of a table: it calls a function that is not told.
    """
    if operation == casadi.OP_CALL:
        return casadi.SX.nan()
    return (casadi.SX.binary if len(arguments) == 2 else casadi.SX.unary)(operation, *arguments)


def kink(operation: int, *arguments: Expr) -> Expr | None:
    """Return what vanishes where an operation is not smooth in its arguments; None where it is
    smooth.

    |a| and sign a give a; min(a, b), max(a, b) and comparisons of a and b give a - b.
    """
    if operation in BINARY:
        return arguments[0] - arguments[1]
    return arguments[0] if operation in UNARY else None


def decided(expression: Expr, at: float) -> Expr:
    """Return an expression (m, n) with every branch that depends on time alone taken as it is at a
    time; one that looks into a table as it is.
    """
    given = casadi.vertcat(*casadi.symvar(expression))
    called: list[int] = []

    def built(operation: int, *arguments: Expr) -> Expr:
        called.extend({operation} & {casadi.OP_CALL})
        turns = kink(operation, *arguments)
        if turns is None or not _of_time(turns):
            return _build(operation, *arguments)
        value = float(casadi.evalf(casadi.substitute(turns, time, at)))
        first = arguments[0]
        if operation in {casadi.OP_FMIN, casadi.OP_FMAX}:
            return arguments[int((value > 0.0) == (operation == casadi.OP_FMIN))]
        if operation in {casadi.OP_LT, casadi.OP_LE}:
            return casadi.SX(float(value < 0.0))
        sign = 1.0 if value > 0.0 else -1.0
        return sign * first if operation == casadi.OP_FABS else casadi.SX(sign)

    parts = fold(casadi.vec(expression), given, given.__getitem__, casadi.SX, built)
    if called:
        return expression
    column = casadi.vertcat(*(casadi.SX(0) if each is None else each for each in parts))
    return casadi.reshape(column, *expression.shape)


def _of_time(expression: Expr) -> bool:
    """Tell whether an expression has time for its only symbol."""
    names = casadi.symvar(expression)
    return len(names) == 1 and bool(casadi.is_equal(names[0], time))


_PLACES, _LOOKS = 33, 11  # 32 parts, 5 bits, each time: all 53 of what is between two times


def crossing(values: Callable[[np.ndarray], np.ndarray], first: float, last: float) -> float:
    """Return the time between two at which values (n,) of times (n,) change from the sign that they
    have at the first.

    Many places are looked at in one call, and again within the two that show it: no more calls than
    a method of higher order takes, and scipy's take as long to import as a word to solve.
    """
    for _ in range(_LOOKS):
        t = np.linspace(first, last, _PLACES)
        signs = np.sign(values(t))
        k = int(np.argmax(signs != signs[0])) or _PLACES - 1  # rounding may hide it
        if signs[k] == 0.0:
            return float(t[k])
        first, last = float(t[k - 1]), float(t[k])
    return 0.5 * (first + last)

"""Branches of expressions with a kink or a jump: which one holds is decided where it is known."""

import casadi

from socp.model import Expr, fold, time

BINARY = {casadi.OP_FMIN, casadi.OP_FMAX, casadi.OP_LT, casadi.OP_LE}
UNARY = {casadi.OP_FABS, casadi.OP_SIGN}


def build(operation: int, *arguments: Expr) -> Expr:
    """Return what an operation, by casadi's number of it, makes of expressions."""
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
    time.
    """
    given = casadi.vertcat(*casadi.symvar(expression))

    def built(operation: int, *arguments: Expr) -> Expr:
        turns = kink(operation, *arguments)
        if turns is None or not _of_time(turns):
            return build(operation, *arguments)
        value = float(casadi.evalf(casadi.substitute(turns, time, at)))
        first = arguments[0]
        if operation in {casadi.OP_FMIN, casadi.OP_FMAX}:
            return arguments[int((value > 0.0) == (operation == casadi.OP_FMIN))]
        if operation in {casadi.OP_LT, casadi.OP_LE}:
            return casadi.SX(float(value < 0.0))
        sign = 1.0 if value > 0.0 else -1.0
        return sign * first if operation == casadi.OP_FABS else casadi.SX(sign)

    parts = fold(casadi.vec(expression), given, given.__getitem__, casadi.SX, built)
    column = casadi.vertcat(*(casadi.SX(0) if each is None else each for each in parts))
    return casadi.reshape(column, *expression.shape)


def _of_time(expression: Expr) -> bool:
    """Tell whether an expression has time for its only symbol."""
    names = casadi.symvar(expression)
    return len(names) == 1 and bool(casadi.is_equal(names[0], time))

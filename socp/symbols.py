"""The words of the problem language: states, controls, parameters, times, and relations between expressions."""

import math
from functools import cache
from typing import Any, Literal

import casadi

from socp.errors import ProblemError

Expr = Any  # a casadi.SX expression, or a number where one will do; casadi carries no types
Role = Literal["state", "control", "parameter"]

_ROLES: dict[Expr, Role] = {}  # keeps every declared symbol alive, so that no other can take its hash

time: Expr = casadi.SX.sym("t")
initial_time: Expr = casadi.SX.sym("t0")
final_time: Expr = casadi.SX.sym("tf")
free: tuple[float, float] = (-math.inf, math.inf)


def states(names: str) -> Any:
    """Declare states by name, `x, y = states("x y")`; one name gives one symbol."""
    return _declare(names, "state")


def controls(names: str) -> Any:
    """Declare controls by name; their order is the order of the rows of a word."""
    return _declare(names, "control")


def parameters(names: str) -> Any:
    """Declare static parameters: constants of the motion that the solver chooses."""
    return _declare(names, "parameter")


@cache
def initial(state: Expr) -> Expr:
    """Return the value of a state at the initial time, for use in end conditions and the Mayer term."""
    if _ROLES.get(state) != "state":
        raise ProblemError(f"initial({state}): only a declared state has an initial value")
    return casadi.SX.sym(f"{state.name()}(t0)")


def role(symbol: Expr) -> Role | None:
    """Return what a symbol was declared as, None if it was not declared here."""
    return _ROLES.get(symbol) if isinstance(symbol, casadi.SX) and symbol.is_symbolic() else None


def declared(kind: Role) -> list[Expr]:
    """Return all symbols of one role in the order of their declaration."""
    return [symbol for symbol, its in _ROLES.items() if its == kind]


def column(expressions: Any) -> Expr:
    """Stack expressions or numbers into a column; an empty list gives a column of no rows."""
    return casadi.vertcat(casadi.SX(0, 1), *(casadi.SX(e) for e in expressions))


def relation(expression: Expr, where: str) -> tuple[Expr, bool]:
    """Split `a <= b` or `a == b` into (a - b, is it an equation).

    Raises ProblemError, starting with `where`, for anything else; a strict < is read as <=.
    """
    if not isinstance(expression, casadi.SX):
        raise ProblemError(f"{where}: {expression!r} holds or fails whatever the states are; write a relation of states")
    operation = expression.op() if expression.is_scalar() and not expression.is_constant() else None
    if operation in {casadi.OP_LE, casadi.OP_LT, casadi.OP_EQ}:
        return expression.dep(0) - expression.dep(1), operation == casadi.OP_EQ
    if expression.is_constant():
        raise ProblemError(f"{where}: the relation is always {'true' if bool(expression) else 'false'}")
    raise ProblemError(f"{where}: {expression} is no relation; write left <= right or left == right")


def _declare(names: str, kind: Role) -> Any:
    words = names.replace(",", " ").split()
    if not words:
        raise ProblemError(f"{kind}s({names!r}): name at least one {kind}")
    repeated = sorted({word for word in words if words.count(word) > 1})
    if repeated:
        raise ProblemError(f"{kind}s({names!r}): '{repeated[0]}' is declared twice")
    symbols = tuple(casadi.SX.sym(word) for word in words)
    _ROLES.update(dict.fromkeys(symbols, kind))
    return symbols if len(symbols) > 1 else symbols[0]

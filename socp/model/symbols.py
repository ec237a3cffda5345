"""The words of the problem language: states, controls, parameters, times, and relations between
expressions.
"""

import math
import sys
from collections.abc import Sequence
from functools import cache
from typing import Any, Literal

import casadi
import numpy as np

from socp.errors import ProblemError
from socp.process import plainly, shown

Expr = Any  # a casadi.SX expression, or a number where one will do; casadi carries no types
Role = Literal["state", "control", "parameter", "constant"]

_LONGEST = 100  # characters of a name: more fit into no table or figure
_RELATIONS = (casadi.OP_LE, casadi.OP_LT, casadi.OP_EQ)
_TIMES = {"t": "time", "t0": "initial_time", "tf": "final_time"}
# every declared symbol by its hash, which no other can take while it is kept alive: as keys of a
# table casadi would compare them as expressions
_ROLES: dict[int, tuple[Expr, Role]] = {}

# numpy's sin of an expression is an expression, as it has always been; by itself casadi warns of it
casadi.GlobalOptions.setNumpyMode(-1)

time: Expr = casadi.SX.sym("t")
initial_time: Expr = casadi.SX.sym("t0")
final_time: Expr = casadi.SX.sym("tf")
free: tuple[float, float] = (-math.inf, math.inf)


def states(names: str) -> Any:
    """Declare states by name, such as `x, y` by "x y"; one name gives one symbol, several a tuple.

    Raises ProblemError for what is no name, a name given twice, and the names of time: t, t0, tf.
    """
    return _declare(names, "state")


def controls(names: str) -> Any:
    """Declare controls by name; their order is the order of the rows of a word.

    Raises ProblemError as `states` does.
    """
    return _declare(names, "control")


def parameters(names: str) -> Any:
    """Declare static parameters: constants of the motion that the solver chooses.

    Raises ProblemError as `states` does.
    """
    return _declare(names, "parameter")


def initial(state: Expr) -> Expr:
    """Return the value of a state at the initial time, for use in end conditions and the Mayer
    term.

    Raises ProblemError for anything but a declared state.
    """
    if role(state) != "state":
        raise ProblemError(f"initial({plainly(state)}): only a declared state has an initial value")
    return _initial(state)


@cache
def _initial(state: Expr) -> Expr:
    return casadi.SX.sym(f"{state.name()}(t0)")


def role(symbol: Expr) -> Role | None:
    """Return what a symbol was declared as, None if it was not declared here."""
    return _ROLES.get(hash(symbol), (None, None))[1] if is_symbol(symbol) else None


def is_symbol(expression: Any) -> bool:
    """Tell whether something is one casadi SX symbol, which can be a key of a table."""
    return (
        isinstance(expression, casadi.SX)
        and bool(expression.is_scalar())
        and bool(expression.is_symbolic())
    )


def symbols_of(kind: Role) -> list[Expr]:
    """Return all symbols of one role in the order of their declaration."""
    return [symbol for symbol, its in _ROLES.values() if its == kind]


def is_number(value: Any) -> bool:
    """Tell whether something is a real number; True and False, which a relation may fold to, are
    none.

    Nor is an integer that no float can hold.
    """
    if isinstance(value, int) and not isinstance(value, bool):
        return abs(value) <= sys.float_info.max
    return isinstance(value, (float, np.integer, np.floating))


def column(expressions: Any) -> Expr:
    """Stack expressions or numbers into a column; an empty list gives a column of no rows."""
    parts = [expression(each) for each in expressions]
    if len(parts) > 1:
        return casadi.vertcat(*parts)
    return parts[0] if parts else casadi.SX(0, 1)


def expression(value: Any) -> Expr:
    """Return an expression as it is, which is quicker than a copy, or that of a number."""
    return value if isinstance(value, casadi.SX) else casadi.SX(value)


def identity(expression: Expr) -> tuple[int, ...]:
    """Return what tells an expression from every other one for as long as it is kept alive: its
    shape, and its entries' places in memory.
    """
    return (*expression.shape, *(each.element_hash() for each in expression.elements()))


def relation(expression: Expr, where: str) -> tuple[Expr, bool]:
    """Split `a <= b` or `a == b` into (a - b, is it an equation).

    Raises ProblemError, starting with `where`, for anything else; a strict < is read as <=.
    """
    scalar = isinstance(expression, casadi.SX) and expression.is_scalar()
    if isinstance(expression, (bool, np.bool_)) or (scalar and expression.is_constant()):
        raise ProblemError(
            f"{where}: the relation is {bool(expression)} whatever the states are; it says nothing"
        )
    if not scalar or expression.op() not in _RELATIONS:
        raise ProblemError(
            f"{where}: {plainly(expression)} is no relation; write left <= right or left == right"
        )
    return expression.dep(0) - expression.dep(1), bool(expression.op() == casadi.OP_EQ)


def is_logical(expression: Expr) -> bool:
    """Tell whether a scalar expression is a truth value, such as a relation, where a quantity may
    be needed.
    """
    return expression.op() in {
        *_RELATIONS,
        casadi.OP_NE,
        casadi.OP_NOT,
        casadi.OP_AND,
        casadi.OP_OR,
    }


def _declare(names: str, kind: Role) -> Any:
    if not isinstance(names, str):
        raise ProblemError(
            f"{kind}s({shown(names)}): give the names in one string, such as {kind}s('a b')"
        )
    words = names.replace(",", " ").split()
    if not words:
        raise ProblemError(f"{kind}s({shown(names)}): name at least one {kind}")
    symbols = declared(words, kind, names)
    return symbols if len(symbols) > 1 else symbols[0]


def declared(words: Sequence[str], kind: Role, names: Any) -> tuple[Expr, ...]:
    """Return new symbols of one role by their names; ProblemError, starting with what was given for
    `names`, refuses what is no name.
    """
    for k, word in enumerate(words):
        if len(word) > _LONGEST:
            raise ProblemError(
                f"{kind}s({shown(names)}): a name of {len(word)} characters; at most {_LONGEST}"
            )
        if not word.isidentifier():
            raise ProblemError(
                f"{kind}s({shown(names)}): '{word}' is no name; use letters, digits and underscores"
            )
        if word in _TIMES:
            raise ProblemError(
                f"{kind}s({shown(names)}): '{word}' is the name of {_TIMES[word]}; choose another"
            )
        if word in words[:k]:
            raise ProblemError(f"{kind}s({shown(names)}): '{word}' is declared twice")
    symbols = tuple(casadi.SX.sym(word) for word in words)
    _ROLES.update((hash(symbol), (symbol, kind)) for symbol in symbols)
    return symbols

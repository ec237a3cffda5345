"""Expressions as data: a numbered list of numbers, symbols and operations, read back by a whitelist
that runs nothing.

An entry of the list is a number, the name of a symbol, or an operation with the places of its
arguments, which stand before it: `["v", 2.0, ["mul", 0, 1]]` is 2 v. What occurs twice stands once,
so that the list is as long as the expression has different parts, however often they are used.
"""

import math
import sys
from collections.abc import Mapping, Sequence
from typing import Any

import casadi

from socp.errors import ProblemError
from socp.model.graph import (
    AREA,
    HYPERBOLIC,
    POWERS,
    TRIGONOMETRIC,
    fold,
    operation_name,
    operation_names,
)
from socp.model.symbols import Expr, column

Node = float | str | list[str | int]

# a table of some thousand points has 1e5 operations; a file that asks for more is not a problem
# that can be solved
MOST = 200_000
# a sum over a table nests as deep as the table is long; beyond this casadi itself, which recurs,
# gives way
DEEPEST = 10_000
# Two settle every expression met so far: casadi folds what has become one, such as f f into f**2
_ROUNDS = 10
_ROUNDED = ("fabs", "sign", "floor", "ceil")
_UNARY = ("neg", "sq", "twice", "inv", *POWERS, *TRIGONOMETRIC, *HYPERBOLIC, *AREA, *_ROUNDED)
_OF_ONE = (*_UNARY, "erf", "erfinv", "log1p", "expm1", "not")
_SIGNS = ("add", "sub", "mul", "div", "pow", "constpow", "lt", "le", "eq", "ne", "and", "or")
_OF_TWO = ("fmod", "remainder", "copysign", "fmin", "fmax", "atan2", "hypot", "if_else_zero")
ARITY: Mapping[str, int] = {**dict.fromkeys(_OF_ONE, 1), **dict.fromkeys((*_SIGNS, *_OF_TWO), 2)}
_NAMES = operation_names(*ARITY)
_CODES = {name: code for code, name in _NAMES.items()}


def written(
    expressions: Sequence[Expr], symbols: Mapping[str, Expr], settled: Sequence[Node] = ()
) -> tuple[list[Node], list[int]]:
    """Return expressions (m) of named symbols as a list of entries and the places of the m
    expressions in it.

    What is read back from it is written as the same list again, which is known of one that is
    `settled`. Raises ProblemError for an operation or a number that has no spelling.
    """
    if not expressions:
        return [], []
    names, given = list(symbols), column(symbols.values())
    found = _listed(expressions, names, given)
    for _ in range(_ROUNDS):
        nodes, places = found
        if nodes == settled:
            break
        whole = read(nodes, symbols)
        again = _listed([whole[place] for place in places], names, given)
        if again == found:
            break
        found = again
    return found


def read(nodes: Sequence[Node], symbols: Mapping[str, Expr]) -> list[Expr]:
    """Return the expression of every entry of a list; ProblemError names the entry that is none."""
    check(nodes, symbols)
    found: list[Expr] = []
    for node in nodes:
        if isinstance(node, str):
            found.append(symbols[node])
        elif isinstance(node, (int, float)):
            found.append(casadi.SX(float(node)))
        else:
            code, arguments = _CODES[str(node[0])], [found[int(place)] for place in node[1:]]
            apply = casadi.SX.unary if len(arguments) == 1 else casadi.SX.binary
            found.append(apply(code, *arguments))
    return found


def check(nodes: Sequence[Node], names: Mapping[str, Any]) -> None:
    """Raise ProblemError, with the place, for an entry that is no number, no known symbol and no
    known operation.
    """
    if len(nodes) > MOST:
        raise ProblemError(f"nodes: {len(nodes)} entries where at most {MOST} are allowed")
    depths: list[int] = []
    for k, node in enumerate(nodes):
        depths.append(_depth(k, node, names, depths))
        if depths[-1] > DEEPEST:
            raise ProblemError(f"nodes[{k}]: operations nested more than {DEEPEST} deep")


def _depth(k: int, node: Any, names: Mapping[str, Any], depths: list[int]) -> int:
    """Return how deep operations are nested in entry k, once it has been found in order."""
    if isinstance(node, str):
        if node not in names:
            raise ProblemError(f"nodes[{k}]: no symbol '{node}'; there are {', '.join(names)}")
        return 0
    if isinstance(node, (int, float)) and not isinstance(node, bool):
        if not abs(node) <= sys.float_info.max:
            raise ProblemError(f"nodes[{k}]: {node} where a finite number is needed")
        return 0
    if not isinstance(node, (list, tuple)) or not node or ARITY.get(str(node[0])) != len(node) - 1:
        raise ProblemError(
            f"nodes[{k}]: {_shown(node)} is no number, no symbol and no operation with its "
            "arguments"
        )
    for place in node[1:]:
        if isinstance(place, bool) or not isinstance(place, int) or not 0 <= place < k:
            raise ProblemError(
                f"nodes[{k}]: argument {_shown(place)} of {node[0]} is no place of an earlier entry"
            )
    return 1 + max(depths[place] for place in node[1:])


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _listed(
    expressions: Sequence[Expr], names: Sequence[str], symbols: Expr
) -> tuple[list[Node], list[int]]:
    """Return the list of expressions of symbols (n, 1) with these names as they are, equal entries
    merged, in the order in which casadi meets them.
    """
    nodes: list[Node] = []
    known: dict[Any, int] = {}

    def place(node: Node) -> int:
        key = (
            node.hex()
            if isinstance(node, float)
            else (node,)
            if isinstance(node, str)
            else tuple(node)
        )
        if key not in known:
            known[key] = len(nodes)
            nodes.append(node)
        return known[key]

    def of_operation(operation: int, *arguments: int) -> int:
        if operation not in _NAMES:
            named = operation_name(operation)
            raise ProblemError(f"the operation '{named}' cannot be written as data")
        name = _NAMES[operation]
        return place([name, *arguments[: ARITY[name]]])

    found = fold(
        column(expressions),
        symbols,
        lambda k: place(names[k]),
        lambda number: place(_number(number)),
        of_operation,
    )
    # casadi writes no instruction for an output that is zero throughout
    zero = place(0.0) if None in found else -1
    return nodes, [zero if each is None else each for each in found]


def _number(value: float) -> float:
    if not math.isfinite(value):
        raise ProblemError(f"the number {value} cannot be written as data")
    return value

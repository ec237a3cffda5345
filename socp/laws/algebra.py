"""Common factors of casadi expressions, and determinants: the algebra that keeps derived laws short
and regular.
"""

from functools import reduce
from operator import mul
from typing import Any, NamedTuple, final

import casadi

from socp.model import Expr, column

_LARGEST = 3000  # nodes: beyond this the search for common factors costs more than it saves

_POWERS = {
    casadi.OP_NEG: (-1, 1),
    casadi.OP_TWICE: (2, 1),
    casadi.OP_SQ: (1, 2),
    casadi.OP_INV: (1, -1),
}
_COMMUTE = {casadi.OP_ADD, casadi.OP_MUL}

Lines = list[list[Expr]]
Powers = dict[int, tuple[Expr, int]]  # factors by what they are, with their integer powers


def primitive(entries: Expr) -> tuple[Expr, Expr]:
    """Split entries (1, n) or (n, 1) into (factor, rest), entries = factor * rest; factor 1 where
    there is none.

    Factors are found in products, quotients and sums of them as they are written; nothing is
    multiplied out.
    """
    filled = {k: e for k, e in enumerate(entries.elements()) if not e.is_zero()}
    if not filled or casadi.n_nodes(entries) > _LARGEST:
        return casadi.SX(1), entries
    factors = _Factors()
    try:
        split = [factors.of(e) for e in filled.values()]
    except (
        RecursionError
    ):  # a product or sum of a thousand terms, nested: to find no factors loses none
        return casadi.SX(1), entries
    common = split[0][1]
    for _, powers in split[1:]:
        common = _shared(common, powers)
    rest = casadi.SX(entries)
    for k, (number, powers) in zip(filled, split, strict=True):
        rest[k] = _scaled(number, _product(_times(powers, common, -1)))
    return _product(common), rest


def determinant(matrix: Expr) -> Expr:
    """Return the determinant of a small matrix (n, n) by minors along its emptiest row, zeros
    skipped.
    """
    return _determinant(_lines(matrix))


def _lines(matrix: Expr) -> Lines:
    """Return the entries of a matrix row by row."""
    entries, rows = matrix.elements(), matrix.size1()
    return [entries[i::rows] for i in range(rows)]


def _determinant(lines: Lines) -> Expr:
    if not lines:
        return casadi.SX(1)
    if len(lines) == 1:
        return lines[0][0]
    filled = [[j for j, e in enumerate(line) if not e.is_zero()] for line in lines]
    row = min(range(len(lines)), key=lambda i: len(filled[i]))
    others = lines[:row] + lines[row + 1 :]
    total = None
    for j in filled[row]:
        minor = _determinant([line[:j] + line[j + 1 :] for line in others])
        if minor.is_zero():
            continue
        term = lines[row][j] * minor
        if total is None:
            total = -term if (row + j) % 2 else term
        else:
            total = total - term if (row + j) % 2 else total + term
    return casadi.SX(0) if total is None else total


def cramer(matrix: Expr, right: Expr) -> tuple[Expr, Expr]:
    """Return (numerators (n, 1), determinant) of the solution of matrix (n, n) times unknowns =
    right (n, 1).
    """
    lines, entries = _lines(matrix), right.elements()
    numerators = [
        _determinant(
            [[*line[:k], e, *line[k + 1 :]] for line, e in zip(lines, entries, strict=True)]
        )
        for k in range(len(lines))
    ]
    return column(numerators), _determinant(lines)


def ratio(numerator: Expr, denominator: Expr) -> Expr:
    """Return numerator / denominator without the factors that both are written with."""
    if numerator.is_zero():
        return casadi.SX(0)
    _, reduced = primitive(casadi.vertcat(numerator, denominator))
    if not reduced[1].is_constant():
        return reduced[0] / reduced[1]
    try:
        number, powers = _Factors().of(reduced[0])
    except RecursionError:
        return reduced[0] / reduced[1]
    return _scaled(number / float(reduced[1]), _product(powers))


class _Node(NamedTuple):
    """A node of an expression, asked once for all that casadi tells of it: the number that stands
    for what it computes, its operation and parts where it has some, its value where it is constant.
    """

    e: Expr
    number: int
    operation: int | None
    parts: "tuple[_Node, ...]"
    value: float | None


@final
class _Factors:
    """Factors of expressions, each found once however often it is used.

    Two nodes are one factor where they compute the same from the same symbols; comparing them node
    by node instead would take a time exponential in how deep they are.
    """

    def __init__(self) -> None:
        self._split: dict[int, tuple[float, Powers]] = {}
        self._nodes: dict[int, _Node] = {}  # by address, which is a node's own while it lives
        self._numbers: dict[tuple[Any, ...], int] = {}

    def of(self, e: Expr) -> tuple[float, Powers]:
        """Return (number, powers) with e = number times the product of the powers."""
        return self._of(self._node(e))

    def _node(self, e: Expr) -> _Node:
        address = e.element_hash()
        found = self._nodes.get(address)
        if found is None:
            operation, value = None, None
            parts: tuple[_Node, ...] = ()
            if count := e.n_dep():
                operation, parts = e.op(), tuple(self._node(e.dep(k)) for k in range(count))
                order = [part.number for part in parts]
                made = (operation, *(sorted(order) if operation in _COMMUTE else order))
            elif e.is_constant():
                value = float(e)
                made = (value,)
            else:
                made = (None, address)
            number = self._numbers.setdefault(made, len(self._numbers))
            found = self._nodes[address] = _Node(e, number, operation, parts, value)
        return found

    def _of(self, node: _Node) -> tuple[float, Powers]:
        if node.value is not None:
            return node.value, {}
        if node.number not in self._split:
            try:
                self._split[node.number] = self._of_node(node)
            except ZeroDivisionError:  # by a constant zero, as written: left as it is
                self._split[node.number] = (1.0, _single(node))
        return self._split[node.number]

    def _of_node(self, node: _Node) -> tuple[float, Powers]:
        operation = node.operation
        if operation in _POWERS:
            times, power = _POWERS[operation]
            number, powers = self._of(node.parts[0])
            return times * number**power, {k: (f, power * n) for k, (f, n) in powers.items()}
        if operation in {casadi.OP_MUL, casadi.OP_DIV}:
            (a, left), (b, right) = map(self._of, node.parts)
            sign = 1 if operation == casadi.OP_MUL else -1
            return a * b**sign, _times(left, right, sign)
        if operation in {casadi.OP_ADD, casadi.OP_SUB}:
            return self._of_sum(node, 1 if operation == casadi.OP_ADD else -1)
        return 1.0, _single(node)

    def _of_sum(self, node: _Node, sign: int) -> tuple[float, Powers]:
        (a, left), (b, right) = map(self._of, node.parts)
        common = _shared(left, right)
        if not common:
            return 1.0, {} if _unit_circle(node) else _single(node)
        total = _scaled(a, _product(_times(left, common, -1)))
        total += _scaled(sign * b, _product(_times(right, common, -1)))
        whole = self._node(total)
        if whole.value is not None or _unit_circle(whole):
            return 1.0 if whole.value is None else whole.value, common
        return 1.0, _times(common, _single(whole))


def _single(node: _Node) -> Powers:
    return {node.number: (node.e, 1)}


def _unit_circle(node: _Node) -> bool:
    """Tell whether a node is cos(a)^2 + sin(a)^2."""
    squares = node.parts
    if node.operation != casadi.OP_ADD or any(s.operation != casadi.OP_SQ for s in squares):
        return False
    roots = [square.parts[0] for square in squares]
    same = {root.operation for root in roots} == {casadi.OP_COS, casadi.OP_SIN}
    return same and roots[0].parts[0].number == roots[1].parts[0].number


def _times(left: Powers, right: Powers, sign: int = 1) -> Powers:
    """Return the powers of a product, or of a quotient where the sign is -1."""
    found = dict(left)
    for key, (factor, power) in right.items():
        own = found[key][1] if key in found else 0
        found[key] = (factor, own + sign * power)
    return {key: each for key, each in found.items() if each[1]}


def _shared(left: Powers, right: Powers) -> Powers:
    """Return the factors that both have, each with the smaller of its powers where they are of one
    sign.
    """
    found: Powers = {}
    for key, (factor, power) in left.items():
        other = right[key][1] if key in right else 0
        if power * other > 0:
            found[key] = (factor, min(power, other, key=abs))
    return found


def _scaled(number: float, e: Expr) -> Expr:
    """Return a number times an expression; one is most numbers, and costs as much as any."""
    return e if number == 1.0 else number * e


def _product(powers: Powers) -> Expr:
    above, below = (
        [f if abs(n) == 1 else f ** abs(n) for f, n in powers.values() if sign * n > 0]
        for sign in (1, -1)
    )
    over = reduce(mul, above) if above else casadi.SX(1)
    return over / reduce(mul, below) if below else over

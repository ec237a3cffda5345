"""Common factors of casadi expressions, and determinants: the algebra that keeps derived laws short
and regular.
"""

import casadi

from socp.model import Expr, column

_LARGEST = 3000  # nodes: beyond this the search for common factors costs more than it saves
_ALIKE = 12  # depth to which two nodes are compared

_POWERS = {
    casadi.OP_NEG: (-1, 1),
    casadi.OP_TWICE: (2, 1),
    casadi.OP_SQ: (1, 2),
    casadi.OP_INV: (1, -1),
}

Powers = list[tuple[Expr, int]]  # factors with their integer powers


def primitive(entries: Expr) -> tuple[Expr, Expr]:
    """Split entries (1, n) or (n, 1) into (factor, rest), entries = factor * rest; factor 1 where
    there is none.

    Factors are found in products, quotients and sums of them as they are written; nothing is
    multiplied out.
    """
    filled = [k for k in range(entries.numel()) if not entries[k].is_zero()]
    if (
        not filled
        or casadi.Function("n", casadi.symvar(entries), [entries]).n_instructions() > _LARGEST
    ):
        return casadi.SX(1), entries
    memo: dict[int, tuple[Expr, float, Powers]] = {}
    try:
        split = [_split(entries[k], memo) for k in filled]
    except (
        RecursionError
    ):  # a product or sum of a thousand terms, nested: to find no factors loses none
        return casadi.SX(1), entries
    common = split[0][1]
    for _, powers in split[1:]:
        common = _shared(common, powers)
    rest = casadi.SX(entries)
    for k, (number, powers) in zip(filled, split, strict=True):
        rest[k] = number * _product(_without(powers, common))
    return _product(common), rest


def determinant(matrix: Expr) -> Expr:
    """Return the determinant of a small matrix (n, n) by minors along its emptiest row, zeros
    skipped.
    """
    n = matrix.shape[0]
    if n == 0:
        return casadi.SX(1)
    counts = [sum(not matrix[i, j].is_zero() for j in range(n)) for i in range(n)]
    row = counts.index(min(counts))
    total = casadi.SX(0)
    for j in range(n):
        if not matrix[row, j].is_zero():
            keep = [k for k in range(n) if k != j]
            total += (
                (-1) ** (row + j)
                * matrix[row, j]
                * determinant(matrix[[k for k in range(n) if k != row], keep])
            )
    return total


def cramer(matrix: Expr, right: Expr) -> tuple[Expr, Expr]:
    """Return (numerators (n, 1), determinant) of the solution of matrix (n, n) times unknowns =
    right (n, 1).
    """
    numerators = []
    for k in range(matrix.shape[0]):
        replaced = casadi.SX(matrix)
        replaced[:, k] = right
        numerators.append(determinant(replaced))
    return column(numerators), determinant(matrix)


def ratio(numerator: Expr, denominator: Expr) -> Expr:
    """Return numerator / denominator without the factors that both are written with."""
    if numerator.is_zero():
        return casadi.SX(0)
    _, reduced = primitive(casadi.vertcat(numerator, denominator))
    if not reduced[1].is_constant():
        return reduced[0] / reduced[1]
    try:
        number, powers = _split(reduced[0], {})
    except RecursionError:
        return reduced[0] / reduced[1]
    return number / float(reduced[1]) * _product(powers)


def _split(e: Expr, memo: dict[int, tuple[Expr, float, Powers]]) -> tuple[float, Powers]:
    """Return (number, powers) with e = number times the product of the powers."""
    if e.is_constant():
        return float(e), []
    key = e.element_hash()
    if key not in memo:
        try:
            memo[key] = (e, *_split_node(e, memo))
        except ZeroDivisionError:  # by a constant zero, as written: left as it is
            memo[key] = (e, 1.0, [(e, 1)])
    return memo[key][1:]


def _split_node(e: Expr, memo: dict[int, tuple[Expr, float, Powers]]) -> tuple[float, Powers]:
    operation = e.op() if e.n_dep() else None
    if operation in _POWERS:
        times, power = _POWERS[operation]
        number, powers = _split(e.dep(0), memo)
        return times * number**power, [(f, power * k) for f, k in powers]
    if operation in {casadi.OP_MUL, casadi.OP_DIV}:
        (a, left), (b, right) = _split(e.dep(0), memo), _split(e.dep(1), memo)
        sign = 1 if operation == casadi.OP_MUL else -1
        return a * b**sign, _times(left, [(f, sign * k) for f, k in right])
    if operation in {casadi.OP_ADD, casadi.OP_SUB}:
        return _split_sum(e, 1 if operation == casadi.OP_ADD else -1, memo)
    return 1.0, [(e, 1)]


def _split_sum(
    e: Expr, sign: int, memo: dict[int, tuple[Expr, float, Powers]]
) -> tuple[float, Powers]:
    (a, left), (b, right) = _split(e.dep(0), memo), _split(e.dep(1), memo)
    common = _shared(left, right)
    if not common:
        return 1.0, [] if _unit_circle(e) else [(e, 1)]
    total = a * _product(_without(left, common)) + sign * b * _product(_without(right, common))
    if total.is_constant() or _unit_circle(total):
        return float(total) if total.is_constant() else 1.0, common
    return 1.0, _times(common, [(total, 1)])


def _unit_circle(e: Expr) -> bool:
    """Tell whether an expression is cos(a)^2 + sin(a)^2."""
    if (
        not e.n_dep()
        or e.op() != casadi.OP_ADD
        or any(e.dep(k).op() != casadi.OP_SQ for k in (0, 1))
    ):
        return False
    roots = [e.dep(k).dep(0) for k in (0, 1)]
    kinds = {root.op() for root in roots if root.n_dep()}
    return kinds == {casadi.OP_COS, casadi.OP_SIN} and _alike(roots[0].dep(0), roots[1].dep(0))


def _alike(a: Expr, b: Expr) -> bool:
    return bool(casadi.is_equal(a, b, _ALIKE))


def _times(left: Powers, right: Powers) -> Powers:
    found = list(left)
    for factor, power in right:
        for k, (other, own) in enumerate(found):
            if _alike(factor, other):
                found[k] = (other, own + power)
                break
        else:
            found.append((factor, power))
    return [(factor, power) for factor, power in found if power]


def _shared(left: Powers, right: Powers) -> Powers:
    """Return the factors that both have, each with the smaller of its powers where they are of one
    sign.
    """
    found = []
    for factor, power in left:
        other = next((k for f, k in right if _alike(f, factor)), 0)
        if power * other > 0:
            found.append((factor, min(power, other, key=abs)))
    return found


def _without(powers: Powers, divisor: Powers) -> Powers:
    return _times(powers, [(factor, -power) for factor, power in divisor])


def _product(powers: Powers) -> Expr:
    above, below = casadi.SX(1), casadi.SX(1)
    for factor, power in powers:
        if power > 0:
            above *= factor**power
        else:
            below *= factor ** (-power)
    return above / below

"""Linear motions V' = A V in balls: Taylor coefficients, and what contains V over a step."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from socp.model import TINY
from socp.proof.balls import Ball, Matrix, flint

_PERRON = 12  # rounds of the power method: sizes need no digits
_LEAST = (1.0, 1e-2, 1e-4, 1e-6)  # sizes of quantities, of the largest, that are tried


def identity(n: int) -> Matrix:
    """Return the matrix 1 (n, n)."""
    return flint().arb_mat(n, n, [int(i == j) for i in range(n) for j in range(n)])


def floats(matrix: Matrix) -> np.ndarray:
    """Return the middles of a matrix as floats."""
    return np.array([[float(each.mid()) for each in row] for row in matrix.tolist()])


def orthogonal(matrix: Matrix) -> Matrix:
    """Return a matrix without radius whose columns are those of Q, matrix = Q R, but for
    rounding.
    """
    found = np.linalg.qr(floats(matrix))[0]
    return flint().arb_mat(*found.shape, [float(each) for each in found.ravel()])


def horner(values: Sequence[Any], h: Ball) -> Any:
    """Return a polynomial with given coefficients, the constant one first, at h."""
    found = values[-1]
    for each in reversed(values[:-1]):
        found = found * h + each
    return found


def around_one(matrix: Matrix, h: Ball) -> Matrix:
    """Return what contains V over a step, V' = A V, V(0) = 1, A a matrix of balls: |V - 1|_ij is at
    most (exp(a h) - 1) s_i / s_j for a = max_i sum_j |A_ij| s_j / s_i, whatever the sizes s.
    """
    n, arb = matrix.nrows(), flint().arb
    bounds = [[matrix[i, j].abs_upper() for j in range(n)] for i in range(n)]
    s = [arb(each) for each in _sizes(np.array([[float(b) for b in row] for row in bounds]), h)]
    norm = max(
        (sum((b * s[j] for j, b in enumerate(row)), arb(0)) / s[i]).upper()
        for i, row in enumerate(bounds)
    )
    growth = ((norm * h).exp() - 1).abs_upper()
    entries = [arb(int(i == j), (growth * s[i] / s[j]).upper()) for i in range(n) for j in range(n)]
    return flint().arb_mat(n, n, entries)


def _sizes(matrix: np.ndarray, h: Ball) -> list[float]:
    """Return sizes of which the largest is 1 and for which a norm of a matrix is nearly the least
    it can be, by the power method (Perron); of several limits of how small the others may be, the
    one that leaves the largest entry of what is contained least.
    """
    least = np.array(_LEAST)
    size = np.ones((len(matrix), least.size))
    with np.errstate(all="ignore"):
        for _ in range(_PERRON):
            moved = matrix @ size
            size = np.maximum(np.sqrt(size * moved / np.maximum(moved.max(axis=0), TINY)), least)
        norms = (matrix @ size / size).max(axis=0)
        spread = np.expm1(norms * float(h.abs_upper())) / least
    fine = np.isfinite(size).all(axis=0) & np.isfinite(spread)
    if not fine.any():
        return [1.0] * len(matrix)
    found: list[float] = size[:, int(np.argmin(np.where(fine, spread, np.inf)))].tolist()
    return found


def evolved(matrices: Sequence[Matrix], first: Matrix, order: int) -> list[Matrix]:
    """Return the Taylor coefficients of V' = A V, V(0) = first, up to an order."""
    found = [first]
    for k in range(order):
        total = matrices[0] * found[k]
        for i in range(1, k + 1):
            total = total + matrices[i] * found[k - i]
        found.append(total * (flint().arb(1) / (k + 1)))
    return found


def bent(
    slopes: Sequence[Sequence[Matrix]], forms: Sequence[Sequence[Matrix]], h: Ball, order: int
) -> tuple[Matrix, Matrix]:
    """Return V (n, n) and the integral of V' B V (n, n) over a step, V' = A V, V(0) = 1, A given by
    `slopes` and B by `forms`: their Taylor coefficients, so many, where the step begins and over
    all of it.
    """
    near = evolved(slopes[0], identity(slopes[0][0].nrows()), order - 1)
    wide = evolved(slopes[1], around_one(slopes[1][0], h), order)
    found: list[Matrix] = []
    for form, its, count in ((forms[0], near, order - 1), (forms[1], wide, order)):
        inner = [_cauchy(form, its, k) for k in range(count)]
        turned = [each.transpose() for each in its[:count]]
        found += [_cauchy(turned, inner, k) for k in range(len(found), count)]
    grown = [each * (flint().arb(1) / (k + 1)) for k, each in enumerate(found)]
    return horner([*near, wide[-1]], h), horner(grown, h) * h


def _cauchy(left: Sequence[Matrix], right: Sequence[Matrix], k: int) -> Matrix:
    """Return the k-th coefficient of a product of series."""
    total = left[0] * right[k]
    for i in range(1, k + 1):
        total = total + left[i] * right[k - i]
    return total

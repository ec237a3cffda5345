"""Gram matrices as explicit squares with exact coefficients, and the defect that is left."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, final

import numpy as np
from scipy.sparse.linalg import spsolve

from socp.proof.bound.squares import Blocks, Exponents, Table

# Coefficients are multiples of one over it, relative to the largest: finer than the solver's
# accuracy, and short to write
_FINE = 2**44
_COARSE = 2**36  # of squares, whose errors enter twice
_NONE = 1e-13  # of the largest eigenvalue: a square below it is left out


@final
@dataclass(frozen=True, eq=False)
class Squares:
    """A demand shown: sum over guards of guard * sum of squares of rows . basis / scale, and the
    defect, a bound of the modulus of what is left.
    """

    kinds: list[Any]
    bases: list[list[Exponents]]
    rows: list[list[list[int]]]
    scales: list[int]
    defect: Fraction


def rounded(values: np.ndarray) -> list[Fraction]:
    """Return floats as short fractions."""
    largest = float(np.max(np.abs(values), initial=0.0)) or 1.0
    grain = _FINE / 2 ** int(np.ceil(np.log2(largest)))
    return [Fraction(round(float(each) * grain)) / Fraction(grain) for each in values]


def shown(blocks: Blocks, coefficients: Sequence[Fraction], grams: Sequence[np.ndarray]) -> Squares:
    """Return a demand with given coefficients as explicit squares."""
    exact = blocks.demand.at(coefficients)
    right = np.array([float(exact.get(exponents, 0)) for exponents in blocks.rows])
    stacked = np.concatenate([gram.flatten(order="F") for gram in grams])
    for _ in range(2):  # what is left goes into the Gram matrices, in the least squares
        left = right - blocks.matrix @ stacked
        weights = spsolve((blocks.matrix @ blocks.matrix.T).tocsc(), left)
        stacked = stacked + blocks.matrix.T @ weights
    rows, scales, place = [], [], 0
    for basis in blocks.bases:
        size = len(basis)
        gram = stacked[place : place + size**2].reshape(size, size, order="F")
        place += size**2
        its, scale = _factor(gram)
        rows.append(its)
        scales.append(scale)
    left_over = _left(blocks, exact, rows, scales)
    return Squares(
        blocks.kinds,
        blocks.bases,
        rows,
        scales,
        sum((abs(each) for each in left_over.values()), Fraction(0)),
    )


def _factor(gram: np.ndarray) -> tuple[list[list[int]], int]:
    """Return rows (k, m) of integers and a scale with (rows/scale)' (rows/scale) near a matrix."""
    values, vectors = np.linalg.eigh((gram + gram.T) / 2)
    most = max(float(values[-1]), 0.0)
    keep = values > _NONE * most
    rows = np.sqrt(values[keep])[:, None] * vectors[:, keep].T
    if not rows.size:
        return [], 1
    triangle = np.linalg.qr(rows, mode="r")  # the same squares, half the numbers
    scale = max(1, int(_COARSE / 2 ** int(np.ceil(np.log2(np.max(np.abs(triangle)))))))
    return [[round(float(each) * scale) for each in row] for row in triangle], scale


def _left(
    blocks: Blocks, exact: Table, rows: Sequence[Sequence[Sequence[int]]], scales: Sequence[int]
) -> Table:
    """Return what a polynomial exceeds its squares by."""
    region, found = blocks.demand.region, dict(exact)
    for guard, basis, its, scale in zip(blocks.guards, blocks.bases, rows, scales, strict=True):
        products: Table = {}
        columns = list(zip(*its, strict=True))
        for i, a in enumerate(basis if its else []):
            for j, b in enumerate(basis[: i + 1]):
                value = sum(map(int.__mul__, columns[i], columns[j])) * (1 if i == j else 2)
                if value:
                    both = tuple(map(int.__add__, a, b))
                    products[both] = products.get(both, 0) + value
        raw: Table = {}
        for e, value in products.items():
            for g, factor in guard.items():
                both = tuple(map(int.__add__, e, g))
                raw[both] = raw.get(both, 0) + value * factor
        for e, value in region.reduced(raw).items():
            found[e] = found.get(e, 0) - Fraction(value) / scale**2
    return found

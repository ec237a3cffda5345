"""Gram matrices as explicit squares with exact coefficients."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, final

import numpy as np
from scipy.sparse.linalg import spsolve

from socp.proof.bound.squares import Blocks, Exponents

# Coefficients are multiples of one over it, relative to the largest: finer than the solver's
# accuracy, and short to write
_FINE = 2**44
_COARSE = 2**36  # of squares, whose errors enter twice
_NONE = 1e-13  # of the largest eigenvalue: a square below it is left out


@final
@dataclass(frozen=True, eq=False)
class Squares:
    """A demand shown, but for what is left of it, about: sum over guards of guard * sum of squares
    of rows . basis / scale.
    """

    kinds: list[Any]
    bases: list[list[Exponents]]
    rows: list[list[list[int]]]
    scales: list[int]
    left: float


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
    rows, scales, place, near = [], [], 0, np.zeros_like(stacked)
    for basis in blocks.bases:
        size = len(basis)
        gram = stacked[place : place + size**2].reshape(size, size, order="F")
        its, scale = _factor(gram)
        if its:
            root = np.array(its, dtype=float) / scale
            near[place : place + size**2] = (root.T @ root).flatten(order="F")
        place += size**2
        rows.append(its)
        scales.append(scale)
    known = set(blocks.rows)
    flat = sum(abs(float(value)) for exponents, value in exact.items() if exponents not in known)
    left = float(np.sum(np.abs(right - blocks.matrix @ near))) + flat
    return Squares(blocks.kinds, blocks.bases, rows, scales, left)


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

"""Sparse matrices by their entries: what a transcription needs of them, without the import of a
package that takes as long as to solve a small problem.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import casadi
import numpy as np


@final
@dataclass(frozen=True, eq=False)
class Entries:
    """Entries of a matrix of a shape: rows, columns and values (k,) each; those of one place add
    up.
    """

    shape: tuple[int, int]
    rows: np.ndarray
    columns: np.ndarray
    values: np.ndarray

    @classmethod
    def joined(cls, shape: tuple[int, int], parts: Sequence["Entries"]) -> "Entries":
        """Return the entries of all parts as those of one matrix."""
        none = cls(shape, np.empty(0, dtype=int), np.empty(0, dtype=int), np.empty(0))
        fields = (
            [getattr(each, name) for each in (none, *parts)]
            for name in ("rows", "columns", "values")
        )
        return cls(shape, *(np.concatenate(each) for each in fields))

    def moved(self, down: int, right: int) -> "Entries":
        """Return the same entries so many rows and columns further on, to be joined."""
        return Entries(self.shape, self.rows + down, self.columns + right, self.values)

    def chosen(self, which: np.ndarray) -> "Entries":
        """Return the entries that a mask (k,) chooses."""
        return Entries(self.shape, self.rows[which], self.columns[which], self.values[which])

    def array(self) -> np.ndarray:
        """Return the matrix, dense."""
        found = np.zeros(self.shape)
        np.add.at(found, (self.rows, self.columns), self.values)
        return found

    def transposed(self, values: np.ndarray) -> np.ndarray:
        """Return the transpose times values (m, j): (n, j)."""
        order = np.argsort(self.columns, kind="stable")
        terms = self.values[order, None] * values[self.rows[order]]
        count = np.bincount(self.columns, minlength=self.shape[1])
        at, first = np.flatnonzero(count), np.cumsum(count) - count
        found = np.zeros((self.shape[1], values.shape[1]))
        found[at] = np.add.reduceat(terms, first[at]) if at.size else 0.0
        return found

    def matrix(self) -> casadi.DM:
        """Return the matrix as casadi keeps it, column after column."""
        m, n = self.shape
        where, entry = np.unique(self.columns * m + self.rows, return_inverse=True)
        data = np.bincount(entry, self.values, where.size)
        ends = np.searchsorted(where, m * np.arange(n + 1))
        return casadi.DM(pattern_of(self.shape, ends, where % max(m, 1)), data.tolist())

    def by_rows(self) -> "Lines":
        """Return the entries row after row."""
        return self._ordered(self.rows, self.columns, self.shape[0])

    def by_columns(self) -> "Lines":
        """Return the entries column after column."""
        return self._ordered(self.columns, self.rows, self.shape[1])

    def _ordered(self, which: np.ndarray, other: np.ndarray, count: int) -> "Lines":
        order = np.argsort(which, kind="stable")
        begin = np.append(0, np.cumsum(np.bincount(which, minlength=count)))
        return Lines(begin, other[order], self.values[order])


@final
@dataclass(frozen=True, eq=False)
class Lines:
    """The lines of a matrix, one after another: where each begins (lines + 1,), and the places in
    it and values (k,).
    """

    begin: np.ndarray
    places: np.ndarray
    values: np.ndarray

    def expanded(self, which: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return all that stands in the lines `which`: the place in `which` that it belongs to, its
        place in the line, and its value.
        """
        begin, size = self.begin[which], np.diff(self.begin)[which]
        of = np.repeat(np.arange(which.size), size)
        inside = np.arange(of.size) - np.repeat(np.cumsum(size) - size, size)
        at = np.repeat(begin, size) + inside
        return of, self.places[at], self.values[at]


def pattern_of(shape: tuple[int, int], ends: np.ndarray, rows: np.ndarray) -> casadi.Sparsity:
    """Return a pattern of a shape (m, n) from where its columns end (n + 1,) among the rows of its
    entries (k,), which ascend in each; casadi looks at one list once, and at several twice.
    """
    return casadi.Sparsity.compressed(np.concatenate([shape, ends, rows]).tolist())

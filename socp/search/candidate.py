"""Candidates: words to try, with edges in time and a guess."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Self, final

import numpy as np

from socp.methods import split
from socp.model import Mode, Modes, Solution, Word

# Of the arc that it is put into: the first length of an inserted arc, soon corrected by the solver
_SPROUT = 0.02


@final
@dataclass(frozen=True, eq=False)
class Candidate:
    """A word to try: its arcs with their edges in time, and the solution whose states are the
    guess.
    """

    arcs: tuple[Modes, ...]
    edges: tuple[float, ...]
    source: Solution

    @classmethod
    def of(cls, solution: Solution, arcs: Sequence[Modes]) -> Self:
        """Return a word whose arcs meet where those of a solution do."""
        edges = (solution.initial_time, *solution.junctions.tolist(), solution.final_time)
        return cls(tuple(arcs), edges, solution)

    @property
    def key(self) -> str:
        """The word as text."""
        return str(Word(tuple(str(i) for i in range(len(self.arcs[0]))), self.arcs))

    def place(self, t: float) -> int:
        """Return the index of the arc at a time, the later one where arcs meet."""
        return int(np.clip(np.searchsorted(self.edges, t, side="right") - 1, 0, len(self.arcs) - 1))

    def guess(self) -> Solution:
        """Return the source cut at the edges."""
        lengths = np.diff(self.edges)
        return split(self.source, np.maximum(lengths, 1e-6 * lengths.sum()).tolist())


def merged(given: Candidate) -> Candidate:
    """Return a candidate without equal neighbours."""
    keep = [0, *(k for k in range(1, len(given.arcs)) if given.arcs[k] != given.arcs[k - 1])]
    arcs = tuple(given.arcs[k] for k in keep)
    return Candidate(arcs, (*(given.edges[k] for k in keep), given.edges[-1]), given.source)


def insert(given: Candidate, control: int, mode: Mode, t: float) -> Candidate:
    """Return a candidate with one control in another mode for a while around a time."""
    arc = given.arcs[given.place(t)]
    return insert_modes(given, (*arc[:control], mode, *arc[control + 1 :]), t)


def insert_modes(given: Candidate, new: Modes, t: float) -> Candidate:
    """Return a candidate with all controls in given modes for a while around a time."""
    edges, k = np.array(given.edges), given.place(t)
    a, b = edges[k], edges[k + 1]
    length = _SPROUT * (b - a)
    start = float(np.clip(t - length / 2.0, a, b - length))
    start = a if start - a < 2.0 * length else b - length if b - start < 3.0 * length else start
    return _cut_in(given, new, k, (start, start + length))


def held(given: Candidate, control: int, mode: Mode, span: tuple[float, float]) -> Candidate:
    """Return a candidate with one control in another mode over a span of the arc in its middle."""
    k = given.place(0.5 * (span[0] + span[1]))
    arc, (a, b) = given.arcs[k], (given.edges[k], given.edges[k + 1])
    start, end = float(np.clip(span[0], a, b)), float(np.clip(span[1], a, b))
    return _cut_in(given, (*arc[:control], mode, *arc[control + 1 :]), k, (start, end))


def _cut_in(given: Candidate, new: Modes, k: int, span: tuple[float, float]) -> Candidate:
    """Return a candidate with all controls in given modes over a span of its arc k."""
    arc = given.arcs[k]
    arcs = (*given.arcs[:k], arc, new, arc, *given.arcs[k + 1 :])
    edges = (*given.edges[: k + 1], *span, *given.edges[k + 1 :])
    return merged(without_short_arcs(Candidate(arcs, edges, given.source), 0.0))


def without_short_arcs(given: Candidate, shortest: float) -> Candidate:
    """Return a candidate without the arcs that are no longer than the shortest; the longest one
    stays in any case.
    """
    longest = int(np.argmax(np.diff(given.edges)))  # of a horizon that shrank to a point too
    keep = [k for k, (a, b) in enumerate(pairwise(given.edges)) if b - a > shortest or k == longest]
    edges = (given.edges[0], *(given.edges[k] for k in keep[1:]), given.edges[-1])
    return Candidate(tuple(given.arcs[k] for k in keep), edges, given.source)

"""Coarse nodes of a search over words: one word, one interval an arc, ends that may be missed at a
price.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import final

import numpy as np

from socp.errors import MethodError, SolveError
from socp.methods import kept_in_box, solve_collocated
from socp.model import SAME_TIME, Problem, Solution, Watch, Word, silent
from socp.search.candidate import Candidate, insert_modes, merged, without_short_arcs
from socp.search.effort import Ration
from socp.solvers import Backend
from socp.transcription import PhasedProblem, follow, lgr, uniform

_TINY = 1e-3  # of the horizon: an arc as short is tried without
_STEP, _DEAREST = 10.0, 1e3  # times the first price of missing an end
_TOLERANCE = 1e-8  # to compare words takes no more digits
_ITERATIONS = 100


@final
@dataclass(eq=False)
class Coarse:
    """Solves along words with `points` collocation points an arc and no more work than the ration
    allows.

    softly: returns the problem with softened ends, at its price times a factor.
    """

    problem: Problem
    softly: Callable[[float], Problem]
    points: int
    ration: Ration
    price: float = 1.0

    def __call__(self, now: Candidate, watch: Watch = silent) -> Solution | None:
        """Solve along a word, its laws boxed where they would leave the box; None where there is no
        such programme.
        """
        try:
            phased = follow(self.problem, Word(self.problem.control_names, now.arcs), now.guess())
            return kept_in_box(
                self.problem,
                lambda boxed: self._solved(phased.with_phases(boxed=boxed), now, watch),
            )
        except (MethodError, SolveError):
            return None

    def dearer(self) -> bool:
        """Raise the price of missing an end; False where it is as high as it may be."""
        self.price *= _STEP
        return self.price <= _DEAREST

    def _solved(self, phased: PhasedProblem, now: Candidate, watch: Watch) -> Solution:
        meshes = [uniform(lgr(self.points), 1)] * len(phased.phases)
        ration = Ration(self.ration.left, _comparing(self.ration.backend))
        soft = replace(phased, of=self.softly(self.price))
        solution = solve_collocated(soft, meshes, ration, now.guess(), watch, longer=False)
        self.ration.left = ration.left
        return solution


def _comparing(backend: Backend) -> Backend:
    """Return a backend as it compares words, of which the one before is near."""
    return backend.within(_TOLERANCE).limited(_ITERATIONS).nearby()


def staggered(now: Candidate) -> Iterator[Candidate]:
    """Yield words in which controls that switch at once switch one after the other."""
    for k, (before, after) in enumerate(pairwise(now.arcs)):
        for i, (a, b) in enumerate(zip(before, after, strict=True)):
            between = (*before[:i], b, *before[i + 1 :])
            if a != b and between != after:
                yield insert_modes(
                    now, between, now.edges[k + 1] - SAME_TIME * (now.edges[-1] - now.edges[0])
                )


def trimmed(now: Candidate) -> Candidate | None:
    """Return a word without its shortest arc where that is very short, None where none is."""
    lengths = np.diff(now.edges)
    shortest = float(lengths.min())
    if len(now.arcs) < 2 or shortest > _TINY * float(lengths.sum()):
        return None
    return merged(without_short_arcs(now, shortest))

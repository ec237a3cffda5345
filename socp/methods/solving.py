"""Solve along a given word: laws on every arc, free lengths, meshes refined until states, cost and
laws have converged.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import final

from socp.methods.contract import solve_collocated
from socp.methods.polish import plausible, polished_along
from socp.model import OUTSIDE, Problem, Solution, Stop, Watch, Word, silent
from socp.solvers import Solver, default_backend
from socp.transcription import (
    PhasedProblem,
    cut_arcs,
    cut_at_knots,
    damping,
    follow,
    lgr,
    refined_meshes,
    rejoin,
    resampled,
    uniform,
    unresolved,
)
from socp.verdict import verify_in_time

# Of the re-integrated control: collocation of smooth motion at the default tolerance stays below
_MISSED = 1e-9
_WHOLE = 4  # intervals that a whole horizon starts with: few motions are smooth enough for less
_NEAR = 10.0  # times the tolerance: an estimate as near as this is put to the test
_CUTS = 3  # times that arcs are cut: a coarse mesh may not show what they touch
_PASSES = 8  # meshes tried; each multiplies the intervals of an arc by up to four


@final
@dataclass(frozen=True)
class Follower:
    """How to solve along a word.

    points: collocation points an interval; intervals: fixed number of intervals an arc, 0 for as
    many as needed; tolerance: size of the last Legendre coefficients of states, cost and laws,
    relative, that ends refinement; boxed: impose the box of the controls on the values of the laws,
    which a right word keeps by itself; loose: joints at which a law has to be at a bound are left
    free; longer: meet the ends with longer horizons first where the guess leads nowhere; dwell:
    least length of every arc; exact: where no sign tells that the word is wrong, Newton on its
    conditions takes the place of programmes on finer meshes.
    """

    points: int = 10
    intervals: int = 0
    tolerance: float = 1e-7
    boxed: bool = False
    loose: bool = False
    longer: bool = True
    dwell: float = 0.0
    exact: bool = False
    backend: Solver = field(default_factory=lambda: default_backend().within(1e-11))

    def __call__(
        self, problem: Problem, word: Word, guess: Solution, watch: Watch = silent
    ) -> Solution:
        """Solve along a word from one guess; raises MethodError where a law of the word cannot be
        had.
        """
        length = (self.dwell, math.inf)
        phased = follow(problem, word, guess, loose=self.loose)
        phased = phased.with_phases(boxed=self.boxed, length=length)
        if self.dwell:  # a part of an arc may be shorter
            return self._solved(phased, guess, watch)
        parts, guess, pieces = cut_at_knots(
            phased, guess, lambda *_: uniform(lgr(self.points), self.intervals or 1)
        )
        found = self._solved(parts, guess, watch)
        return found if len(pieces) == len(parts.phases) else rejoin(found, pieces)

    def _solved(self, phased: PhasedProblem, guess: Solution, watch: Watch) -> Solution:
        """Solve a phased problem, cut at the kinks that its solution shows, on meshes that are fine
        enough.
        """
        problem = phased.of
        meshes = [
            uniform(lgr(self.points), self.intervals or count)
            for count in self._counts(phased, guess)
        ]
        solution = solve_collocated(phased, meshes, self.backend, guess, watch, longer=self.longer)
        if self.intervals or not sound(problem, solution):
            return solution
        if self.dwell:  # a part of an arc may be shorter
            return self._refined(phased, solution, watch)
        return self._cut(phased, solution, watch)

    def _counts(self, phased: PhasedProblem, guess: Solution) -> list[int]:
        """Return how many intervals every arc starts with: one, or its share of those of a whole
        horizon, more where they would let grow what decays.
        """
        if len(guess.arcs) != len(phased.phases):
            return [1] * len(phased.phases)
        lengths = [float(arc.t[-1] - arc.t[0]) for arc in guess.arcs]
        shares = [math.ceil(_WHOLE * length / sum(lengths)) for length in lengths]
        return [
            max(pair) for pair in zip(shares, damping(phased.of, guess, self.points), strict=True)
        ]

    def _cut(self, phased: PhasedProblem, solution: Solution, watch: Watch) -> Solution:
        """Solve on finer meshes with arcs cut where they have to be, as long as that shows more
        places to cut.
        """
        pieces = 0
        for _ in range(_CUTS):
            cut = cut_arcs(phased, solution, self.points)
            if sum(cut.pieces) <= pieces:
                return solution
            found = solution
            if len(cut.phased.phases) > len(phased.phases):
                found = solve_collocated(cut.phased, cut.meshes, self.backend, cut.solution, watch)
                if found.stop is Stop.INTERRUPTED:
                    return replace(solution, stop=Stop.INTERRUPTED, message=found.message)
                found = found.after(solution)
            if not sound(phased.of, found):
                break
            refined = self._refined(cut.phased, found, watch)
            solution, pieces = rejoin(refined, cut.pieces), sum(cut.pieces)
        return solution if pieces else self._refined(phased, solution, watch)

    def _refined(self, phased: PhasedProblem, solution: Solution, watch: Watch) -> Solution:
        """Solve on finer meshes until states, cost and laws have converged, or the solver is not
        content any more.
        """
        problem, tolerance = phased.of, self.tolerance
        if self.exact and plausible(problem, solution):
            rest = unresolved(problem, solution)
            finer = refined_meshes(solution.arcs, rest, self.points, tolerance)
            start = solution if finer is None else resampled(solution, finer)
            solution = polished_along(phased, start) or solution
        for _ in range(_PASSES):
            rest = unresolved(problem, solution)
            near = max(float(each.max()) for each in rest) <= _NEAR * tolerance
            if near and verify_in_time(problem, solution).worst <= _MISSED:
                break  # another mesh costs more than this look
            finer = refined_meshes(solution.arcs, rest, self.points, tolerance)
            if finer is None:
                # Where the motion is not smooth the end of an interval is no better than its inside
                tolerance /= 100.0
                continue
            solution = solve_collocated(phased, finer, self.backend, solution, watch).after(
                solution
            )
            if not sound(problem, solution):
                break
        return solution


def kept_in_box(
    problem: Problem,
    solve: Callable[[bool], Solution],
    telling: Callable[[Solution], bool] = lambda _: False,
) -> Solution:
    """Return what `solve(False)` gives, or `solve(True)`, which imposes the box of the controls on
    the laws, where they leave it by themselves and the solver can keep them in.

    telling: whether a solution whose laws leave the box is returned as it is, for what it shows.
    Where it is interrupted on the way, so is what is returned.
    """
    solution = solve(False)
    if not solution.stop.ok or sound(problem, solution) or telling(solution):
        return solution
    boxed = solve(True)
    return boxed if boxed.stop.ok or boxed.stop is Stop.INTERRUPTED else solution


def sound(problem: Problem, solution: Solution) -> bool:
    """Tell whether the solver is content and the laws stay in the box, which the programme need not
    impose.
    """
    low, high = problem.box[0][:, None], problem.box[1][:, None]
    margin = OUTSIDE * (high - low)  # beyond the solver's own tolerance
    return solution.stop.ok and all(
        ((arc.u >= low - margin) & (arc.u <= high + margin)).all() for arc in solution.arcs
    )

"""Legendre-Gauss-Radau collocation on several phases of free lengths, with free controls or along a
given word.
"""

import math
from dataclasses import dataclass, replace
from typing import ClassVar, final

from socp import (
    Backend,
    Method,
    MethodError,
    Problem,
    Solution,
    Watch,
    Word,
    hookimpl,
    option,
    silent,
    single_phase,
    solve_collocated,
    uniform,
)
from socp.methods import Follower, guess_along, sound, split
from socp.model import Stop
from socp.solvers import default_backend
from socp.transcription import euler, lgr
from socp.verdict import certified

_TOLERANCE = 1e-11  # of the solver: switching times to many digits
_PHASES = 3  # one a kind of arc: bang, singular, bang
_COARSE = 100  # steps of the coarse solve: enough to show the arcs, few enough to cost nothing


@final
@dataclass(frozen=True)
class LgrMultiphase(Method):
    """Along a word, given or that of the guess: laws on every arc, switching times to many digits.
    Without one: phases of free controls.
    """

    name: ClassVar[str] = "lgr-multiphase"
    source: ClassVar[str] = "doi:10.3934/dcdsb.2019092, section 4 (GPOPS) and (16)"
    word: str = option(
        "",
        "arcs by control, as 'r: + s s s +; f: + + b - -', or stretches, as 'r: +, s, +; f: +, b, "
        "-'; that of the guess where it has one",
    )
    lengths: str = option(
        "", "rough arc lengths as a guess, such as '0.05 0.6 14 0.1 0.2'; equal where not given"
    )
    phases: int = option(
        0,
        f"number of phases of free controls; 0 means along the word, {_PHASES} where there is none",
        least=0,
        most=1000,
    )
    points: int = option(
        0,
        "collocation points an interval; 0 means 40 without a word, 10 with one",
        least=0,
        most=100,
    )
    intervals: int = option(
        0,
        "intervals an arc; 0 means one without a word, as many as the tolerance needs with one",
        least=0,
    )
    tolerance: float = option(
        1e-7,
        "size of the last Legendre coefficients of states, cost and laws, relative, that ends "
        "refinement",
        least=1e-15,
    )
    backend: Backend = option(default_backend(), "solver of the nonlinear programme")

    def solve(self, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
        """Solve on phases of free lengths; along a word, on meshes that are refined until the
        states have converged.

        Where the guess leads nowhere along a word, a coarse solve without it gives another.
        """
        words = self._words(problem, guess)
        if not words:
            count = self.phases or _PHASES
            meshes = [uniform(lgr(self.points or 40), self.intervals or 1)] * count
            phased, backend = single_phase(problem, count), self.backend.within(_TOLERANCE)
            return solve_collocated(phased, meshes, backend, self._cut(guess, count), watch)
        best = self._along(problem, words[0], guess, watch)
        for word in words[1:]:
            if best.stop is Stop.INTERRUPTED or certified(problem, best).extremal:
                break
            other = self._along(problem, word, guess, watch)
            better = (not other.stop.ok, other.objective) < (not best.stop.ok, best.objective)
            best = other.after(best) if better else best.after(other)
        return best

    def _along(self, problem: Problem, word: Word, guess: Solution, watch: Watch) -> Solution:
        """Solve along a word."""
        backend = self.backend.within(_TOLERANCE)
        follower = Follower(self.points or 10, self.intervals, self.tolerance, backend=backend)
        solution = follower(problem, word, self._cut(guess, len(word.arcs)), watch)
        if sound(problem, solution) or solution.stop is Stop.INTERRUPTED:
            return solution
        coarse = solve_collocated(
            single_phase(problem), [uniform(euler(), _COARSE)], self.backend, guess, watch
        )
        again = replace(follower, boxed=True)(
            problem, word, guess_along(problem, coarse, word), watch
        )
        better = again if again.stop.ok or not solution.stop.ok else solution
        return better.after(coarse).after(solution if better is again else again)

    def _words(self, problem: Problem, guess: Solution) -> tuple[Word, ...]:
        """Return the words to solve along, more than one where the order of switches is open, none
        where controls are free.
        """
        if self.word:
            if guess.lawful and self._rows(guess.followed) == self.word.replace(",", "").split():
                return (guess.followed,)
            return Word.readings(self.word, problem.control_names)
        known = {None, *(constraint.name for constraint in problem.constraints)}
        modes = [mode for arc in guess.arcs for mode in arc.modes]
        if self.phases or not guess.lawful or any(m.constraint not in known for m in modes):
            return ()
        return (guess.followed,)

    @staticmethod
    def _rows(word: Word) -> list[str]:
        """Return the signs of a word as a report prints it."""
        return "; ".join(f"{name}: {word.of(name)}" for name in word.controls).split()

    def _cut(self, guess: Solution, count: int) -> Solution:
        if not self.lengths:
            return guess
        try:
            lengths = [float(part) for part in self.lengths.replace(",", " ").split()]
        except ValueError:
            raise MethodError(f"lengths: '{self.lengths}' should be numbers, one an arc") from None
        if len(lengths) != count or not all(0 < length < math.inf for length in lengths):
            raise MethodError(
                f"lengths: '{self.lengths}' should be {count} positive numbers, one an arc"
            )
        return split(guess, lengths)


@hookimpl
def socp_methods() -> list[type[Method]]:
    """Register the method."""
    return [LgrMultiphase]

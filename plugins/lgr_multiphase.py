"""Legendre-Gauss-Radau collocation on several phases of free lengths, with free controls or along a given word."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, final

from socp import (
    Backend,
    Ipopt,
    Method,
    MethodError,
    Problem,
    Solution,
    Watch,
    Word,
    follow,
    hookimpl,
    option,
    silent,
    single_phase,
    solve_collocated,
    uniform,
)  # fmt: skip
from socp.collocate import Mesh
from socp.guess import arranged, split
from socp.meshing import refined
from socp.phases import PhasedProblem
from socp.schemes import euler, lgr
from socp.simulate import scales, verify
from socp.solution import Stop

_COARSE = 100  # steps of the coarse solve: enough to show the arcs, few enough to cost nothing
_MISSED = 1e-9  # of the re-integrated control: collocation of smooth motion at the default tolerance stays below
_PASSES = 8  # meshes tried; each multiplies the intervals of an arc by up to four


@final
@dataclass(frozen=True)
class LgrMultiphase(Method):
    """Along a word: its laws on every arc, switching times to many digits. Without one: phases of free controls."""

    name: ClassVar[str] = "lgr-multiphase"
    source: ClassVar[str] = "doi:10.3934/dcdsb.2019092, section 4 (GPOPS) and (16)"
    word: str = option("", "arcs by control, such as 'r: + s s s +; f: + + b - -'")
    lengths: str = option("", "rough arc lengths as a guess, such as '0.05 0.6 14 0.1 0.2'; equal where not given")
    phases: int = option(3, "number of phases where there is no word", least=1)
    points: int = option(0, "collocation points an interval; 0 means 40 without a word, 10 with one", least=0)
    intervals: int = option(
        0, "intervals an arc; 0 means one without a word, as many as the tolerance needs with one", least=0
    )
    tolerance: float = option(
        1e-7, "size of the states' last Legendre coefficients, relative, that ends refinement", least=1e-15
    )
    backend: Backend = option(Ipopt({"tol": 1e-11}), "solver of the nonlinear programme")

    def solve(self, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
        """Solve on phases of free lengths; along a word, on meshes that are refined until the states have converged.

        Where the guess leads nowhere along a word, a coarse solve without it gives another.
        """
        if not self.word:
            phased, meshes = single_phase(problem, self.phases), [uniform(lgr(self.points or 40), self.intervals or 1)]
            return solve_collocated(phased, meshes * self.phases, self.backend, self._cut(guess, self.phases), watch)
        word = Word.parse(self.word, problem.control_names)
        phased = follow(problem, word)
        solution = self._along(phased, self._cut(guess, len(phased.phases)), watch)
        if _sound(problem, solution) or solution.stop is Stop.INTERRUPTED:
            return solution
        coarse = solve_collocated(single_phase(problem), [uniform(euler(), _COARSE)], Ipopt(), guess, watch)
        boxed = replace(phased, phases=tuple(replace(phase, boxed=True) for phase in phased.phases))
        again = self._along(boxed, arranged(problem, coarse, word), watch)
        better = again if again.stop.ok or not solution.stop.ok else solution
        return better.after(coarse).after(solution if better is again else again)

    def _along(self, phased: PhasedProblem, guess: Solution, watch: Watch) -> Solution:
        """Solve along a word from one guess."""
        points = self.points or 10
        meshes: Sequence[Mesh] = [uniform(lgr(points), self.intervals or 1)] * len(phased.phases)
        solution = solve_collocated(phased, meshes, self.backend, guess, watch)
        tolerance = self.tolerance
        for _ in range(0 if self.intervals else _PASSES):
            if not _sound(phased.of, solution):
                break
            finer = refined(solution.arcs, scales(phased.of, solution), points, tolerance)
            if finer is None:
                if verify(phased.of, solution)[0].worst <= _MISSED:
                    break
                tolerance /= 100.0  # where the motion is not smooth the end of an interval is no better than its inside
                continue
            solution = solve_collocated(phased, finer, self.backend, solution, watch).after(solution)
        return solution

    def _cut(self, guess: Solution, count: int) -> Solution:
        if not self.lengths:
            return guess
        try:
            lengths = [float(part) for part in self.lengths.replace(",", " ").split()]
        except ValueError:
            raise MethodError(f"lengths: '{self.lengths}' should be numbers, one an arc") from None
        if len(lengths) != count or min(lengths) <= 0:
            raise MethodError(f"lengths: '{self.lengths}' should be {count} positive numbers, one an arc")
        return split(guess, lengths)


def _sound(problem: Problem, solution: Solution) -> bool:
    """Tell whether the solver is content and the laws stay in the box, which the programme does not impose."""
    low, high = problem.box[0][:, None], problem.box[1][:, None]
    margin = 1e-6 * (high - low)  # beyond the solver's own tolerance
    return solution.stop.ok and all(((arc.u >= low - margin) & (arc.u <= high + margin)).all() for arc in solution.arcs)


@hookimpl
def socp_methods() -> list[type[Method]]:
    """Register the method."""
    return [LgrMultiphase]

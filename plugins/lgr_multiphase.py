"""Legendre-Gauss-Radau collocation on several phases of free lengths, with free controls or along a given word."""

from dataclasses import dataclass
from typing import ClassVar, final

from socp import (
    Backend, Ipopt, Method, MethodError, Problem, Solution, Watch, Word, follow, hookimpl, option, silent, single_phase,
    solve_collocated, uniform,
)  # fmt: skip
from socp.guess import split
from socp.meshing import refined
from socp.schemes import lgr
from socp.simulate import scales

_PASSES = 6  # meshes tried; each multiplies the intervals of an arc by up to four


@final
@dataclass(frozen=True)
class LgrMultiphase(Method):
    """With a word: its laws on every arc, switching times to many digits. Without: phases of free controls, as GPOPS does."""

    name: ClassVar[str] = "lgr-multiphase"
    source: ClassVar[str] = "doi:10.3934/dcdsb.2019092, section 4 (GPOPS) and (16)"
    word: str = option("", "arcs by control, such as 'r: + s s s +; f: + + b - -'")
    lengths: str = option("", "rough arc lengths as a guess, such as '0.05 0.6 14 0.1 0.2'; equal where not given")
    phases: int = option(3, "number of phases where there is no word", least=1)
    points: int = option(0, "collocation points an interval; 0 means 40 without a word, 10 with one", least=0)
    intervals: int = option(0, "intervals an arc; 0 means one without a word, as many as the tolerance needs with one", least=0)
    tolerance: float = option(1e-7, "size of the states' last Legendre coefficients, relative, that ends refinement", least=1e-15)
    backend: Backend = option(Ipopt({"tol": 1e-11}), "solver of the nonlinear programme")

    def solve(self, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
        """Solve on phases of free lengths; along a word the meshes of long arcs are refined until the states have converged."""
        phased = follow(problem, Word.parse(self.word, problem.control_names)) if self.word else single_phase(problem, self.phases)
        points = self.points or (10 if self.word else 40)
        meshes = [uniform(lgr(points), self.intervals or 1)] * len(phased.phases)
        solution = solve_collocated(phased, meshes, self.backend, self._cut(guess, len(meshes)), watch)
        for _ in range(_PASSES if self.word and not self.intervals else 0):
            finer = refined(solution.arcs, scales(problem, solution), points, self.tolerance)
            if finer is None or not solution.stop.ok:
                break
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


@hookimpl
def socp_methods() -> list[type[Method]]:
    """Register the method."""
    return [LgrMultiphase]

"""The default: direct solves show the arcs, their word is solved and mended until the judge certifies it."""

from dataclasses import dataclass, replace
from typing import ClassVar, final

from socp import Backend, Ipopt, Method, Problem, Solution, Watch, hookimpl, option, silent, single_phase, solve_collocated, uniform
from socp.refine import refine
from socp.schemes import euler, radau_iia


@final
@dataclass(frozen=True)
class Auto(Method):
    """No word, no guess: finds the arcs by itself and says whether they are an extremal."""

    name: ClassVar[str] = "auto"
    source: ClassVar[str] = "structure from direct collocation, mended by the minimum principle"
    steps: int = option(100, "steps of the first direct solves", least=10)
    backend: Backend = option(Ipopt(), "solver of the first direct solves")

    def solve(self, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
        """Solve directly on two grids, then refine from each until a word is certified; else return the best found."""
        direct = []
        for mesh in (uniform(radau_iia(2), self.steps // 2), uniform(euler(), 2 * self.steps)):
            found = solve_collocated(single_phase(problem), [mesh], self.backend, guess, watch)
            if found.stop.ok:
                direct.append(found)
        best: Solution | None = None
        for each in sorted(direct, key=lambda solution: solution.objective):
            found, _ = refine(problem, each, watch)
            if found is not None and found.extremal:
                return found
            best = found if best is None else best
        return best if best is not None else direct[0]


@hookimpl
def socp_methods() -> list[type[Method]]:
    """Register the method."""
    return [Auto]

"""Hermite-Simpson on a uniform grid, solved by Ipopt."""

from dataclasses import dataclass
from typing import ClassVar, final

from socp import (
    Backend,
    Ipopt,
    Method,
    Problem,
    Solution,
    Watch,
    hookimpl,
    option,
    silent,
    single_phase,
    solve_collocated,
    uniform,
)
from socp.transcription import hermite_simpson


@final
@dataclass(frozen=True)
class HermiteSimpson(Method):
    """Order 4 where the control is smooth; a control quadratic between the steps, which rings on
    singular arcs.
    """

    name: ClassVar[str] = "hermite-simpson"
    source: ClassVar[str] = (
        "Betts, Practical Methods for Optimal Control Using Nonlinear Programming, 4.6"
    )
    steps: int = option(200, "steps of equal length", least=1)
    backend: Backend = option(Ipopt(), "solver of the nonlinear programme")

    def solve(self, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
        """Solve on one phase."""
        return solve_collocated(
            single_phase(problem),
            [uniform(hermite_simpson(), self.steps)],
            self.backend,
            guess,
            watch,
        )


@hookimpl
def socp_methods() -> list[type[Method]]:
    """Register the method."""
    return [HermiteSimpson]

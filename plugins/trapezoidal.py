"""The trapezoid rule on a uniform grid, solved by Ipopt."""

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
from socp.transcription import trapezoid


@final
@dataclass(frozen=True)
class Trapezoidal(Method):
    """Order 2 with a control linear between the steps; on singular and boundary arcs that control
    rings.
    """

    name: ClassVar[str] = "trapezoidal"
    source: ClassVar[str] = (
        "doi:10.3934/dcdsb.2019092, section 4 (ICLOCS); Betts, Practical Methods, 4.5"
    )
    steps: int = option(400, "steps of equal length", least=1)
    backend: Backend = option(Ipopt(), "solver of the nonlinear programme")

    def solve(self, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
        """Solve on one phase."""
        return solve_collocated(
            single_phase(problem), [uniform(trapezoid(), self.steps)], self.backend, guess, watch
        )


@hookimpl
def socp_methods() -> list[type[Method]]:
    """Register the method."""
    return [Trapezoidal]

"""Implicit Euler on a uniform grid, solved by Ipopt."""

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
from socp.transcription import euler


@final
@dataclass(frozen=True)
class EulerIpopt(Method):
    """Order 1, and the calmest grid: its controls seldom ring. A robust start for sharper
    methods.
    """

    name: ClassVar[str] = "euler-ipopt"
    source: ClassVar[str] = "doi:10.3934/dcdsb.2019092, section 4 (AMPL + IPOPT)"
    steps: int = option(1000, "steps of equal length", least=1)
    backend: Backend = option(Ipopt(), "solver of the nonlinear programme")

    def solve(self, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
        """Solve on one phase."""
        return solve_collocated(
            single_phase(problem), [uniform(euler(), self.steps)], self.backend, guess, watch
        )


@hookimpl
def socp_methods() -> list[type[Method]]:
    """Register the method."""
    return [EulerIpopt]

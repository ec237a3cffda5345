"""Legendre-Gauss-Radau collocation on an hp mesh in one phase, solved by Ipopt."""

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
from socp.transcription import lgr


@final
@dataclass(frozen=True)
class Lgr(Method):
    """Spectral order on smooth arcs; it does not know where the control jumps."""

    name: ClassVar[str] = "lgr"
    source: ClassVar[str] = (
        "Garg et al., Automatica 46 (2010), doi:10.1016/j.automatica.2010.06.048"
    )
    intervals: int = option(40, "intervals of equal length", least=1)
    points: int = option(4, "collocation points an interval", least=1, most=100)
    backend: Backend = option(Ipopt(), "solver of the nonlinear programme")

    def solve(self, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
        """Solve on one phase."""
        return solve_collocated(
            single_phase(problem),
            [uniform(lgr(self.points), self.intervals)],
            self.backend,
            guess,
            watch,
        )


@hookimpl
def socp_methods() -> list[type[Method]]:
    """Register the method."""
    return [Lgr]

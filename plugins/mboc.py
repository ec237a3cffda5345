"""Mixed-binary optimal control: which mode every arc is in, given only how many switches there may
be.
"""

from dataclasses import dataclass
from typing import ClassVar, final

from socp import Backend, Method, Problem, Solution, Watch, hookimpl, option, silent
from socp.search import BoundedSearch
from socp.solvers import default_backend


@final
@dataclass(frozen=True)
class Mboc(Method):
    """Finds the word from a bound on its switches: branch and bound over words, or a mixed-integer
    solver.
    """

    name: ClassVar[str] = "mboc"
    source: ClassVar[str] = "doi:10.3934/dcdsb.2019092, section 3 (MBOC, MBNLP)"
    switches: str = option(
        "auto", "most switches that the word may have, or auto: as few as it takes"
    )
    points: int = option(12, "collocation points an arc during the search", least=2, most=100)
    solver: str = option(
        "search", "search over words, or bonmin, scip, gdpopt, mindtpy, knitro, gurobi"
    )
    time: float = option(60.0, "seconds after which the search gives its best", least=0)
    starts: int = option(
        12, "coarse solves from scattered guesses, at most, to find the best extremal", least=1
    )
    backend: Backend = option(default_backend(), "solver of the nonlinear programmes")

    def solve(self, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
        """Search for a word that the judge certifies; else return the best with what is left open
        in its message.
        """
        search = BoundedSearch(
            self.switches, self.points, self.solver, self.time, self.starts, self.backend
        )
        return search.solve(problem, guess, watch)


@hookimpl
def socp_methods() -> list[type[Method]]:
    """Register the method."""
    return [Mboc]

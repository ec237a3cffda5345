"""A lower bound as it is told."""

from dataclasses import asdict, dataclass, field
from typing import Any, final

import numpy as np

from socp.model import Proof, Rung, Solution
from socp.proof.bound.certificate import Data


@final
@dataclass(frozen=True, kw_only=True)
class LowerBound:
    """A proved lower bound of a problem's optimum with its certificate, or why there is none; the
    last one in hand where the search was interrupted.
    """

    problem: str
    bound: float | None = None
    degree: int = 0
    reason: str = ""
    region: tuple[str, ...] = ()
    certificate: Data = field(default_factory=dict, repr=False)
    seconds: float = 0.0
    interrupted: bool = False

    def gap(self, solution: Solution) -> float | None:
        """Return how far the optimum may be below a solution's objective, over its magnitude; None
        where either is missing.
        """
        if self.bound is None or not np.isfinite(solution.objective):
            return None
        size = max(abs(solution.objective), float(np.finfo(float).tiny))
        return (solution.objective - self.bound) / size

    def rungs(self, solution: Solution) -> tuple[Proof, ...]:
        """Return what it proves of a solution as rungs of the ladder, none where it fails."""
        gap = self.gap(solution)
        if gap is None:
            return ()
        statement = (
            f"within {100 * gap:.2g} %: no control is below {self.bound:.10g}, degree "
            f"{self.degree}, checked in fractions"
        )
        return (Proof(rung=Rung.GLOBAL, margin=gap, statement=statement),)

    @property
    def data(self) -> dict[str, Any]:
        """The bound as plain values, without its certificate."""
        found = {"proved": self.bound is not None, **asdict(self)}
        return {key: value for key, value in found.items() if key != "certificate"}

    @property
    def lines(self) -> list[tuple[str, str]]:
        """The bound as lines of a report: labels and texts."""
        if self.bound is None:
            return [("no bound", self.reason)]
        return [
            ("proved", f"no admissible control has a lower objective than {self.bound:.10g}"),
            ("region", ", ".join(self.region) or "every state"),
            ("subsolution", f"degree {self.degree}, {self.seconds:.1f} s"),
            ("arithmetic", "sums of squares, checked in fractions"),
        ]

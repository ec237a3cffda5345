"""How near a solution that is no extremal is to one."""

from dataclasses import dataclass
from typing import final

# of the largest curvature along a singular arc: against it by more than the noise of a good grid
AGAINST = 1e-2


@final
@dataclass(frozen=True, kw_only=True)
class Grade:
    """How far the objective is from that of the extremal nearby (`socp.verdict.grading.grade`).

    In its units, `error`: of the objective, as returned and as reached; `objective`: that of the
    Lagrangian; `gain`: what better controls would gain; `dynamics`, `ends`, `path`: multipliers
    times what is missed of these; `size`: the magnitude of its terms. `curvature`, relative: the
    Legendre-Clebsch expression at its worst on singular arcs that are no switches.
    """

    objective: float
    error: float
    gain: float
    dynamics: float
    ends: float
    path: float
    size: float
    curvature: float

    @property
    def curved(self) -> bool:
        """Whether no singular arc is clearly of the wrong curvature."""
        return self.curvature >= -AGAINST

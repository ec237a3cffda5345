"""Records of a solution: how feasible it is, what a search tried, how far two computations of it agree."""

from dataclasses import dataclass
from typing import final

import numpy as np


@final
@dataclass(frozen=True, kw_only=True)
class Feasibility:
    """What an independent integration of the returned control says.

    Every figure is relative to the problem's own magnitudes (see `socp.simulate.sizes`), which no returned state
    enlarges. `miss`: worst violation of start, end and target conditions by the re-integrated end point, at the
    condition `miss_at`; `path`: worst violation of a state constraint along the way, at `path_at`; `box`: worst
    violation of a control bound; `drift`: largest distance between the re-integrated and the returned states, at any
    node; `gap`: distance between the re-integrated and the returned objective. `feedback` tells whether laws were
    integrated as feedback (True) or the control as a function of time (False). `end` is the re-integrated final state
    (nx,) and `objective` the re-integrated objective, in the problem's units; nan where it is not known. `error` holds
    the reason where the integration broke down.
    """

    miss: float
    miss_at: str
    path: float
    path_at: str
    box: float
    drift: float
    feedback: bool
    end: tuple[float, ...] = ()
    error: str = ""
    objective: float = float("nan")
    gap: float = 0.0

    @property
    def off(self) -> float:
        """Largest of all figures: the violations, and how far the motion and its objective are from what is claimed."""
        figures = (self.worst, self.drift, self.gap)
        return float("inf") if np.isnan(figures).any() else max(figures)

    @property
    def off_at(self) -> str:
        """What the largest figure is of, as text."""
        found = {
            f"end condition {self.miss_at}": self.miss, f"state constraint {self.path_at}": self.path,
            "box of the controls": self.box, "states other than the returned ones": self.drift,
            f"objective {self.objective:.6g}, not the returned one": self.gap,
        }  # fmt: skip
        return self.error or max(found, key=lambda what: np.inf if np.isnan(found[what]) else found[what])

    @property
    def worst(self) -> float:
        """Largest of the violations, infinite where the integration broke down."""
        figures = (self.miss, self.path, self.box)
        return float("inf") if self.error or np.isnan(figures).any() else max(figures)


@final
@dataclass(frozen=True, kw_only=True)
class Node:
    """One node of a search over words: what was tried and what came of it; nan where it is not known.

    `bound` is a proved lower bound of the objective, `miss` and `residual` those of the node's verdict.
    """

    word: str
    stop: str
    objective: float = float("nan")
    bound: float = float("nan")
    miss: float = float("nan")
    residual: float = float("nan")


@final
@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How far two computations of a solution are apart: objective, relative, and switching times, in the time's units.

    They differ in the mesh alone, or in method: a solver's tolerance says nothing of either.
    """

    objective: float
    switches: float

    @property
    def digits(self) -> int:
        """Significant digits of the objective on which they agree, 15 at most."""
        return int(np.clip(-np.log10(max(self.objective, 1e-15)), 0, 15))

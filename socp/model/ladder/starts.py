"""From how many starts a solution is the best, and what else was met on the way to it."""

from dataclasses import dataclass
from typing import final


@final
@dataclass(frozen=True, kw_only=True)
class Met:
    """A local solution that a search met beside the one that it returned: its objective, its word
    where it is a certified extremal, and in how many starts.
    """

    objective: float
    word: str = ""
    starts: int = 1


@final
@dataclass(frozen=True, kw_only=True)
class Starts:
    """How many coarse solves a search began with, `tried`, the local solutions in which they ended,
    by the objectives of their coarse grid, best first, and the `extremals` that were certified on
    the way, other than the one returned; `better` is the objective of a feasible point that is
    clearly better and that nothing certified, None where there was none.
    """

    tried: int
    coarse: tuple[Met, ...] = ()
    extremals: tuple[Met, ...] = ()
    better: float | None = None

    @property
    def ended(self) -> int:
        """How many of them ended in a local solution."""
        return sum(each.starts for each in self.coarse)

"""What the second order says of an extremal: which kind of minimum it is, how clearly, or what
lowers it.
"""

from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any, final


class Minimum(Enum):
    """What the second order shows of an extremal, the strongest claim first; the value is the
    sentence shown to the user.
    """

    STRONG = "strict strong local minimum"
    WORD = "strict local minimum among controls of this word"
    DEGENERATE = "degenerate: the second order decides nothing"
    NONE = "no local minimum"
    UNTESTED = "second order not tested"

    @property
    def shown(self) -> bool:
        """Whether it is a minimum, if only among controls of its word."""
        return self in {Minimum.STRONG, Minimum.WORD}


@final
@dataclass(frozen=True, kw_only=True)
class Curvature:
    """The least eigenvalue of a second variation, and how far it may be off.

    Both are in units of the objective, for changes of norm 1: times are measured in horizons,
    parameters and states in their magnitudes. `free` is the number of directions that the
    conditions leave free, 0 where there is nothing to test.
    """

    least: float
    error: float
    free: int

    @property
    def positive(self) -> bool:
        """Whether it is above zero by more than it may be off; where nothing is free it is."""
        return self.free == 0 or self.least > self.error

    @property
    def negative(self) -> bool:
        """Whether it is below zero by more than it may be off."""
        return self.free > 0 and self.least < -self.error


@final
@dataclass(frozen=True, kw_only=True)
class Descent:
    """A change of an extremal that lowers its objective, as a simulation of the changed control
    found.

    `times` (arcs + 1,) are the changes of the initial time, the times between the arcs and the
    final time, `parameters` those of the parameters, in the problem's units; `predicted` and
    `found` are the changes of the objective by the second order and by re-integration.
    """

    times: tuple[float, ...]
    parameters: tuple[float, ...]
    predicted: float
    found: float


@final
@dataclass(frozen=True, kw_only=True)
class SecondOrder:
    """What the second order says of an extremal.

    - kind: the strongest claim whose every hypothesis was checked; theorem: its name, where the
      claim goes beyond the word;
    - word: curvature over the arc lengths, times, parameters and free initial states of the word;
    - singular: curvature with the singular controls free as well, after Goh's transformation, where
      it settled;
    - margin: of bang arcs alone, how many times over what is told from zero switching functions
      and their slopes at switches are, where they are least: the strong claim asks for more than 1;
    - limits: why no more is claimed, a reason a line;
    - descent: what lowers the objective, where it is no minimum.
    """

    kind: Minimum
    theorem: str = ""
    word: Curvature | None = None
    singular: Curvature | None = None
    margin: float | None = None
    limits: tuple[str, ...] = ()
    descent: Descent | None = None

    @property
    def data(self) -> dict[str, Any]:
        """All of it as plain values, the kind by its name, as result files hold it."""
        return {**asdict(self), "kind": self.kind.name}

"""The ladder: what can be said of a solution, from no point at all to a strong local minimum, each
rung with the figure that decides it.
"""

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, final

from socp.model.ladder.second_order import Minimum
from socp.model.tolerances import APPROXIMATE, EXTREMAL, FEASIBLE

if TYPE_CHECKING:
    from socp.model.findings import Verdict


class Rung(Enum):
    """The rungs from below; the value is what a report calls it."""

    INFEASIBLE = "not feasible"
    FEASIBLE = "feasible"
    APPROXIMATE = "approximately extremal"
    EXTREMAL = "extremal"
    WORD = "strict local minimum among controls of its word"
    STRONG = "strict strong local minimum"

    @property
    def height(self) -> int:
        """Its place from below, 0 for the lowest."""
        return list(Rung).index(self)


@final
@dataclass(frozen=True, kw_only=True)
class Step:
    """A rung with what decides it: `figure` is at most `allowed` where it holds, or, of a
    curvature, above it; None where nothing of it was worked out, for the reason in `why`.
    """

    rung: Rung
    holds: bool
    figure: float | None = None
    allowed: float | None = None
    why: str = ""


def rung_of(verdict: "Verdict | None") -> Rung:
    """Return the highest rung that a verdict reaches; the lowest where nobody judged."""
    if verdict is None or not verdict.feasible:
        return Rung.INFEASIBLE
    if not verdict.extremal:
        return Rung.APPROXIMATE if verdict.approximate else Rung.FEASIBLE
    known = {Minimum.WORD: Rung.WORD, Minimum.STRONG: Rung.STRONG}
    found = verdict.second_order
    return Rung.EXTREMAL if found is None else known.get(found.kind, Rung.EXTREMAL)


def ladder_steps(verdict: "Verdict") -> tuple[Step, ...]:
    """Return the rungs above the lowest with what decides each, from below."""
    height, found, grade = rung_of(verdict).height, verdict.second_order, verdict.grade
    curved = None if found is None else found.word
    free = curved is not None and curved.free > 0
    limits = "; ".join(() if found is None else found.limits)
    of_word = "" if free and height >= Rung.WORD.height else limits
    steps = [
        Step(rung=Rung.FEASIBLE, holds=verdict.feasible, figure=verdict.miss, allowed=FEASIBLE),
        Step(
            rung=Rung.EXTREMAL,
            holds=verdict.extremal,
            figure=verdict.residual if verdict.findings else None,
            allowed=EXTREMAL,
            why="; ".join(verdict.reasons[:1]),
        ),
        Step(
            rung=Rung.WORD,
            holds=height >= Rung.WORD.height,
            figure=curved.least if curved and free else None,
            allowed=curved.error if curved and free else None,
            why="no direction is free" if curved and not free else of_word,
        ),
        Step(
            rung=Rung.STRONG,
            holds=height >= Rung.STRONG.height,
            why=found.theorem if found and found.theorem else limits,
        ),
    ]
    if grade is not None:
        allowed = APPROXIMATE * grade.size
        near = Step(
            rung=Rung.APPROXIMATE, holds=verdict.approximate, figure=grade.error, allowed=allowed
        )
        steps.insert(1, near)
    return tuple(steps)

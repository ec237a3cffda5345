"""What a solve came to: an answer or none, and which."""

from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from socp.model import Solution


class Outcome(Enum):
    """What a solve came to; the value is the sentence shown to the user."""

    EXTREMAL = "an answer: an extremal, certified"
    NO_MINIMUM = "no answer: an extremal, but no local minimum"
    APPROXIMATE = "an answer: approximately extremal, not certified"
    FEASIBLE = "an answer: a feasible point, not certified as an extremal"
    LIMIT = "no answer: the solver reached its limit of iterations or time"
    INFEASIBLE = "no answer: the solver found no point that satisfies the problem's conditions"
    MISSED = (
        "no answer: re-integrated, the control misses the problem's conditions; try a finer grid"
    )
    FAILED = "no answer: the solver failed"
    INTERRUPTED = "no answer: interrupted"

    @property
    def answer(self) -> bool:
        """Whether there is a point that can be used."""
        return self in {Outcome.EXTREMAL, Outcome.APPROXIMATE, Outcome.FEASIBLE}


def outcome_of(solution: "Solution") -> Outcome | None:
    """Return what a solve came to, by the judge's re-integration first and the solver's own word
    second; None where nobody judged it.
    """
    verdict, stop = solution.verdict, solution.stop
    if stop.name == "INTERRUPTED":
        return Outcome.INTERRUPTED
    if verdict is None:
        return None
    if verdict.extremal:
        lowered = verdict.second_order is not None and verdict.second_order.descent is not None
        return Outcome.NO_MINIMUM if lowered else Outcome.EXTREMAL
    if not stop.ok:
        return {"LIMIT": Outcome.LIMIT, "INFEASIBLE": Outcome.INFEASIBLE}.get(
            stop.name, Outcome.FAILED
        )
    if verdict.approximate:
        return Outcome.APPROXIMATE
    return Outcome.FEASIBLE if verdict.feasible else Outcome.MISSED


def infeasible(solution: "Solution") -> bool:
    """Tell whether a solution was judged and does not satisfy its conditions: its objective and
    word mean nothing.
    """
    return solution.verdict is not None and not solution.verdict.feasible

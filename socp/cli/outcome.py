"""What a solve came to: an answer or none, and which; the exit code of `socp solve` follows from
it.
"""

from enum import Enum
from typing import TYPE_CHECKING

from socp.cli.session import Exit

if TYPE_CHECKING:
    from socp.model import Problem, Solution

_NOTHING = 1e-12  # share of the horizon below which an initial time is 0


class Outcome(Enum):
    """What a solve came to; the value is the sentence shown to the user."""

    EXTREMAL = "an answer: an extremal, certified"
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
        return self in {Outcome.EXTREMAL, Outcome.FEASIBLE}

    def code(self, *, strict: bool = False) -> Exit:
        """Return the exit code; a strict one takes nothing below an extremal for an answer."""
        if self is Outcome.INTERRUPTED:
            return Exit.INTERRUPTED
        good = self is Outcome.EXTREMAL if strict else self.answer
        return Exit.SOLVED if good else Exit.UNSOLVED


def outcome(solution: "Solution") -> Outcome:
    """Return what a solve came to, by the judge's re-integration first and the solver's own word
    second.
    """
    verdict, stop = solution.verdict, solution.stop
    if verdict is None or stop.name == "INTERRUPTED":
        return Outcome.INTERRUPTED
    if verdict.extremal:
        return Outcome.EXTREMAL
    if stop.name == "LIMIT":
        return Outcome.LIMIT
    if stop.name == "INFEASIBLE":
        return Outcome.INFEASIBLE
    if not stop.ok:
        return Outcome.FAILED
    return Outcome.FEASIBLE if verdict.feasible else Outcome.MISSED


def infeasible(solution: "Solution") -> bool:
    """Tell whether a solution was judged and does not satisfy its conditions: its objective and
    word mean nothing.
    """
    return solution.verdict is not None and not solution.verdict.feasible


def objective(solution: "Solution") -> tuple[str, ...]:
    """Return the objective for a report; that of an infeasible point is none."""
    if not infeasible(solution):
        return solution.headline
    own = f"{solution.objective:.12g}"
    none = "none: the point is infeasible" + ("" if own == "nan" else f" (its value {own})")
    return (none, solution.headline[0]) if len(solution.headline) > 1 else (none,)


def initial_time(solution: "Solution") -> float:
    """Return the initial time, 0 where it is rounding."""
    t0, horizon = solution.initial_time, abs(solution.final_time - solution.initial_time)
    return 0.0 if abs(t0) <= _NOTHING * horizon else t0


def final_time(problem: "Problem", solution: "Solution") -> str:
    """Return the final time for a report; one that is fixed is that of the problem, whatever was
    reached.
    """
    low, high = problem.final_time_box
    reached = solution.final_time
    if not infeasible(solution):
        return f"{reached:.12g}"
    if low == high:
        short = abs(reached - low) > 1e-9 * max(
            abs(low), 1.0
        )  # as printed, with some digits to spare
        return f"{low:.12g}" + (f" (not reached: the point ends at {reached:.6g})" if short else "")
    return f"none: the point is infeasible (its value {reached:.12g})"

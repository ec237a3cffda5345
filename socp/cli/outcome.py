"""The exit code of `socp solve`, which follows from what the solve came to."""

from typing import TYPE_CHECKING

from socp.cli.session import Exit
from socp.view import Outcome, outcome_of

if TYPE_CHECKING:
    from socp.model import Solution

UNJUDGED = Outcome.INTERRUPTED  # a command judges what it solved unless it is interrupted


def outcome(solution: "Solution") -> Outcome:
    """Return what a solve came to."""
    return outcome_of(solution) or UNJUDGED


def code(came_to: Outcome, *, strict: bool = False) -> Exit:
    """Return the exit code; a strict one takes nothing below an extremal for an answer."""
    if came_to is Outcome.INTERRUPTED:
        return Exit.INTERRUPTED
    good = came_to is Outcome.EXTREMAL if strict else came_to.answer
    return Exit.SOLVED if good else Exit.UNSOLVED

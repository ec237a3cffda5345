"""The exit code of `socp solve`, which follows from what the solve came to."""

from typing import TYPE_CHECKING

import click

from socp.cli.session import Exit
from socp.view import Outcome, outcome_of

if TYPE_CHECKING:
    from socp.model import Solution

# the rungs by their names that some command can show of a result
REQUIRED = ("feasible", "approximate", "extremal", "word", "strong", "best")
UNJUDGED = Outcome.INTERRUPTED  # a command judges what it solved unless it is interrupted


def outcome(solution: "Solution") -> Outcome:
    """Return what a solve came to."""
    return outcome_of(solution) or UNJUDGED


require_option = click.option(
    "--require",
    metavar="RUNG",
    type=click.Choice(REQUIRED),
    help="Exit code 0 if the result reaches this rung or one that stands on it, else 1: "
    f"{', '.join(REQUIRED)}.",
)


def required_rung(solution: "Solution", required: str) -> bool:
    """Tell whether a solution reaches a rung, by its name, or one that stands on it."""
    from socp.model import Rung, reaches

    return reaches(solution, Rung[required.upper()])


def code(solution: "Solution", *, strict: bool = False, required: str | None = None) -> Exit:
    """Return the exit code: by the rung that is required, where one is; a strict one takes nothing
    below an extremal for an answer.
    """
    came_to = outcome(solution)
    if came_to is Outcome.INTERRUPTED:
        return Exit.INTERRUPTED
    good = came_to is Outcome.EXTREMAL if strict else came_to.answer
    if required is not None:
        good = required_rung(solution, required)
    return Exit.SOLVED if good else Exit.UNSOLVED

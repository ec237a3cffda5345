"""The exit code of `socp solve`, which follows from what the solve came to."""

from typing import TYPE_CHECKING

import click

from socp.cli.session import Exit
from socp.view import Outcome, outcome_of

if TYPE_CHECKING:
    from socp.model import Solution

REQUIRED = ("feasible", "approximate", "extremal", "word", "strong")  # rungs by their names
UNJUDGED = Outcome.INTERRUPTED  # a command judges what it solved unless it is interrupted


def outcome(solution: "Solution") -> Outcome:
    """Return what a solve came to."""
    return outcome_of(solution) or UNJUDGED


require_option = click.option(
    "--require",
    metavar="RUNG",
    type=click.Choice(REQUIRED),
    help="Exit code 0 if the result reaches this rung or a higher one, else 1: "
    f"{', '.join(REQUIRED)}.",
)


def reaches(solution: "Solution", required: str) -> bool:
    """Tell whether a solution reaches a rung, by its name, or a higher one."""
    from socp.model import Rung, rung_of

    return rung_of(solution.verdict).height >= Rung[required.upper()].height


def code(solution: "Solution", *, strict: bool = False, required: str | None = None) -> Exit:
    """Return the exit code: by the rung that is required, where one is; a strict one takes nothing
    below an extremal for an answer.
    """
    came_to = outcome(solution)
    if came_to is Outcome.INTERRUPTED:
        return Exit.INTERRUPTED
    good = came_to is Outcome.EXTREMAL if strict else came_to.answer
    if required is not None:
        good = reaches(solution, required)
    return Exit.SOLVED if good else Exit.UNSOLVED

"""Problems as a command was given them: loaded, with the numbers that `--set` changes."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import click

from socp.cli.options import pairs
from socp.errors import MethodError, ProblemError
from socp.process import short
from socp.registry import Registry, load_problem

if TYPE_CHECKING:
    from socp.model import Problem

set_option = click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="NAME=VALUE",
    help="Change a number: a constant, start.x, end.x, bounds.u.upper, final_time. VALUE is a "
    "number, LOWER,UPPER or free.",
)


def load_posed(given: str, changes: Sequence[str], registry: Registry) -> "Problem":
    """Return the problem of a path or a name, with changes NAME=VALUE.

    Raises ProblemError where it cannot be loaded, MethodError for a change that names nothing or
    that leaves no problem.
    """
    problem = load_problem(given, registry)
    named = pairs(changes, "--set", "start.x=30")
    if not named:
        return problem
    try:
        return problem.with_({name: _value(name, text) for name, text in named})
    except ProblemError as error:
        raise MethodError(f"--set: {error}") from error


def _value(name: str, text: str) -> Any:
    """Return a number, or an interval; MethodError for a text that is neither."""
    from socp.model import free

    if text.lower() == "free":
        return free
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) not in {1, 2}:
        raise MethodError(f"--set {short(name)}={short(text)}: give a number, LOWER,UPPER or free")
    return numbers[0] if len(numbers) == 1 else numbers

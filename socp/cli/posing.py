"""Problems as a command was given them: loaded, with the numbers that `--set` changes."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import click
from rich.text import Text

from socp.cli.options import pairs
from socp.errors import MethodError, ProblemError
from socp.process import file_stem, one_line, short
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
    return with_changes(load_problem(given, registry), changes)


@final
@dataclass(frozen=True)
class Named:
    """A problem by path or name, for worker processes, which load it themselves."""

    given: str
    changes: tuple[str, ...]

    def __call__(self) -> "Problem":
        """Load the problem."""
        return load_posed(self.given, self.changes, Registry.load(only=()))


def with_changes(problem: "Problem", changes: Sequence[str], option: str = "--set") -> "Problem":
    """Return a problem with changes NAME=VALUE of an option; MethodError as above."""
    named = told(changes, option)
    if not named:
        return problem
    try:
        return problem.with_({name: _value(name, text, option) for name, text in named.items()})
    except ProblemError as error:
        raise MethodError(f"{option}: {error}") from error


def span_of(changes: Sequence[str]) -> tuple[str, tuple[float, float], tuple[str, ...]]:
    """Return the number that is set to a range FROM:TO, by name, the range, and the other changes;
    MethodError where there is not one of them.
    """
    spans = {name: text for name, text in told(changes).items() if ":" in text}
    if len(spans) != 1:
        raise MethodError(
            f"--set NAME=FROM:TO: {len(spans)} numbers have a range; give one, such as "
            "--set start.x=30:40"
        )
    ((name, text),) = spans.items()
    try:
        first, last = map(float, text.split(":"))
    except ValueError:
        raise MethodError(f"--set {short(name)}={short(text)}: give FROM:TO, two numbers") from None
    others = tuple(f"{n}={text}" for n, text in told(changes).items() if n != name)
    return name, (first, last), others


def ranges_of(changes: Sequence[str]) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return the numbers that take several values, by name, LO:HI:N or a distribution each, and the
    other changes. A distribution may follow its name after a tilde.
    """
    spelt = [
        text if "=" in text.partition("~")[0] else text.replace("~", "=", 1) for text in changes
    ]
    named = told(spelt)
    ranges = {name: text for name, text in named.items() if ":" in text or "(" in text}
    return ranges, tuple(f"{n}={text}" for n, text in named.items() if n not in ranges)


def told(changes: Sequence[str], option: str = "--set") -> dict[str, str]:
    """Return what is set, by name, as it was written; MethodError for a name given twice."""
    found: dict[str, str] = {}
    for name, text in pairs(changes, option, "start.x=30"):
        if name in found:
            raise MethodError(f"{option} {short(name)} is given twice")
        found[name] = text
    return found


def told_line(changes: Sequence[str]) -> list[Text]:
    """Return the line of a report that says what was set, none where nothing was."""
    set_ = ", ".join(f"{name}={text}" for name, text in told(changes).items())
    return [Text(one_line(f"set  {set_}"))] if set_ else []


def named_after(problem: str, ending: str, changes: Sequence[str] = ()) -> Path:
    """Return the path of a file in the current folder that is named after a problem, and after what
    is set: results of other numbers are other files.
    """
    numbers = "".join(f".{name}={text}" for name, text in told(changes).items())
    if len(numbers) > _LONGEST:
        numbers = f".{hashlib.sha256(numbers.encode()).hexdigest()[:8]}"
    return Path(f"{file_stem(problem + numbers)}{ending}")


_LONGEST = 60  # characters of numbers in a file's name: people read no more


def _value(name: str, text: str, option: str) -> Any:
    """Return a number, or an interval; MethodError for a text that is neither."""
    from socp.model import free

    if text.lower() == "free":
        return free
    try:
        numbers = tuple(float(part) for part in text.split(","))
    except ValueError:
        numbers = ()
    if len(numbers) not in {1, 2}:
        raise MethodError(
            f"{option} {short(name)}={short(text)}: give a number, LOWER,UPPER or free"
        )
    return numbers[0] if len(numbers) == 1 else numbers

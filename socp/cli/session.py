"""What the commands share: the two consoles, the options given before the command, and its exit
codes.
"""

import contextlib
import json
import math
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

from socp.cli.streams import current, say
from socp.errors import MethodError
from socp.process import one_line, printable, short

if TYPE_CHECKING:  # help needs none of them
    from rich.console import Console, RenderableType
    from rich.text import Text

    from socp.registry import Registry

_TEMPORARY = ".12345678.part"  # what a file's name is followed by while it is written
_PIPED = 200  # columns of what is not read on a terminal


class Exit(IntEnum):
    """Exit codes; `socp --help` explains them."""

    SOLVED = 0
    UNSOLVED = 1
    USAGE = 2
    LOADING = 3
    INTERNAL = 4
    LACKING = 5
    HUNG_UP = 129
    INTERRUPTED = 130
    CLOSED = 141
    TERMINATED = 143


@final
@dataclass
class Session:
    """One run of the command line; the options before the command are put here."""

    debug: bool = False
    without: tuple[str, ...] = ()
    quiet: bool = False
    written: list[Path] = field(default_factory=list)

    def registry(self, *, plugins: bool = True) -> "Registry":
        """Load the registry, with or without its plugins, and say on stderr what is wrong with
        it.
        """
        from socp.registry import Registry

        registry = Registry.load(only=None if plugins else (), without=self.without)
        for line in registry.warnings:
            self.warn(line)
        return registry

    def complain(self, registry: "Registry") -> None:
        """Warn of plugins that failed: what they offer is missing from what follows."""
        for failure in registry.failures:
            self.warn(f"{failure.name} of {failure.package} is left out: {failure.reason}")

    def warn(self, text: str) -> None:
        """Write a warning on stderr, unless quiet."""
        from rich.text import Text

        if not self.quiet:
            messages().print(Text.assemble(("warning: ", "bold yellow"), text), soft_wrap=True)

    def note(self, text: str) -> None:
        """Write a message on stderr, unless quiet."""
        if not self.quiet:
            messages().print(text, markup=False, soft_wrap=True)

    def tell(self, path: Path) -> None:
        """Write the path of a file that was written, as it is; on a terminal with its control
        characters escaped.
        """
        self.written.append(path)
        say(printable(path) if results().is_terminal else str(path))


def writable(path: Path, option: str = "--out", *, replaced: bool = True) -> Path:
    """Return a path that can be written; MethodError says before the solve, not after it, why one
    cannot.

    `replaced`: the file is put in the place of one that is there, which must not happen to a device
    or a pipe.
    """
    folder = path.parent
    try:
        # these never raise
        there = os.path.exists(path)  # noqa: PTH110
        regular, directory = os.path.isfile(path), os.path.isdir(path)  # noqa: PTH112, PTH113
        if not directory:
            _nameable(path)
    except (OSError, ValueError) as error:
        text = error.strerror or error if isinstance(error, OSError) else error
        raise MethodError(f"{option} {short(str(path))}: {text}; give another name") from error
    if directory:
        raise MethodError(f"{option} {path}: is a directory; name a file in it")
    if replaced and there and not regular:
        raise MethodError(
            f"{option} {path}: is no regular file, which alone can be replaced; name another"
        )
    if not folder.is_dir():
        raise MethodError(f"{option} {path}: there is no directory {folder}")
    if not os.access(folder, os.W_OK):
        raise MethodError(
            f"{option} {path}: directory {folder.resolve()} cannot be written; name a file "
            "elsewhere"
        )
    return path


def _nameable(path: Path) -> None:
    """Raise what the system raises for a name that it does not take, such as one too long."""
    with contextlib.suppress(FileNotFoundError, NotADirectoryError, PermissionError):
        path.with_name(path.name + _TEMPORARY).lstat()


def results() -> "Console":
    """Return a console that renders as standard output would, without writing there."""
    from socp.cli.consoles import Shadow, console

    streams = current()
    return console(Shadow(sys.stdout if streams is None else streams.report), piped=_PIPED)


def messages() -> "Console":
    """Return the console of progress and messages: standard error."""
    from socp.cli.consoles import console

    streams = current()
    return console(sys.stderr if streams is None else streams.messages)


def heading(name: str, title: str) -> "Text":
    """Return the first line of what is said about something."""
    from rich.text import Text

    return Text.assemble((one_line(name), "bold cyan"), f"  {one_line(title)}" if title else "")


def show(*parts: "RenderableType") -> None:
    """Write results on standard output, without the blanks that fill their lines."""
    shown = results()
    with shown.capture() as captured:
        shown.print(*parts, sep="\n", crop=False)
    say("\n".join(line.rstrip() for line in captured.get().split("\n")).rstrip("\n"))


def write_json(value: Any) -> None:
    """Write a value as strict JSON on standard output; what is not finite becomes null."""
    say(json.dumps(_plain(value), indent=1, allow_nan=False))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value

"""What the commands share: the two consoles, the options given before the command, and its exit codes."""

import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any, final

import click
from rich.console import Console, RenderableType
from rich.text import Text

from socp.errors import MethodError
from socp.registry import Registry

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

    def registry(self, *, plugins: bool = True) -> Registry:
        """Load the registry, with or without its plugins, and say on stderr what is wrong with it."""
        registry = Registry.load(only=None if plugins else (), without=self.without)
        for line in registry.warnings:
            self.warn(line)
        return registry

    def complain(self, registry: Registry) -> None:
        """Warn of plugins that failed: what they offer is missing from what follows."""
        for failure in registry.failures:
            self.warn(f"{failure.name} of {failure.package} is left out: {failure.reason}")

    def warn(self, text: str) -> None:
        """Write a warning on stderr, unless quiet."""
        if not self.quiet:
            messages().print(Text.assemble(("warning: ", "bold yellow"), text), soft_wrap=True)

    def note(self, text: str) -> None:
        """Write a message on stderr, unless quiet."""
        if not self.quiet:
            messages().print(Text(text), soft_wrap=True)


def writable(path: Path, option: str = "--out") -> Path:
    """Return a path that can be written; MethodError says before the solve, not after it, why one cannot."""
    folder = path.parent
    if path.is_dir():
        raise MethodError(f"{option} {path}: is a directory; name a file in it")
    if not folder.is_dir():
        raise MethodError(f"{option} {path}: there is no directory {folder}")
    if not os.access(folder, os.W_OK):
        raise MethodError(f"{option} {path}: directory {folder.resolve()} cannot be written; name a file elsewhere")
    return path


def results() -> Console:
    """Return the console of results: standard output."""
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=_PIPED)


def messages() -> Console:
    """Return the console of progress and messages: standard error."""
    return Console(stderr=True, highlight=False)


def heading(name: str, title: str) -> Text:
    """Return the first line of what is said about something."""
    return Text.assemble((name, "bold cyan"), f"  {title}" if title else "")


def show(*parts: RenderableType) -> None:
    """Write results on standard output, without the blanks that fill their lines."""
    console = results()
    with console.capture() as captured:
        console.print(*parts, sep="\n")
    click.echo("\n".join(line.rstrip() for line in captured.get().splitlines()), color=console.is_terminal)


def write_json(value: Any) -> None:
    """Write a value as strict JSON on standard output; what is not finite becomes null."""
    click.echo(json.dumps(_plain(value), indent=1, allow_nan=False))


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _plain(each) for key, each in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(each) for each in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value

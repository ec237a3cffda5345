"""Consoles that show text as it is: no markup, no control characters but their own, and room to write in."""

import io
import os
from collections.abc import Iterator, Mapping
from typing import TextIO, final

from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderHook
from rich.segment import Segment

from socp.printable import printable

_NARROW = 20  # columns: tables with fewer are unreadable, and such a width is a mistake or no terminal's


def console(file: TextIO | None, piped: int | None = None) -> Console:
    """Return a console on a file, nowhere for None; `piped` is its width where it is no terminal."""
    made = _console(file)
    if not made.is_terminal and piped is not None:
        return _console(file, piped)
    return made if made.width >= _NARROW else _console(file, _NARROW)


def _console(file: TextIO | None, width: int | None = None) -> Console:
    made = Console(
        file=file or io.StringIO(), width=width, highlight=False, markup=False, emoji=False, _environ=_environment()
    )  # fmt: skip
    made.push_render_hook(Escaping())
    return made


def _environment() -> Mapping[str, str]:
    """Return the environment without a size of the terminal that none can have."""
    sizes = {"COLUMNS": _NARROW, "LINES": 1}

    def fits(name: str, value: str) -> bool:
        return name not in sizes or (value.isascii() and value.isdigit() and sizes[name] <= int(value) < 10_000)

    return {name: value for name, value in os.environ.items() if fits(name, value)}


@final
class Escaping(RenderHook):
    """What a console does with all that it is to show: control characters in its text become escapes."""

    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        """Return what is shown in place of some renderables."""
        return [_Escaped(each) for each in renderables]


@final
class _Escaped:
    def __init__(self, inner: ConsoleRenderable) -> None:
        self.inner = inner

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Segment]:
        for segment in console.render(self.inner, options):
            yield segment if segment.control else Segment(printable(segment.text), segment.style)

"""Consoles that show text as it is: no markup, no control characters but their own, and room to
write in.
"""

import io
import os
from collections.abc import Iterator, Mapping
from typing import TextIO, final

from rich.console import Console, ConsoleOptions, ConsoleRenderable, RenderableType, RenderHook
from rich.segment import Segment

from socp.process import printable

_NARROW = (
    20  # columns: tables with fewer are unreadable, and such a width is a mistake or no terminal's
)


def console(file: TextIO | None, piped: int | None = None) -> Console:
    """Return a console on a file, nowhere for None; `piped` is its width where it is no
    terminal.
    """
    made = _console(file)
    if not made.is_terminal and piped is not None:
        return _console(file, piped)
    return _console(file, max(_width(file) or made.width, _NARROW))


def _console(file: TextIO | None, width: int | None = None) -> Console:
    made = Console(
        file=file or io.StringIO(),
        width=width,
        highlight=False,
        markup=False,
        emoji=False,
        _environ=_environment(),
    )
    made.push_render_hook(Escaping())
    return made


def _width(file: TextIO | None) -> int | None:
    """Return the width of the terminal that a file is, None where COLUMNS says it or nothing is
    known.

    Rich asks the standard descriptors, of which the second is not the file's own while a command
    runs.
    """
    if file is None or "COLUMNS" in _environment():
        return None
    try:
        return os.get_terminal_size(file.fileno()).columns or None
    except (OSError, ValueError):
        return None


def _environment() -> Mapping[str, str]:
    """Return the environment without a size of the terminal that none can have."""
    sizes = {"COLUMNS": _NARROW, "LINES": 1}

    def fits(name: str, value: str) -> bool:
        """Tell whether a variable holds a size that a terminal may have, or is none of size."""
        return name not in sizes or (
            value.isascii() and value.isdigit() and sizes[name] <= int(value) < 10_000
        )

    return {name: value for name, value in os.environ.items() if fits(name, value)}


@final
class Shadow(io.StringIO):
    """Takes what is rendered for a stream, in its place: as wide, as coloured, in the same
    encoding.
    """

    def __init__(self, stream: TextIO | None) -> None:
        super().__init__()
        self.stream = stream

    @property
    def encoding(self) -> str:  # type: ignore[override]  # read-only, as it is in truth
        """Return the stream's encoding."""
        return getattr(self.stream, "encoding", None) or "utf-8"

    def isatty(self) -> bool:
        """Tell whether the stream is a terminal; one that is closed is none."""
        try:
            return self.stream is not None and self.stream.isatty()
        except ValueError:
            return False

    def fileno(self) -> int:
        """Return the stream's descriptor."""
        return super().fileno() if self.stream is None else self.stream.fileno()


@final
class Escaping(RenderHook):
    """What a console does with all that it is to show: control characters in its text become
    escapes.
    """

    def process_renderables(self, renderables: list[ConsoleRenderable]) -> list[ConsoleRenderable]:
        """Return what is shown in place of some renderables."""
        return [Escaped(each) for each in renderables]


@final
class Escaped:
    """Something to show, with the control characters of its text as escapes."""

    def __init__(self, inner: RenderableType) -> None:
        self.inner = inner

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Segment]:
        for segment in console.render(self.inner, options):
            yield segment if segment.control else Segment(printable(segment.text), segment.style)

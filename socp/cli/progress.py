"""Progress on stderr: one live line on a terminal, an occasional line elsewhere."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rich.console import Console
from rich.live import Live
from rich.text import Text

if TYPE_CHECKING:
    from socp.nlp import Progress, Watch

_LIVE = 0.1  # seconds between two refreshes of the live line
_OCCASIONAL = 5.0  # seconds between two plain lines


@contextmanager
def progress(console: Console, label: str, *, quiet: bool) -> "Iterator[Watch]":
    """Yield a watch that shows the progress of a solve; a quiet one shows nothing."""
    from socp.nlp import silent

    if quiet:
        yield silent
    elif console.is_terminal:
        first = Text(f"{label}: building")
        with Live(first, console=console, transient=True, auto_refresh=False, redirect_stdout=False) as live:
            live.refresh()
            yield _Throttled(lambda text: live.update(text, refresh=True), label, _LIVE, at_once=True)
    else:
        yield _Throttled(lambda text: console.print(text, soft_wrap=True), label, _OCCASIONAL, at_once=False)


class _Throttled:
    """A watch that passes a line on at most once in so many seconds."""

    def __init__(self, show: Callable[[Text], object], label: str, every: float, *, at_once: bool) -> None:
        self.show, self.label, self.every = show, label, every
        self.next = time.monotonic() + (0.0 if at_once else every)

    def __call__(self, progress: "Progress", /) -> bool:
        now = time.monotonic()
        if now >= self.next:
            self.next = now + self.every
            self.show(_line(self.label, progress))
        return False


def _line(label: str, now: "Progress") -> Text:
    return Text.assemble(
        f"{label}: ", f"iteration {now.iteration:<5d}",
        (f" objective {now.objective:<14.9g}", "cyan"), f" infeasibility {now.infeasibility:.1e}",
    )  # fmt: skip

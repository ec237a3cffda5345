"""Progress on stderr: one live display on a terminal, an occasional line elsewhere."""

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, final

from rich.console import Console, RenderableType
from rich.live import Live
from rich.table import Table
from rich.text import Text

from socp.cli.consoles import Escaped
from socp.process import one_line

if TYPE_CHECKING:
    from socp.model import Progress, Watch

_LIVE = 0.1  # seconds between two refreshes of the live display
_OCCASIONAL = 5.0  # seconds between two plain lines


@contextmanager
def progress(console: Console, label: str, *, quiet: bool) -> "Iterator[Watch]":
    """Yield a watch that shows the progress of a solve or a search; a quiet one shows nothing."""
    from socp.model import silent

    label = one_line(label)
    if quiet:
        yield silent
    elif console.is_terminal:
        first = Escaped(
            Text(f"{label}: building")
        )  # what is live comes after a console's own hooks
        with Live(first, console=console, transient=True, auto_refresh=False) as live:
            live.refresh()
            yield Display(
                label, lambda view: live.update(Escaped(view.table()), refresh=True), _LIVE
            )
    else:
        display = Display(
            label, lambda view: console.print(view.line(), soft_wrap=True), _OCCASIONAL
        )
        display.due += _OCCASIONAL  # what is over soon needs no line
        yield display


@contextmanager
def shown(label: str) -> "Iterator[Watch]":
    """Yield a watch for who calls from Python: on a terminal a display, in a notebook a line now
    and then, elsewhere nothing.
    """
    notebook = type(sys.stderr).__module__.startswith("ipykernel.")
    console = Console(stderr=True, force_jupyter=False)
    with progress(console, label, quiet=not (console.is_terminal or notebook)) as watch:
        yield watch


@final
@dataclass(eq=False)
class Display:
    """A watch that keeps what it is told, and shows it at most once in so many seconds; other calls
    cost little.

    `solves` counts the programmes begun, each by its iteration 0; what a later call does not tell
    stays as it was told.
    """

    label: str
    show: Callable[["Display"], object]
    every: float
    began: float = field(default_factory=time.monotonic)
    due: float = field(default_factory=time.monotonic)
    solves: int = 0
    now: "Progress | None" = None
    word: str = ""
    best: float = math.nan
    violation: float = math.nan

    def __call__(self, progress: "Progress", /) -> bool:
        """Take in what is told, and show it where that is due."""
        if progress.iteration == 0:
            self.solves += 1
        if progress.word:
            self.word = progress.word
        if not math.isnan(progress.best):
            self.best, self.violation = progress.best, progress.violation
        self.now = progress
        if time.monotonic() >= self.due:
            self.show(self)
            self.due = time.monotonic() + self.every
        return False

    def facts(self) -> Iterator[tuple[str, str]]:
        """Yield what is known, each with its label; the solver's own figures first."""
        if self.now is None:
            return
        yield "iteration", f"{self.now.iteration}"
        if not math.isnan(self.now.objective):
            yield "objective", f"{self.now.objective:.9g}"
        if not math.isnan(self.now.infeasibility):
            yield "infeasibility", f"{self.now.infeasibility:.1e}"
        if not math.isnan(self.best):
            yield "best", f"{self.best:.9g}"
        if not math.isnan(self.violation):
            yield "violation", f"{self.violation:.1e}"
        if self.word:
            yield "word", self.word
        yield "solves", f"{self.solves}"
        yield "elapsed", f"{time.monotonic() - self.began:.0f} s"

    def stage(self) -> str:
        """Return the phase of the work: a backend's name says only that a programme is solved."""
        from socp.solvers import BACKENDS

        told = "" if self.now is None else self.now.stage
        before, _, last = told.rpartition(", ")
        return before if last in BACKENDS else told

    def line(self) -> Text:
        """Return all of it on one line."""
        stage = f"{self.stage()}: " if self.stage() else ""
        return Text(
            f"{self.label}: {stage}" + "  ".join(f"{name} {value}" for name, value in self.facts())
        )

    def table(self) -> RenderableType:
        """Return all of it as a small table, one fact a row."""
        grid = Table.grid(padding=(0, 2, 0, 0))
        grid.add_column(no_wrap=True, style="bold")
        grid.add_column(overflow="ellipsis", no_wrap=True)
        grid.add_row(Text(f"{self.label}:"), Text(self.stage(), "cyan"))
        known = dict(self.facts())
        paired = {
            "iteration": ("objective", "infeasibility"),
            "best": ("violation",),
            "solves": ("elapsed",),
        }
        for name, value in known.items():
            beside = paired.get(name)
            if beside is not None:
                more = "".join(f"   {each} {known[each]}" for each in beside if each in known)
                grid.add_row(Text(name), Text(f"{value}{more}"))
        if self.word:
            grid.add_row(Text("word"), Text(self.word))
        return grid

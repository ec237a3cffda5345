"""Figures of a branch: objective and switching times over a number of the problem, by word."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

from socp import errors
from socp.errors import SolveError
from socp.view.figures import style

_COLOURS = (  # one a word, in turn: from dark to light in grey too
    "#1f4e8c",
    "#c2571a",
    "#3c7d3f",
    "#9a5c94",
    "#b8860b",
    "#4aa3a2",
)
_HEIGHT = 2.0  # inches a panel
_COLUMNS = {"value", "objective", "word", "switches", "event"}

Rows = Sequence[Mapping[str, Any]]


def draw_branch(rows: Rows, facts: Mapping[str, Any], *, width: float) -> Any:
    """Return a matplotlib Figure of the rows of a branch, `width` inches wide: the objective and
    the switching times over the number `facts["name"]`, every word in a colour, events as lines.

    Raises MethodError where matplotlib is not installed, SolveError for rows that are no branch.
    """
    matplotlib = errors.load("matplotlib", "plot", "a figure")
    figures = errors.load("matplotlib.figure", "plot", "a figure")
    if not rows or not all(row.keys() >= _COLUMNS for row in rows):
        raise SolveError("the table holds no branch: nothing is drawn")
    with matplotlib.rc_context(style.SETTINGS):
        figure = figures.Figure(figsize=(width, 2 * _HEIGHT), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        words = dict.fromkeys(row["word"] for row in rows if not row["event"])
        colours = {word: _COLOURS[k % len(_COLOURS)] for k, word in enumerate(words)}
        for piece in _pieces(rows):
            word = next(row["word"] for row in piece if not row["event"])
            _drawn(above, below, piece, colours[word])
        for word, colour in colours.items():
            above.plot([], [], color=colour, label=style.plain(word))
        for row in rows:
            if row["event"]:
                for axes in (above, below):
                    axes.axvline(row["value"], color=style.FAINT, linewidth=style.THIN, zorder=0)
        above.set_ylabel("objective")
        below.set_ylabel("switching times")
        below.set_xlabel(style.plain(str(facts.get("name", "value"))))
        above.legend(frameon=False)
    return figure


def _pieces(rows: Rows) -> Iterator[list[Mapping[str, Any]]]:
    """Yield the rows from event to event, these included, where there are points between them."""
    cuts = [0, *(k for k, row in enumerate(rows) if row["event"]), len(rows) - 1]
    for a, b in pairwise(cuts):
        piece = list(rows[a : b + 1])
        if any(not row["event"] for row in piece):
            yield piece


def _drawn(above: Any, below: Any, piece: Rows, colour: str) -> None:
    """Draw objective and switching times of one word."""
    look = {"color": colour, "linewidth": style.LINE}
    values = [row["value"] for row in piece]
    above.plot(values, [row["objective"] for row in piece], **look)
    count = max(len(row["switches"]) for row in piece if not row["event"])
    times = [_times(row, count) for row in piece]
    for k in range(count):
        below.plot(values, [each[k] for each in times], **look)


def _times(row: Mapping[str, Any], count: int) -> list[float]:
    """Return so many switching times of a row: an arc that comes or goes at an event begins and
    ends at its time.
    """
    found: list[float] = sorted(row["switches"])
    while len(found) > count:
        found.remove(min(found, key=lambda t: abs(t - row["time"])))
    return sorted([*found, *[row["time"]] * (count - len(found))])

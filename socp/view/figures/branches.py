"""Figures of a branch: objective and switching times over a number of the problem, by word."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby, pairwise
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
    if not rows or not all(row.keys() >= _COLUMNS for row in rows):
        raise SolveError("the table holds no branch: nothing is drawn")
    events = [row["value"] for row in rows if row["event"]]
    return _curves(list(_pieces(rows)), str(facts.get("name", "value")), events, width)


def draw_curves(rows: Rows, name: str, *, width: float) -> Any:
    """Return a matplotlib Figure of solutions at values `row[name]`: objective and switching times
    over them, every word in a colour. Raises MethodError where matplotlib is not installed.
    """
    own = {"event": "", "time": float("nan")}
    ordered = sorted(({**row, **own, "value": row[name]} for row in rows), key=_value)
    pieces = [list(piece) for _, piece in groupby(ordered, key=lambda row: row["word"])]
    return _curves(pieces, name, [], width)


def _value(row: Mapping[str, Any]) -> float:
    return float(row["value"])


def _curves(pieces: Sequence[Rows], name: str, events: Sequence[float], width: float) -> Any:
    """Draw pieces, each of one word, and events as lines."""
    matplotlib = errors.load("matplotlib", "plot", "a figure")
    figures = errors.load("matplotlib.figure", "plot", "a figure")
    with matplotlib.rc_context(style.SETTINGS):
        figure = figures.Figure(figsize=(width, 2 * _HEIGHT), layout="constrained")
        above, below = figure.subplots(2, 1, sharex=True)
        words = [next(row["word"] for row in piece if not row["event"]) for piece in pieces]
        colours = word_colours(words)
        for word, piece in zip(words, pieces, strict=True):
            _drawn(above, below, piece, colours[word])
        for word, colour in colours.items():
            above.plot([], [], color=colour, label=style.plain(word))
        for value in events:
            for axes in (above, below):
                axes.axvline(value, color=style.FAINT, linewidth=style.THIN, zorder=0)
        above.set_ylabel("objective")
        below.set_ylabel("switching times")
        below.set_xlabel(style.plain(name))
        above.legend(frameon=False)
    return figure


def word_colours(words: Iterable[str]) -> dict[str, str]:
    """Return a colour for every word, in the order in which they come."""
    return {word: _COLOURS[k % len(_COLOURS)] for k, word in enumerate(dict.fromkeys(words))}


def _pieces(rows: Rows) -> Iterator[list[Mapping[str, Any]]]:
    """Yield the rows from event to event, these included, where there are points between them."""
    cuts = [0, *(k for k, row in enumerate(rows) if row["event"]), len(rows) - 1]
    for a, b in pairwise(cuts):
        piece = list(rows[a : b + 1])
        if any(not row["event"] for row in piece):
            yield piece


def _drawn(above: Any, below: Any, piece: Rows, colour: str) -> None:
    """Draw objective and switching times of one word."""
    look = {"color": colour, "linewidth": style.LINE, "marker": "" if piece[1:] else "."}
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

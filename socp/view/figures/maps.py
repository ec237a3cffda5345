"""Maps of a sweep over two numbers: the objective, and the words with their borders."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from socp import errors
from socp.errors import SolveError
from socp.view.figures import style
from socp.view.figures.branches import draw_curves, word_colours
from socp.view.maps import Rows, axes_of, checked, gridded, placed, switching

_TALL = 0.5  # of the width: two panels side by side, a legend below
_MAP = "cividis"  # in grey too
_FILL = 0.45  # opacity of a region: contours are read upon it
_LEVELS = 5  # contours of a switching time


def draw_sweep(rows: Rows, facts: Mapping[str, Any], *, width: float) -> Any:
    """Return a matplotlib Figure of a sweep, `width` inches wide: over one number objective and
    switching times as curves; over two a map of the objective and one of the words, with borders
    between them and contours of switching times. What is not certified is left blank.

    Raises MethodError where matplotlib is not installed, SolveError for rows that are no sweep, or
    one over another number of numbers.
    """
    names = checked(rows, facts)
    axes = axes_of(rows, names)
    good = [row for row in rows if not row["message"]]
    if not good:
        raise SolveError("the table holds nothing certified: nothing is drawn")
    if len(axes) == 1:
        return draw_curves(good, next(iter(axes)), width=width)
    if len(axes) != 2:
        told = ", ".join(axes) or "none"
        raise SolveError(f"a map is over one or two numbers; those with several values: {told}")
    matplotlib = errors.load("matplotlib", "plot", "a figure")
    figures = errors.load("matplotlib.figure", "plot", "a figure")
    with matplotlib.rc_context(style.SETTINGS):
        figure = figures.Figure(figsize=(width, _TALL * width), layout="constrained")
        left, right = figure.subplots(1, 2, sharex=True, sharey=True)
        index = gridded(rows, axes)
        colours = word_colours(row["word"] for row in good)
        (x, y), names_of = axes.values(), tuple(axes)
        if index is None:
            shown = _scattered(left, right, good, names_of, colours)
        else:
            index = np.where(
                placed(index, [bool(r["message"]) for r in rows], fill=True), -1, index
            )
            value = placed(index, [row["objective"] for row in rows], np.nan)
            shown = left.pcolormesh(x, y, value.T, shading="nearest", cmap=_MAP)
            _words(right, (x, y), (index, rows), colours)
        figure.colorbar(shown, ax=left, label="objective", location="top", shrink=0.9)
        for axes_ in (left, right):
            axes_.set_xlabel(style.plain(names_of[0]))
        left.set_ylabel(style.plain(names_of[1]))
        for word, colour in colours.items():
            right.plot([], [], "s", color=colour, alpha=_FILL, label=style.plain(word))
        right.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), frameon=False)
    return figure


def _scattered(
    left: Any, right: Any, rows: Rows, names: tuple[str, ...], colours: Mapping[str, str]
) -> Any:
    """Draw points that are on no grid."""
    x, y = ([row[name] for row in rows] for name in names)
    right.scatter(x, y, s=9, c=[colours[row["word"]] for row in rows], alpha=_FILL, linewidths=0)
    return left.scatter(x, y, s=9, c=[row["objective"] for row in rows], cmap=_MAP, linewidths=0)


def _words(
    axes: Any,
    sides: tuple[np.ndarray, np.ndarray],
    table: tuple[np.ndarray, Rows],
    colours: Mapping[str, str],
) -> None:
    """Draw the regions of equal word, their borders, and contours of switching times inside."""
    (x, y), (index, rows) = sides, table
    order = list(colours)
    numbers = [order.index(row["word"]) if row["word"] in order else -1 for row in rows]
    words = placed(index, numbers, -1)
    times = switching(index, rows)
    ends = [_edges(x), _edges(y)]
    for k, word in enumerate(order):
        here = words == k
        own = np.where(here, 1.0, np.nan)
        axes.pcolormesh(*ends, own.T, cmap=_one(colours[word]), alpha=_FILL, linewidth=0)
        for s in range(times.shape[-1]):
            level = np.where(here, times[..., s], np.nan)
            known = level[np.isfinite(level)]
            if min(here.shape) > 1 and known.size and np.ptp(known) > 0.0:
                lines = axes.contour(
                    x, y, level.T, _LEVELS, colors=colours[word], linewidths=style.THIN
                )
                axes.clabel(lines, fontsize="xx-small")
    look = {"color": style.INK, "linewidth": style.LINE}
    for i, j in zip(*np.nonzero(words[1:] != words[:-1]), strict=True):
        axes.plot([ends[0][i + 1]] * 2, ends[1][j : j + 2], **look)
    for i, j in zip(*np.nonzero(words[:, 1:] != words[:, :-1]), strict=True):
        axes.plot(ends[0][i : i + 2], [ends[1][j + 1]] * 2, **look)


def _edges(values: np.ndarray) -> np.ndarray:
    """Return the ends (n + 1,) of cells around values (n,)."""
    inner = (values[1:] + values[:-1]) / 2
    return np.array([1.5 * values[0] - values[1] / 2, *inner, 1.5 * values[-1] - values[-2] / 2])


def _one(colour: str) -> Any:
    """Return a map of one colour."""
    return errors.load("matplotlib.colors", "plot", "a figure").ListedColormap([colour])

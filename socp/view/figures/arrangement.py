"""How the panels of a figure stand: two columns of equal height, or one, with one time axis under
each.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

import numpy as np

from socp.view.figures import style

if TYPE_CHECKING:
    from socp.model import Solution

TWO = 5.0  # inches: narrower figures have one column
LEFT, RIGHT = 0.7, 0.12  # inches beside a panel
_TOP, _BOTTOM, _GAP, _BETWEEN, _LINE, _UPRIGHT = (
    0.32,
    0.3,
    0.12,
    0.4,
    0.17,
    0.25,
)  # inches: margins, gaps, a line
_LABEL = 0.55  # inches from a panel to its label, so that the labels of a column stand in line
_SHARE = 0.09  # of a stretched axis, for every arc at least
_REST = ("costates", "multipliers", "hamiltonian")  # panels that fill the columns
_SHOWN = 1e-3  # of the horizon: what ends so little later ends there, as it looks
_UPRIGHT_FROM = 5  # labels of switching times stand upright where there are as many


@final
@dataclass(frozen=True, eq=False)
class Panel:
    """One panel of a figure: what draws it, its height in inches, the room above it, and whether
    time runs along it.
    """

    draw: Callable[[Any], None]
    height: float
    above: float = 0.0
    timed: bool = True


@final
@dataclass(frozen=True, eq=False)
class TimeAxis:
    """The time axis: where on it a time is, its label, and the times marked; None leaves that to
    matplotlib.
    """

    warp: Callable[[Any], np.ndarray]
    label: str
    marked: tuple[float, ...] | None = None

    @staticmethod
    def of(solution: "Solution", unit: str, *, stretch: bool, until: float = 0.0) -> "TimeAxis":
        """Return the axis of a solution, as it is or with arcs that are no shorter than a share of
        it; it goes on `until` where others end.
        """
        label = style.label("t", unit)
        if not stretch:
            return TimeAxis(np.asarray, label)
        times = np.array([solution.initial_time, *solution.switches, solution.final_time])
        if until - times[-1] > _SHOWN * (times[-1] - times[0]):
            times = np.append(times, until)
        length = np.diff(times) / (times[-1] - times[0])
        share = np.maximum(length, min(_SHARE, 0.5 / length.size))
        places = np.concatenate([[0.0], np.cumsum(share / share.sum())])
        warp = lambda t: np.asarray(np.interp(t, times, places))  # noqa: E731
        return TimeAxis(warp, f"{label}, short arcs widened", tuple(times.tolist()))

    @property
    def upright(self) -> bool:
        """Whether the labels of the marked times stand upright."""
        return self.marked is not None and len(self.marked) >= _UPRIGHT_FROM

    def put(self, axes: Any, *, last: bool) -> None:
        """Mark times under a panel, and name them under the last of a column."""
        from matplotlib.ticker import MaxNLocator

        if self.marked is None:
            axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 2.5, 5, 10]))
        else:
            texts = [f"{t:.4g}" for t in self.marked]
            axes.set_xticks(self.warp(self.marked), texts, rotation=90 if self.upright else 0)
        axes.tick_params(labelbottom=last)
        if last:
            axes.set_xlabel(self.label)


def arranged(
    made: Mapping[str, Sequence[Panel]], scene: Panel | None, *, one: bool
) -> list[list[Panel]]:
    """Return the columns: controls and switching functions left, scene and states right, the rest
    where it fits.
    """
    controls, switching = made.get("controls", ()), made.get("switching", ())
    paired = [panel for pair in zip(controls, switching, strict=False) for panel in pair]
    left = paired if len(paired) == len(controls) + len(switching) else [*controls, *switching]
    right = [*([] if scene is None else [scene]), *made.get("states", ())]
    rest = [panel for name in _REST for panel in made.get(name, ())]
    if one:
        columns = [[*left, *right, *rest]]
    else:  # in their order: the first of them left, the others right
        pairs = [([*left, *rest[:k]], [*right, *rest[k:]]) for k in range(len(rest) + 1)]
        columns = list(min(pairs, key=lambda pair: max(map(_height, pair))))
    return [column for column in columns if column]


@final
@dataclass(frozen=True, eq=False)
class Frame:
    """What stands around the panels: the signs of the modes that the legend explains, the width in
    inches, a title, and the names of several solutions with their looks.
    """

    kinds: Collection[str]
    width: float
    title: str = ""
    names: tuple[tuple[str, style.Look], ...] = ()

    @property
    def rows(self) -> int:
        """Lines above the panels beside the first of the legend."""
        return (self.width < TWO) + bool(self.title) + bool(self.names)


def composed(
    top: Panel | None, columns: Sequence[Sequence[Panel]], axis: TimeAxis, frame: Frame
) -> Any:
    """Return a figure with one panel across the page, if any, and columns of equal height below
    it.
    """
    from matplotlib.figure import Figure

    width, tallest = frame.width, max(map(_height, columns), default=0.0)
    begin = _TOP + _LINE * frame.rows
    under = begin + (0.0 if top is None else top.height + _BETWEEN + _GAP)
    height = under + tallest + _BOTTOM + (_UPRIGHT if axis.upright else 0.0)
    figure = Figure(figsize=(width, height))
    if top is not None:
        _put(figure, top, (LEFT, begin, width - LEFT - RIGHT, top.height))
    across = width / max(len(columns), 1)
    for k, column in enumerate(columns):
        spare = (tallest - _height(column)) / max(sum(panel.timed for panel in column), 1)
        up = under
        for panel in column:
            tall = panel.height + (spare if panel.timed else 0.0)
            axes = _put(
                figure, panel, (k * across + LEFT, up + panel.above, across - LEFT - RIGHT, tall)
            )
            up += panel.above + tall + (_GAP if panel.timed else _BETWEEN)
            if panel.timed:
                axis.put(axes, last=panel is column[-1])
    _legend(figure, frame)
    return figure


def _height(column: Sequence[Panel]) -> float:
    """Return the height of a column in inches."""
    return sum(panel.height + panel.above + (_GAP if panel.timed else _BETWEEN) for panel in column)


def _put(figure: Any, panel: Panel, box: tuple[float, float, float, float]) -> Any:
    """Draw a panel in a box (left, down from the top, width, height) in inches; return its axes."""
    (width, height), (left, down, across, tall) = figure.get_size_inches(), box
    axes = figure.add_axes(
        (left / width, 1.0 - (down + tall) / height, across / width, tall / height)
    )
    panel.draw(axes)
    axes.yaxis.set_label_coords(-_LABEL / across, 0.5)
    return axes


def _legend(figure: Any, frame: Frame) -> None:
    """Write the title, and explain the lines of several solutions, the colours of the arcs and the
    marks in the scene, those that there are.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    looks: dict[str, Any] = {
        "frameon": False,
        "handlelength": 1.6,
        "handleheight": 0.9,
        "borderaxespad": 0.3,
    }
    line, down = _LINE / figure.get_figheight(), 1.0
    if frame.title:
        place = {"ha": "center", "va": "top", "fontsize": style.FONT}
        figure.text(0.5, down - 0.3 * line, frame.title, **place)
        down -= line
    if frame.names:
        lines = [Line2D([], [], color=c, ls=dash, label=name) for name, (c, dash) in frame.names]
        above = {**looks, "handlelength": 2.6, "bbox_to_anchor": (0.5, down)}
        figure.legend(handles=lines, loc="upper center", ncols=len(lines), **above)
        down -= line
    shown = [each for sign, each in style.MODES.items() if sign in frame.kinds]
    handles: list[Any] = [
        Patch(facecolor=colour, hatch=hatch, label=name, lw=0) for name, colour, hatch in shown
    ]
    points = {each.get_label(): each for axes in figure.axes for each in axes.get_lines()}
    handles += [points[name] for name in ("start", "switch", "end") if name in points]
    if handles:
        row = 7 if figure.get_figwidth() >= TWO else 4
        looks["bbox_to_anchor"] = (0.5, down)
        figure.legend(handles=handles, loc="upper center", ncols=min(len(handles), row), **looks)

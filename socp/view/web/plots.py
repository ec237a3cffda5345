"""The curves and the scene of a figure as plots that can be zoomed: plain data for plotly.js."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Any, final

import numpy as np

from socp.view.figures import style
from socp.view.figures.curves import Curve, limits_of
from socp.view.figures.overlay import Group

if TYPE_CHECKING:
    from socp.model import Solution
    from socp.view.picture import Picture

_FIGURES = 8  # digits of a plotted value
_GRID = "#e6e6e6"
_HEAD = 0.3  # of an arrow's length
_DASHES = ("dash", "dot", "dashdot", "longdash")
_LETTERS = re.compile(r"\\([A-Za-z]+)")
_ROMAN = re.compile(r"\\mathrm\{([^{}]*)\}")
_BELOW = re.compile(r"_\{([^{}]*)\}")
_LOGARITHMIC = ("inf_pr", "inf_du", "mu", "step")  # of a solver's trace


@final
@dataclass(frozen=True, kw_only=True)
class Plot:
    """One plot: what stands above it, its traces and its layout for plotly.js, its height in
    pixels; whether it goes across the page, and whether time runs along it.
    """

    title: str
    traces: list[dict[str, Any]]
    layout: dict[str, Any]
    height: int = 190
    wide: bool = False
    timed: bool = True

    @property
    def data(self) -> dict[str, Any]:
        """What plotly.js is given."""
        return {"data": self.traces, "layout": self.layout, "timed": self.timed}


def label_html(mathtext: str, unit: str = "") -> str:
    """Return a label as HTML: Greek letters, what stands below."""
    plain = _BELOW.sub(r"<sub>\1</sub>", _ROMAN.sub(r"\1", escape(mathtext)))
    letters = _LETTERS.sub(lambda found: style.letter(found[1]), plain)
    return letters + (f" ({escape(unit)})" if unit else "")


def curve_plot(curve: Curve, names: Mapping[style.Look, str]) -> Plot:
    """Return the plot of a curve, its arcs shaded and named, bounds and switching times marked;
    `names`: of the solution and of those beside it, by their looks.
    """
    low, high = limits_of(curve, 1.0)
    lines = ((style.OWN, curve.t, curve.values), *curve.others)
    traces = [
        _line(t, values, (look[0], k), names.get(look, ""))
        for k, (look, t, values) in enumerate(lines)
    ]
    shapes = [*_arcs(curve), *_marks(curve, low, high)]
    layout = _layout({"range": list(curve.span)}, {"range": [low, high]}, shapes)
    if curve.lanes:
        layout["annotations"] = list(_arc_names(curve))
        layout["margin"]["t"] = 30
    tall = 230 if curve.lanes else 180
    return Plot(
        title=label_html(curve.label, curve.unit), traces=traces, layout=layout, height=tall
    )


def scene_plot(picture: "Picture", labels: tuple[str, str], group: Group) -> Plot:
    """Return the plot of the plane: current, target, headings, the path with its switches, and
    the paths of other solutions.
    """
    (left, right), (low, high) = picture.box
    traces = [] if picture.flow is None else [_current(*picture.flow)]
    if picture.heading is not None:
        traces.append(_headings(picture, picture.heading))
    own = _line(
        picture.path[0], picture.path[1], (style.INK, 0), group.name if group.names else "path"
    )
    own |= {"text": [f"t = {t:.6g}" for t in picture.t], "hovertemplate": "%{x}, %{y}<br>%{text}"}
    traces += [own]
    traces += [
        _line(path[0], path[1], (each.look[0], k + 1), each.name)
        for k, (each, path) in enumerate(zip(group.others, picture.others, strict=True))
    ]
    traces += _places(picture)
    shapes = []
    if picture.target is not None:
        cx, cy, radius = picture.target
        corners = {"x0": cx - radius, "x1": cx + radius, "y0": cy - radius, "y1": cy + radius}
        shapes = [{"type": "circle", **corners, "line": {"color": "#38761d", "width": 1}}]
    across: dict[str, Any] = {"range": [left, right], "title": {"text": labels[0], "standoff": 4}}
    up: dict[str, Any] = {"range": [low, high], "title": {"text": labels[1], "standoff": 4}}
    if picture.spatial:
        up |= {"scaleanchor": "x", "scaleratio": 1}
    layout = _layout(across, up, shapes)
    layout["margin"] |= {"l": 60, "b": 44}
    layout["hovermode"] = "closest"
    return Plot(
        title="scene",
        traces=traces,
        layout=layout,
        height=260 if picture.flat else 400,
        wide=picture.flat,
        timed=False,
    )


def trace_plot(solution: "Solution") -> Plot | None:
    """Return the solver's trace by iteration, each quantity on powers of ten; None without one."""
    found = {
        name: np.array(solution.effort.trace[name], dtype=float)
        for name in _LOGARITHMIC
        if name in solution.effort.trace
    }
    shown = {name: values for name, values in found.items() if (values > 0).any()}
    if not shown:
        return None
    looks = [look for look, _ in style.OTHERS]
    traces = [
        _line(np.arange(values.size), np.where(values > 0, values, np.nan), (looks[k], 0), name)
        for k, (name, values) in enumerate(shown.items())
    ]
    layout = _layout({"title": {"text": "iteration"}}, {"type": "log"}, [])
    layout |= {"showlegend": True, "legend": {"orientation": "h", "y": 1.02, "yanchor": "bottom"}}
    layout["margin"] |= {"t": 34, "b": 40}
    return Plot(title="the last solve", traces=traces, layout=layout, height=280, timed=False)


def _line(t: Any, values: Any, look: tuple[str, int], name: str) -> dict[str, Any]:
    """Return a line as a trace in its colour; the k-th beside the solution's own has dashes."""
    colour, k = look
    dash = "solid" if k == 0 else _DASHES[(k - 1) % len(_DASHES)]
    return {
        "type": "scatter",
        "mode": "lines",
        "x": _numbers(t),
        "y": _numbers(values),
        "name": escape(name),
        "line": {"color": colour, "width": 1.6, "dash": dash},
        "hovertemplate": "%{x:.8~g}, %{y:.6~g}",
    }


def _numbers(values: Iterable[float]) -> list[float | None]:
    """Return values as JSON may hold them."""
    return [float(f"{v:.{_FIGURES}g}") if np.isfinite(v) else None for v in map(float, values)]


def _layout(
    across: Mapping[str, Any], up: Mapping[str, Any], shapes: Sequence[Any]
) -> dict[str, Any]:
    """Return the layout of a plot with its two axes."""
    axis = {"showline": True, "linecolor": style.FAINT, "ticks": "outside", "ticklen": 3}
    axis |= {"gridcolor": _GRID, "zeroline": False, "tickfont": {"size": 11}}
    return {
        "xaxis": {**axis, **across},
        "yaxis": {**axis, "nticks": 6, "exponentformat": "power", **up},
        "shapes": list(shapes),
        "margin": {"l": 56, "r": 12, "t": 8, "b": 26},
        "showlegend": False,
        "plot_bgcolor": "white",
        "paper_bgcolor": "white",
        "font": {"size": 12, "color": style.INK},
        "hovermode": "x",
        "dragmode": "zoom",
    }


def _arcs(curve: Curve) -> Iterator[dict[str, Any]]:
    """Yield the shades of the arcs, and their lanes above the panel."""
    for mode, start, end in curve.stretches:
        _, colour, _ = style.MODES[style.kind(mode)]
        shade = {"type": "rect", "xref": "x", "yref": "paper", "x0": start, "x1": end}
        shade |= {"line": {"width": 0}, "fillcolor": colour}
        yield {**shade, "y0": 0, "y1": 1, "layer": "below", "opacity": 0.22}
        if curve.lanes:
            yield {**shade, "y0": 1.02, "y1": 1.07}


def _arc_names(curve: Curve) -> Iterator[dict[str, Any]]:
    """Yield the names of the arcs that are long enough to bear one."""
    first, last = curve.span
    for mode, start, end in curve.stretches:
        name = style.MODES[style.kind(mode)][0]
        if (end - start) < 0.018 * len(name) * (last - first):
            continue
        middle, small = 0.5 * (start + end), {"size": 10}
        place = {"x": middle, "y": 1.07, "xref": "x", "yref": "paper", "yanchor": "bottom"}
        yield {**place, "text": name, "showarrow": False, "font": small}


def _marks(curve: Curve, low: float, high: float) -> Iterator[dict[str, Any]]:
    """Yield lines at switching times, bounds and zero."""
    faint = {"type": "line", "layer": "below"}
    if len(curve.switches) <= style.MARKED:
        for t in curve.switches:
            line = {"color": style.FAINT, "width": 1, "dash": "dot"}
            yield {**faint, "x0": t, "x1": t, "y0": 0, "y1": 1, "yref": "paper", "line": line}
    rows = [(bound, "dash") for bound in curve.bounds if low <= bound <= high]
    for value, dash in [*rows, *([(0.0, "solid")] if curve.zero else [])]:
        line = {"color": style.FAINT, "width": 1, "dash": dash}
        yield {**faint, "x0": 0, "x1": 1, "xref": "paper", "y0": value, "y1": value, "line": line}


def _places(picture: "Picture") -> Iterator[dict[str, Any]]:
    """Yield start, end and switches as points."""
    point = {"type": "scatter", "mode": "markers", "hovertemplate": "%{text}"}
    if 0 < len(picture.marks) <= style.MARKED:
        places = np.array([mark.place for mark in picture.marks]).T
        texts = [escape(f"{mark.label} at t = {mark.t:.10g}") for mark in picture.marks]
        look = {"size": 8, "color": "white", "line": {"color": style.ACCENT, "width": 1.6}}
        yield {**point, "x": _numbers(places[0]), "y": _numbers(places[1]), "text": texts,
               "name": "switch", "marker": look}  # fmt: skip
    for k, name, sign in ((0, "start", "circle-open"), (-1, "end", "square")):
        x, y = picture.path[:, k]
        look = {"size": 11 if k == 0 else 8, "color": style.INK, "symbol": sign}
        yield {**point, "x": _numbers([x]), "y": _numbers([y]), "text": [name], "name": name,
               "marker": look}  # fmt: skip


def _current(points: np.ndarray, flow: np.ndarray) -> dict[str, Any]:
    """Return a current (2, k) at points (2, k) of a grid, no arrow as long as its cell."""
    columns = np.unique(points[0])
    step = float(np.diff(columns).min()) if columns.size > 1 else 1.0
    along = flow * (0.75 * step / (float(np.hypot(*flow).max(initial=0.0)) or 1.0))
    return _arrows(points - 0.5 * along, along, "#8fb0cf", "current")


def _headings(picture: "Picture", heading: np.ndarray) -> dict[str, Any]:
    """Return about a dozen arrows that show where the vehicle points, headings (n,)."""
    at = picture.headed
    size = 0.04 * float((picture.box[:, 1] - picture.box[:, 0]).max())
    along = size * np.array([np.cos(heading[at]), np.sin(heading[at])])
    return _arrows(picture.path[:, at], along, style.ACCENT, "heading")


def _arrows(tail: np.ndarray, along: np.ndarray, colour: str, name: str) -> dict[str, Any]:
    """Return arrows `along` (2, k) from their tails (2, k) as one broken line."""
    tip, aside = tail + along, 0.4 * np.array([-along[1], along[0]])
    wings = [tip - _HEAD * (along + sign * aside) for sign in (1.0, -1.0)]
    nothing = np.full_like(tip, np.nan)
    strokes = np.stack([tail, tip, wings[0], tip, wings[1], nothing], axis=-1).reshape(2, -1)
    drawn = _line(strokes[0], strokes[1], (colour, 0), name)
    return {**drawn, "hoverinfo": "skip", "line": {"color": colour, "width": 1}}

"""Items and layouts in rerun's own terms: its archetypes, columns, views and blueprints."""

from typing import Any

import numpy as np

from socp.process import one_line
from socp.view import PALETTE, Bars, Drawing, Film, Group, Item, Lane, Note, Panel, Plane, Series

_TICK = 1e-9  # of a timeline's unit, as fine as it counts


def send(stream: Any, item: Item, value: str = "value") -> None:
    """Write one item to a `rerun.RecordingStream`, whose timeline `value` is called so."""
    import rerun as rr

    if isinstance(item, Series):
        _series(stream, item, one_line(value))
    elif isinstance(item, Film):
        _film(stream, item, one_line(value))
    elif isinstance(item, Lane):
        known = item.colours
        names = [one_line(each) for each in known]
        config = rr.StateConfiguration(values=names, labels=names, colors=[*known.values()])
        stream.log(item.path, config, static=True)
        at = rr.TimeColumn("t", duration=item.at)
        stream.send_columns(
            item.path, [at], rr.StateChange.columns(state=[one_line(each) for each in item.states])
        )
    elif isinstance(item, Note):
        stream.log(
            item.path, rr.TextDocument(item.text, media_type=rr.MediaType.MARKDOWN), static=True
        )
    elif isinstance(item, Plane):
        across, up = item.scale
        stream.log(item.path, rr.Transform3D(scale=[across, -up, 1.0]), static=True)
    elif isinstance(item, Bars):
        stream.log(
            item.path, rr.BarChart(item.values, abscissa=item.at, color=item.colour), static=True
        )
    else:
        _drawing(stream, item)


def _series(stream: Any, item: Series, value: str) -> None:
    import rerun as rr

    if item.points:
        style: Any = rr.SeriesPoints(
            names=[one_line(item.name)],
            colors=[item.colour],
            markers="diamond",
            marker_sizes=[item.width],
        )
    else:
        policy = "Off" if item.exact else None
        style = rr.SeriesLines(
            names=[one_line(item.name)],
            colors=[item.colour],
            widths=[item.width],
            aggregation_policy=policy,
        )
    stream.log(item.path, style, static=True)
    if item.timeline in {"t", "value"}:
        times = [rr.TimeColumn("t" if item.timeline == "t" else value, duration=item.at)]
    else:
        times = [rr.TimeColumn(item.timeline, sequence=item.at.astype(int))]
    if item.along is not None:
        times.append(rr.TimeColumn("point", sequence=item.along.astype(int)))
    stream.send_columns(item.path, times, rr.Scalars.columns(scalars=item.values))


def _film(stream: Any, item: Film, value: str) -> None:

    last = float(item.at.max())
    frames = [*zip(item.at.tolist(), item.along.tolist(), item.frames, strict=True)]
    frames.append((last + _TICK, item.along[-1] + 1, ()))
    for at, place, lines in frames:
        stream.set_time(value, duration=at)
        stream.set_time("point", sequence=place)
        stream.log(item.path, strips([*lines]))
    stream.reset_time()


def strips(lines: list[np.ndarray]) -> Any:
    """Return lines (n, 2), each in its colour."""
    import rerun as rr

    colours = [PALETTE[k % len(PALETTE)] for k in range(len(lines))]
    return rr.LineStrips2D(lines, colors=colours, radii=rr.Radius.ui_points(1.5))


def _drawing(stream: Any, item: Drawing) -> None:
    import rerun as rr

    style: dict[str, Any] = {"colors": [item.colour], "radii": rr.Radius.ui_points(item.size)}
    if item.labels:
        style |= {"labels": [one_line(each) for each in item.labels], "show_labels": True}
    if item.at is not None:
        columns = (
            {"origins": item.points, "vectors": item.vectors}
            if item.kind == "arrows"
            else {"positions": item.points}
        )
        kind = rr.Arrows2D if item.kind == "arrows" else rr.Points2D
        stream.log(item.path, kind.from_fields(**style), static=True)
        stream.send_columns(
            item.path, [rr.TimeColumn("t", duration=item.at)], kind.columns(**columns)
        )
    elif item.kind == "line":
        stream.log(item.path, rr.LineStrips2D([item.points], **style), static=True)
    elif item.kind == "arrows":
        stream.log(
            item.path, rr.Arrows2D(origins=item.points, vectors=item.vectors, **style), static=True
        )
    else:
        stream.log(item.path, rr.Points2D(item.points, **style), static=True)


def blueprint(group: Group, timeline: str, tab: int = 0) -> Any:
    """Return a layout as a `rerun.blueprint.Blueprint` that opens on a timeline, at one of its
    tabs.
    """
    import rerun.blueprint as rrb

    time_panel = rrb.TimePanel(timeline=timeline, play_state="paused", state="collapsed")
    panels = [rrb.BlueprintPanel(state="collapsed"), rrb.SelectionPanel(state="hidden"), time_panel]
    return rrb.Blueprint(_arranged(group, tab), *panels, auto_layout=False, auto_views=False)


def _arranged(part: Group | Panel, tab: int = 0) -> Any:
    import rerun.blueprint as rrb

    if isinstance(part, Panel):
        return _view(part)
    parts = [_arranged(each) for each in part.parts]
    name = {"name": one_line(part.name)} if part.name else {}
    if part.kind == "tabs":
        return rrb.Tabs(*parts, active_tab=tab, **name)
    if part.kind == "grid":
        return rrb.Grid(*parts, grid_columns=part.columns, **name)
    if part.kind == "row":
        return rrb.Horizontal(*parts, column_shares=part.shares, **name)
    return rrb.Vertical(*parts, row_shares=part.shares, **name)


def _view(panel: Panel) -> Any:
    import rerun as rr
    import rerun.blueprint as rrb

    given: dict[str, Any] = {"name": one_line(panel.name), "contents": [*panel.contents]}
    if panel.kind == "curves":
        legend = rrb.PlotLegend(corner=panel.legend or "LeftBottom", visible=bool(panel.legend))
        if panel.times is not None:
            first, last = (rr.TimeRangeBoundary.absolute(seconds=each) for each in panel.times)
            axis = rrb.TimeAxis(link="Independent", view_range=rr.TimeRange(start=first, end=last))
        else:
            axis = rrb.TimeAxis(link="LinkToGlobal" if panel.timeline == "t" else "Independent")
        if panel.span is not None:
            given["axis_y"] = rrb.ScalarAxis(range=panel.span)
        return rrb.TimeSeriesView(plot_legend=legend, axis_x=axis, **given)
    if panel.kind == "plane":
        bounds = {}
        if panel.box is not None:
            bounds = {
                "visual_bounds": rrb.VisualBounds2D(x_range=panel.box[0], y_range=panel.box[1])
            }
        return rrb.Spatial2DView(origin="/", **bounds, **given)
    kinds = {"lanes": rrb.StateTimelineView, "text": rrb.TextDocumentView, "bars": rrb.BarChartView}
    return kinds[panel.kind](**given)

"""One pair of axes: a curve or the scene drawn in it, arcs and switching times marked."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from socp.view.figures import style
from socp.view.figures.curves import Curve, limits_of, power_of

if TYPE_CHECKING:
    from socp.view.picture import Picture

_LANE = (0.04, 0.145, 0.165)  # inches above a panel: the lane's lower and upper edge, and the names


def draw_curve(axes: Any, curve: Curve, warp: Callable[[Any], np.ndarray]) -> None:
    """Draw a curve with its bounds, arcs and switching times; `warp` maps times to places on the
    axis.
    """
    power = power_of(curve.everything)
    low, high = limits_of(curve, 10.0**power)
    axes.set_ylim(low, high)
    axes.set_xlim(*warp(np.array(curve.span)))
    if curve.stretches:
        _shade(axes, curve, warp)
    if len(curve.switches) <= style.MARKED:
        for t in curve.switches:
            axes.axvline(float(warp(t)), color=style.FAINT, lw=0.5, ls=(0, (1, 2)), zorder=1)
    for bound in curve.bounds:
        if np.isfinite(bound) and low <= bound / 10.0**power <= high:
            axes.axhline(
                bound / 10.0**power, color=style.FAINT, lw=style.THIN, ls=(0, (5, 2.5)), zorder=1.5
            )
    if curve.zero:
        axes.axhline(0.0, color=style.FAINT, lw=style.THIN, zorder=1.5)
    lines = ((style.OWN, curve.t, curve.values), *curve.others)
    for k, ((colour, dashes), times, values) in enumerate(lines):
        shown = np.where(np.isfinite(values), values, np.nan) / 10.0**power
        axes.plot(
            warp(times),
            shown,
            color=colour,
            ls=dashes,
            lw=style.LINE,
            zorder=3 + 0.1 * bool(k),
            solid_joinstyle="miter",
        )
    unit = f"$10^{{{power}}}$ {curve.unit}".strip() if power else curve.unit
    axes.set_ylabel(style.label(curve.label, unit))
    _ticks(axes)


def _shade(axes: Any, curve: Curve, warp: Callable[[Any], np.ndarray]) -> None:
    """Shade the arcs, and name them in a lane above the panel where there is room."""
    across = axes.get_xaxis_transform()
    width = float(np.ptp(warp(np.array(curve.span)))) or 1.0
    inches, tall = (axes.get_position().size * axes.figure.get_size_inches()).tolist()
    below, above, named = (1.0 + height / tall for height in _LANE)
    for mode, start, end in curve.stretches:
        name, colour, hatch = style.MODES[style.kind(mode)]
        left, right = warp(np.array([start, end]))
        axes.axvspan(left, right, color=style.tint(colour), lw=0, zorder=0)
        if not curve.lanes:
            continue
        axes.fill_between(
            [left, right],
            below,
            above,
            transform=across,
            facecolor=colour,
            hatch=hatch,
            lw=0,
            clip_on=False,
            zorder=2,
            edgecolor="white",
        )
        if (right - left) / width * inches > 0.048 * len(name) + 0.04:
            place, middle = {"ha": "center", "va": "bottom", "fontsize": 6.0}, 0.5 * (left + right)
            axes.text(middle, named, name, transform=across, color=style.INK, **place)


def _ticks(axes: Any) -> None:
    from matplotlib.ticker import MaxNLocator

    axes.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 2.5, 5, 10]))
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def draw_scene(
    axes: Any, picture: "Picture", labels: tuple[str, str], looks: Sequence[style.Look] = ()
) -> None:
    """Draw a path in its plane: the current, the target, headings, start, end and switching
    points, and the paths of other solutions in their looks.
    """
    from matplotlib.patches import Circle

    (left, right), (low, high) = picture.box
    if picture.flow is not None:
        _current(axes, *picture.flow)
    if picture.target is not None:
        cx, cy, radius = picture.target
        axes.add_patch(
            Circle(
                (cx, cy),
                radius,
                facecolor="#cfe3c8",
                edgecolor=style.FAINT,
                lw=style.THIN,
                zorder=1,
            )
        )
    axes.plot(*picture.path, color=style.INK, lw=style.LINE, zorder=3)
    for (colour, dashes), path in zip(looks, picture.others, strict=True):
        axes.plot(*path, color=colour, ls=dashes, lw=style.LINE, zorder=3.1)
    if picture.heading is not None:
        _headings(axes, picture)
    _points(axes, picture)
    axes.set_xlim(left, right)
    axes.set_ylim(low, high)
    if picture.spatial:
        axes.set_aspect("equal")
    axes.set_xlabel(labels[0])
    axes.set_ylabel(labels[1])
    _ticks(axes)


def _points(axes: Any, picture: "Picture") -> None:
    """Draw start, end and switching points, under the names that the legend takes."""
    if len(picture.marks) <= style.MARKED:
        places = np.array([mark.place for mark in picture.marks]).reshape(-1, 2).T
        axes.plot(
            *places,
            "o",
            ms=3.6,
            mfc="white",
            mec=style.ACCENT,
            mew=0.9,
            ls="none",
            zorder=4,
            label="switch",
        )
    axes.plot(
        *picture.path[:, :1],
        "o",
        ms=6,
        mfc="none",
        mec=style.INK,
        mew=1,
        ls="none",
        zorder=4.5,
        label="start",
    )
    axes.plot(
        *picture.path[:, -1:], "s", ms=3.2, color=style.INK, ls="none", zorder=4.5, label="end"
    )


def _current(axes: Any, points: np.ndarray, flow: np.ndarray) -> None:
    """Draw a current (2, k) at points (2, k) of a grid, no arrow as long as its cell."""
    speed = np.hypot(*flow)
    fastest = float(speed.max(initial=0.0))
    moving = speed > 0.1 * fastest  # slower ones would be dots
    columns = np.unique(points[0])
    step = float(np.diff(columns).min()) if columns.size > 1 else 1.0
    if moving.any():
        more = {"scale": fastest / (0.75 * step), "width": 0.0022, "headwidth": 4.0}
        places = {"angles": "xy", "scale_units": "xy", "pivot": "middle"}
        axes.quiver(
            *points[:, moving], *flow[:, moving], color="#8fb0cf", zorder=0.5, **places, **more
        )


def _headings(axes: Any, picture: "Picture") -> None:
    """Draw about a dozen arrows that show where the vehicle points."""
    heading, ((left, right), (low, high)) = picture.heading, picture.box
    if heading is None:
        return
    at = picture.headed
    size = 0.028 * max(right - left, high - low)
    x, y = picture.path[:, at]
    axes.quiver(
        x,
        y,
        size * np.cos(heading[at]),
        size * np.sin(heading[at]),
        angles="xy",
        scale_units="xy",
        scale=1.0,
        color=style.ACCENT,
        width=0.002,
        headwidth=6,
        headlength=7,
        headaxislength=6,
        zorder=3.5,
        pivot="tail",
    )

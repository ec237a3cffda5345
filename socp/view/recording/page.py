"""How a recording is laid out: the tabs Solution and Solver, and what a solve in progress shows."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from socp.model import TINY, Problem, Solution
from socp.view.picture import Picture, picture_of
from socp.view.recording.contents import BARS, MESHES
from socp.view.recording.items import GREY, Corner, Group, Item, Panel, Series, Timeline
from socp.view.recording.iterates import rows_window
from socp.view.recording.plane import STRIP, scale, window

HELP = """\
A curve shows on its own timeline, which is chosen in the panel at the bottom: `iteration` for
the solver's trace, `refinement` for the nodes of a search, `progress` for the tab Progress.
Bars, meshes and tables show on all of them."""
RUNNING, FITTED, CONTROLS = "/progress/plan", "/progress/fitted", "/progress/controls"
_SEPARATE = 6  # panels in a column; more stand in two
_FLAT = 1e-6  # of its magnitude: a quantity that varies less is shown as constant
_QUANTITIES = {
    "switching": "Switching functions",
    "costates": "Costates",
    "hamiltonian": "Hamiltonian",
    "multipliers": "Multipliers of state constraints",
}


def layout(
    problem: Problem,
    solution: Solution,
    items: Sequence[Item],
    roots: Sequence[str] = ("",),
    seen: Picture | None = None,
) -> Group:
    """Return the tabs of a recording of `items`, whose paths begin with `roots`: one, or one a run.

    `seen` is what the planes show, by default the picture of `solution`. The tabs are those of the
    solution, of the solver, and of the solve as it ran.
    """
    first = picture_of(problem, solution)
    paths = {
        each.path.removeprefix(root)
        for each in items
        for root in roots
        if each.path.startswith(f"{root}/")
        and not (isinstance(each, Series) and each.timeline == "refinement" and each.at.size < 2)
    }
    tabs = (
        _solution(problem, seen or first, scale(first), paths, roots),
        _solver(paths, roots),
        streaming(len(problem.control_names), window(seen or first), FITTED),
    )
    return fitted(Group(kind="tabs", parts=tabs), items)


def streaming(controls: int, box: np.ndarray | None = None, plan: str = RUNNING) -> Group:
    """Return the layout of a solve in progress, of so many controls; it is all there is of one that
    was killed. `plan` is where its iterates are: as they came, or to the scale of what they led to.
    """
    plane = Panel(
        kind="plane",
        name="Iterates in the plane",
        contents=(f"{plan}/**",),
        timeline="progress",
        box=box,
    )
    rows = Panel(
        kind="plane",
        name="Controls of the iterates, from start to end",
        contents=(f"{CONTROLS}/**",),
        timeline="progress",
        box=rows_window(controls),
    )
    curves = (
        _curves("Objective while it ran", ("/progress/objective",), "progress"),
        _curves("Infeasibility while it ran, log10", ("/progress/infeasibility",), "progress"),
        Panel(
            kind="lanes",
            name="What was being solved",
            contents=("/progress/stage",),
            timeline="progress",
        ),
    )
    return Group(
        kind="row",
        name="Progress",
        parts=(
            Group(kind="column", parts=(plane, rows), shares=(1.4, 1.0)),
            Group(kind="column", parts=curves),
        ),
        shares=(1.0, 1.0),
    )


def _solution(
    problem: Problem,
    seen: Picture,
    factors: tuple[float, float],
    paths: set[str],
    roots: Sequence[str],
) -> Group:
    plane = Panel(
        kind="plane", name="Plane", contents=_at(roots, "/plan/**"), box=window(seen, factors)
    )
    lanes = Panel(kind="lanes", name="Arcs", contents=_at(roots, "/arcs/**"))
    controls = [
        _curves(f"Control {problem.labelled(n)}", _at(roots, f"/controls/{n}/**"))
        for n in problem.control_names
    ]
    states = [
        _curves(f"State {problem.labelled(n)}", _at(roots, f"/states/{n}/**"))
        for n in problem.state_names
    ]
    adjoint = [
        _curves(name, _at(roots, f"/{part}/**"))
        for part, name in _QUANTITIES.items()
        if any(path.startswith(f"/{part}") for path in paths)
    ]
    text = [Panel(kind="text", name="Summary", contents=("/summary",))]
    if any(path.startswith("/principle") for path in paths):
        text.append(_curves("Residuals of the principle, log10", _at(roots, "/principle/**")))
    wide = seen.stretch > STRIP
    first = Group(kind="column", parts=(lanes, *controls), shares=(0.9, *([1.0] * len(controls))))
    if not wide:
        first = replace(first, parts=(plane, *first.parts), shares=(2.2, *(first.shares or ())))
    columns = (first, _pile(states), *([_pile(adjoint)] if adjoint else []))
    plots = Group(kind="row", parts=columns, shares=(1.25, 1.0, 1.0)[: len(columns)])
    if wide:
        plots = Group(kind="column", parts=(plane, plots), shares=(1.0, 2.6))
    aside = Group(kind="column", parts=tuple(text), shares=(3.2, 1.0)[: len(text)])
    return Group(kind="row", name="Solution", parts=(plots, aside), shares=(3.0, 1.0))


def _solver(paths: set[str], roots: Sequence[str]) -> Group:
    """Return the tab about how the solution came about, with what there is of it."""
    help_ = Panel(kind="text", name="Timelines", contents=("/help",))
    trace = [  # of one run bars show the same, whatever the timeline
        _curves("Objective by iteration", _at(roots, "/solver/objective"), "iteration"),
        _curves("Trace by iteration, log10", _at(roots, "/solver/log10/**"), "iteration"),
    ][: 2 * (len(roots) > 1)]
    bars = [
        Panel(
            kind="bars",
            name=f"{title} by iteration, log10",
            contents=_at(roots[:1], f"/solver/bars/{name}"),
        )
        for name, title in BARS.items()
        if f"/solver/bars/{name}" in paths
    ]
    search = []
    if "/search/words" in paths:
        search.append(
            Panel(kind="text", name="Words tried", contents=_at(roots[:1], "/search/words"))
        )
        values = tuple(
            rule for part in ("objective", "bound") for rule in _at(roots, f"/search/{part}")
        )
        if "/search/bars" in paths:
            where = _at(roots[:1], "/search/bars")
            search.append(Panel(kind="bars", name="Residual by word, log10", contents=where))
        # without bounds, and of one run, the table and the bars say as much on every timeline
        if "/search/objective" in paths and ("/search/bound" in paths or len(roots) > 1):
            search.append(_curves("Search by node", values, "refinement"))
    meshes = [
        Panel(
            kind="plane",
            name="Nodes of the meshes in time, first below",
            contents=_at(roots, "/mesh/nodes/**"),
            box=np.array([[-0.02 * MESHES, 1.02 * MESHES], [-1.0, 0.0]]),  # y points down
        ),
        *(
            [Panel(kind="bars", name="Intervals by mesh", contents=_at(roots[:1], "/mesh/bars"))]
            if "/mesh/bars" in paths
            else []
        ),
    ]
    columns = [
        Group(kind="column", parts=(*trace, *bars)) if bars or trace else None,
        Group(kind="column", parts=(*search, *meshes, help_)),
    ]
    return Group(kind="row", name="Solver", parts=tuple(filter(None, columns)))


def _curves(name: str, contents: tuple[str, ...], timeline: Timeline = "t") -> Panel:
    return Panel(kind="curves", name=name, contents=contents, timeline=timeline)


def _at(roots: Sequence[str], path: str) -> tuple[str, ...]:
    return tuple(f"{root}{path}" for root in roots)


def _pile(panels: list[Panel]) -> Group:
    """Return panels on top of one another, in two columns where there are many."""
    if len(panels) > _SEPARATE:
        return Group(kind="grid", parts=tuple(panels), columns=2)
    return Group(kind="column", parts=tuple(panels))


def fitted(group: Group, items: Sequence[Item]) -> Group:
    """Return a layout whose curves have room around them and their legends where the curves are
    not.
    """
    parts = [
        fitted(each, items) if isinstance(each, Group) else _fit(each, items)
        for each in group.parts
    ]
    return replace(group, parts=tuple(parts))


def _fit(panel: Panel, items: Sequence[Item]) -> Panel:
    series = [
        each
        for each in visible(items, panel)
        if isinstance(each, Series) and np.isfinite(each.values).any()
    ]
    if panel.kind != "curves" or not series:
        return panel
    low = float(min(np.nanmin(each.values) for each in series))
    high = float(max(np.nanmax(each.values) for each in series))
    size = max(abs(low), abs(high), *(each.magnitude for each in series))
    room = 0.07 * (high - low) if high - low > _FLAT * size else 0.1 * size or 1.0
    span = (low - room, high + room)
    named = [each for each in series if each.colour != GREY]
    few = 1 < len(named) <= 6 and not all(each.points for each in named)
    fitted = replace(panel, span=span, legend=_free_corner(series, span) if few else "")
    if panel.timeline != "t" or not all(each.points for each in named):
        return fitted
    first, last = (
        min(float(each.at[0]) for each in series),
        max(float(each.at[-1]) for each in series),
    )
    return replace(
        fitted, times=(first - 0.04 * (last - first), last + 0.04 * (last - first))
    )  # marks need a margin


def _free_corner(series: Sequence[Series], span: tuple[float, float]) -> Corner:
    """Return the corner of a panel with the least of the curves in it."""
    starts, ends = [float(each.at[0]) for each in series], [float(each.at[-1]) for each in series]
    first, last = min(starts), max(ends)
    crowd: dict[Corner, float] = {
        "RightTop": 0.0,
        "LeftTop": 0.0,
        "RightBottom": 0.0,
        "LeftBottom": 0.0,
    }
    for each in series:
        t = np.linspace(first, last, 500)
        known = np.isfinite(each.values)
        values = np.interp(t, each.at[known], each.values[known])
        across = (t - first) / max(last - first, TINY)
        up = (values - span[0]) / (span[1] - span[0])
        length = np.hypot(np.gradient(across), np.gradient(up))
        for corner in crowd:
            here = (across > 0.7) if corner.startswith("Right") else (across < 0.3)
            crowd[corner] += float(
                length[here & ((up > 0.55) if corner.endswith("Top") else (up < 0.45))].sum()
            )
    return min(crowd, key=lambda corner: crowd[corner])


def visible(items: Sequence[Item], panel: Panel) -> list[Item]:
    """Return the items that a panel shows."""
    hidden = [rule[2:] for rule in panel.contents if rule.startswith("- ")]
    shown = [each for each in items if any(_matches(each.path, rule) for rule in panel.contents)]
    return [each for each in shown if each.path not in hidden]


def _matches(path: str, rule: str) -> bool:
    rule = rule.removeprefix("+ ")
    return path == rule.removesuffix("/**") or (rule.endswith("/**") and path.startswith(rule[:-2]))


def panels(group: Group) -> list[Panel]:
    """Return all panels of a layout, in order."""
    return [
        each
        for part in group.parts
        for each in (panels(part) if isinstance(part, Group) else [part])
    ]

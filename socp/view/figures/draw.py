"""Figures of a solution for papers: controls with their arcs, states, costates, switching
functions, the scene.
"""

import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from socp import errors
from socp.errors import MethodError
from socp.model import known_problem
from socp.process import printable
from socp.view.exports import unit
from socp.view.figures import style
from socp.view.figures.arrangement import (
    LEFT,
    RIGHT,
    TWO,
    Frame,
    Panel,
    TimeAxis,
    arranged,
    composed,
)
from socp.view.figures.axes import Curve, draw_curve, draw_scene
from socp.view.figures.overlay import Group, heading_of, overlaid
from socp.view.ladder import top_text
from socp.view.picture import picture_of, scene_of
from socp.view.traces import Traces

if TYPE_CHECKING:
    from socp.model import Problem, Solution

PANELS = ("scene", "controls", "switching", "states", "costates", "multipliers", "hamiltonian")
DEFAULT = PANELS[:-1]
ENDINGS = ("png", "svg", "pdf")
WIDTH = 7.0  # inches: both columns of a page
_FLAT = 2.5  # scenes flatter than this go across the page
# Of the largest multiplier: what an interior point leaves of a constraint that is not active
_NOTHING = 1e-6
_APART = 1e-3  # of its largest value: nearer to zero a constraint on a grid may be active
_DPI = 200


def draw(
    solution: "Solution",
    problem: "Problem | None" = None,
    panels: Sequence[str] = DEFAULT,
    *,
    width: float = WIDTH,
    stretch: bool = False,
    **more: Any,
) -> Any:
    """Return a matplotlib Figure of a solution, `width` inches wide, drawn without pyplot.

    The problem is the one that the solution carries, unless another is given. `panels`: names out
    of `PANELS`; what is not known is left out: without a problem bounds, switching functions and
    units. `stretch` widens short arcs on the time axis, which then is marked at the switching
    times. `more`: `beside`, other solutions drawn in the same panels, in a list or by the names
    that the legend gives them; `title`, a text, or True for what is known of the solution.

    Raises MethodError where matplotlib is not installed, for a panel that there is not, and for
    solutions that share no state or control.
    """
    check(panels)
    matplotlib = errors.load("matplotlib", "plot", "a figure")
    problem = problem or known_problem(solution)
    with matplotlib.rc_context(style.SETTINGS):
        group = overlaid(problem, solution, **{k: v for k, v in more.items() if k != "title"})
        axis = TimeAxis.of(solution, _unit(problem, "time"), stretch=stretch, until=group.until)
        curves = {
            name: list(_curves(name, solution, problem, group))
            for name in panels
            if name != "scene"
        }
        made = {
            name: [
                Panel(partial(draw_curve, curve=curve, warp=axis.warp), *_heights(curve))
                for curve in each
            ]
            for name, each in curves.items()
        }
        seen = _scene(solution, problem, group, width) if problem and "scene" in panels else None
        top, beside = (seen[0], None) if seen and seen[1] else (None, seen[0] if seen else None)
        arcs = {
            style.kind(mode)
            for each in curves.values()
            for curve in each
            for mode, _, _ in curve.stretches
        }
        columns = arranged(made, beside, one=width < TWO)
        heading = heading_of(solution, more.get("title", ""))
        figure = composed(top, columns, axis, Frame(arcs, width, heading, group.names))
        figure.set_label(printable("; ".join(filter(None, (solution.problem, top_text(solution))))))
        return figure


def check(panels: Sequence[str]) -> None:
    """Raise MethodError for a panel that there is not."""
    wrong = [name for name in panels if name not in PANELS]
    if wrong or not panels:
        raise MethodError(f"no panel '{wrong[0] if wrong else ''}'; there are {', '.join(PANELS)}")


def to_bytes(figure: Any, ending: str) -> bytes:
    """Return a figure as a PNG, SVG or PDF file, the same bytes for the same figure.

    Its label, what is known of the solution, is the file's description.

    Raises MethodError for any other ending.
    """
    if ending not in ENDINGS:
        raise MethodError(f"no figures as '{ending}'; there are {', '.join(ENDINGS)}")
    matplotlib, file = errors.load("matplotlib", "plot", "a figure"), io.BytesIO()
    said = figure.get_label() or None
    about = {
        "png": {"Software": None, **({"Description": said} if said else {})},
        "svg": {"Date": None, "Creator": None, "Description": said},
        "pdf": {"CreationDate": None, "Subject": said},
    }
    with matplotlib.rc_context(style.SETTINGS):
        figure.savefig(file, format=ending, metadata=about[ending], dpi=_DPI)
    return file.getvalue()


def _curves(
    name: str, solution: "Solution", problem: "Problem | None", group: Group
) -> Iterator[Curve]:
    """Yield the panels of one kind that have anything to show."""
    rows = _rows(name, solution, group.along)
    others = [(_rows(name, each.solution, each.along), each) for each in group.others]
    box = _bounds(name, problem)
    for (owner, label), values in rows.items():
        if not np.isfinite(values).any():
            continue
        arcs = solution.structure.get(owner, ()) if name in {"controls", "switching"} else ()
        yield Curve(
            label=label,
            unit=_unit(problem, owner) if name in {"controls", "states"} else "",
            t=group.along.t,
            values=values,
            bounds=box.get(owner, (-np.inf, np.inf)),
            stretches=arcs,
            switches=[end for _, _, end in arcs[:-1]] if arcs else solution.switches,
            zero=name in {"switching", "multipliers"},
            lanes=name == "controls",
            others=tuple(
                (each.look, each.along.t, found[owner, label])
                for found, each in others
                if (owner, label) in found
            ),
        )


def _rows(name: str, solution: "Solution", along: Traces) -> dict[tuple[str, str], np.ndarray]:
    """Return the values (n,) of one kind of panels by name and label."""
    sizes = {
        c: float(np.nanmax(np.abs(row), initial=0.0))
        for c, row in along.multipliers.items()
        if _met(along.constraints.get(c))
    }
    active = [c for c, size in sizes.items() if size > _NOTHING * max(sizes.values())]
    found: dict[str, tuple[Sequence[str], str, Iterable[np.ndarray]]] = {
        "controls": (solution.control_names, "{}", along.u),
        "switching": (solution.control_names, r"\sigma_{{{}}}", along.switching),
        "states": (solution.state_names, "{}", along.x),
        "costates": (solution.state_names, r"\lambda_{{{}}}", along.costate),
        "multipliers": (tuple(active), r"\mu_{{{}}}", [along.multipliers[c] for c in active]),
        "hamiltonian": (("H",), "{}", [along.hamiltonian]),
    }
    names, pattern, values = found[name]
    return {
        (each, pattern.format(style.symbol(each))): row
        for each, row in zip(names, values, strict=True)
    }


def _met(constraint: np.ndarray | None) -> bool:
    """Tell whether a constraint c (n,) <= 0 comes near zero: the multiplier of one that does not is
    what an interior point leaves of it.
    """
    if constraint is None or not constraint.size:
        return True
    return bool(np.nanmax(constraint) >= -_APART * np.nanmax(np.abs(constraint)))


def _unit(problem: "Problem | None", name: str) -> str:
    return style.plain(unit(problem, name))


def _bounds(name: str, problem: "Problem | None") -> dict[str, tuple[float, float]]:
    """Return the bounds of controls or states by name."""
    if problem is None or name not in {"controls", "states"}:
        return {}
    pair = (
        (problem.control_names, problem.box)
        if name == "controls"
        else (problem.state_names, problem.state_box)
    )
    return {
        each: (float(low), float(high)) for each, low, high in zip(pair[0], *pair[1], strict=True)
    }


def _heights(curve: Curve) -> tuple[float, float]:
    """Return the height of a panel and the room for the arcs' names above it, in inches."""
    return (0.95, 0.3) if curve.lanes else (0.62, 0.0)


def _scene(
    solution: "Solution", problem: "Problem", group: Group, width: float
) -> tuple[Panel, bool] | None:
    """Return the panel of the scene, and whether it goes across the page; None where there is no
    plane.
    """
    if problem.scene is None and len(solution.state_names) < 2:
        return None
    seen = picture_of(problem, solution, group.along.t)
    paths = [
        (each.look, picture_of(problem, each.solution, each.along.t).path) for each in group.others
    ]
    seen = replace(seen, others=tuple(path for _, path in paths))
    plane = [str(each) for each in scene_of(problem).plane]
    pairs = zip(plane, seen.labels, strict=True)
    labels = [
        style.label(style.symbol(p), _unit(problem, p))
        if p in (*solution.state_names, "t")
        else text
        for p, text in pairs
    ]
    (left, right), (low, high) = seen.box
    ratio = (right - left) / (high - low) if seen.spatial else 1.6
    across = seen.spatial and ratio > _FLAT
    room = width if across or width < TWO else 0.5 * width
    height = min((room - LEFT - RIGHT) / ratio, 2.6)
    put = partial(
        draw_scene,
        picture=seen,
        labels=(labels[0], labels[1]),
        looks=tuple(look for look, _ in paths),
    )
    return Panel(put, height, timed=False), across

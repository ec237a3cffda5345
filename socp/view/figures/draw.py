"""Figures of a solution for papers: controls with their arcs, states, costates, switching
functions, the scene.
"""

import io
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from socp import errors
from socp.errors import MethodError
from socp.model import known_problem
from socp.process import printable
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
from socp.view.figures.axes import draw_curve, draw_scene
from socp.view.figures.curves import Curve, curves_of, has_scene, scene_of_group, unit_of
from socp.view.figures.overlay import Group, heading_of, overlaid
from socp.view.ladder import top_text

if TYPE_CHECKING:
    from socp.model import Problem, Solution

PANELS = ("scene", "controls", "switching", "states", "costates", "multipliers", "hamiltonian")
DEFAULT = PANELS[:-1]
ENDINGS = ("png", "svg", "pdf")
WIDTH = 7.0  # inches: both columns of a page
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
        axis = TimeAxis.of(solution, unit_of(problem, "time"), stretch=stretch, until=group.until)
        curves = {
            name: list(curves_of(name, solution, problem, group))
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


def _heights(curve: Curve) -> tuple[float, float]:
    """Return the height of a panel and the room for the arcs' names above it, in inches."""
    return (0.95, 0.3) if curve.lanes else (0.62, 0.0)


def _scene(
    solution: "Solution", problem: "Problem", group: Group, width: float
) -> tuple[Panel, bool] | None:
    """Return the panel of the scene, and whether it goes across the page; None where there is no
    plane.
    """
    if not has_scene(problem):
        return None
    seen, labels = scene_of_group(solution, problem, group)
    ratio = seen.stretch if seen.spatial else 1.6
    room = width if seen.flat or width < TWO else 0.5 * width
    height = min((room - LEFT - RIGHT) / ratio, 2.6)
    put = partial(
        draw_scene,
        picture=seen,
        labels=labels,
        looks=tuple(each.look for each in group.others),
    )
    return Panel(put, height, timed=False), seen.flat

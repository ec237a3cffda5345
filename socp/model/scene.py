"""Scenes: what a problem looks like in the plane, a phase plane where it does not say, seen along
solutions.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from math import isfinite
from typing import TYPE_CHECKING, Any, final

import casadi
import numpy as np

from socp.errors import ProblemError
from socp.model.symbols import Expr, column, is_number, is_symbol, role, time
from socp.process import plainly, shown

if TYPE_CHECKING:
    from socp.model.problem import Problem
    from socp.model.solution import Solution

_ARROWS = 90  # of a current, about
_MARGIN = 0.06  # of the picture's size, left free around the path


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """The plane in which a solution is drawn; all expressions are of states, time and parameters.

    plane: the two coordinates. heading: direction of the vehicle in the plane, an angle in radians.
    flow: the two components of a current; with it the plane's coordinates are states, and the flow
    depends on no other states. target: centre and radius of a disc, (cx, cy, radius). What is left
    out is not drawn.
    """

    plane: tuple[Expr, Expr]
    heading: Expr | None = None
    flow: tuple[Expr, Expr] | None = None
    target: tuple[float, float, float] | None = None


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Mark:
    """A switch in the plane: time, place (2,) and what happens there, `r: + s`."""

    t: float
    place: np.ndarray
    label: str


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Picture:
    """A scene along a solution: times t (n,), path (2, n), heading (n,) where there is one, and the
    switches.

    `flow`: points (2, k) and the current there (2, k), None where there is none, at the initial
    time where it depends on time; `target`: (cx, cy, radius) or None; `labels`: the names of the
    axes; `spatial`: whether one unit is as long on both axes, as it is in a scene of the problem's
    own, not in a phase plane.
    """

    t: np.ndarray
    path: np.ndarray
    heading: np.ndarray | None
    marks: tuple[Mark, ...]
    flow: tuple[np.ndarray, np.ndarray] | None
    target: tuple[float, float, float] | None
    labels: tuple[str, str]
    spatial: bool

    @property
    def box(self) -> np.ndarray:
        """Lower left and upper right corner (2, 2) of what there is to see: rows x and y, a margin
        around them.
        """
        seen = self.path[:, np.isfinite(self.path).all(axis=0)]
        if self.target is not None:
            cx, cy, radius = self.target
            seen = np.hstack([seen, [[cx - radius, cx + radius], [cy - radius, cy + radius]]])
        return box_around(seen, spatial=self.spatial)

    @property
    def stretch(self) -> float:
        """How much wider the picture is than high, 1 for a phase plane, which fills any frame."""
        width, height = self.box[:, 1] - self.box[:, 0]
        return float(width / height) if self.spatial else 1.0


def scene_of(problem: "Problem") -> Scene:
    """Return the problem's scene, or the phase plane of its first two states; of a single one,
    against time.
    """
    if problem.scene is not None:
        return problem.scene
    first, *others = list(problem.dynamics)
    return Scene(plane=(first, others[0]) if others else (time, first))


def picture(problem: "Problem", solution: "Solution", t: Any = None) -> Picture:
    """Return the scene along a solution at times t (n,), at the nodes where none are given."""
    scene = scene_of(problem)
    at = solution.t if t is None else np.asarray(t, dtype=float)
    x = solution.rows("x") if t is None else solution.at(at)
    path = _values(problem, solution, list(scene.plane), at, x)
    heading = (
        None if scene.heading is None else _values(problem, solution, [scene.heading], at, x)[0]
    )
    labels = [problem.labelled(str(each)) for each in scene.plane]
    found = Picture(
        t=at,
        path=path,
        heading=heading,
        marks=tuple(_marks(problem, solution, scene)),
        flow=None,
        target=scene.target,
        labels=(labels[0], labels[1]),
        spatial=problem.scene is not None,
    )
    if scene.flow is None:
        return found
    return _flowing(problem, solution, scene, found)


def box_around(points: np.ndarray, *, spatial: bool) -> np.ndarray:
    """Return the corners (2, 2) of a box around points (2, n), rows x and y; a spatial one is never
    a mere strip.

    Around no points, as where a solver found none, it is the unit square.
    """
    points = points if points.size else np.array([[0.0, 1.0], [0.0, 1.0]])
    low, high = points.min(axis=1), points.max(axis=1)
    size = high - low
    least = (
        0.15 * size.max() if spatial else np.where(size > 0, size, np.maximum(np.abs(high), 1.0))
    )
    half = 0.5 * np.maximum(size, least) * (1 + 2 * _MARGIN)
    middle = 0.5 * (low + high)
    return np.column_stack([middle - half, middle + half])


def _flowing(problem: "Problem", solution: "Solution", scene: Scene, found: Picture) -> Picture:
    """Return a picture with its current on a grid that is about square."""
    (left, right), (low, high) = found.box
    step = float(np.sqrt((right - left) * (high - low) / _ARROWS))
    across, up = (np.arange(a + step / 2, b, step) for a, b in ((left, right), (low, high)))
    points = np.array([each.ravel() for each in np.meshgrid(across, up)])
    x = np.repeat(solution.rows("x")[:, :1], points.shape[1], axis=1)
    for symbol, row in zip(scene.plane, points, strict=True):
        x[problem.state_names.index(symbol.name())] = row
    t = np.full(points.shape[1], solution.initial_time)
    return replace(found, flow=(points, _values(problem, solution, list(scene.flow or ()), t, x)))


def _marks(problem: "Problem", solution: "Solution", scene: Scene) -> Iterator[Mark]:
    """Yield the switches in order of time, one control at a time."""
    switches = sorted(
        (after[1], f"{name}: {before[0]} {after[0]}")
        for name, row in solution.structure.items()
        for before, after in pairwise(row)
    )
    t = np.array([each[0] for each in switches])
    places = (
        _values(problem, solution, list(scene.plane), t, solution.at(t))
        if t.size
        else np.empty((2, 0))
    )
    for (when, label), place in zip(switches, places.T, strict=True):
        yield Mark(t=float(when), place=place, label=label)


def _values(
    problem: "Problem", solution: "Solution", expressions: list[Expr], t: np.ndarray, x: np.ndarray
) -> np.ndarray:
    """Evaluate expressions at times t (n,) and states x (nx, n); returns (expressions, n)."""
    p = column(solution.parameters[name] for name in problem.parameter_names)
    function = casadi.Function(
        "scene", [problem.x, time, problem.p], [casadi.densify(column(expressions))]
    )
    values = function.map(t.size)(x, t[None, :], casadi.repmat(casadi.DM(p), 1, t.size))
    return np.array(values.full())


def check(scene: Any) -> None:
    """Raise ProblemError unless a scene has the shape of one; its expressions are checked with all
    the others.
    """
    if scene is None:
        return
    if not isinstance(scene, Scene):
        raise ProblemError(f"scene: {shown(scene)} where a Scene(plane=(x, y)) is needed")
    for name, value in (("plane", scene.plane), ("flow", scene.flow)):
        pair = isinstance(value, (tuple, list)) and len(value) == 2
        if not pair and not (name == "flow" and value is None):
            raise ProblemError(
                f"scene {name}: {shown(value)} where a pair of expressions is needed"
            )
    if scene.target is not None:
        _check_target(scene.target)
    if scene.flow is not None:
        _check_flow(scene)


def scene_expressions(scene: Scene | None) -> Iterator[tuple[str, Expr]]:
    """Yield (where it stands, expression) for everything in a scene."""
    if scene is not None:
        yield from (("scene plane", each) for each in scene.plane)
        yield from (("scene flow", each) for each in scene.flow or ())
        yield from (("scene heading", each) for each in [scene.heading] if each is not None)


def _check_target(target: Any) -> None:
    numbers = isinstance(target, (tuple, list)) and len(target) == 3 and all(map(is_number, target))
    if not numbers or not all(map(isfinite, target)) or target[2] <= 0:
        raise ProblemError(
            f"scene target: {shown(target)} where (cx, cy, radius), a disc, is needed"
        )


def _check_flow(scene: Scene) -> None:
    for each in scene.plane:
        if not is_symbol(each) or role(each) != "state":
            what = f"the plane's coordinate {plainly(each)} is no state"
            raise ProblemError(f"scene flow: {what}; a flow needs a plane of states")
    allowed = set(scene.plane)
    for each in scene.flow or ():
        for symbol in casadi.symvar(casadi.SX(each)) if isinstance(each, casadi.SX) else []:
            if role(symbol) == "state" and symbol not in allowed:
                raise ProblemError(
                    f"scene flow: depends on '{symbol}', which is no coordinate of the plane"
                )

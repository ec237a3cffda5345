"""Pictures: the scene of a problem along a solution, a phase plane where the problem has none."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, final

import casadi
import numpy as np

from socp.model import (
    Expr,
    Problem,
    Scene,
    Solution,
    column,
    evaluate,
    numbers,
    parameters_of,
    time,
)

_ARROWS = 90  # of a current, about
_FLAT = 2.5  # pictures wider than this times their height go across a page
_TRIED = 8  # points at which formulas are compared
_MARGIN = 0.06  # of the picture's size, left free around the path


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
    own, and in a phase plane of two states of one unit, or that an angle turns; `others`: paths
    (2, k) beside this one.
    """

    t: np.ndarray
    path: np.ndarray
    heading: np.ndarray | None
    marks: tuple[Mark, ...]
    flow: tuple[np.ndarray, np.ndarray] | None
    target: tuple[float, float, float] | None
    labels: tuple[str, str]
    spatial: bool
    others: tuple[np.ndarray, ...] = ()

    @property
    def box(self) -> np.ndarray:
        """Lower left and upper right corner (2, 2) of what there is to see: rows x and y, a margin
        around them.
        """
        seen = np.hstack([self.path, *self.others])
        seen = seen[:, np.isfinite(seen).all(axis=0)]
        if self.target is not None:
            cx, cy, radius = self.target
            seen = np.hstack([seen, [[cx - radius, cx + radius], [cy - radius, cy + radius]]])
        return box_around(seen, spatial=self.spatial)

    @property
    def stretch(self) -> float:
        """How much wider the picture is than high, 1 for a phase plane, which fills any frame."""
        width, height = self.box[:, 1] - self.box[:, 0]
        return float(width / height) if self.spatial else 1.0

    @property
    def flat(self) -> bool:
        """Whether the picture is so much wider than high that it goes across a page."""
        return self.stretch > _FLAT

    @property
    def headed(self) -> np.ndarray:
        """Numbers of about a dozen points, evenly along the path, at which headings are shown."""
        gone = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self.path, axis=1)))])
        return np.unique(np.searchsorted(gone, np.linspace(0.0, gone[-1], 13)[1:-1]))


def scene_of(problem: Problem) -> Scene:
    """Return the problem's scene, or the phase plane of its first two states; of a single one,
    against time.
    """
    if problem.scene is not None:
        return problem.scene
    first, *others = list(problem.dynamics)
    return Scene(plane=(first, others[0]) if others else (time, first))


def picture_of(problem: Problem, solution: Solution, t: Any = None) -> Picture:
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
        spatial=problem.scene is not None or _alike(problem, scene) or _turned(problem),
    )
    if scene.flow is None:
        return found
    return _flowing(problem, solution, scene, found)


def _alike(problem: Problem, scene: Scene) -> bool:
    """Tell whether both axes of a plane have one and the same unit."""
    first, second = (problem.unit(str(each)) for each in scene.plane)
    return bool(first) and first == second


def _turned(problem: Problem) -> bool:
    """Tell whether an angle turns the rates of the first two states, or the rates of these, as it
    does where both are lengths in one plane.

    With X = a cos q + c and Y = a sin q + d the derivatives by q are X'' = -Y' and Y'' = X', with
    sine and cosine exchanged X'' = Y' and Y'' = -X'. They are compared at points drawn at random,
    the same ones every time.
    """
    x = problem.x
    given = [x, problem.u, problem.p, time]
    random = np.random.default_rng(1)
    at = [random.uniform(0.1, 1.0, (each.numel(), _TRIED)) for each in given]
    rates = problem.rate[:2]
    for pair in (rates, casadi.jtimes(rates, x, problem.rate)):
        for angle in casadi.vertsplit(x)[2:]:
            slope = casadi.jacobian(pair, angle)
            both = casadi.densify(casadi.vertcat(slope, casadi.jacobian(slope, angle)))
            found = numbers(casadi.Function("turned", given, [both]), *at)[0]
            x1, y1, x2, y2 = found[:, np.isfinite(found).all(axis=0)]
            if not (x1.size and x1.all() and y1.all()):
                continue
            near = 1e-9 * np.hypot(x1, y1)
            if any((np.hypot(x2 + s * y1, y2 - s * x1) <= near).all() for s in (1.0, -1.0)):
                return True
    return False


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


def _flowing(problem: Problem, solution: Solution, scene: Scene, picture: Picture) -> Picture:
    """Return a picture with its current on a grid that is about square."""
    (left, right), (low, high) = picture.box
    step = float(np.sqrt((right - left) * (high - low) / _ARROWS))
    across, up = (np.arange(a + step / 2, b, step) for a, b in ((left, right), (low, high)))
    points = np.array([each.ravel() for each in np.meshgrid(across, up)])
    x = np.repeat(solution.rows("x")[:, :1], points.shape[1], axis=1)
    for symbol, row in zip(scene.plane, points, strict=True):
        x[problem.state_names.index(symbol.name())] = row
    t = np.full(points.shape[1], solution.initial_time)
    return replace(picture, flow=(points, _values(problem, solution, list(scene.flow or ()), t, x)))


def _marks(problem: Problem, solution: Solution, scene: Scene) -> Iterator[Mark]:
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
    problem: Problem,
    solution: Solution,
    expressions: list[Expr],
    t: np.ndarray,
    x: np.ndarray,
) -> np.ndarray:
    """Evaluate expressions at times t (n,) and states x (nx, n); returns (expressions, n)."""
    symbols, rows = [problem.x, time, problem.p], casadi.densify(column(expressions))
    function = casadi.Function("scene", symbols, [rows])
    return evaluate(function, x, t, parameters_of(problem, solution))[0]

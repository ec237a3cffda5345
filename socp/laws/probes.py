"""Admissible points, moved onto the surfaces on which a law has to hold: they decide what is zero
there.
"""

from collections.abc import Callable
from functools import lru_cache

import casadi
import numpy as np

from socp.laws.drawing import guessed_ends, reachable_points
from socp.model import TINY, Expr, Problem, expression, numbers, of_motion, once, time

COUNT = 24  # points; a false "zero" would need chance to strike at most of them
# Points where COUNT of them are too few: what is looked for may lie in a corner of the states
_MANY = 240
_DECADES = 4.0  # of sizes over which states are scattered
_PASSES = (
    60  # Gauss-Newton steps at most; from afar each may move no further than the states spread
)
_INERTIA = (
    0.1  # of states against costates: the costate moves first, the state only where it has to
)
# Steps after which half of the points are enough, and after which a point must have come nearer
_PATIENCE = 8
_PROGRESS = (
    0.9  # of the residual so many steps before: a point with more is stuck where the surface is not
)
_TOUCH = 1e-6  # of its spread: a state as near to a bound still moves by as much
_CLOSE = 1e-11  # residual, relative to the size of its terms, of a point that lies on the surface
# Relative perturbation that tells a number from round-off: a number hardly changes, round-off does
_NUDGE = 1e-7
# Times which a matrix and its inverse may enlarge: a step keeps half of its digits, and the next
# corrects it
_SOUND = 1e8
_FAR = 1e3  # spreads: a point moved further than this lies where the problem does not live

Evaluate = Callable[[np.ndarray], tuple[np.ndarray, ...]]


@of_motion
@once
def symbols(problem: Problem) -> Expr:
    """Return all that a point gives values to: t, x, p, the costate and the controls, as one column
    (nv, 1).
    """
    return casadi.vertcat(time, problem.x, problem.p, problem.costate, problem.u)


def evaluator(problem: Problem, *expressions: Expr) -> Evaluate:
    """Return a function of points (nv, n) that gives an array (n, rows, columns) for every
    expression.
    """
    function = casadi.Function("e", [symbols(problem)], [expression(e) for e in expressions])

    def evaluate(points: np.ndarray) -> tuple[np.ndarray, ...]:
        n, found = points.shape[1], numbers(function, points)
        return tuple(
            each.reshape(shape[0], n, shape[1]).transpose(1, 0, 2)
            for each, shape in zip(found, shapes, strict=True)
        )

    shapes = [function.size_out(i) for i in range(function.n_out())]
    return evaluate


@of_motion
@once
def spread(problem: Problem) -> np.ndarray:
    """Return how much every symbol (nv,) varies over the admissible points; where it does not, a
    bit of its size.
    """
    points = admissible(problem)
    size = np.sqrt(np.mean(points**2, axis=1))
    varies = points.std(axis=1)
    return np.where(varies > 1e-9 * size, varies, 1e-3 * np.where(size > 0, size, 1.0))


def admissible(problem: Problem, count: int = COUNT) -> np.ndarray:
    """Return points (nv, count) that random bang controls reach from the start, with random
    costates and controls.
    """
    return _reached(problem, count).copy()


_reached = of_motion(once(reachable_points))


def scattered_points(problem: Problem) -> np.ndarray:
    """Return many points (nv, n), states of two in three nearer to where they start, or to their
    bound or else zero.

    Each is nearer by a random power of ten: rates that saturate, of growth or of a reaction, bend
    where their state is small, and motions seldom stay there.
    """
    points, nx = admissible(problem, _MANY), problem.x.numel()
    start, low = guessed_ends(problem)[0], problem.state_box[0]
    random = np.random.default_rng(4)
    for k, place in enumerate((start, np.where(np.isfinite(low), low, 0.0))):
        away = points[1 : 1 + nx, k::3] - place[:, None]
        points[1 : 1 + nx, k::3] = place[:, None] + away * 10.0 ** random.uniform(
            -_DECADES, 0.0, away.shape
        )
    return points


def note_points(problem: Problem, points: np.ndarray) -> None:
    """Keep points (nv, n) that a solution of the problem shows: laws are looked for from them
    too.
    """
    _noted(problem).append(points)


def noted_points(problem: Problem) -> tuple[np.ndarray, ...]:
    """Return the points (nv, n) kept of solutions, the latest first."""
    return tuple(reversed(_noted(problem)))


@of_motion
@once
def _noted(_problem: Problem) -> list[np.ndarray]:
    return []


def onto(
    problem: Problem,
    equations: Expr,
    points: np.ndarray,
    *,
    interior: bool = False,
    far: float = _FAR,
) -> np.ndarray:
    """Move points (nv, n) in state and costate onto `equations` = 0 (m, 1); return those that
    arrive (nv, k).

    They arrive if they have not moved `far`, in spreads of each symbol. Points within the state
    bounds are preferred: others are returned only where there are none within. In the `interior`
    states are measured by how far they are from their bounds, as interior point methods do: where a
    population or a concentration is zero much vanishes, and no law holds.
    """
    if not equations.numel() or not points.shape[1]:
        return points
    columns, movable = _movable(problem)
    evaluate = evaluator(problem, equations, casadi.jacobian(equations, columns))
    size, start = spread(problem)[movable], points[movable]
    weights = np.where(np.arange(size.size) < problem.x.numel(), _INERTIA * size, size)[:, None]
    room = _room(problem) if interior else None
    points, arrived = points.copy(), np.zeros(points.shape[1], dtype=bool)
    active, before = np.arange(points.shape[1]), np.full(points.shape[1], np.inf)
    for k in range(_PASSES):
        weight = weights if room is None else np.minimum(weights, room(points[:, active]))
        # at all points: a new number of them costs more to prepare for than to evaluate
        value, slope = (each[active] for each in evaluate(points))
        there, step, left = _newton(value[:, :, 0], slope, weight)
        # of those that are there once more: the error squares
        points[movable[:, None], active] += step
        arrived[active[there]] = True
        stays = ~there
        if k % _PATIENCE == _PATIENCE - 1:
            stays &= left < _PROGRESS * before[active]
            before[active] = left
        active = active[stays]
        if not active.size or (k >= _PATIENCE and arrived.mean() > 0.5):
            break
    if not arrived.any():
        return points[:, :0]
    arrived &= (np.abs(points[movable] - start) <= far * size[:, None]).all(axis=0)
    if room is not None:  # an arc on a bound is a boundary arc
        arrived &= (
            room(points)[: problem.x.numel()] > _INERTIA * _TOUCH * size[: problem.x.numel(), None]
        ).all(axis=0)
    return _within(problem, points[:, arrived])


@of_motion
@once
def _movable(problem: Problem) -> tuple[Expr, np.ndarray]:
    """Return the symbols of states and costates, which points are moved in, as one column (2 nx,
    1), and their places in a point (2 nx,).
    """
    nx = problem.x.numel()
    states = np.arange(1, 1 + nx)
    costates = states + nx + problem.p.numel()
    return casadi.vertcat(problem.x, problem.costate), np.concatenate([states, costates])


@of_motion
@once
def points_on(problem: Problem, held: Expr) -> np.ndarray:
    """Return admissible points (nv, k) on state equations `held` = 0 (m, 1), however far they have
    to be moved.
    """
    points, fixed = admissible(problem), fixed_states(problem, held)
    whole = len(fixed) == held.numel()  # then they ask for no more than these values
    found = points[:, :0] if whole else onto(problem, held, points)
    if not found.shape[1]:
        for k, value in fixed.items():
            points[1 + k] = value
        found = _within(problem, points) if whole else onto(problem, held, points, far=np.inf)
    found.setflags(write=False)  # shared by all who ask
    return found


@of_motion
@once
def fixed_states(problem: Problem, held: Expr) -> dict[int, float]:
    """Return the states, by number, that equations `held` (m, 1) fix one by one, as v = 2 does, and
    their values.
    """
    found = {}
    for e in casadi.vertsplit(held) if held.numel() else []:
        inside = casadi.symvar(e)
        if len(inside) == 1 and casadi.depends_on(problem.x, inside[0]):
            slope = casadi.simplify(casadi.jacobian(e, inside[0]))
            if slope.is_constant():
                state = problem.state_names.index(inside[0].name())
                found[state] = float(-casadi.substitute(e, inside[0], 0) / slope)
    return found


def nonzero(problem: Problem, expression: Expr, points: np.ndarray) -> np.ndarray:
    """Tell for every entry of an expression (rows, columns) whether it differs from zero at most of
    the points.

    An entry counts as zero where a tiny change of the point changes it by its own size: it is
    round-off, or vanishes on the surface that the points lie on.
    """
    if not expression.nnz() or not points.shape[1]:
        return np.zeros(expression.shape, dtype=bool)
    if expression.is_constant():
        known = np.array([float(e) for e in expression.elements()])
        number: np.ndarray = np.isfinite(known) & (known != 0)
        return number.reshape(expression.shape, order="F")
    evaluate = evaluator(problem, expression)
    return generic(problem, lambda at: evaluate(at)[0], points)


def generic(
    problem: Problem, value: Callable[[np.ndarray], np.ndarray], points: np.ndarray
) -> np.ndarray:
    """Tell for every entry of value(points) (n, ...) whether it is a number, not round-off, at most
    of the points.
    """
    most: np.ndarray = real(problem, value, points).mean(axis=0) > 0.5
    return most


def real(
    problem: Problem, value: Callable[[np.ndarray], np.ndarray], points: np.ndarray
) -> np.ndarray:
    """Tell for every entry of value(points) (n, ...) at every point whether it is a number, not
    round-off. It is called once, at these points and after them at others nearby.
    """
    n = points.shape[1]
    size = spread(problem)[
        :, None
    ]  # not of these points, on which a symbol may be round-off itself
    moved = points + _NUDGE * size * _directions(points.shape)
    values = value(np.hstack([points, *moved]))
    base, others = values[:n], values[n:].reshape(4, *values[:n].shape)
    with np.errstate(invalid="ignore"):
        same = (np.abs(others - base) < 1e-2 * np.abs(base)).all(axis=0)
    found: np.ndarray = same & np.isfinite(base) & (base != 0)
    return found


@lru_cache(maxsize=16)  # a problem is probed at few counts of points, over and over
def _directions(shape: tuple[int, ...]) -> np.ndarray:
    """Return four random directions (4, nv, n) in which points (nv, n) are moved."""
    return np.random.default_rng(1).standard_normal((4, *shape))


def _room(problem: Problem) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function of points (nv, n): the step (m, n) in states and costates that is half the
    way to bounds.
    """
    nx, (low, high) = problem.x.numel(), (side[:, None] for side in problem.state_box)
    least = _TOUCH * spread(problem)[1 : 1 + nx, None]

    def room(points: np.ndarray) -> np.ndarray:
        x = points[1 : 1 + nx]
        nearest = np.maximum(np.minimum(np.abs(x - low), np.abs(high - x)), least)
        return np.vstack([_INERTIA * nearest / 2, np.full((nx, points.shape[1]), np.inf)])

    return room


def _newton(
    value: np.ndarray, slope: np.ndarray, weight: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which points, of values (n, k) and slopes (n, k, m), lie on the surface (n,), the
    steps (m, n), and residuals (n,) relative to their terms.

    Steps are measured by the sizes `weight` (m, n) of the symbols that may move.
    """
    with np.errstate(all="ignore"):
        scaled = slope * weight.T[:, None, :]
        terms, off = np.abs(scaled).sum(axis=2), np.abs(value)
        arrived = (off <= _CLOSE * terms).all(axis=1)
        rows = np.where(terms > 0, terms, 1.0)
        matrix, right = scaled / rows[:, :, None], value / rows
        finite = np.isfinite(off + terms).all(axis=1)  # what is not in a row is not in its sum
        if not finite.all():
            matrix[~finite], right[~finite] = 0.0, 0.0
        step = -_least(matrix, right)
        length = np.sqrt(np.square(step).sum(axis=1, keepdims=True))
        step *= np.minimum(1.0, 1.0 / np.maximum(_INERTIA * length, TINY))
        left = np.sqrt(np.square(right).sum(axis=1))
    return arrived & finite, step.T * weight, left


def _least(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Return the shortest vectors (n, m) that matrices (n, k, m) send nearest to `right` (n, k).

    matrix' (matrix matrix')^-1 right takes a fifth of the time of singular values, which are left
    to tell the dependence of rows from rounding.
    """
    square = matrix @ matrix.transpose(0, 2, 1)
    diagonal = np.einsum("nii->ni", square)
    diagonal += diagonal == 0  # a row of nothing asks for nothing
    try:
        inverse = np.linalg.inv(square)
    except np.linalg.LinAlgError:  # of one of them: it does not say of which
        inverse = np.full(square.shape, np.nan)
    found: np.ndarray = ((right[:, None, :] @ inverse) @ matrix)[:, 0, :]
    size = np.abs(square).max(axis=(1, 2)) * np.abs(inverse).max(axis=(1, 2))
    close = ~(size < _SOUND)
    if close.any():
        by_values = np.linalg.pinv(matrix[close], rcond=1e-9)
        found[close] = np.einsum("nij,nj->ni", by_values, right[close])
    return found


def _within(problem: Problem, points: np.ndarray) -> np.ndarray:
    low, high = problem.state_box
    x = points[1 : 1 + problem.x.numel()]
    if not points.shape[1]:
        return points
    slack = 1e-8 * spread(problem)[1 : 1 + problem.x.numel(), None]
    inside = ((x >= low[:, None] - slack) & (x <= high[:, None] + slack)).all(axis=0)
    return points[:, inside] if inside.any() else points

"""Random admissible points, moved onto the surfaces on which a law has to hold: they decide what is zero there."""

from collections.abc import Callable
from typing import Any
from weakref import WeakKeyDictionary

import casadi
import numpy as np

from socp.problem import Problem
from socp.symbols import Expr, column, final_time, time

COUNT = 24  # points; a false "zero" would need chance to strike at most of them
_STEPS = 16  # of the simulations that spread the points over what the controls can reach
_DRAWS = 4  # constant controls in one simulation
_PASSES = 60  # Gauss-Newton steps at most; from afar each may move no further than the states spread
_INERTIA = 0.1  # of states against costates: the costate moves first, the state only where it has to
_PATIENCE = 8  # steps after which half of the points are enough
_CLOSE = 1e-11  # residual, relative to the size of its terms, of a point that lies on the surface
_NUDGE = 1e-7  # relative perturbation that tells a number from round-off: a number hardly changes, round-off does
_FAR = 1e3  # spreads: a point moved further than this lies where the problem does not live

Evaluate = Callable[[np.ndarray], tuple[np.ndarray, ...]]
_BASES: WeakKeyDictionary[Problem, np.ndarray] = WeakKeyDictionary()


def symbols(problem: Problem) -> Expr:
    """Return all that a point gives values to: t, x, p, the costate and the controls, as one column (nv, 1)."""
    return casadi.vertcat(time, problem.x, problem.p, problem.costate, problem.u)


def evaluator(problem: Problem, *expressions: Expr) -> Evaluate:
    """Return a function of points (nv, n) that gives an array (n, rows, columns) for every expression."""
    function = casadi.Function("e", [symbols(problem)], [casadi.densify(casadi.SX(e)) for e in expressions])

    def evaluate(points: np.ndarray) -> tuple[np.ndarray, ...]:
        n = points.shape[1]
        if not n:  # casadi maps over one column at least
            return tuple(np.empty((0, *e.shape)) for e in shaped)
        results = function.map(n)(points)
        listed = results if isinstance(results, tuple) else (results,)
        return tuple(
            np.array(r.full()).reshape(e.shape[0], n, e.shape[1]).transpose(1, 0, 2)
            for r, e in zip(listed, shaped, strict=True)
        )

    shaped = [casadi.SX(e) for e in expressions]
    return evaluate


def spread(problem: Problem) -> np.ndarray:
    """Return how much every symbol (nv,) varies over the admissible points; where it does not, a bit of its size."""
    points = admissible(problem)
    size = np.sqrt(np.mean(points**2, axis=1))
    varies = points.std(axis=1)
    return np.where(varies > 1e-9 * size, varies, 1e-3 * np.where(size > 0, size, 1.0))


def admissible(problem: Problem, count: int = COUNT) -> np.ndarray:
    """Return points (nv, count) that random bang controls reach from the start, with random costates and controls."""
    if problem not in _BASES or _BASES[problem].shape[1] < count:
        _BASES[problem] = _reached(problem, count)
    return _BASES[problem][:, :count].copy()


def onto(problem: Problem, equations: Expr, points: np.ndarray) -> np.ndarray:
    """Move points (nv, n) in state and costate onto `equations` = 0 (m, 1); return those that arrive (nv, k).

    Points within the state bounds are preferred: others are returned only where there are none within.
    """
    if not equations.numel() or not points.shape[1]:
        return points
    first = 1 + problem.x.numel() + problem.p.numel()
    movable = np.r_[1 : 1 + problem.x.numel(), first : first + problem.x.numel()]
    evaluate = evaluator(problem, equations, casadi.jacobian(equations, symbols(problem)[movable.tolist()]))
    size, start = spread(problem)[movable], points[movable]
    weight = np.where(np.arange(size.size) < problem.x.numel(), _INERTIA * size, size)
    points, arrived = points.copy(), np.zeros(points.shape[1], dtype=bool)
    for k in range(_PASSES):
        arrived, step = _newton(evaluate, points, weight)
        if arrived.all() or (k >= _PATIENCE and arrived.mean() > 0.5):
            break
        points[movable] += np.where(arrived, 0.0, step)
    points[movable] += np.where(arrived, step, 0.0)  # once more from where the error squares
    if not arrived.any():
        return points[:, :0]
    arrived &= (np.abs(points[movable] - start) <= _FAR * size[:, None]).all(axis=0)
    return _within(problem, points[:, arrived])


def nonzero(problem: Problem, expression: Expr, points: np.ndarray) -> np.ndarray:
    """Tell for every entry of an expression (rows, columns) whether it differs from zero at most of the points.

    An entry counts as zero where a tiny change of the point changes it by its own size: it is round-off, or vanishes
    on the surface that the points lie on.
    """
    if not expression.nnz() or not points.shape[1]:
        return np.zeros(expression.shape, dtype=bool)
    evaluate = evaluator(problem, expression)
    return generic(problem, lambda at: evaluate(at)[0], points)


def generic(problem: Problem, value: Callable[[np.ndarray], np.ndarray], points: np.ndarray) -> np.ndarray:
    """Tell for every entry of value(points) (n, ...) whether it is a number, not round-off, at most of the points."""
    random, n = np.random.default_rng(1), points.shape[1]
    size = spread(problem)[:, None]  # not of these points, on which a symbol may be round-off itself
    moved = [points + _NUDGE * size * random.standard_normal(points.shape) for _ in range(4)]
    values = value(np.hstack([points, *moved]))
    base = values[:n]
    real = np.isfinite(base) & (base != 0)
    with np.errstate(invalid="ignore"):
        for k in range(1, 5):
            real &= np.abs(values[k * n : (k + 1) * n] - base) < 1e-2 * np.abs(base)
    most: np.ndarray = real.mean(axis=0) > 0.5
    return most


def _newton(evaluate: Evaluate, points: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return which points lie on the surface (n,) and the step (m, n) of the movable symbols, of sizes weight (m,)."""
    with np.errstate(all="ignore"):
        value, slope = evaluate(points)
        value, scaled = value[:, :, 0], slope * weight
        terms = np.abs(scaled).sum(axis=2)
        arrived = (np.abs(value) <= _CLOSE * terms).all(axis=1)
        rows = np.where(terms > 0, terms, 1.0)
        finite = np.isfinite(value).all(axis=1) & np.isfinite(scaled).all(axis=(1, 2))
        matrix = np.where(finite[:, None, None], scaled / rows[:, :, None], 0.0)
        right = np.where(finite[:, None], value / rows, 0.0)
        step = -np.einsum("nij,nj->ni", np.linalg.pinv(matrix, rcond=1e-9), right)
        length = np.linalg.norm(step, axis=1, keepdims=True)
        step *= np.minimum(1.0, 1.0 / (_INERTIA * length).clip(1e-300))
    return arrived & finite, (step * weight).T


def _within(problem: Problem, points: np.ndarray) -> np.ndarray:
    low, high = problem.state_box
    x = points[1 : 1 + problem.x.numel()]
    if not points.shape[1]:
        return points
    slack = 1e-8 * spread(problem)[1 : 1 + problem.x.numel(), None]
    inside = ((x >= low[:, None] - slack) & (x <= high[:, None] + slack)).all(axis=0)
    return points[:, inside] if inside.any() else points


def _reached(problem: Problem, count: int) -> np.ndarray:
    random = np.random.default_rng(0)
    x0, horizon = _starts(problem, count, random), _horizon(problem)
    p = _drawn(problem.parameter_box, count, random)
    t0 = problem.initial_time_box[0] if np.isfinite(problem.initial_time_box[0]) else 0.0
    lengths = horizon * random.uniform(0.05, 1.0, count)
    x = _simulated(problem, x0, (t0, lengths, p), random)
    x = np.where(np.isfinite(x), x, x0)
    moved = np.abs(x - x0).mean(axis=1, keepdims=True)
    x += 0.1 * moved * random.standard_normal(x.shape)
    low, high = problem.state_box
    x = np.clip(x, low[:, None], high[:, None])
    size = np.sqrt(np.mean(x**2, axis=1, keepdims=True)) + 1e-12
    costate = random.standard_normal(x.shape) * _cost(problem, x, t0 + lengths, p) / np.where(size > 1e-9, size, 1.0)
    return np.vstack([(t0 + lengths)[None, :], x, p, costate, _bangs(problem, count, random)])


def _simulated(
    problem: Problem, x: np.ndarray, given: tuple[float, np.ndarray, np.ndarray], random: np.random.Generator
) -> np.ndarray:
    """Integrate random piecewise constant bang controls by Runge-Kutta, states kept within their bounds."""
    (t0, lengths, p), count = given, x.shape[1]
    flow = casadi.Function("f", [problem.x, problem.u, time, problem.p], [problem.rate]).map(count)
    low, high = problem.state_box
    u = _bangs(problem, count, random)
    for k in range(_STEPS):
        if k % (_STEPS // _DRAWS) == 0:
            u = _bangs(problem, count, random)
        h, t = lengths / _STEPS, t0 + lengths * k / _STEPS
        with np.errstate(all="ignore"):
            a = flow(x, u, t, p).full()
            b = flow(x + h / 2 * a, u, t + h / 2, p).full()
            c = flow(x + h / 2 * b, u, t + h / 2, p).full()
            d = flow(x + h * c, u, t + h, p).full()
            x = np.clip(x + h / 6 * (a + 2 * b + 2 * c + d), low[:, None], high[:, None])
    return x


def _starts(problem: Problem, count: int, random: np.random.Generator) -> np.ndarray:
    known = _drawn(problem.start_box, count, random)
    other = _drawn(problem.end_box, count, random)
    open_ = ~np.isfinite(problem.start_box).all(axis=0)
    return np.where(open_[:, None], other, known)


def _drawn(box: np.ndarray, count: int, random: np.random.Generator) -> np.ndarray:
    """Draw values (n, count) from intervals (2, n); an open end is put one size of the other one away."""
    low, high = box
    reach = (
        np.nan_to_num(np.where(np.isfinite(low), np.abs(low), 0.0) + np.where(np.isfinite(high), np.abs(high), 0.0))
        + 1.0
    )
    first = np.where(np.isfinite(low), low, np.where(np.isfinite(high), high, 0.0) - reach)
    last = np.where(np.isfinite(high), high, np.where(np.isfinite(low), low, 0.0) + reach)
    drawn: np.ndarray = first[:, None] + (last - first)[:, None] * random.random((low.size, count))
    return drawn


def _bangs(problem: Problem, count: int, random: np.random.Generator) -> np.ndarray:
    side = random.integers(0, 2, (problem.box.shape[1], count))
    drawn: np.ndarray = np.where(side == 1, problem.box[1][:, None], problem.box[0][:, None])
    return drawn


def _horizon(problem: Problem) -> float:
    """Return the fixed or guessed horizon, else how long the slowest state needs for its way at its highest rate."""
    low, high = problem.final_time_box
    first = problem.initial_time_box[0] if np.isfinite(problem.initial_time_box[0]) else 0.0
    guess: Any = problem.guess.get(final_time)
    if low == high:
        return low - first
    if guess is not None:
        return max(float(guess) - first, 1e-9)
    random = np.random.default_rng(2)
    x = _starts(problem, COUNT, random)
    flow = casadi.Function("f", [problem.x, problem.u, time, problem.p], [problem.rate]).map(COUNT)
    p = _drawn(problem.parameter_box, COUNT, random)
    rate = np.nanmax(np.abs(flow(x, _bangs(problem, COUNT, random), first, p).full()), axis=1)
    with np.errstate(all="ignore"):
        needed = np.abs(problem.end_box.mean(axis=0) - problem.start_box.mean(axis=0)) / rate
    needed = needed[np.isfinite(needed) & (needed > 0)]
    return float(needed.max()) if needed.size else 1.0


def _cost(problem: Problem, x: np.ndarray, t: np.ndarray, p: np.ndarray) -> float:
    """Return the size of the running cost over points, 1 where there is none: costates are measured by it."""
    u = np.zeros((problem.u.numel(), x.shape[1]))
    running = casadi.Function("L", [problem.x, problem.u, time, problem.p], [column([problem.lagrangian])]).map(
        x.shape[1]
    )
    value = np.abs(running(x, u, t, p).full())
    size = float(np.nanmean(np.where(np.isfinite(value), value, np.nan))) if np.isfinite(value).any() else 0.0
    return size if size > 0 else 1.0

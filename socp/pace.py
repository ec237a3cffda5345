"""Both ends of a problem as far as they can be guessed, and how long the way between them takes."""

import casadi
import numpy as np

from socp.problem import Problem
from socp.symbols import column, final_time, initial_time, time


def ends(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Return guessed states at both ends: the given value, that of the other end, or the nearest to zero in the box."""
    box = problem.state_box
    found = []
    for own, other in ((problem.start_box, problem.end_box), (problem.end_box, problem.start_box)):
        middle = np.where(
            np.isfinite(other).all(axis=0), np.nan_to_num(other, posinf=0.0, neginf=0.0).mean(axis=0), 0.0
        )
        found.append(np.clip(np.clip(middle, *own), *box))
    return found[0], _reach(problem, *found)


def travel_time(problem: Problem, x0: np.ndarray, xf: np.ndarray, t0: float) -> float:
    """Estimate the time from x0 (nx,) to xf (nx,): |x'| T + |x''| T^2 / 2 = |xf - x0| for the slowest state.

    Rates and their derivatives are taken over samples of the line between the ends, of bounded states within their
    bounds and of the box of controls. Returns 1 where nothing moves.
    """
    rate = problem.rate
    second = casadi.jtimes(rate, problem.x, rate) + casadi.jacobian(rate, time)
    function = casadi.Function("rates", [problem.x, problem.u, time, problem.p], [rate, second])
    random = np.random.default_rng(0)
    count = 200  # enough to meet the order of magnitude; the guess needs no more
    share = random.random(count)
    x = x0[:, None] + (xf - x0)[:, None] * share
    bounded = np.isfinite(problem.state_box).all(axis=0)
    low, high = problem.state_box[:, bounded]
    x[bounded] = low[:, None] + (high - low)[:, None] * random.random((int(bounded.sum()), count))
    u = problem.box[random.integers(0, 2, (problem.box.shape[1], count)), np.arange(problem.box.shape[1])[:, None]]
    p = np.clip(np.zeros(problem.p.numel()), *problem.parameter_box)
    values = [function(x[:, k], u[:, k], t0, p) for k in range(count)]
    first, curve = (np.nanmax(np.abs(np.hstack([v[i].full() for v in values])), axis=1) for i in (0, 1))
    distance = np.abs(xf - x0)
    with np.errstate(divide="ignore", invalid="ignore"):
        needed = 2.0 * distance / (first + np.sqrt(first**2 + 2.0 * curve * distance))
    needed = needed[np.isfinite(needed) & (needed > 0)]
    # a state that these samples hardly move (one that a heading across the line would move) says nothing
    return float(needed[needed <= 1e3 * needed.min()].max()) if needed.size else 1.0


def _reach(problem: Problem, x0: np.ndarray, xf: np.ndarray) -> np.ndarray:
    """Move a guessed end state (nx,) within its box until it meets the target conditions, by Gauss-Newton."""
    if not problem.conditions:
        return xf
    values = column(c.expression if c.equation else casadi.fmax(c.expression, 0) for c in problem.conditions)
    start = [problem.x0, problem.p, initial_time, final_time]
    function = casadi.Function("target", [problem.x, *start], [values, casadi.jacobian(values, problem.x)])
    movable = problem.end_box[0] < problem.end_box[1]
    for _ in range(30):  # Newton from afar halves a quadratic's distance at every step: 30 cover nine digits
        value, slope = (each.full() for each in function(xf, x0, 0.0, 0.0, 1.0))
        if not np.isfinite(value).all() or not np.isfinite(slope).all():
            break
        xf = np.clip(xf - np.linalg.pinv(slope * movable) @ value[:, 0], *problem.end_box)
    return xf

"""Where the states can be at all: bounds from their rates, both ends and the longest horizon, for global solvers."""

import casadi
import numpy as np

from socp.enclosure import enclosed
from socp.problem import Problem
from socp.symbols import time
from socp.tables import Table

_ROUNDS = 8  # tighter bounds may bound the rates more tightly; this many times is enough


def reachable(problem: Problem, horizon: float, t: Table) -> np.ndarray:
    """Return bounds (2, nx) of the states at all nodes of arcs collocated by a table, within a horizon at most so long.

    At the ends of arcs a state is as far from both ends of the horizon as its rate allows. Between them a collocation
    polynomial may leave that region, by its coefficients of the wrong sign. Infinite where nothing bounds the state.
    """
    box, symbols = problem.state_box.copy(), casadi.vertcat(problem.x, problem.u, time, problem.p)
    times = np.array([[problem.initial_time_box[0]], [problem.final_time_box[1]]])
    over = horizon * _overshoot(t)
    for _ in range(_ROUNDS):
        low, high = enclosed(problem.rate, symbols, np.hstack([box, problem.box, times, problem.parameter_box]))
        with np.errstate(invalid="ignore"):
            top = _farthest(problem.start_box[1], problem.end_box[1], low, high, horizon)
            bottom = -_farthest(-problem.start_box[0], -problem.end_box[0], -high, -low, horizon)
            wide = _known(over * (high - low))
        box = np.array([np.fmax(box[0], bottom - wide), np.fmin(box[1], top + wide)])
    return box


def _farthest(start: np.ndarray, end: np.ndarray, low: np.ndarray, high: np.ndarray, horizon: float) -> np.ndarray:
    """Return the largest of min(start + high t, end - low (horizon - t)) over t; infinite where it is unbounded."""
    spread = np.where(high > low, high - low, 1.0)
    meet = np.clip((end - start - low * horizon) / spread, 0.0, horizon)
    meet = np.where(np.isfinite(meet), meet, np.where(np.isfinite(start), horizon, 0.0))
    places = [np.zeros_like(meet), meet, np.full_like(meet, horizon)]
    values = [np.fmin(start + high * t, end - low * (horizon - t)) for t in places]
    return _known(np.max(values, axis=0))


def _overshoot(t: Table) -> float:
    """Return the largest sum of the negative coefficients of a node's state, as a share of the arc's length.

    The state is that of the nearer end plus the length times coefficients times rates; the coefficients sum to the
    distance from that end.
    """
    A, B = t.A.toarray(), t.B.toarray()
    forward = np.linalg.solve(A[:, 1:], B)
    backward = np.linalg.solve(A[:, :-1], B)
    ahead = np.append(0.0, np.maximum(-forward, 0.0).sum(axis=1))
    behind = np.append(np.maximum(backward, 0.0).sum(axis=1), 0.0)
    return float(np.minimum(ahead, behind).max())


def _known(values: np.ndarray) -> np.ndarray:
    """Return values with infinity where nothing is known of them."""
    return np.where(np.isnan(values), np.inf, values)

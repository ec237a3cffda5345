"""Intervals that hold all values of an expression on a box: big-M constants and bounds of states
come from them.
"""

import math
from collections.abc import Callable
from typing import Any

import casadi
import numpy as np

from socp.model import Expr, Problem, interpret, time
from socp.transcription import Table

Span = tuple[float, float]

_ALL: Span = (-math.inf, math.inf)


def enclosures(expressions: Expr, symbols: Expr, box: np.ndarray) -> np.ndarray:
    """Return an interval (2, m) for every expression (m, 1) of symbols (n, 1) within box (2, n),
    infinite ones allowed.

    By interval arithmetic, so it may be wider than the values; what casadi computes beyond the
    functions known here is taken as unbounded.
    """
    spans: list[Span] = [(float(low), float(high)) for low, high in box.T]
    found = interpret(
        expressions,
        symbols,
        spans,
        _OPERATIONS,
        lambda number: (number, number),
        lambda *_given: _ALL,
    )
    return np.array(found, dtype=float).reshape(-1, 2).T


def _times(a: float, b: float) -> float:
    return (
        0.0 if a == 0 or b == 0 else a * b
    )  # 0 times infinity is 0: the factor is a bound, not a limit


def _mul(a: Span, b: Span) -> Span:
    corners = [_times(i, j) for i in a for j in b]
    return min(corners), max(corners)


def _inv(a: Span) -> Span:
    if a[0] <= 0 <= a[1]:
        return (1 / a[1] if a[1] else math.inf, math.inf) if a[0] == 0 else _ALL
    low, high = (0.0 if math.isinf(v) else 1 / v for v in (a[1], a[0]))
    return low, high


def _sq(a: Span) -> Span:
    ends = sorted(_times(v, v) for v in a)
    return (0.0 if a[0] <= 0 <= a[1] else ends[0]), ends[1]


def _abs(a: Span) -> Span:
    ends = sorted(map(abs, a))
    return (0.0 if a[0] <= 0 <= a[1] else ends[0]), ends[1]


def _wave(function: Callable[[float], float], crest: float) -> Callable[[Span], Span]:
    """Return sin or cos on intervals; crest: one place of its maximum."""

    def on(a: Span) -> Span:
        if not all(map(math.isfinite, a)) or a[1] - a[0] >= 2 * math.pi:
            return -1.0, 1.0
        low, high = sorted((function(a[0]), function(a[1])))
        meets = [
            math.floor((a[1] - at) / (2 * math.pi)) >= math.ceil((a[0] - at) / (2 * math.pi))
            for at in (crest, crest + math.pi)
        ]
        return (-1.0 if meets[1] else low), (1.0 if meets[0] else high)

    return on


def _rising(function: Callable[[float], float], domain: Span = _ALL) -> Callable[[Span], Span]:
    """Return a monotone function on intervals, cut to where it is defined."""

    def at(value: float) -> float:
        try:
            return function(min(max(value, domain[0]), domain[1]))
        except OverflowError:
            return math.inf if value > 0 else -math.inf
        except ValueError:
            return -math.inf

    return lambda a: (at(a[0]), at(a[1]))


def _cosh(a: Span) -> Span:
    low, high = _abs(a)
    return _rising(math.cosh)((low, high))


def _pow(a: Span, b: Span) -> Span:
    power = b[0]
    if b[0] != b[1] or (a[0] < 0 and power != int(power)):
        return _ALL
    if power < 0:
        return _inv(_pow(a, (-power, -power)))
    if power == int(power) and int(power) % 2 == 0:
        a = _abs(a)
    return _rising(lambda v: v**power)(a)


_OPERATIONS: dict[int, Any] = {
    casadi.OP_ASSIGN: lambda a: a,
    casadi.OP_ADD: lambda a, b: (a[0] + b[0], a[1] + b[1]),
    casadi.OP_SUB: lambda a, b: (a[0] - b[1], a[1] - b[0]),
    casadi.OP_NEG: lambda a: (-a[1], -a[0]),
    casadi.OP_TWICE: lambda a: (2 * a[0], 2 * a[1]),
    casadi.OP_MUL: _mul,
    casadi.OP_DIV: lambda a, b: _mul(a, _inv(b)),
    casadi.OP_INV: _inv,
    casadi.OP_SQ: _sq,
    casadi.OP_FABS: _abs,
    casadi.OP_SQRT: _rising(math.sqrt, (0.0, math.inf)),
    casadi.OP_EXP: _rising(math.exp),
    casadi.OP_LOG: _rising(math.log, (0.0, math.inf)),
    casadi.OP_TANH: _rising(math.tanh),
    casadi.OP_SINH: _rising(math.sinh),
    casadi.OP_COSH: _cosh,
    casadi.OP_ATAN: _rising(math.atan),
    casadi.OP_ASIN: _rising(math.asin, (-1.0, 1.0)),
    casadi.OP_SIN: _wave(math.sin, math.pi / 2),
    casadi.OP_COS: _wave(math.cos, 0.0),
    casadi.OP_POW: _pow,
    casadi.OP_CONSTPOW: _pow,
    casadi.OP_FMIN: lambda a, b: (min(a[0], b[0]), min(a[1], b[1])),
    casadi.OP_FMAX: lambda a, b: (max(a[0], b[0]), max(a[1], b[1])),
    casadi.OP_SIGN: lambda a: (float(np.sign(a[0])), float(np.sign(a[1]))),
}


_ROUNDS = 8  # tighter bounds may bound the rates more tightly; this many times is enough


def reachable(problem: Problem, horizon: float, t: Table) -> np.ndarray:
    """Return bounds (2, nx) of the states at all nodes of arcs collocated by a table, within a
    horizon at most so long.

    At the ends of arcs a state is as far from both ends of the horizon as its rate allows. Between
    them a collocation polynomial may leave that region, by its coefficients of the wrong sign.
    Infinite where nothing bounds the state.
    """
    box, symbols = problem.state_box.copy(), casadi.vertcat(problem.x, problem.u, time, problem.p)
    times = np.array([[problem.initial_time_box[0]], [problem.final_time_box[1]]])
    over = horizon * _overshoot(t)
    for _ in range(_ROUNDS):
        low, high = enclosures(
            problem.rate, symbols, np.hstack([box, problem.box, times, problem.parameter_box])
        )
        with np.errstate(invalid="ignore"):
            top = _farthest(problem.start_box[1], problem.end_box[1], low, high, horizon)
            bottom = -_farthest(-problem.start_box[0], -problem.end_box[0], -high, -low, horizon)
            wide = _known(over * (high - low))
        box = np.array([np.fmax(box[0], bottom - wide), np.fmin(box[1], top + wide)])
    return box


def _farthest(
    start: np.ndarray, end: np.ndarray, low: np.ndarray, high: np.ndarray, horizon: float
) -> np.ndarray:
    """Return the largest of min(start + high t, end - low (horizon - t)) over t; infinite where it
    is unbounded.
    """
    spread = np.where(high > low, high - low, 1.0)
    meet = np.clip((end - start - low * horizon) / spread, 0.0, horizon)
    meet = np.where(np.isfinite(meet), meet, np.where(np.isfinite(start), horizon, 0.0))
    places = [np.zeros_like(meet), meet, np.full_like(meet, horizon)]
    values = [np.fmin(start + high * t, end - low * (horizon - t)) for t in places]
    return _known(np.max(values, axis=0))


def _overshoot(t: Table) -> float:
    """Return the largest sum of the negative coefficients of a node's state, as a share of the
    arc's length.

    The state is that of the nearer end plus the length times coefficients times rates; the
    coefficients sum to the distance from that end.
    """
    A, B = t.A.array(), t.B.array()
    forward = np.linalg.solve(A[:, 1:], B)
    backward = np.linalg.solve(A[:, :-1], B)
    ahead = np.append(0.0, np.maximum(-forward, 0.0).sum(axis=1))
    behind = np.append(np.maximum(backward, 0.0).sum(axis=1), 0.0)
    return float(np.minimum(ahead, behind).max())


def _known(values: np.ndarray) -> np.ndarray:
    """Return values with infinity where nothing is known of them."""
    return np.where(np.isnan(values), np.inf, values)

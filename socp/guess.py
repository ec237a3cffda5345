"""The guess of a problem: what its file says, straight lines and the middle of the box elsewhere."""

from typing import Any

import casadi
import numpy as np

from socp.problem import Problem
from socp.solution import Arc, Solution, Stop
from socp.symbols import column, final_time, initial_time, time

_NODES = 101  # a guess that varies in time is sampled as finely as a plot would be


def default_guess(problem: Problem) -> Solution:
    """Return a straight-line guess with one arc: from start to end values, controls as near to zero as their box allows.

    What the problem's own `guess` says takes precedence. A free final time is estimated from how fast the box of controls
    can move the states over the distance they have to go.
    """
    first = _within(problem.guess.get(initial_time), problem.initial_time_box, 0.0)
    x0, xf = _ends(problem)
    low, high = problem.final_time_box
    horizon = max(low - first, 0.0) if low == high else travel_time(problem, x0, xf, first)
    last = _within(problem.guess.get(final_time), problem.final_time_box, first + horizon)
    if last <= first:
        last = first + horizon
    t = np.linspace(first, last, _NODES)
    share = np.linspace(0.0, 1.0, _NODES)
    x = x0[:, None] + (xf - x0)[:, None] * share
    u = np.repeat(np.clip(0.0, *problem.box)[:, None], _NODES, axis=1)
    p = {name: _within(None, tuple(box), 0.0) for name, box in zip(problem.parameter_names, problem.parameter_box.T, strict=True)}
    for symbol, value in problem.guess.items():
        if symbol.name() in problem.state_names and symbol in problem.dynamics:
            x[problem.state_names.index(symbol.name())] = _row(value, t, share)
        elif symbol.name() in problem.control_names:
            u[problem.control_names.index(symbol.name())] = _row(value, t, share)
        elif symbol.name() in p:
            p[symbol.name()] = float(_row(value, t, share)[0])
    return guess_of(problem, t, x, u, p)


def guess_of(problem: Problem, t: np.ndarray, x: np.ndarray, u: np.ndarray, p: dict[str, float] | None = None) -> Solution:
    """Return values at times t (n,), x (nx, n) and u (nu, n) as a piecewise linear guess of one arc."""
    unknown = np.full_like(x, np.nan)
    arc = Arc(t=t, x=x, u=u, costate=unknown, mesh=np.arange(t.size), side="both", modes=("*",) * u.shape[0])
    return Solution(
        problem=problem.name, method="guess", arcs=(arc,), objective=float("nan"), stop=Stop.FAILED, message="a guess",
        state_names=problem.state_names, control_names=problem.control_names, parameters=p or {},
    )  # fmt: skip


def split(guess: Solution, lengths: list[float]) -> Solution:
    """Return a guess cut into arcs of the given relative or absolute lengths, rescaled to the guess's own horizon."""
    share = np.cumsum([0.0, *lengths]) / sum(lengths)
    corners = guess.initial_time + share * (guess.final_time - guess.initial_time)
    arcs = []
    for a, b in zip(corners[:-1], corners[1:], strict=True):
        t = np.linspace(a, b, _NODES)
        x, u, costate = (guess.at(t, which) for which in ("x", "u", "costate"))
        arcs.append(Arc(t=t, x=x, u=u, costate=costate, mesh=np.arange(t.size), side="both", modes=("*",) * u.shape[0]))
    fields: dict[str, Any] = {name: getattr(guess, name) for name in ("problem", "state_names", "control_names", "parameters")}
    return Solution(method="guess", arcs=tuple(arcs), objective=float("nan"), stop=Stop.FAILED, message="a guess", **fields)


def travel_time(problem: Problem, x0: np.ndarray, xf: np.ndarray, t0: float) -> float:
    """Estimate how long the states need from x0 (nx,) to xf (nx,): T with |x'| T + |x''| T^2 / 2 = |xf - x0|, the worst state.

    Rates and their derivatives are taken over samples of the line between the ends, of bounded states within their bounds and
    of the box of controls. Returns 1 where nothing moves.
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
    return float(needed.max()) if needed.size else 1.0


def _ends(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Return guessed values of the states at both ends: the given one, its neighbour at the other end, or near zero in its box."""
    box = problem.state_box
    ends = []
    for own, other in ((problem.start_box, problem.end_box), (problem.end_box, problem.start_box)):
        middle = np.where(np.isfinite(other).all(axis=0), np.nan_to_num(other, posinf=0.0, neginf=0.0).mean(axis=0), 0.0)
        ends.append(np.clip(np.clip(middle, *own), *box))
    return ends[0], _reach(problem, *ends)


def _reach(problem: Problem, x0: np.ndarray, xf: np.ndarray) -> np.ndarray:
    """Move a guessed end state (nx,) as little as its end box allows until it meets the target conditions, by Gauss-Newton."""
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


def _within(value: Any, box: tuple[float, float], otherwise: float) -> float:
    return float(np.clip(otherwise if value is None else float(value), *box))


def _row(value: Any, t: np.ndarray, share: np.ndarray) -> np.ndarray:
    if isinstance(value, (tuple, list)):
        return float(value[0]) + (float(value[1]) - float(value[0])) * share
    row = casadi.Function("guess", [time], [casadi.SX(value)]).map(t.size)(t[None, :])
    return np.array(row.full()).ravel()

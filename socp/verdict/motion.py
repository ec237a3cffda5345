"""Where controls really go: a solution's controls integrated by DOP853, as functions of time or as
feedback.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import groupby
from typing import TYPE_CHECKING, Any, final

import casadi
import numpy as np

from socp.model import (
    EXTREMAL,
    Arc,
    Problem,
    Solution,
    fast,
    lagrange,
    magnitude,
    of_motion,
    once,
    parameters_of,
    running_costs,
    scales,
)
from socp.process import in_time
from socp.verdict.simulation.domains import domain_ended
from socp.verdict.simulation.pieces import (
    Control,
    Piece,
    closed_flow,
    controls_of,
    cut_at_knots,
    open_flow,
    planned,
)
from socp.verdict.simulation.steps import Flow, Steps
from socp.verdict.simulation.strides import Course, Strides, strides

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver
else:
    OdeSolver = Any

RTOL = 1e-10  # of DOP853; what is compared with it is seldom better than 1e-9
# The same where a motion enlarges what steps leave: a decade above what rounding lets through
FINE = 1e-13
# Points looked at in every step: a parabola, which takes DOP853 one step, hides 1/400 of its height
# there
_LOOKS = 20
# Of the horizon: how long a step is tried at most. Its stages leave a quarter of it without a look
_LONGEST = 1 / 16
_GLANCES = 4  # the same on a short piece, over which nothing rises much
# Steps of DOP853, but for the first few on every piece, after which a motion is taken for stiff and
# goes on by a method for that: some second of time, and what is not stiff takes a tenth
_MANY, _FEW = 1000, 10
# Steps on one piece: where a rate grows without end those of that method shrink until time stands
# still, and it does not say so; what is stiff takes some thousands
_MOST = 100_000
_DIVERGED = 1e6  # times the problem's own magnitude: the state has left for good
# A piece this short against the horizon is tried in one step: no time goes into choosing the first
_SHORT = 1e-2

Leg = tuple[Arc, Piece]
# magnitudes of what moves (n,), the horizon, and the relative tolerance of steps
Size = tuple[np.ndarray, float, float]


@final
@dataclass(eq=False)
class Log:
    """Points looked at along the way, those of a piece each, the states at the returned nodes, how
    far (nx,) the claimed ones were off at most, and the steps that tell a stiff motion.
    """

    t: list[np.ndarray] = field(default_factory=list)
    x: list[np.ndarray] = field(default_factory=list)
    u: list[np.ndarray] = field(default_factory=list)
    nodes: list[np.ndarray] = field(default_factory=list)
    steps: int = 0
    off: np.ndarray = field(default_factory=lambda: np.zeros(1))

    def compare(self, x: np.ndarray, claimed: np.ndarray) -> None:
        """Compare states (nx, k) with those claimed for the same times, the next nodes."""
        self.nodes.append(x)
        self.off = np.maximum(self.off, np.abs(x - claimed).max(axis=1, initial=0.0))

    @property
    def motion(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times (n,), states (nx, n) and controls (nu, n) of the points."""
        return np.concatenate(self.t), np.hstack(self.x), np.hstack(self.u)


@final
@dataclass(frozen=True, eq=False)
class _Looks:
    """Points looked at on one piece of an arc, on their way into a log."""

    log: Log
    arc: Arc
    t: list[np.ndarray]
    x: list[np.ndarray]

    def add(self, solver: Steps | OdeSolver, count: int) -> None:
        """Look at so many points of the last step, and compare the nodes within it."""
        t = solver.t_old + (solver.t - solver.t_old) * _shares(count)
        t[-1] = solver.t
        nodes = slice(*self.arc.t.searchsorted((solver.t_old, solver.t), side="right"))
        at = np.concatenate([t, self.arc.t[nodes]])
        x = (solver.between(at) if isinstance(solver, Steps) else solver.dense_output()(at))[:-1]
        self.t.append(t)
        self.x.append(x[:, :count])
        if at.size > count:
            self.log.compare(x[:, count:], self.arc.x[:, nodes])


@cache
def _shares(count: int) -> np.ndarray:
    return np.arange(1, count + 1) / count


def travel(
    problem: Problem,
    solution: Solution,
    pieces: list[list[Piece]],
    log: Log,
    rtol: float = RTOL,
) -> tuple[np.ndarray, str]:
    """Integrate motion and running cost over all pieces, each step to a relative tolerance; returns
    both at the end and, where it breaks down, why. Raises LateError where the time allowed is over
    first.
    """
    p = parameters_of(problem, solution)
    y = np.append(np.clip(solution.arcs[0].x[:, 0], *problem.start_box), 0.0)
    if not all(np.isfinite(values).all() for values in (y, solution.t, solution.rows("u"), p)):
        at, x = np.array([solution.initial_time]), y[:-1, None]
        log.t, log.x, log.u = [at], [x], [pieces[0][0].controls(problem, at, x, p)]
        log.off = np.array([math.inf])
        return y, "the solution itself is not finite"
    horizon = solution.final_time - solution.initial_time
    scale = np.append(scales(problem, solution), running_size(solution, problem))
    legs = [
        (arc, piece)
        for arc, stretches in zip(solution.arcs, pieces, strict=True)
        for whole in stretches
        for piece in cut_at_knots(problem, whole)
    ]
    size = scale, horizon, rtol
    found, left, begun = _in_rows(problem, legs, (y, p), size), legs, None
    if found.ends.size:
        _noted(problem, legs, found, (p, horizon), log)
        y, left, begun = found.after[-1], _left(legs, found), legs[found.on[-1]][0]
    for arc, piece in left:
        if arc is not begun:
            log.compare(y[:-1, None], arc.x[:, :1])
            begun = arc
        looks = _Looks(log, arc, [np.array([piece.start])], [y[:-1, None]])
        y, error = _integrate(piece, _flow(problem, piece, p), y, size, looks)
        log.t.append(t := np.concatenate(looks.t))
        log.x.append(x := np.hstack(looks.x))
        log.u.append(piece.controls(problem, t, x, p))
        if error:
            return y, error + domain_ended(problem, y[:-1], t[-1], p, scale[:-1])
    return y, ""


def _in_rows(
    problem: Problem, legs: Sequence[Leg], now: tuple[np.ndarray, np.ndarray], size: Size
) -> Strides:
    """Take steps in rows from y under parameters p for as long as that leads on, those of all plans
    in one and those of a law; none where casadi does not know a control.
    """
    (y, p), (scale, horizon, rtol) = now, size
    pieces = [piece for _, piece in legs]
    known = all(each.control is None and each.end > each.start for each in pieces)
    most = np.append(_DIVERGED * scale[:-1], math.inf)
    latest = np.array([_latest(each) for each in pieces])
    done = [Strides.none(y.size)]
    flows = [_moving(problem, each) for each in pieces] if known else []
    controls = planned(pieces)
    for _, group in groupby(range(len(flows)), key=lambda k: id(flows[k])):
        own = list(group)
        course = Course(flows[own[0]], controls, p, latest, rtol, rtol * scale)
        laid = np.hstack([_laid(legs[k], k, _LONGEST * horizon) for k in own])
        done.append(found := strides(course, laid, y, most))
        if not found.ends.size or found.ends[-1] < pieces[own[-1]].end:
            break
        y = found.after[-1]
    return Strides.joined(done)


def _laid(leg: Leg, k: int, longest: float) -> np.ndarray:
    """Return steps as `strides` has them: one over a plan, one an interval of the mesh by a law,
    or several that are not too long.
    """
    (arc, piece), corners = leg, np.array([leg[1].start, leg[1].end])
    if piece.modes is not None:
        inside = arc.t[arc.mesh]
        inside = inside[(inside > piece.start) & (inside < piece.end)]
        corners = np.concatenate([corners[:1], inside, corners[1:]])
    if piece.end - piece.start > longest:
        place = np.append(0.0, np.cumsum(np.ceil(np.diff(corners) / longest)))
        corners = np.interp(np.arange(place[-1] + 1), place, corners)
    return np.array([corners[:-1], corners[1:], np.full(corners.size - 1, float(k))])


def _left(legs: Sequence[Leg], found: Strides) -> list[Leg]:
    """Return what of the pieces was not gone over."""
    last, end = int(found.on[-1]), float(found.ends[-1])
    arc, piece = legs[last]
    rest = [(arc, replace(piece, start=end))] if end < piece.end else []
    return [*rest, *legs[last + 1 :]]


def _noted(
    problem: Problem, legs: Sequence[Leg], found: Strides, given: tuple[np.ndarray, float], log: Log
) -> None:
    """Look at points of steps, compare the nodes within them, and enter all into a log."""
    (p, horizon), pieces = given, [piece for _, piece in legs]
    log.steps += max(found.ends.size - _FEW * len(legs), 0)
    short = np.array([each.end - each.start < _SHORT * horizon for each in pieces])
    t, step = found.looks(np.where(short, _GLANCES, _LOOKS))
    on = found.on[step]
    arcs = list(dict.fromkeys(arc for arc, _ in legs[: on[-1] + 1]))
    nodes, claimed = np.concatenate([arc.t for arc in arcs]), np.hstack([arc.x for arc in arcs])
    nodes = nodes[: np.count_nonzero(nodes <= found.ends[-1])]
    at = np.append(step, np.minimum(found.ends.searchsorted(nodes), found.ends.size - 1))
    x = found.at(np.append(t, nodes), at)[:-1]
    log.compare(x[:, t.size :], claimed[:, : nodes.size])
    x = x[:, : t.size]
    u = controls_of(problem, pieces, (t, x, p), on)
    parts = np.flatnonzero(np.diff(on)) + 1
    log.t += np.split(t, parts)
    log.x += np.split(x, parts, axis=1)
    log.u += np.split(u, parts, axis=1)


@once
def running_size(solution: Solution, problem: Problem) -> float:
    """Return the integral of the running cost's absolute value at the returned nodes, 1 where that
    is none.

    Where the motion takes the cost to zero what is left of it is rounding, which no integrator can
    follow: it counts for no less than the judge can tell of what it is when states change by their
    own magnitude.
    """
    t, x, u = solution.t, solution.rows("x"), solution.rows("u")
    p, scale = parameters_of(problem, solution), scales(problem, solution)

    def whole(values: np.ndarray) -> float:
        return float(np.nansum(0.5 * (values[1:] + values[:-1]) * np.diff(t)))

    here = np.abs(running_costs(problem, x, u, t, p))
    found = max(whole(here), EXTREMAL * whole(magnitude_along(problem, (t, x, u), p, scale)))
    return found if 0.0 < found < np.inf else 1.0


def magnitude_along(
    problem: Problem,
    motion: tuple[np.ndarray, np.ndarray, np.ndarray],
    p: np.ndarray,
    scale: np.ndarray,
) -> np.ndarray:
    """Return the magnitude (n,) of the running cost at times (n,), states (nx, n) and controls
    (nu, n) under parameters p (np,): its absolute value, and what it changes by when every state
    changes by its own, `scale` (nx,).
    """
    t, x, u = motion

    def at(states: np.ndarray) -> np.ndarray:
        return running_costs(problem, states, u, t, p)

    return magnitude(at, x, scale[:, None]) if _by_states(problem) else np.abs(at(x))


@of_motion
@once
def _by_states(problem: Problem) -> bool:
    """Tell whether the running cost changes with the states."""
    cost = problem.lagrangian
    return not cost.is_constant() and bool(casadi.depends_on(cost, problem.x))


def _flow(problem: Problem, piece: Piece, p: np.ndarray) -> Flow | Control:
    """Return what moves states and running cost on a piece: a flow with its controls and
    parameters, or, where casadi does not know the control, rates (n,) at a time and a state.
    """
    if piece.plan is not None:
        return _moving(problem, piece), partial(lagrange, *piece.plan), p
    flow, control = fast(open_flow(problem)), piece.control
    assert control is not None  # noqa: S101 - one of the three is there
    last = _latest(piece)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        t = min(t, last)
        return flow(y[:-1], control(t, y[:-1]), t, p)

    return rate


def _moving(problem: Problem, piece: Piece) -> casadi.Function:
    """Return the rates of states and running cost on a piece that is planned or has a law."""
    return open_flow(problem) if piece.modes is None else closed_flow(problem, piece.modes)


def _latest(piece: Piece) -> float:
    """Return the last time of a piece: at its end rates are those before what jumps there."""
    return math.nextafter(piece.end, piece.start)


def _scipy(
    name: str, rate: Control, span: tuple[float, float], y: np.ndarray, **options: Any
) -> OdeSolver:
    """Return a method of scipy, which is imported where it is needed."""
    import scipy.integrate

    solver: OdeSolver = getattr(scipy.integrate, name)(rate, span[0], y, span[1], **options)
    return solver


def _integrate(
    piece: Piece,
    flow: Flow | Control,
    y: np.ndarray,
    size: Size,
    looks: _Looks,
) -> tuple[np.ndarray, str]:
    """Integrate over one piece of an arc; returns the end and, where it breaks down, the reason."""
    scale, horizon, rtol = size
    length = piece.end - piece.start
    if length <= 0:
        return y, ""
    first, count = (length, _GLANCES) if length < _SHORT * horizon else (None, _LOOKS)
    span = piece.start, piece.end, _latest(piece)
    tolerance: dict[str, Any] = {"rtol": rtol, "atol": rtol * scale}
    solver: Steps | OdeSolver
    if callable(flow):
        rate = flow
        solver = _scipy("DOP853", rate, span[:2], y, first_step=first, **tolerance)
    else:
        solver = Steps(flow, span, y, first, **tolerance)
        rate = solver.rate
    taken, stiff = 0, False
    while solver.status == "running":
        in_time("re-integration")
        if looks.log.steps > _MANY and not stiff:
            solver = _scipy("LSODA", rate, (solver.t, piece.end), solver.y, **tolerance)
            stiff = True
        message, taken = solver.step(), taken + 1
        looks.log.steps += taken > _FEW
        if taken > _MOST or solver.t == solver.t_old:
            return solver.y, f"integration came to a halt at t = {solver.t:.6g}"
        if solver.status == "failed" or not np.all(np.abs(solver.y[:-1]) <= _DIVERGED * scale[:-1]):
            return (
                solver.y,
                f"integration broke down at t = {solver.t:.6g}: {message or 'the state diverged'}",
            )
        looks.add(solver, count)
    return solver.y, ""

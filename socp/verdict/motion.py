"""Where controls really go: a solution's controls integrated by DOP853, as functions of time or as
feedback.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cache, partial
from itertools import chain, pairwise
from typing import TYPE_CHECKING, Any, final

import casadi
import numpy as np

from socp import laws
from socp.model import (
    EXTREMAL,
    ROUNDED,
    SAME_TIME,
    Arc,
    Modes,
    Problem,
    Solution,
    barycentric,
    coincident,
    evaluate,
    fast,
    lagrange,
    magnitude,
    numbers,
    of_motion,
    once,
    parameters_of,
    running_function,
    scales,
    time,
)
from socp.process import in_time
from socp.transcription import knot_times
from socp.verdict.simulation.domains import domain_ended
from socp.verdict.simulation.steps import Flow, Plan, Steps

if TYPE_CHECKING:
    from scipy.integrate import OdeSolver
else:
    OdeSolver = Any

RTOL = 1e-10  # of DOP853; what is compared with it is seldom better than 1e-9
# Points looked at in every step: a parabola, which takes DOP853 one step, hides 1/400 of its height
# there
_LOOKS = 20
_GLANCES = 4  # the same on a short piece, over which nothing rises much
# Steps of DOP853, but for the first few on every piece, after which a motion is taken for stiff and
# goes on by a method for that: some second of time, and what is not stiff takes a tenth
_MANY, _FEW = 1000, 10
_DIVERGED = 1e6  # times the problem's own magnitude: the state has left for good
# A piece this short against the horizon is tried in one step: no time goes into choosing the first
_SHORT = 1e-2

Control = Callable[[float, np.ndarray], np.ndarray]  # (t, x (nx,)) -> u (nu,)


@final
@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch of time on which the control is smooth: a `plan` over times, the law of an arc of
    `modes`, or any function of time and state; `constant` (nu,) is the control where it does not
    vary.
    """

    start: float
    end: float
    plan: Plan | None = None
    modes: Modes | None = None
    control: Control | None = None
    constant: np.ndarray | None = None

    def controls(self, problem: Problem, t: np.ndarray, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return the controls (nu, k) at times (k,) and states (nx, k) under parameters p (np,)."""
        if self.plan is not None:
            return self.plan(t)
        if self.modes is not None:
            return numbers(laws.feedback_function(problem, self.modes), x, t, p)[0]
        assert self.control is not None  # noqa: S101 - one of the three is there
        u = [self.control(at, here) for at, here in zip(t.tolist(), x.T, strict=True)]
        return np.array(u).T


def pieces_in_time(arc: Arc) -> list[Piece]:
    """Return the pieces of an arc's control as a function of time, one an interval of its mesh."""
    found: list[Piece] = []
    for k in range(len(arc.mesh) - 1):
        nodes = arc.nodes(k, "u")
        start, end = float(arc.t[arc.mesh[k]]), float(arc.t[arc.mesh[k + 1]])
        values, times = arc.u[:, nodes], arc.t[nodes]
        if (values == values[:, :1]).all():
            constant = values[:, 0]
            last = found[-1].constant if found else None
            if last is not None and (last == constant).all():
                start = (
                    found.pop().start
                )  # one integration over neighbours with one and the same control
            found.append(Piece(start, end, _hold(constant), constant=constant))
        else:
            found.append(Piece(start, end, _polynomial(times, values)))
    return found


def piece_of_law(problem: Problem, arc: Arc) -> Piece:
    """Return an arc's control as a feedback; raises MethodError where there is none."""
    laws.feedback_function(problem, arc.modes)
    return Piece(float(arc.t[0]), float(arc.t[-1]), modes=arc.modes)


def _hold(constant: np.ndarray) -> Plan:
    return lambda t: np.repeat(constant[:, None], t.size, axis=1)


def _polynomial(times: np.ndarray, values: np.ndarray) -> Plan:
    if times.size == 1 or coincident(times):
        return partial(lagrange, times, values)
    weights, near = barycentric(times), ROUNDED * np.ptp(times)

    def plan(t: np.ndarray) -> np.ndarray:
        distance = t[:, None] - times
        hit = np.abs(distance) <= near
        distance[hit] = 1.0
        terms = weights / distance
        found: np.ndarray = (values @ terms.T) / terms.sum(axis=1)
        where, node = np.nonzero(hit)
        found[:, where] = values[:, node]
        return found

    return plan


@of_motion
@once
def _open_flow(problem: Problem) -> casadi.Function:
    """Return the rates of the states and the running cost as a function of x, u, t, p."""
    rates = casadi.densify(casadi.vertcat(problem.rate, problem.lagrangian))
    return casadi.Function("flow", [problem.x, problem.u, time, problem.p], [rates])


@of_motion
@once
def _closed_flow(problem: Problem, modes: Modes) -> casadi.Function:
    """Return the same under the feedback of an arc as a function of x, u (0,), t, p."""
    nothing, given = casadi.SX.sym("u", 0), [problem.x, time, problem.p]
    u = laws.feedback_function(problem, modes)(*given)
    rates = _open_flow(problem)(problem.x, u, time, problem.p)
    return casadi.Function("flow", [problem.x, nothing, time, problem.p], [rates])


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
    problem: Problem, solution: Solution, pieces: list[list[Piece]], log: Log
) -> tuple[np.ndarray, str]:
    """Integrate motion and running cost over all pieces; returns both at the end and, where it
    breaks down, why. Raises LateError where the time allowed is over first.
    """
    p = parameters_of(problem, solution)
    y = np.append(np.clip(solution.arcs[0].x[:, 0], *problem.start_box), 0.0)
    if not all(np.isfinite(values).all() for values in (y, solution.t, solution.rows("u"), p)):
        at, x = np.array([solution.initial_time]), y[:-1, None]
        log.t, log.x, log.u = [at], [x], [pieces[0][0].controls(problem, at, x, p)]
        log.off = np.array([math.inf])
        return y, "the solution itself is not finite"
    horizon = solution.final_time - solution.initial_time
    scale = np.append(scales(problem, solution), running_size(problem, solution))
    for arc, stretches in zip(solution.arcs, pieces, strict=True):
        log.compare(y[:-1, None], arc.x[:, :1])
        for piece in chain.from_iterable(_cut_at_knots(problem, each) for each in stretches):
            looks = _Looks(log, arc, [np.array([piece.start])], [y[:-1, None]])
            y, error = _integrate(piece, _flow(problem, piece, p), y, (scale, horizon), looks)
            log.t.append(t := np.concatenate(looks.t))
            log.x.append(x := np.hstack(looks.x))
            log.u.append(piece.controls(problem, t, x, p))
            if error:
                return y, error + domain_ended(problem, y[:-1], t[-1], p, scale[:-1])
    return y, ""


def running_size(problem: Problem, solution: Solution) -> float:
    """Return the integral of the running cost's absolute value at the returned nodes, 1 where that
    is none.

    Where the motion takes the cost to zero what is left of it is rounding, which no integrator can
    follow: it counts for no less than the judge can tell of what it is when states change by their
    own magnitude.
    """
    x, u, t = solution.rows("x"), solution.rows("u"), solution.t
    p, scale = parameters_of(problem, solution), scales(problem, solution)[:, None]
    cost = running_function(problem)

    def at(states: np.ndarray) -> np.ndarray:
        return evaluate(cost, states, u, t, p)[0].ravel()

    def whole(values: np.ndarray) -> float:
        return float(np.nansum(0.5 * (values[1:] + values[:-1]) * np.diff(t)))

    found = max(whole(np.abs(at(x))), EXTREMAL * whole(magnitude(at, x, scale)))
    return found if 0.0 < found < np.inf else 1.0


def _cut_at_knots(problem: Problem, piece: Piece) -> Iterator[Piece]:
    """Yield a piece cut where the problem's functions may jump: a step across that would not see
    it.
    """
    apart = SAME_TIME * (piece.end - piece.start)
    inside = [t for t in knot_times(problem) if piece.start + apart < t < piece.end - apart]
    for start, end in pairwise([piece.start, *inside, piece.end]):
        yield replace(piece, start=start, end=end)


def _flow(problem: Problem, piece: Piece, p: np.ndarray) -> Flow | Control:
    """Return what moves states and running cost on a piece: a flow with its controls and
    parameters, or, where casadi does not know the control, rates (n,) at a time and a state.
    """
    if piece.modes is not None:
        return _closed_flow(problem, piece.modes), _nothing, p
    if piece.plan is not None:
        return _open_flow(problem), piece.plan, p
    flow, control = fast(_open_flow(problem)), piece.control
    assert control is not None  # noqa: S101 - one of the three is there
    last = math.nextafter(piece.end, piece.start)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        t = min(t, last)
        return flow(y[:-1], control(t, y[:-1]), t, p)

    return rate


def _nothing(t: np.ndarray) -> np.ndarray:
    return np.empty((0, t.size))


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
    size: tuple[np.ndarray, float],
    looks: _Looks,
) -> tuple[np.ndarray, str]:
    """Integrate over one piece of an arc; returns the end and, where it breaks down, the reason."""
    scale, horizon = size
    length = piece.end - piece.start
    if length <= 0:
        return y, ""
    first, count = (length, _GLANCES) if length < _SHORT * horizon else (None, _LOOKS)
    # at the end of the piece rates are those before what jumps there
    span = piece.start, piece.end, math.nextafter(piece.end, piece.start)
    tolerance: dict[str, Any] = {"rtol": RTOL, "atol": RTOL * scale}
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
        if solver.status == "failed" or not np.all(np.abs(solver.y[:-1]) <= _DIVERGED * scale[:-1]):
            return (
                solver.y,
                f"integration broke down at t = {solver.t:.6g}: {message or 'the state diverged'}",
            )
        looks.add(solver, count)
    return solver.y, ""

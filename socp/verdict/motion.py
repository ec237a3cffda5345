"""Where controls really go: a solution's controls integrated by DOP853, as functions of time or as
feedback.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import chain, pairwise
from typing import final

import casadi
import numpy as np
from scipy.integrate import DOP853, LSODA

from socp import laws
from socp.model import (
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
    once,
    parameters_of,
    running_function,
    scales,
    time,
)
from socp.transcription import knot_times

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
    """A stretch of time on which the control is smooth: a function of time, or of the state along
    an arc of `modes`; `constant` (nu,) is the control where it does not vary.
    """

    start: float
    end: float
    control: Control
    constant: np.ndarray | None = None
    modes: Modes | None = None


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
            found.append(Piece(start, end, _hold(constant), constant))
        else:
            found.append(Piece(start, end, _polynomial(times, values)))
    return found


def piece_of_law(problem: Problem, arc: Arc, p: np.ndarray) -> Piece:
    """Return an arc's control as a feedback; raises MethodError where there is none."""
    law = fast(laws.feedback_function(problem, arc.modes))
    return Piece(float(arc.t[0]), float(arc.t[-1]), lambda t, x: law(x, t, p), modes=arc.modes)


def _hold(constant: np.ndarray) -> Control:
    return lambda _t, _x: constant


def _polynomial(times: np.ndarray, values: np.ndarray) -> Control:
    if times.size == 1 or coincident(times):
        return lambda t, _x: lagrange(times, values, np.array([t]))[:, 0]
    weights, near = barycentric(times), ROUNDED * np.ptp(times)

    def control(t: float, _x: np.ndarray) -> np.ndarray:
        distance = t - times
        k = int(np.abs(distance).argmin())
        if abs(distance[k]) <= near:
            return np.asarray(values[:, k])
        terms = weights / distance
        return np.asarray(values @ terms / terms.sum())

    return control


@once
def _open_flow(problem: Problem) -> casadi.Function:
    """Return the rates of the states and the running cost as a function of x, u, t, p."""
    rates = casadi.densify(casadi.vertcat(problem.rate, problem.lagrangian))
    return casadi.Function("flow", [problem.x, problem.u, time, problem.p], [rates])


@once
def _closed_flow(problem: Problem, modes: Modes) -> casadi.Function:
    """Return the same under the feedback of an arc as a function of x, t, p."""
    given = [problem.x, time, problem.p]
    u = laws.feedback_function(problem, modes)(*given)
    return casadi.Function("flow", given, [_open_flow(problem)(problem.x, u, time, problem.p)])


@final
@dataclass(eq=False)
class Log:
    """Points looked at along the way, the states at the returned nodes, how far (nx,) the claimed
    ones were off at most, and the steps that tell a stiff motion; `begun`: where in the lists the
    points of every piece begin.
    """

    begun: list[int] = field(default_factory=list)
    t: list[np.ndarray] = field(default_factory=list)
    x: list[np.ndarray] = field(default_factory=list)
    u: list[np.ndarray] = field(default_factory=list)
    nodes: list[np.ndarray] = field(default_factory=list)
    steps: int = 0
    off: np.ndarray = field(default_factory=lambda: np.zeros(1))

    def keep(self, t: np.ndarray, x: np.ndarray, piece: Piece) -> None:
        """Keep states (nx, k) at times (k,), with the controls of a piece there."""
        self.t.append(t)
        self.x.append(x)
        u = [piece.control(at, here) for at, here in zip(t.tolist(), x.T, strict=True)]
        self.u.append(np.array(u).T)

    def compare(self, x: np.ndarray, claimed: np.ndarray) -> None:
        """Compare states (nx, k) with those claimed for the same times, the next nodes."""
        self.nodes.append(x)
        self.off = np.maximum(self.off, np.abs(x - claimed).max(axis=1, initial=0.0))

    @property
    def motion(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times (n,), states (nx, n) and controls (nu, n) of the points."""
        return np.concatenate(self.t), np.hstack(self.x), np.hstack(self.u)


def travel(
    problem: Problem, solution: Solution, pieces: list[list[Piece]], log: Log
) -> tuple[np.ndarray, str]:
    """Integrate motion and running cost over all pieces; returns both at the end and, where it
    breaks down, why.
    """
    p = parameters_of(problem, solution)
    y = np.append(np.clip(solution.arcs[0].x[:, 0], *problem.start_box), 0.0)
    if not all(np.isfinite(values).all() for values in (y, solution.t, solution.rows("u"), p)):
        log.keep(np.array([solution.initial_time]), y[:-1, None], pieces[0][0])
        log.off = np.array([math.inf])
        return y, "the solution itself is not finite"
    flow = fast(_open_flow(problem))
    horizon = solution.final_time - solution.initial_time
    scale = np.append(scales(problem, solution), running_size(problem, solution))
    for arc, stretches in zip(solution.arcs, pieces, strict=True):
        log.compare(y[:-1, None], arc.x[:, :1])
        for piece in chain.from_iterable(_cut_at_knots(problem, each) for each in stretches):
            log.begun.append(len(log.t))
            log.keep(np.array([piece.start]), y[:-1, None], piece)
            rate = _rate(problem, flow, piece, p)
            y, error = _integrate(rate, (piece, arc), y, (scale, horizon), log)
            if error:
                return y, error
    return y, ""


def running_size(problem: Problem, solution: Solution) -> float:
    """Return the integral of the running cost's absolute value at the returned nodes, 1 where that
    is none.
    """
    given = solution.rows("x"), solution.rows("u"), solution.t, parameters_of(problem, solution)
    values = evaluate(running_function(problem), *given)[0].ravel()
    found = float(np.nansum(0.5 * np.abs(values[1:] + values[:-1]) * np.diff(solution.t)))
    return found if 0.0 < found < np.inf else 1.0


def _cut_at_knots(problem: Problem, piece: Piece) -> Iterator[Piece]:
    """Yield a piece cut where the problem's functions may jump: a step across that would not see
    it.
    """
    apart = SAME_TIME * (piece.end - piece.start)
    inside = [t for t in knot_times(problem) if piece.start + apart < t < piece.end - apart]
    for start, end in pairwise([piece.start, *inside, piece.end]):
        yield replace(piece, start=start, end=end)


def _rate(
    problem: Problem, flow: Callable[..., np.ndarray], piece: Piece, p: np.ndarray
) -> Control:
    """Return the rates of a motion on a piece; at its end they are those before what jumps
    there.
    """
    last, control = math.nextafter(piece.end, piece.start), piece.control
    if piece.modes is not None:  # one call in place of two
        closed = fast(_closed_flow(problem, piece.modes))
        return lambda t, y: closed(y[:-1], min(t, last), p)

    def rate(t: float, y: np.ndarray) -> np.ndarray:
        t = min(t, last)
        return flow(y[:-1], control(t, y[:-1]), t, p)

    return rate


def _integrate(
    rate: Control, on: tuple[Piece, Arc], y: np.ndarray, size: tuple[np.ndarray, float], log: Log
) -> tuple[np.ndarray, str]:
    """Integrate over one piece of an arc; returns the end and, where it breaks down, the reason."""
    (piece, arc), (scale, horizon) = on, size
    length = piece.end - piece.start
    if length <= 0:
        return y, ""
    first, looks = (length, _GLANCES) if length < _SHORT * horizon else (None, _LOOKS)
    solver = DOP853(rate, piece.start, y, piece.end, rtol=RTOL, atol=RTOL * scale, first_step=first)
    taken = 0
    while solver.status == "running":
        if log.steps > _MANY and isinstance(solver, DOP853):
            solver = LSODA(rate, solver.t, solver.y, piece.end, rtol=RTOL, atol=RTOL * scale)
        message, taken = solver.step(), taken + 1
        log.steps += taken > _FEW
        if solver.status == "failed" or not np.all(np.abs(solver.y[:-1]) <= _DIVERGED * scale[:-1]):
            return (
                solver.y,
                f"integration broke down at t = {solver.t:.6g}: {message or 'the state diverged'}",
            )
        dense = solver.dense_output()
        t = np.linspace(solver.t_old, solver.t, looks + 1)[1:]
        nodes = slice(*np.searchsorted(arc.t, [solver.t_old, solver.t], side="right"))
        x = dense(np.append(t, arc.t[nodes]))[:-1]
        log.keep(t, x[:, :looks], piece)
        log.compare(x[:, looks:], arc.x[:, nodes])
    return solver.y, ""

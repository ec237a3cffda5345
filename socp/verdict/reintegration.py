"""A control integrated again by itself, and how far the motion misses what a problem asks for: its
ends, its state constraints and its box, relative to sizes.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, pairwise
from typing import final

import casadi
import numpy as np
from scipy.integrate import DOP853

from socp import laws
from socp.errors import MethodError
from socp.model import (
    ROUNDED,
    SAME_TIME,
    TINY,
    Arc,
    Feasibility,
    Problem,
    Solution,
    barycentric,
    coincident,
    column,
    condition_function,
    condition_slopes,
    end_values,
    evaluate,
    lagrange,
    magnitude,
    mayer_function,
    once,
    parameters_of,
    running_function,
    scales,
    sizes,
    time,
)
from socp.transcription import knot_times


def box_miss(u: np.ndarray, box: np.ndarray) -> float:
    """Return the worst excess of controls (nu, n) over their box, relative to its width."""
    low, high = box[0][:, None], box[1][:, None]
    return float(np.max(np.maximum(low - u, u - high) / (high - low), initial=0.0))


def end_miss(
    problem: Problem, solution: Solution, x: np.ndarray, scale: np.ndarray
) -> tuple[float, str]:
    """Return the worst relative violation of the end conditions by the end state x (nx,), and which
    condition it is.
    """
    low, high = problem.end_box
    excess = np.maximum(np.maximum(low - x, x - high), 0.0) / scale
    found = dict(zip(problem.state_names, excess.tolist(), strict=True))
    values = [x, *end_values(problem, solution)[1:]]
    sizes = np.concatenate([scale, scale, np.abs(np.hstack(values[2:]))])
    for condition in problem.conditions:
        value = float(condition_function(problem, condition)(*values))
        slope = casadi.horzcat(*condition_slopes(problem, condition)(*values)).full().ravel()
        violation = abs(value) if condition.equation else max(value, 0.0)
        found[condition.name] = float(violation / (np.abs(slope) @ sizes or 1.0))
    for name, at, (first, last) in (
        ("initial time", solution.initial_time, problem.initial_time_box),
        ("final time", solution.final_time, problem.final_time_box),
    ):
        found[name] = max(first - at, at - last, 0.0) / max(
            solution.final_time - solution.initial_time, TINY
        )
    worst = max(found, key=lambda name: np.inf if np.isnan(found[name]) else found[name])
    return found[worst], worst


def path_miss(
    problem: Problem, p: np.ndarray, scale: np.ndarray, t: Sequence[float], x: Sequence[np.ndarray]
) -> tuple[float, str]:
    """Return the worst relative violation of the state constraints at the points looked at, and
    which it is.
    """
    if not problem.constraints:
        return 0.0, ""
    stack = column(c.expression for c in problem.constraints)
    slopes = casadi.mtimes(casadi.fabs(casadi.jacobian(stack, problem.x)), scale)
    function = casadi.Function("c", [problem.x, time, problem.p], [stack, slopes])
    values, sizes = evaluate(function, np.array(x).T, np.array(t), p)
    # a constraint's magnitude is how much it changes when every state changes by its own, at worst
    # along the way
    relative = values.max(axis=1) / np.where((largest := sizes.max(axis=1)) > 0, largest, 1.0)
    worst = int(np.argmax(relative))
    return max(float(relative[worst]), 0.0), problem.constraints[worst].name


def objective_of(
    problem: Problem,
    solution: Solution,
    motion: tuple[np.ndarray, np.ndarray, np.ndarray],
    scale: np.ndarray,
    running: float,
) -> tuple[float, float]:
    """Return the objective of a motion, and how far the returned one is from it, relative to its
    magnitude.

    The motion is times (n,), states (nx, n) and controls (nu, n) from start to end, with the
    integral of the running cost. The magnitude is the sum of all terms by absolute value, and of
    what they change by when every state changes by its own: a cost that the best motion takes to
    zero is not measured by its rounding.
    """
    (t, x, u), p = motion, parameters_of(problem, solution)
    ends = solution.initial_time, solution.final_time
    mayer, cost = mayer_function(problem), running_function(problem)

    def last(states: np.ndarray) -> np.ndarray:
        return np.array(mayer(states, x[:, 0], p, *ends).full().ravel())

    def within(states: np.ndarray) -> np.ndarray:
        return evaluate(cost, states, u, t, p)[0].ravel()

    value = running + float(last(x[:, -1])[0])
    terms = magnitude(within, x, scale[:, None])
    size = float(
        np.sum(0.5 * (terms[1:] + terms[:-1]) * np.diff(t)) + magnitude(last, x[:, -1], scale)[0]
    )
    off = abs(solution.objective - value)
    # nan is far from everything
    return value, off / max(size, TINY) if off == off else np.inf  # noqa: PLR0124


def running_size(problem: Problem, solution: Solution) -> float:
    """Return the integral of the running cost's absolute value at the returned nodes, 1 where that
    is none.
    """
    given = solution.rows("x"), solution.rows("u"), solution.t, parameters_of(problem, solution)
    values = evaluate(running_function(problem), *given)[0].ravel()
    found = float(np.nansum(0.5 * np.abs(values[1:] + values[:-1]) * np.diff(solution.t)))
    return found if 0.0 < found < np.inf else 1.0


RTOL = 1e-10  # of DOP853; what is compared with it is seldom better than 1e-9
# Points looked at in every step: a parabola, which takes DOP853 one step, hides 1/400 of its height
# there
_LOOKS = 20
_GLANCES = 4  # the same on a short piece, over which nothing rises much
_DIVERGED = 1e6  # times the problem's own magnitude: the state has left for good
# A piece this short against the horizon is tried in one step: no time goes into choosing the first
_SHORT = 1e-2

Control = Callable[[float, np.ndarray], np.ndarray]  # (t, x (nx,)) -> u (nu,)


def verify(problem: Problem, solution: Solution) -> tuple[Feasibility, ...]:
    """Integrate the control as a function of time and, where every arc has a law of the state, as
    feedback too.

    A solution keeps what was found for it: it is asked for more than once on the way to a certified
    word.
    """
    return _both(solution, problem)


@once
def _both(solution: Solution, problem: Problem) -> tuple[Feasibility, ...]:
    as_time = [_time_pieces(arc) for arc in solution.arcs]
    found = [_verify(problem, solution, as_time, feedback=False)]
    if all(arc.lawful for arc in solution.arcs):
        p = parameters_of(problem, solution)
        try:
            ends = [(float(arc.t[0]), float(arc.t[-1])) for arc in solution.arcs]
            laws_ = [_feedback(problem, arc, p) for arc in solution.arcs]
            as_feedback = [[_Piece(*span, law)] for span, law in zip(ends, laws_, strict=True)]
        except MethodError:
            return tuple(found)  # the word was read off a solution of a problem without such laws
        found.append(_verify(problem, solution, as_feedback, feedback=True))
    return tuple(found)


@final
@dataclass(frozen=True, eq=False)
class _Piece:
    """A stretch of time on which the control is smooth; `constant` (nu,) is the control where it
    does not vary.
    """

    start: float
    end: float
    control: Control
    constant: np.ndarray | None = None


def _cut_at_knots(problem: Problem, piece: _Piece) -> Iterator[_Piece]:
    """Yield a piece cut where the problem's functions may jump: a step across that would not see
    it.
    """
    apart = SAME_TIME * (piece.end - piece.start)
    inside = [t for t in knot_times(problem) if piece.start + apart < t < piece.end - apart]
    for start, end in pairwise([piece.start, *inside, piece.end]):
        yield replace(piece, start=start, end=end)


def _time_pieces(arc: Arc) -> list[_Piece]:
    found: list[_Piece] = []
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
            found.append(_Piece(start, end, _hold(constant), constant))
        else:
            found.append(_Piece(start, end, _polynomial(times, values)))
    return found


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


def _feedback(problem: Problem, arc: Arc, p: np.ndarray) -> Control:
    evaluate = fast(laws.feedback_function(problem, arc.modes))
    return lambda t, x: evaluate(x, t, p)


def fast(function: casadi.Function) -> Callable[..., np.ndarray]:
    """Return a function of numpy arrays for a casadi function of one output column, ten times as
    quick to call.
    """
    inputs = [np.zeros(max(function.numel_in(i), 1)) for i in range(function.n_in())]
    output = np.zeros(max(function.numel_out(0), 1))
    function = casadi.Function(
        "dense", function.sx_in(), [casadi.densify(function(*function.sx_in()))]
    )
    buffer, trigger = function.buffer()
    for i, each in enumerate(inputs):
        buffer.set_arg(i, each.data)
    buffer.set_res(0, output.data)

    def call(*arguments: np.ndarray | float) -> np.ndarray:
        for each, value in zip(inputs, arguments, strict=True):
            if np.size(value):
                each[:] = value
        trigger()
        return output.copy()

    call.__dict__["keep"] = (function, buffer)  # the buffer must outlive the call
    return call


@final
@dataclass(eq=False)
class _Log:
    """Points looked at along the way, and how far (nx,) the claimed states were off at most."""

    t: list[float] = field(default_factory=list)
    x: list[np.ndarray] = field(default_factory=list)
    u: list[np.ndarray] = field(default_factory=list)
    off: np.ndarray = field(default_factory=lambda: np.zeros(1))

    def keep(self, t: float, x: np.ndarray, u: np.ndarray) -> None:
        self.t.append(t)
        self.x.append(x)
        self.u.append(u)

    def compare(self, x: np.ndarray, claimed: np.ndarray) -> None:
        """Compare states (nx, k) with those claimed for the same times."""
        self.off = np.maximum(self.off, np.abs(x - claimed).max(axis=1, initial=0.0))


def _verify(
    problem: Problem, solution: Solution, pieces: list[list[_Piece]], *, feedback: bool
) -> Feasibility:
    p, log = parameters_of(problem, solution), _Log()
    with np.errstate(all="ignore"):  # what overflows on the way ends as an error of the integration
        y, error = _travel(problem, solution, pieces, log)
        motion, x = (np.array(log.t), np.array(log.x).T, np.array(log.u).T), y[:-1]
        scale = sizes(problem, motion[0], motion[1], parameters_of(problem, solution))
        objective, gap = objective_of(problem, solution, motion, scale, float(y[-1]))
        miss, miss_at = end_miss(problem, solution, x, scale)
        path, path_at = path_miss(problem, p, scale, log.t, log.x)
    box = box_miss(np.hstack([motion[2], *(arc.u for arc in solution.arcs)]), problem.box)
    return Feasibility(
        miss=miss,
        miss_at=miss_at,
        path=path,
        path_at=path_at,
        box=box,
        drift=float(np.max(log.off / scale)),
        feedback=feedback,
        end=tuple(x.tolist()),
        error=error,
        objective=math.nan if error else objective,
        gap=gap,
    )


def _travel(
    problem: Problem, solution: Solution, pieces: list[list[_Piece]], log: _Log
) -> tuple[np.ndarray, str]:
    """Integrate motion and running cost over all pieces; returns both at the end and, where it
    breaks down, why.
    """
    p = parameters_of(problem, solution)
    y = np.append(np.clip(solution.arcs[0].x[:, 0], *problem.start_box), 0.0)
    log.keep(solution.initial_time, y[:-1], pieces[0][0].control(solution.initial_time, y[:-1]))
    if not all(np.isfinite(values).all() for values in (y, solution.t, solution.rows("u"), p)):
        log.off = np.array([math.inf])
        return y, "the solution itself is not finite"
    rates = casadi.vertcat(problem.rate, problem.lagrangian)
    flow = fast(casadi.Function("flow", [problem.x, problem.u, time, problem.p], [rates]))
    horizon = solution.final_time - solution.initial_time
    scale = np.append(scales(problem, solution), running_size(problem, solution))
    for arc, stretches in zip(solution.arcs, pieces, strict=True):
        log.compare(y[:-1, None], arc.x[:, :1])
        for piece in chain.from_iterable(_cut_at_knots(problem, each) for each in stretches):
            y, error = _integrate(
                partial(_rate, flow, piece, p), (piece, arc), y, (scale, horizon), log
            )
            if error:
                return y, error
    return y, ""


def _rate(
    flow: Callable[..., np.ndarray], piece: _Piece, p: np.ndarray, t: float, y: np.ndarray
) -> np.ndarray:
    """Return the rates of a motion on a piece; at its end they are those before what jumps
    there.
    """
    t = min(t, math.nextafter(piece.end, piece.start))
    return flow(y[:-1], piece.control(t, y[:-1]), t, p)


def _integrate(
    rate: Control, on: tuple[_Piece, Arc], y: np.ndarray, size: tuple[np.ndarray, float], log: _Log
) -> tuple[np.ndarray, str]:
    """Integrate over one piece of an arc; returns the end and, where it breaks down, the reason."""
    (piece, arc), (scale, horizon) = on, size
    length = piece.end - piece.start
    if length <= 0:
        return y, ""
    first, looks = (length, _GLANCES) if length < _SHORT * horizon else (None, _LOOKS)
    solver = DOP853(rate, piece.start, y, piece.end, rtol=RTOL, atol=RTOL * scale, first_step=first)
    while solver.status == "running":
        message = solver.step()
        if solver.status == "failed" or not np.all(np.abs(solver.y[:-1]) <= _DIVERGED * scale[:-1]):
            return (
                solver.y,
                f"integration broke down at t = {solver.t:.6g}: {message or 'the state diverged'}",
            )
        dense = solver.dense_output()
        for t in np.linspace(solver.t_old, solver.t, looks + 1)[1:].tolist():
            x = dense(t)[:-1]
            log.keep(t, x, piece.control(t, x))
        nodes = slice(*np.searchsorted(arc.t, [solver.t_old, solver.t], side="right"))
        if nodes.start < nodes.stop:
            log.compare(dense(arc.t[nodes])[:-1], arc.x[:, nodes])
    return solver.y, ""

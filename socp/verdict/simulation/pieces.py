"""Pieces of a motion: stretches of time with a smooth control, and what moves the states there."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import final

import casadi
import numpy as np

from socp import laws
from socp.model import (
    SAME_TIME,
    Arc,
    Expr,
    Modes,
    Problem,
    lagrange,
    numbers,
    of_motion,
    once,
    piecewise,
    time,
)
from socp.transcription import constants, knot_times, opened
from socp.verdict.simulation.strides import Controls

Control = Callable[[float, np.ndarray], np.ndarray]  # (t, x (nx,)) -> u (nu,)


@final
@dataclass(frozen=True, eq=False)
class Piece:
    """A stretch of time on which the control is smooth: a `plan`, which is the polynomial through
    values (nu, k) at nodes (k,), one where the control does not vary; the law of an arc of `modes`,
    whose constants are the plan; or any function of time and state.
    """

    start: float
    end: float
    plan: tuple[np.ndarray, np.ndarray] | None = None
    modes: Modes | None = None
    control: Control | None = None

    def controls(self, problem: Problem, t: np.ndarray, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return the controls (nu, k) at times (k,) and states (nx, k) under parameters p (np,)."""
        if self.modes is not None:
            return numbers(laws.feedback_function(problem, self.modes), x, t, p)[0]
        if self.plan is not None:
            return lagrange(*self.plan, t)
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
            values, times = values[:, :1], times[:1]
            last = found[-1].plan if found else None
            if last is not None and last[0].size == 1 and (last[1] == values).all():
                start = (
                    found.pop().start
                )  # one integration over neighbours with one and the same control
        found.append(Piece(start, end, (times, values)))
    return found


def piece_of_law(problem: Problem, arc: Arc) -> Piece:
    """Return an arc's control as a feedback; raises MethodError where there is none."""
    laws.feedback_function(problem, arc.modes)
    plan = arc.t[:1], _constants(problem, arc.modes)[:, None]
    return Piece(float(arc.t[0]), float(arc.t[-1]), plan, arc.modes)


@of_motion
@once
def _constants(problem: Problem, modes: Modes) -> np.ndarray:
    """Return the constants (nu,) of an arc's law."""
    return constants(laws.arc_law(problem, modes).control)


def planned(pieces: Sequence[Piece]) -> Controls:
    """Return the controls of pieces that are planned; those of others, and of laws where these are
    not constant, are nothing.
    """
    counts = np.array([0 if each.plan is None else each.plan[0].size for each in pieces])
    if (counts == 1).all():  # bangs, and laws with their constants
        levels = np.hstack([each.plan[1] for each in pieces if each.plan])
        return lambda _, on: levels[:, on]
    place, tables, size = np.empty(counts.size, dtype=int), {}, 0
    for count in set(counts.tolist()) - {0}:
        alike = np.flatnonzero(counts == count)
        place[alike] = np.arange(alike.size)
        plans = [each.plan for each in pieces if each.plan and each.plan[0].size == count]
        times, values = zip(*plans, strict=True)
        tables[count], size = (np.array(times), np.stack(values, axis=1)), len(values[0])

    def controls(t: np.ndarray, on: np.ndarray) -> np.ndarray:
        u = np.empty((size, t.size))
        for count, (times, values) in tables.items():
            here = np.flatnonzero(counts[on] == count)
            own = place[on[here]]
            u[:, here] = piecewise(times, values, t[here], own) if count > 1 else values[:, own, 0]
        return u

    return controls


def controls_of(
    problem: Problem,
    pieces: Sequence[Piece],
    at: tuple[np.ndarray, np.ndarray, np.ndarray],
    on: np.ndarray,
) -> np.ndarray:
    """Return the controls (nu, k), planned or by laws, at times (k,) and states (nx, k) under
    parameters (np,), of the pieces whose numbers are given (k,).
    """
    (t, x, p), u = at, planned(pieces)(at[0], on)
    for modes in dict.fromkeys(each.modes for each in pieces):
        if modes is not None and closed_flow(problem, modes) is not open_flow(problem):
            here = np.array([each.modes == modes for each in pieces])[on]
            law = laws.feedback_function(problem, modes)
            u[:, here] = numbers(law, x[:, here], t[here], p)[0]
    return u


@of_motion
@once
def open_flow(problem: Problem) -> casadi.Function:
    """Return the rates of the states and the running cost as a function of x, u, t, p."""
    rates = casadi.densify(casadi.vertcat(problem.rate, problem.lagrangian))
    return casadi.Function("flow", [problem.x, problem.u, time, problem.p], [rates])


@of_motion
@once
def closed_flow(problem: Problem, modes: Modes) -> casadi.Function:
    """Return the same under the feedback of an arc, whose constants alone are taken from u: laws
    that differ in these share it.
    """
    control = opened(problem, laws.arc_law(problem, modes).control)
    if casadi.is_equal(control, problem.u):
        return open_flow(problem)
    return _closed(problem, control)


@of_motion
@once
def _closed(problem: Problem, control: Expr) -> casadi.Function:
    rates = open_flow(problem)(problem.x, control, time, problem.p)
    return casadi.Function("flow", [problem.x, problem.u, time, problem.p], [rates])


def cut_at_knots(problem: Problem, piece: Piece) -> Iterator[Piece]:
    """Yield a piece cut where the problem's functions may jump: a step across that would not see
    it.
    """
    apart = SAME_TIME * (piece.end - piece.start)
    inside = [t for t in knot_times(problem) if piece.start + apart < t < piece.end - apart]
    if not inside:
        yield piece
        return
    for start, end in pairwise([piece.start, *inside, piece.end]):
        yield replace(piece, start=start, end=end)

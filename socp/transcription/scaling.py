"""The magnitudes in which a programme is written, so that the units of a problem do not matter to
its solver.
"""

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import final

import casadi
import numpy as np

from socp.laws import admissible, guessed_ends, horizon
from socp.model import (
    Expr,
    Problem,
    Solution,
    end_values,
    evaluate,
    numbers,
    objective_size,
    of_motion,
    once,
    parameters_of,
    scales,
    shown_sizes,
    time,
)
from socp.transcription.phases import Phase

# Of what motions reach from the start: a state that a guess hardly moves is taken for at least as
# large. A guess may say nothing of it; motions with constant controls may take it too far. Of its
# bounds as well, where a guess does say nothing: motions may not go on for long enough
_MOVED = 1e-2
# Of the horizon: the shortest motion that is drawn. A state that is led on steadily comes to as
# much of its way at least: measures that differ by more are not of one and the same magnitude
_SHARE = 0.05
_STEPS, _RUNS = 16, 8  # implicit motions over the horizon, and their steps: enough for magnitudes
# What the objective counts in a programme: the barrier of an interior point method begins at 0.1,
# which should be a small share of it
_WEIGHT = 10.0


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Scale:
    """The magnitudes of time, states (nx,), parameters (np,) and objective, and a solution near
    which they were found, None where all are 1. The objective's is such that a programme minimises
    something of size `_WEIGHT`.
    """

    time: float
    x: np.ndarray
    p: np.ndarray
    cost: float
    near: Solution | None

    @classmethod
    def of(cls, problem: Problem, near: Solution | None) -> "Scale":
        """Return the magnitudes of a problem near a solution or a guess; all 1 without one."""
        nx, names = problem.x.numel(), problem.parameter_names
        if near is None:
            return cls(time=1.0, x=np.ones(nx), p=np.ones(len(names)), cost=1.0, near=None)
        near = replace(near, parameters={name: near.parameters.get(name, 0.0) for name in names})
        x, length = state_magnitudes(problem, near), near.final_time - near.initial_time
        return cls(
            time=length if length > 0.0 else horizon(problem),  # one that has shrunk to none
            x=x,
            p=_widths(problem.parameter_box),
            cost=objective_size(problem, near, _shown(problem, near, x)) / _WEIGHT,
            near=near,
        )

    @property
    def costate(self) -> np.ndarray:
        """Magnitudes of the costates (nx,): of the objective over those of the states."""
        found: np.ndarray = self.cost / self.x
        return found

    def control(self, phase: Phase) -> np.ndarray:
        """Return the widths (nv,) of the boxes of a phase's free controls."""
        return _widths(phase.box) if self.near is not None else np.ones(phase.box.shape[1])

    def law(self, problem: Problem, i: int) -> float:
        """Return the width of the box of a control that follows a law."""
        return 1.0 if self.near is None else float(_widths(problem.box[:, i : i + 1])[0])

    def path(self, problem: Problem, expression: Expr) -> float:
        """Return how much an expression of x, t, p changes by all magnitudes, at most, near the
        solution; 1 where nothing changes it.
        """
        return self._change(problem, expression, casadi.SX(0, 1))

    def joint(self, problem: Problem, phase: Phase, row: Expr) -> float:
        """Return the same of an expression of x, t, p and what a phase carries, the costate."""
        return self._change(problem, row, phase.carried)

    def condition(self, problem: Problem, slopes: casadi.Function) -> float:
        """Return the same of an end condition, from its slopes as a function of the ends."""
        if self.near is None:
            return 1.0
        found = numbers(slopes, *end_values(problem, self.near))
        sizes = (self.x, self.x, self.p, np.array([self.time]), np.array([self.time]))
        return _size(sum(float(np.abs(s[0]) @ z) for s, z in zip(found, sizes, strict=True)))

    def _change(self, problem: Problem, row: Expr, carried: Expr) -> float:
        if self.near is None:
            return 1.0
        t, p = self.near.t, parameters_of(problem, self.near)
        sizes = [self.x, self.costate[: carried.numel()], np.array([self.time]), self.p]
        given = [problem.x, carried, time, problem.p]
        slopes = casadi.fabs(casadi.jacobian(row, casadi.vertcat(*given)))
        total = casadi.mtimes(slopes, casadi.DM(np.concatenate(sizes)))
        costate = np.repeat(sizes[1][:, None], t.size, axis=1)
        function = casadi.Function("change", given, [total])
        values = evaluate(function, self.near.rows("x"), costate, t, p)[0]
        return _size(float(values[np.isfinite(values)].max(initial=0.0)))


def state_magnitudes(problem: Problem, near: Solution) -> np.ndarray:
    """Return the magnitudes of the states (nx,): what they reach near a solution, at their given
    ends, and in part by motions from the start; else their bounds'.
    """
    ends = np.vstack([problem.start_box, problem.end_box])
    named = np.where(np.isfinite(ends), np.abs(ends), 0.0).max(axis=0)
    own = np.abs(np.nan_to_num(near.rows("x"), posinf=0.0, neginf=0.0)).max(axis=1)
    size = np.maximum(named, own)
    moved = np.sqrt(np.mean(admissible(problem)[1 : 1 + size.size] ** 2, axis=1))
    moved = np.where(np.isfinite(moved), moved, 0.0)
    if not size.all():
        led = _led(problem)
        moved = np.where((led > 0) & _apart(moved, led), led, moved)
    box = np.where(np.isfinite(problem.state_box), np.abs(problem.state_box), 0.0).max(axis=0)
    unknown = np.where(moved > 0, np.maximum(moved, _MOVED * box), 0.0)
    size = np.where(size > 0, np.maximum(size, _MOVED * moved), unknown)
    size = np.where(size > 0, size, box)
    return np.where(size > 0, size, 1.0)


def _shown(problem: Problem, near: Solution, x: np.ndarray) -> np.ndarray:
    """Return the magnitudes of the states (nx,) by their ends, their bounds and a solution, and x
    (nx,) where none of these shows one and the rate at the start leads elsewhere in the horizon.
    """
    found, known = scales(problem, near), shown_sizes(problem, near.rows("x")) > 0
    return np.where(_apart(found, x) & ~known, x, found)


def _apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Tell which of two measures (n,) of the same are of different magnitudes."""
    found: np.ndarray = (one < _SHARE * other) | (other < _SHARE * one)
    return found


@of_motion
@once
def _led(problem: Problem) -> np.ndarray:
    """Return what motions over the horizon reach of every state (nx,), typically.

    Controls are constant, and steps linearly implicit, x + (I - h J)^-1 h x': stiff rates do not
    blow them up, and they lead along a chain of states at once, to whose end explicit steps, each
    as far as some states, come late or never.
    """
    nx, (t0, _) = problem.x.numel(), problem.initial_time_box
    points, slope = admissible(problem)[:, :_RUNS], casadi.jacobian(problem.rate, problem.x)
    p, u = points[1 + nx : 1 + nx + problem.p.numel()], points[-problem.u.numel() :]
    given, (low, high) = [problem.x, problem.u, time, problem.p], problem.state_box[:, :, None]
    flow = casadi.Function("flow", given, [casadi.densify(problem.rate), casadi.densify(slope)])
    x = np.repeat(guessed_ends(problem)[0][:, None], u.shape[1], axis=1)
    h, begin, most = horizon(problem) / _STEPS, t0 if np.isfinite(t0) else 0.0, np.abs(x)
    with np.errstate(all="ignore"), suppress(np.linalg.LinAlgError):
        for k in range(_STEPS):
            rate, slopes = evaluate(flow, x, u, np.full(u.shape[1], begin + h * k), p)
            left = np.eye(nx) - h * slopes.reshape(nx, -1, nx).transpose(1, 0, 2)
            step = np.linalg.solve(left, h * rate.T[..., None])[..., 0].T
            if not np.isfinite(step).all():
                break
            x = np.clip(x + step, low, high)
            most = np.fmax(most, np.abs(x))
    typical = np.median(most, axis=1)  # a motion that escapes is not
    found: np.ndarray = np.where(typical > 0, typical, most.mean(axis=1))
    return found


def _widths(box: np.ndarray) -> np.ndarray:
    """Return the widths (n,) of intervals (2, n), 1 where they have none."""
    width = box[1] - box[0]
    return np.where(np.isfinite(width) & (width > 0), width, 1.0)


def _size(value: float) -> float:
    return value if 0.0 < value < np.inf else 1.0

"""The motion along a phase's law by explicit Runge-Kutta steps of order 8, with its first and
second derivatives: functions built once for all laws that differ in constant controls alone, such
as those of all bang arcs, whatever words and intervals they stand in.

The formula is that of Dormand and Prince (Hairer, Norsett, Wanner, Solving ODEs I, II.5).
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import final

import casadi
import numpy as np

from socp.model import (
    Expr,
    Problem,
    column,
    lately,
    numbers,
    of_motion,
    repeated,
    time,
)
from socp.transcription.dormand_prince import stage_points
from socp.transcription.kinks import kinks
from socp.transcription.phases import Phase, once_alike, once_along

_END = 12  # the stage that is the end of a step


def opened(problem: Problem, control: Expr) -> Expr:
    """Return a law (nu, 1) with the problem's symbols of controls in place of its constants."""
    pairs = zip(casadi.vertsplit(control), casadi.vertsplit(problem.u), strict=True)
    return column(open_ if law.is_constant() else law for law, open_ in pairs)


def constants(control: Expr) -> np.ndarray:
    """Return the values (nu,) of a law's constants, 0 for what varies."""
    rows = casadi.vertsplit(control)
    return np.array([float(each) if each.is_constant() else 0.0 for each in rows])


@final
@dataclass(frozen=True, eq=False)
class Flow:
    """Steps along a law, of which those controls u (nu,) are given that are symbols in it.

    y (ny,) are the states with what the phase carries, the running cost and the time.
    """

    problem: Problem
    phase: Phase

    @cached_property
    def kinks(self) -> Expr:
        """What vanishes (k, 1) where the rate, or the running cost, is not smooth."""
        problem = self.problem
        given = casadi.vertcat(problem.x, time, problem.p, problem.u)
        return kinks(casadi.vertcat(*self.phase.flow(problem)), given)

    @cached_property
    def step(self) -> casadi.Function:
        """One step (y, h, p, u) -> y after it."""
        problem, phase = self.problem, self.phase
        rate, running = phase.flow(problem)
        given = [casadi.vertcat(problem.x, phase.carried), time, problem.p, problem.u]
        motion = casadi.Function("f", given, [casadi.vertcat(rate, phase.carried_rate, running, 1)])
        y, h = casadi.SX.sym("y", motion.size1_out(0)), casadi.SX.sym("h")
        slopes, at = [], y
        for point in stage_points(y.numel())[:_END]:
            slopes.append(motion(at[:-2], at[-1], problem.p, problem.u))
            at = point(y, h, casadi.horzcat(*slopes))
        return casadi.Function("step", [y, h, problem.p, problem.u], [casadi.densify(at)])

    @cached_property
    def varied(self) -> casadi.Function:
        """One step of y (ny,) and its slopes (ny, nz + 2 + np) by z, t, the length of all steps
        and p: (y, slopes, h, p, u) -> both after it, and the slopes (ny, ny) of y by y before.
        """
        y, h, p, u = self.step.sx_in()
        end = self.step(y, h, p, u)
        across, others = casadi.jacobian(end, y), casadi.jacobian(end, casadi.vertcat(h, p))
        slopes = casadi.SX.sym("slopes", y.numel(), y.numel() + p.numel())
        direct = casadi.horzcat(casadi.SX(y.numel(), y.numel() - 1), others)
        after = casadi.mtimes(across, slopes) + direct
        found = [end, casadi.densify(after), casadi.densify(across)]
        return casadi.Function("varied", [y, slopes, h, p, u], found)

    @cached_property
    def curved(self) -> casadi.Function:
        """(y, h, p, u, multipliers (ny,)) -> Hessian by y, h, p of y after a step times these."""
        y, h, p, u = self.step.sx_in()
        held = casadi.SX.sym("l", y.numel())
        total = casadi.dot(held, self.step(y, h, p, u))
        hessian = casadi.densify(casadi.hessian(total, casadi.vertcat(y, h, p))[0])
        return casadi.Function("curved", [y, h, p, u, held], [hessian])


@final
@dataclass(frozen=True, eq=False)
class Motion:
    """The motion along a law: a flow with the law's constants u (nu,); z (nz,) are the states with
    what the phase carries.
    """

    problem: Problem
    phase: Phase
    flow: Flow
    u: np.ndarray

    @cached_property
    def kinks(self) -> Expr:
        """What vanishes (k, 1) where the rate, or the running cost, is not smooth."""
        shared = self.flow.kinks
        if not casadi.depends_on(shared, self.problem.u):
            return shared
        given = casadi.vertcat(self.problem.x, time, self.problem.p)
        return kinks(casadi.vertcat(*self.phase.flow(self.problem)), given)

    def moved(
        self, z: np.ndarray, t: np.ndarray, h: np.ndarray, p: np.ndarray, steps: int
    ) -> np.ndarray:
        """Return y (steps + 1, ny, n), that is z, the running cost and the time, before and after
        every one of so many steps, from z (nz, n) at times t (n,) over times h (n,) under p, (np,)
        or (np, n).
        """
        return self.through(z, t, np.tile(h / steps, (steps, 1)), p)

    def through(self, z: np.ndarray, t: np.ndarray, h: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return the same for steps of lengths h (steps, n)."""
        first = np.vstack([z, np.zeros(t.size), t]).T
        (found,) = repeated(self.flow.step, [first], [h[:, :, None], p.T, self.u], len(h))
        return np.concatenate([first[None], found]).transpose(0, 2, 1)

    @cached_property
    def control(self) -> casadi.Function:
        """The controls as a function of x, what is carried, t, p."""
        given = [self.problem.x, self.phase.carried, time, self.problem.p]
        return casadi.Function("u", given, [self.phase.control])

    def sweep(self, given: list[np.ndarray], steps: int) -> "Sweep":
        """Integrate over n intervals from what is given: z (nz, n), t (1, n), h (1, n), p (np, 1),
        in so many steps each.
        """
        z, t, h, p = given
        n, ny = t.size, len(z) + 2
        first = np.vstack([z, np.zeros((1, n)), t]).T
        by = np.zeros((ny, ny + len(p)))
        by[: len(z), : len(z)], by[-1, len(z)] = np.eye(len(z)), 1.0
        each = np.repeat(h / steps, steps)[None, :]
        begin = [first, np.tile(by.ravel("F"), (n, 1))]
        others = [h[0][:, None] / steps, p[:, 0], self.u]
        found = repeated(self.flow.varied, begin, others, steps)
        y, slopes, across = (
            m.swapaxes(0, 1).reshape(n, steps, -1, ny).swapaxes(2, 3) for m in found
        )
        before = np.concatenate([first[:, None], y[:, :-1, :, 0]], axis=1)
        begun = np.concatenate([np.broadcast_to(by, (n, 1, *by.shape)), slopes[:, :-1]], axis=1)
        last = slopes[:, -1, :-1].copy()
        last[:, :, len(z) + 1] /= steps
        return Sweep(self, y[:, -1, :-1, 0], last, before, begun, across, each, p)


@final
@dataclass(frozen=True, eq=False)
class Sweep:
    """Steps over n intervals: z with the running cost in which they end, `ends` (n, nz + 1), and
    its slopes (n, nz + 1, nz + 2 + np) by z, t, h and p.

    Of every step: y `before` (n, steps, ny), the slopes `begun` (n, steps, ny, nz + 2 + np) of
    that, those `across` (n, steps, ny, ny) the step, and its length (1, n steps).
    """

    motion: Motion
    ends: np.ndarray
    slopes: np.ndarray
    before: np.ndarray
    begun: np.ndarray
    across: np.ndarray
    each: np.ndarray
    p: np.ndarray

    def returned(self, held: np.ndarray) -> np.ndarray:
        """Return the multipliers (n, steps, ny) of y after every step from those of z where the
        intervals end, held (nz, n).
        """
        n, steps, ny, _ = self.begun.shape
        later = np.empty((n, steps, ny))
        now = np.vstack([held, np.ones((1, n)), np.zeros((1, n))]).T
        for k in reversed(range(steps)):
            later[:, k] = now
            now = (now[:, None] @ self.across[:, k])[:, 0]
        return later

    def between(self, held: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return y and its multipliers (ny, n s) at nodes (s,) between 0 and 1 of every interval,
        one interval after the other: one step from the last before it, and back from the next.
        """
        motion, (n, steps, ny) = self.motion, self.before.shape
        last = np.minimum((nodes * steps).astype(int), steps - 1)
        step = self.each.reshape(n, steps)[:, last]
        way = (step * (nodes * steps - last)).reshape(1, -1)
        y = self.before[:, last].reshape(-1, ny).T
        at = motion.through(y[:-2], y[-1], way, self.p[:, 0])[1]
        at[-2] += y[-2]
        slopes, rest = np.zeros((at.shape[1], ny * (ny + len(self.p)))), step.reshape(1, -1) - way
        others = [rest[:, :, None], self.p[:, 0], motion.u]
        *_, across = repeated(motion.flow.varied, [at.T, slopes], others, 1)
        later = self.returned(held)[:, last].reshape(-1, ny, 1)
        return at, (across.reshape(-1, ny, ny) @ later)[:, :, 0].T

    def bent(self, held: np.ndarray, stride: int = 1) -> np.ndarray:
        """Return the Hessians (n, nz + 2 + np,) twice, by the same, of the running cost and z times
        multipliers held (nz, n): those of steps as long as `stride` together. They are kept for the
        two that were asked for last.
        """
        make = partial(self._bent, held, stride)
        return lately(self, Sweep.bent, (held.tobytes(), stride), make, 2)

    def _bent(self, held: np.ndarray, stride: int) -> np.ndarray:
        n, steps, ny, count = self.begun.shape
        together = math.gcd(stride, steps)
        later = self.returned(held)[:, together - 1 :: together]
        y, multipliers = (each.reshape(-1, ny).T for each in (self.before[:, ::together], later))
        motion, each = self.motion, together * self.each[:, ::together]
        (found,) = numbers(motion.flow.curved, y, each, self.p, motion.u, multipliers)
        hessians = found.T.reshape(n, steps // together, ny + 1 + len(self.p), -1)
        by = np.zeros((n, steps // together, hessians.shape[2], count))
        by[:, :, :ny] = self.begun[:, ::together]
        by[:, :, ny:, ny - 1 :] = np.diag([together, *np.ones(len(self.p))])
        bent: np.ndarray = (by.swapaxes(2, 3) @ hessians @ by).sum(axis=1)
        bent[:, ny - 1] /= steps
        bent[:, :, ny - 1] /= steps
        return bent


@of_motion
def motion_of(problem: Problem, phase: Phase) -> Motion:
    """Return the motion along a phase's law; phases of one law share it."""

    def made() -> Motion:
        return Motion(problem, phase, _flow_of(problem, phase), constants(phase.control))

    return once_along(problem, phase, motion_of, made)


@of_motion
def _flow_of(problem: Problem, phase: Phase) -> Flow:
    """Return the flow along a phase's law, shared with those that differ in constants alone."""
    whole = replace(phase, control=opened(problem, phase.control))
    return once_alike(problem, whole, _flow_of, partial(Flow, problem, whole))

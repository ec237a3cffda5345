"""The motion along a phase's law by explicit Runge-Kutta steps of order 8, with its first and
second derivatives: functions built once for all laws that differ in constant controls alone, such
as those of all bang arcs, whatever words and intervals they stand in.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial
from typing import final

import casadi
import numpy as np

from socp.model import (
    Expr,
    Problem,
    column,
    lately,
    of_motion,
    repeated,
    time,
)
from socp.transcription.dormand_prince import Stages, Steps, staged
from socp.transcription.kinks import kinks
from socp.transcription.phases import Phase, once_alike, once_along


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
    def steps(self) -> Steps:
        """Steps of it."""
        problem, phase = self.problem, self.phase
        rate, running = phase.flow(problem)
        y = casadi.vertcat(problem.x, phase.carried, casadi.SX.sym("cost"), time)
        motion = casadi.vertcat(rate, phase.carried_rate, running, 1)
        return Steps(y, problem.p, problem.u, motion)


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
        return self._walked(z, t, (h / steps)[:, None], p, steps)[0].swapaxes(1, 2)

    def through(self, z: np.ndarray, t: np.ndarray, h: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Return the same for steps of lengths h (steps, n)."""
        return self._walked(z, t, h[:, :, None], p, len(h))[0].swapaxes(1, 2)

    def _walked(
        self, z: np.ndarray, t: np.ndarray, h: np.ndarray, p: np.ndarray, steps: int
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return y (steps + 1, n, ny), and (steps, n, c stages) what the steps have of stages, of
        steps of lengths h (n, 1) or (steps, n, 1).
        """
        first = np.vstack([z, np.zeros(t.size), t]).T
        y, at = repeated(self.flow.steps.step, [first], [h, p.T, self.u], steps)
        return np.concatenate([first[None], y]), at

    @cached_property
    def control(self) -> casadi.Function:
        """The controls as a function of x, what is carried, t, p."""
        given = [self.problem.x, self.phase.carried, time, self.problem.p]
        return casadi.Function("u", given, [self.phase.control])

    def sweep(self, given: list[np.ndarray], steps: int) -> "Sweep":
        """Integrate over n intervals from what is given: z (nz, n), t (1, n), h (1, n), p (np, 1),
        in so many steps each.
        """
        return swept([self], [given], [steps])[0]

    def walk(self, given: list[np.ndarray], steps: int) -> "Walk":
        """Return the same without slopes."""
        z, t, h, p = given
        each = h.T / steps
        y, at = self._walked(z, t[0], each, p[:, 0], steps)
        return Walk(self, y, at, each, p[:, 0])


@final
@dataclass(frozen=True, eq=False)
class Walk:
    """Steps of lengths `each` (n, 1) over n intervals under p (np,): y (steps + 1, n, ny) before
    and after every one, and what they have of their stages, `at` (steps, n, c stages).
    """

    motion: Motion
    y: np.ndarray
    at: np.ndarray
    each: np.ndarray
    p: np.ndarray

    @property
    def count(self) -> int:
        """How many steps there are over all intervals."""
        return math.prod(self.at.shape[:2])

    def given(self, together: int = 1) -> list[np.ndarray]:
        """Return h (k, 1) and u (k, nu) of all steps as long as so many together, the first ones of
        all intervals first.
        """
        h = np.concatenate([together * self.each] * (len(self.at) // together))
        u = np.empty((len(h), self.motion.u.size))
        u[:] = self.motion.u
        return [h, u]


@final
@dataclass(frozen=True, eq=False)
class Sweep:
    """A walk over n intervals with its slopes: `begun` (steps + 1, n, ny + 1 + np, nz + 2 + np),
    those of y, the length of a step and p by z, t, h and p where intervals begin, and `along`
    (steps, n, ny, ny + 1 + np), those of y after every step by the former.

    `stages` are those of all steps, among others or alone.
    """

    walk: Walk
    stages: Stages
    begun: np.ndarray
    along: np.ndarray

    @classmethod
    def of(cls, walk: Walk, stages: Stages, along: np.ndarray) -> "Sweep":
        """Take the slopes (n steps, ny, ny + 1 + np) of steps in turns."""
        n, ny = walk.y.shape[1:]
        steps, count = len(walk.at), walk.p.size
        along = along.reshape(steps, n, ny, -1)
        begun = np.zeros((steps + 1, n, ny + 1 + count, ny + count))
        begun[0, :, range(ny - 2), range(ny - 2)] = begun[0, :, ny - 1, ny - 2] = 1.0
        begun[:, :, ny, ny - 1] = 1.0 / steps
        begun[:, :, range(ny + 1, ny + 1 + count), range(ny, ny + count)] = 1.0
        for k, own in enumerate(along):
            np.matmul(own, begun[k], out=begun[k + 1, :, :ny])
        return cls(walk, stages, begun, along)

    @property
    def ends(self) -> np.ndarray:
        """Where the intervals end: z with the running cost (n, nz + 1)."""
        return self.walk.y[-1, :, :-1]

    @property
    def slopes(self) -> np.ndarray:
        """Slopes (n, nz + 1, nz + 2 + np) of that by z, t, h and p."""
        return self.begun[-1, :, : self.ends.shape[1]]

    @property
    def before(self) -> np.ndarray:
        """Of every step y before it (n, steps, ny)."""
        return self.walk.y[:-1].swapaxes(0, 1)

    @property
    def across(self) -> np.ndarray:
        """Of every step the slopes (n, steps, ny, ny) of y after it by y before."""
        return self.along[:, :, :, : self.along.shape[2]].swapaxes(0, 1)

    @property
    def each(self) -> np.ndarray:
        """The lengths (1, n steps) of the steps."""
        return np.repeat(self.walk.each, len(self.along), axis=0).T

    @property
    def p(self) -> np.ndarray:
        """The parameters (np, 1)."""
        return self.walk.p[:, None]

    def returned(self, held: np.ndarray) -> np.ndarray:
        """Return the multipliers (n, steps, ny) of y after every step from those of z where the
        intervals end, held (nz, n).
        """
        steps, n, ny, _ = self.along.shape
        later = np.empty((steps, n, 1, ny))
        later[-1, :, 0] = np.vstack([held, np.ones((1, n)), np.zeros((1, n))]).T
        for k in reversed(range(1, steps)):
            np.matmul(later[k], self.along[k, :, :, :ny], out=later[k - 1])
        return later[:, :, 0].swapaxes(0, 1)

    def bent(self, held: np.ndarray, stride: int = 1) -> np.ndarray:
        """Return what the function of that name does for this alone."""
        return bent([self], [held], stride)[0]


def moved(
    motions: Sequence[Motion], given: Sequence[Sequence[np.ndarray]], p: np.ndarray, steps: int
) -> list[np.ndarray]:
    """Return of every motion where its n intervals end, z with the running cost (nz + 1, n), in so
    many steps each, from what is given of it, z (nz, n), times (n,) and lengths (n,), and p (np,):
    those of one flow go on at once.
    """
    found = dict[int, np.ndarray]()
    for flow, which in _by_flow(motions):
        rows = []
        for z, t, h in (given[k] for k in which):
            rows.append([np.vstack([z, np.zeros(t.size), t]).T, h[:, None] / steps])
        u = [np.tile(motions[k].u, (given[k][1].size, 1)) for k in which]
        first, h = _joined(rows)
        y, _ = repeated(flow.steps.step, [first], [h, p, np.concatenate(u)], steps)
        parts = np.cumsum([len(each) for each in u[:-1]], dtype=int)
        ends = np.split(y[-1, :, :-1].T, parts, axis=1)
        found |= dict(zip(which, ends, strict=True))
    return [found[k] for k in range(len(motions))]


def swept(
    motions: Sequence[Motion], given: Sequence[list[np.ndarray]], steps: Sequence[int]
) -> list[Sweep]:
    """Return the sweep of every motion from what is given of it, as `Motion.sweep` takes it: the
    slopes of those of one flow are worked out at once.
    """
    walks = [one.walk(own, count) for one, own, count in zip(motions, given, steps, strict=True)]
    found = dict[int, Sweep]()
    for flow, which in _by_flow(motions):
        h, u = _joined([walks[k].given() for k in which])
        at = np.concatenate([row for k in which for row in walks[k].at])
        stages = Stages(flow.steps, staged(at, len(flow.steps.active)), (h, walks[which[0]].p, u))
        parts = np.split(stages.across, np.cumsum([walks[k].count for k in which[:-1]], dtype=int))
        found |= {k: Sweep.of(walks[k], stages, own) for k, own in zip(which, parts, strict=True)}
    return [found[k] for k in range(len(walks))]


def bent(sweeps: Sequence[Sweep], held: Sequence[np.ndarray], stride: int = 1) -> list[np.ndarray]:
    """Return of every sweep the Hessians (n, nz + 2 + np,) twice, by z, t, h and p where intervals
    begin, of the running cost and z times its multipliers held (nz, n): those of steps as long as
    `stride` together. They are kept for the two that were asked for last.
    """
    together = cache(partial(_bent, sweeps, held, stride))

    def made(k: int) -> np.ndarray:
        return together()[k]

    return [
        lately(sweep, Sweep.bent, (own.tobytes(), stride), partial(made, k), 2)
        for k, (sweep, own) in enumerate(zip(sweeps, held, strict=True))
    ]


def _bent(
    sweeps: Sequence[Sweep], held: Sequence[np.ndarray], stride: int
) -> dict[int, np.ndarray]:
    found = dict[int, np.ndarray]()
    for flow, which in _by_flow([each.walk.motion for each in sweeps]):
        own, steps = [sweeps[k] for k in which], flow.steps
        long = [math.gcd(stride, len(each.along)) for each in own]
        ny, stages, count = own[0].along.shape[2], own[0].stages, sum(e.walk.count for e in own)
        shared = all(e.stages is stages for e in own) and len(stages.given[0]) == count
        if max(long) > 1 or not shared:
            h, u = _joined([each.walk.given(k) for each, k in zip(own, long, strict=True)])
            y = [e.walk.y[:-1:k].reshape(-1, ny) for e, k in zip(own, long, strict=True)]
            stages = Stages.of(steps, np.concatenate(y), h, own[0].walk.p, u)
        later = [
            sweeps[k].returned(held[k]).swapaxes(0, 1)[m - 1 :: m].reshape(-1, ny)
            for k, m in zip(which, long, strict=True)
        ]
        parts = np.cumsum([len(each) for each in later[:-1]], dtype=int)
        hessians = np.split(stages.bent(np.concatenate(later)), parts)
        inner = [*steps.active, *range(ny, own[0].begun.shape[2])]
        for k, m, each in zip(which, long, hessians, strict=True):
            by = sweeps[k].begun[:-1:m][:, :, inner]
            by[:, :, len(steps.active)] *= m
            part = each.reshape(*by.shape[:3], -1)
            found[k] = (by.swapaxes(2, 3) @ (part @ by)).sum(axis=0)
    return found


def _by_flow(motions: Sequence[Motion]) -> list[tuple[Flow, list[int]]]:
    """Return every flow with the places of its motions."""
    found = dict[Flow, list[int]]()
    for k, each in enumerate(motions):
        found.setdefault(each.flow, []).append(k)
    return list(found.items())


def _joined(rows: Sequence[Sequence[np.ndarray]]) -> list[np.ndarray]:
    return [np.concatenate(each) for each in zip(*rows, strict=True)]


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

"""Shooting equations and cost at given variables, with their first and second derivatives,
assembled from those of the motion over single intervals.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from socp.model import Solution, numbers, parameters_of
from socp.transcription.motion import Sweep, bent, motion_of, moved, swept
from socp.transcription.phases import PhasedProblem
from socp.transcription.shooting import Shooting


def begun(shooting: Shooting, k: int, w: np.ndarray) -> list[np.ndarray]:
    """Return what the n intervals of phase k begin with at variables w: z (nz, n), t (1, n), h
    (1, n), p (np, 1).
    """
    block, first = shooting.blocks[k], 1 + len(shooting.blocks)
    last = first + block.change.shape[1] - 2 - block.variables.shape[1]
    t = w[: 1 + k].sum() + w[1 + k] * block.shares[:-1]
    h = w[1 + k] * (block.shares[1:] - block.shares[:-1])
    return [w[block.variables[:-1]].T, t[None, :], h[None, :], w[first:last, None]]


def interval_ends(
    phased: PhasedProblem, start: Solution
) -> Callable[[Sequence[int], int], list[np.ndarray]]:
    """Return states, what is carried and running cost (nz + 1, m) in which the m intervals of some
    phases end, as a function of these and of how many steps each of them takes.
    """
    p, given = parameters_of(phased.of, start), []
    for phase, arc in zip(phased.phases, start.arcs, strict=True):
        t = arc.t[arc.mesh]
        z = np.vstack([arc.x, arc.costate[: phase.carried.numel()]])[:, arc.mesh[:-1]]
        given.append([z, t[:-1], np.diff(t)])
    motions = [motion_of(phased.of, phase) for phase in phased.phases]

    def ends(phases: Sequence[int], steps: int) -> list[np.ndarray]:
        return moved([motions[k] for k in phases], [given[k] for k in phases], p, steps)

    return ends


def residuals(shooting: Shooting, w: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the equations (m,) and the cost at variables w (n,), without their slopes."""
    given, cost, *_ = numbers(shooting.joined[0], w)
    equations, objective = np.zeros(shooting.signs.size), float(cost[0, 0])
    equations[shooting.others] = given[:, 0] - shooting.levels
    for k, block in enumerate(shooting.blocks):
        z, t, h, p = begun(shooting, k, w)
        ends = shooting.motions[k].moved(z, t[0], h[0], p[:, 0], shooting.steps[k])[-1][:-1]
        equations[block.equations] = ends[:-1].T - w[block.variables[1:]]
        objective += float(ends[-1].sum())
    return equations, objective


@final
@dataclass(frozen=True, eq=False)
class Linearised:
    """Equations (m,) and cost of shooting at variables `at` (n,), their slopes (m, n) and (n,), and
    the steps over the intervals of every phase.
    """

    shooting: Shooting
    at: np.ndarray
    equations: np.ndarray
    cost: float
    slopes: np.ndarray
    gradient: np.ndarray
    sweeps: tuple[Sweep, ...]

    @classmethod
    def of(cls, shooting: Shooting, w: np.ndarray) -> "Linearised":
        """Return what the equations are at variables w (n,)."""
        given, cost, joined, at_ends = numbers(shooting.joined[0], w)
        equations, slopes = np.zeros(shooting.signs.size), np.zeros((shooting.signs.size, w.size))
        equations[shooting.others] = given[:, 0] - shooting.levels
        slopes[shooting.others] = joined
        objective, gradient = float(cost[0, 0]), at_ends[:, 0]
        starts = [begun(shooting, k, w) for k in range(len(shooting.blocks))]
        sweeps = swept(shooting.motions, starts, shooting.steps)
        for block, sweep in zip(shooting.blocks, sweeps, strict=True):
            ends, by = sweep.ends, sweep.slopes @ block.change
            equations[block.equations] = ends[:, :-1] - w[block.variables[1:]]
            objective += float(ends[:, -1].sum())
            slopes[block.equations[:, :, None], block.columns[:, None, :]] = by[:, :-1]
            slopes[block.equations, block.variables[1:]] -= 1.0
            gradient += np.bincount(block.columns.ravel(), by[:, -1].ravel(), w.size)
        return cls(shooting, w, equations, objective, slopes, gradient, tuple(sweeps))

    def under(self, shooting: Shooting) -> "Linearised":
        """Return the same for equations that differ in the levels of the ends alone."""
        equations = self.equations.copy()
        equations[shooting.others] += self.shooting.levels - shooting.levels
        return replace(self, shooting=shooting, equations=equations)

    def hessian(self, held: np.ndarray, stride: int = 1) -> np.ndarray:
        """Return the Hessian (n, n) of the cost and the equations times multipliers held (m,): that
        of steps as long as `stride` together along the same motion, in as small a part of the time.
        """
        shooting, n = self.shooting, self.at.size
        found: np.ndarray
        (found,) = numbers(shooting.joined[1], self.at, held[shooting.others])
        bends = bent(self.sweeps, [held[each.equations].T for each in shooting.blocks], stride)
        for block, own in zip(shooting.blocks, bends, strict=True):
            each = block.change.transpose(0, 2, 1) @ own @ block.change
            places = n * block.columns[:, :, None] + block.columns[:, None, :]
            found = found + np.bincount(places.ravel(), each.ravel(), n * n).reshape(n, n)
        return found

"""Shooting equations and cost at given variables, with their first and second derivatives,
assembled from those of the motion over single intervals.
"""

from dataclasses import dataclass
from typing import final

import numpy as np

from socp.model import numbers
from socp.transcription.motion import Sweep
from socp.transcription.shooting import Shooting


@final
@dataclass(frozen=True, eq=False)
class Span:
    """The motion over the n intervals of a phase, the variables (n, v) that z, t, h and p depend on
    where these begin, and how, `change` (n, nz + 2 + np, v).
    """

    sweep: Sweep
    columns: np.ndarray
    change: np.ndarray

    @classmethod
    def of(cls, shooting: Shooting, k: int, w: np.ndarray) -> "Span":
        """Return the intervals of phase k at variables w (n,)."""
        block, count = shooting.blocks[k], shooting.phased.of.p.numel()
        shares, (n, nz) = block.shares, block.variables[1:].shape
        others = [*range(2 + k), *(1 + len(shooting.pairs) + np.arange(count))]
        columns = np.hstack([block.variables[:-1], np.tile(others, (n, 1))]).astype(int)
        change = np.zeros((n, nz + 2 + count, columns.shape[1]))
        change[:, :nz, :nz] = np.eye(nz)
        change[:, nz, nz : nz + 1 + k] = 1.0
        change[:, nz, nz + 1 + k] = shares[:-1]
        change[:, nz + 1, nz + 1 + k] = np.diff(shares)
        change[:, nz + 2 :, nz + 2 + k :] = np.eye(count)
        given = begun(shooting, k, w)
        return cls(shooting.motions[k].sweep(given, shooting.steps[k]), columns, change)


def begun(shooting: Shooting, k: int, w: np.ndarray) -> list[np.ndarray]:
    """Return what the n intervals of phase k begin with at variables w: z (nz, n), t (1, n), h
    (1, n), p (np, 1).
    """
    block, first = shooting.blocks[k], 1 + len(shooting.pairs)
    t = w[: 1 + k].sum() + w[1 + k] * block.shares[:-1]
    h, p = w[1 + k] * np.diff(block.shares), w[first : first + shooting.phased.of.p.numel()]
    return [w[block.variables[:-1]].T, t[None, :], h[None, :], p[:, None]]


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
    the intervals of every phase.
    """

    shooting: Shooting
    at: np.ndarray
    equations: np.ndarray
    cost: float
    slopes: np.ndarray
    gradient: np.ndarray
    spans: tuple[Span, ...]

    @classmethod
    def of(cls, shooting: Shooting, w: np.ndarray) -> "Linearised":
        """Return what the equations are at variables w (n,)."""
        given, cost, joined, at_ends = numbers(shooting.joined[0], w)
        equations, slopes = np.zeros(shooting.signs.size), np.zeros((shooting.signs.size, w.size))
        equations[shooting.others] = given[:, 0] - shooting.levels
        slopes[shooting.others] = joined
        objective, gradient, spans = float(cost[0, 0]), at_ends[:, 0], []
        for k, block in enumerate(shooting.blocks):
            spans.append(span := Span.of(shooting, k, w))
            ends, by = span.sweep.ends, span.sweep.slopes
            equations[block.equations] = ends[:, :-1] - w[block.variables[1:]]
            objective += float(ends[:, -1].sum())
            for j, each in enumerate(by @ span.change):
                rows, columns = block.equations[j], span.columns[j]
                slopes[rows[:, None], columns] = each[:-1]
                slopes[rows, block.variables[j + 1]] -= 1.0
                gradient[columns] += each[-1]
        return cls(shooting, w, equations, objective, slopes, gradient, tuple(spans))

    def hessian(self, held: np.ndarray) -> np.ndarray:
        """Return the Hessian (n, n) of the cost and the equations times multipliers held (m,)."""
        shooting = self.shooting
        found: np.ndarray
        (found,) = numbers(shooting.joined[1], self.at, held[shooting.others])
        for block, span in zip(shooting.blocks, self.spans, strict=True):
            bent = span.sweep.bent(held[block.equations].T)
            each = span.change.transpose(0, 2, 1) @ bent @ span.change
            for columns, part in zip(span.columns, each, strict=True):
                found[np.ix_(columns, columns)] += part
        return found

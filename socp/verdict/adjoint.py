"""The adjoint equation along a given solution, condensed: costates as affine functions of a few
unknown multipliers.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import final

import numpy as np

from socp.model import (
    ACTIVE,
    Problem,
    Solution,
    condition_function,
    condition_slopes,
    end_values,
    lagrange,
    mayer_slopes,
    numbers,
    scales,
)
from socp.transcription import lgr
from socp.verdict.nodes import POINTS, Samples, sample
from socp.verdict.structure import nearness

# Entries of the linear systems that are solved in one call: 16 MB, and many of a small problem's
_AT_ONCE = 2_000_000

__all__ = ["POINTS", "Costates", "Samples", "Unknowns", "condense", "sample"]


@final
@dataclass(frozen=True, eq=False)
class Unknowns:
    """The multipliers that are looked for, as columns of z: what each one is and where.

    ends: rows (nx, columns) of the final costate; mu: (constraint, interval) blocks of d nodes;
    jumps: (constraint, joint k at edges[k]).
    """

    ends: np.ndarray
    mu: Sequence[tuple[int, int]] = ()
    jumps: Sequence[tuple[int, int]] = ()

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return int(self.ends.shape[1]) + POINTS * len(self.mu) + len(self.jumps)

    def mu_columns(self, block: int) -> slice:
        """Return the columns of one block of constraint multipliers."""
        first = self.ends.shape[1] + POINTS * block
        return slice(first, first + POINTS)

    def jump_column(self, jump: int) -> int:
        """Return the column of one jump."""
        return int(self.ends.shape[1]) + POINTS * len(self.mu) + jump


@final
@dataclass(frozen=True, eq=False)
class Costates:
    """lambda at the nodes as offset (n, nx) + maps (n, nx, nz) z; mu at the nodes as mu (n, nc, nz)
    z.
    """

    offset: np.ndarray
    maps: np.ndarray
    mu: np.ndarray

    def at(self, z: np.ndarray) -> np.ndarray:
        """Return the costates (nx, n) for multipliers z (nz,)."""
        result: np.ndarray = (self.offset + self.maps @ z).T
        return result


def condense(samples: Samples, unknowns: Unknowns, end: np.ndarray) -> Costates:
    """Integrate lambda' = -H_x - mu c_x backwards from lambda(tf) = end (nx,) + unknowns, by Radau
    collocation.

    Backwards the adjoint equation is as stable as the state equation forwards, so condensing loses
    no digits there. At a joint lambda(t-) = lambda(t+) + jump c_x (Hartl, Sethi, Vickson, SIAM
    Review 37, 1995, theorem 4.1).
    """
    v, nx, d = samples.values, samples.x.shape[0], POINTS
    count, nc, nz = samples.intervals, v["cx"].shape[1], unknowns.size
    lasts, mu = np.empty((count, nx, nz + 1)), np.zeros((count, samples.width, nc, nz))
    nodes = np.empty((count, d, nx, nz + 1))
    value = np.zeros((nx, nz + 1))  # the last column is the part without unknowns
    value[:, : unknowns.ends.shape[1]], value[:, -1] = unknowns.ends, end
    for block, (constraint, k) in enumerate(unknowns.mu):
        columns = unknowns.mu_columns(block)
        mu[k, np.arange(d), constraint, np.arange(columns.start, columns.stop)] = 1.0
        mu[k, d, constraint, columns] = _extrapolation()
    together = max(_AT_ONCE // (d * nx * (d * nx + nz + 1)), 1)
    for last in range(count, 0, -together):
        some = slice(max(last - together, 0), last)
        maps, own = _over(samples, unknowns, mu[some], some)
        for k in reversed(range(some.start, last)):
            for jump, (constraint, joint) in enumerate(unknowns.jumps):
                if joint == k + 1:
                    slope = v["cx"][(k + 1) * samples.width - 1, constraint]
                    value[:, unknowns.jump_column(jump)] += slope
            lasts[k] = value
            value = maps[k - some.start, :nx] @ value + own[k - some.start, :nx]
        nodes[some] = (maps @ lasts[some] + own).reshape(-1, d, nx, nz + 1)
    table = np.concatenate([nodes, lasts[:, None]], axis=1).reshape(-1, nx, nz + 1)
    return Costates(table[:, :, -1], table[:, :, :-1], mu.reshape(samples.t.size, nc, nz))


def _over(
    samples: Samples, unknowns: Unknowns, mu: np.ndarray, some: slice
) -> tuple[np.ndarray, np.ndarray]:
    """Return lambda at the collocated nodes of some intervals, k of them, as maps (k, d nx, nx) of
    its value at their ends, and the rest (k, d nx, nz + 1) that is not; mu (k, d + 1, nc, nz).
    """
    scheme, v, nx, d = lgr(POINTS), samples.values, samples.x.shape[0], POINTS
    half = 0.5 * np.diff(samples.edges)[some, None, None]
    fx, cx = (
        v[name].reshape(samples.intervals, samples.width, *v[name].shape[1:])[some, :d]
        for name in ("fx", "cx")
    )
    forcing = np.empty((len(fx), d, nx, unknowns.size + 1))
    forcing[..., -1] = np.moveaxis(v["Lx"].reshape(nx, samples.intervals, -1)[:, some, :d], 0, -1)
    forcing[..., :-1] = cx.swapaxes(2, 3) @ mu[:, :d]
    matrix = np.tile(np.kron(scheme.A[:, :-1], np.eye(nx)), (len(fx), 1, 1))
    for j in range(d):
        rows = slice(j * nx, (j + 1) * nx)
        matrix[:, rows, rows] += half * fx[:, j].swapaxes(1, 2)
    outer = np.tile(-np.kron(scheme.A[:, -1:], np.eye(nx)), (len(fx), 1, 1))
    given = -half * forcing.reshape(len(fx), d * nx, unknowns.size + 1)
    solved = np.linalg.solve(matrix, np.concatenate([outer, given], axis=2))
    return solved[:, :, :nx], solved[:, :, nx:]


@cache
def _extrapolation() -> np.ndarray:
    """Return the weights (d,) that extend a polynomial from the collocated nodes to the end of an
    interval.
    """
    return lagrange(lgr(POINTS).nodes[:-1], np.eye(POINTS), np.array([1.0]))[:, 0]


@final
@dataclass(frozen=True, eq=False)
class Ends:
    """The Mayer term's slopes at the ends and those of the end conditions: cost (nx,), conditions
    (k, nx), and so on.

    `signs` (k,): 0 for equations, 1 for an inequality whose multiplier must not be negative. Fixed
    final states and active ends of intervals are conditions too, with unit slopes; sign -1 belongs
    to a lower end. `values` (k,) are those of the conditions, zero where they are met exactly.
    """

    slope_final: np.ndarray
    slope_initial: np.ndarray
    slope_tf: float
    slope_t0: float
    slope_p: np.ndarray
    psi_final: np.ndarray
    psi_initial: np.ndarray
    psi_tf: np.ndarray
    psi_t0: np.ndarray
    psi_p: np.ndarray
    signs: np.ndarray
    names: list[str]
    values: np.ndarray

    @staticmethod
    def of(problem: Problem, solution: Solution) -> "Ends":
        """Work out the slopes at the ends of a solution."""
        values, scale = end_values(problem, solution), scales(problem, solution)
        cost = [each.ravel() for each in numbers(mayer_slopes(problem), *values)]
        found: list[tuple[list[np.ndarray], int, str, float]] = []
        for condition in problem.conditions:
            value = float(numbers(condition_function(problem, condition), *values)[0][0, 0])
            slopes = condition_slopes(problem, condition)
            slope = [each.ravel() for each in numbers(slopes, *values)]
            size = float(np.abs(slope[0]) @ scale + np.abs(slope[1]) @ scale) or 1.0
            if condition.equation or value > -ACTIVE * size:
                found.append(
                    (slope, 0 if condition.equation else 1, f"target '{condition.name}'", value)
                )
        found += list(_end_values(problem, values[0], scale, [each.size for each in cost]))
        stacked = [
            np.array([row[0][i] for row in found]).reshape(len(found), cost[i].size)
            for i in range(5)
        ]
        return Ends(
            cost[0],
            cost[1],
            float(cost[4][0]),
            float(cost[3][0]),
            cost[2],
            stacked[0],
            stacked[1],
            stacked[4][:, 0],
            stacked[3][:, 0],
            stacked[2],
            np.array([row[1] for row in found], dtype=int),
            [row[2] for row in found],
            np.array([row[3] for row in found]),
        )


def _end_values(
    problem: Problem, xf: np.ndarray, scale: np.ndarray, sizes: list[int]
) -> Iterator[tuple[list[np.ndarray], int, str, float]]:
    """Yield fixed final states and active ends of final intervals as conditions with unit
    slopes.
    """
    low, high = problem.end_box
    for i, name in enumerate(problem.state_names):
        near = ACTIVE * scale[i]
        sign = (
            0
            if low[i] == high[i]
            else 1
            if xf[i] > high[i] - near
            else -1
            if xf[i] < low[i] + near
            else None
        )
        if sign is not None:
            slope = [np.zeros(size) for size in sizes]
            slope[0][i] = 1.0
            yield slope, sign, f"final {name}", float(xf[i] - (low[i] if sign < 0 else high[i]))


def unknowns_of(problem: Problem, solution: Solution, samples: Samples, ends: Ends) -> Unknowns:
    """Choose the unknowns: end conditions, densities on active intervals, jumps at their ends, at
    touches and at knots.
    """
    c, width = samples.values["c"], samples.width
    inner = np.arange(1, samples.intervals)
    free = samples.on_knot(samples.edges[inner])  # where what the constraint is worth may jump
    blocks: list[tuple[int, int]] = []
    jumps: list[tuple[int, int]] = []
    for j, near in enumerate(nearness(solution, problem)):
        at = c[j].reshape(-1, width) > -near
        active = at.all(axis=1)
        blocks += [(j, int(k)) for k in np.flatnonzero(active)]
        within = active[inner - 1] & active[inner]
        met = at[inner - 1, -1] & at[inner, 0] & (~within | free)
        jumps += [(j, int(k)) for k in inner[met]]
        held = np.flatnonzero(samples.values["cx"][-1, j])
        fixed = problem.end_box[0] == problem.end_box[1]
        if at[-1, -1] and not fixed[held].all():
            jumps.append((j, samples.intervals))
    return Unknowns(ends.psi_final.T, blocks, jumps)


@final
@dataclass(frozen=True, eq=False)
class AdjointSystem:
    """A solution laid out for judging: nodes, unknown multipliers, costates as functions of them,
    end slopes.
    """

    problem: Problem
    solution: Solution
    samples: Samples
    unknowns: Unknowns
    costates: Costates
    ends: Ends

    @property
    def horizon(self) -> float:
        """Length of the horizon."""
        return self.solution.final_time - self.solution.initial_time

    @cached_property
    def scale(self) -> np.ndarray:
        """Magnitude of every state (nx,)."""
        return scales(self.problem, self.solution)

    @cached_property
    def sigma(self) -> tuple[np.ndarray, np.ndarray]:
        """Switching functions as offset (nu, n) and matrix (nu, n, nz)."""
        v = self.samples.values
        offset = v["L1"] + np.einsum("njk,nj->kn", v["G"], self.costates.offset)
        return offset, np.einsum("njk,njz->knz", v["G"], self.costates.maps)

    @cached_property
    def hamiltonian(self) -> tuple[np.ndarray, np.ndarray]:
        """Hamiltonian as offset (n,) and matrix (n, nz)."""
        v = self.samples.values
        return v["L"] + np.einsum("jn,nj->n", v["f"], self.costates.offset), np.einsum(
            "jn,njz->nz", v["f"], self.costates.maps
        )

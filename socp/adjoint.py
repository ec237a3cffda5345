"""The adjoint equation along a given solution, condensed: costates as affine functions of a few unknown multipliers."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from socp.sampling import POINTS, Samples, sample
from socp.schemes import lgr

__all__ = ["POINTS", "Costates", "Samples", "Unknowns", "condense", "sample"]


@final
@dataclass(frozen=True, eq=False)
class Unknowns:
    """The multipliers that are looked for, as columns of z: what each one is and where.

    ends: rows (nx, columns) of the final costate; mu: (constraint, interval) blocks of d nodes; jumps: (constraint,
    joint k at edges[k]).
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
    """lambda at the nodes as offset (n, nx) + maps (n, nx, nz) z; mu at the nodes as mu (n, nc, nz) z."""

    offset: np.ndarray
    maps: np.ndarray
    mu: np.ndarray

    def at(self, z: np.ndarray) -> np.ndarray:
        """Return the costates (nx, n) for multipliers z (nz,)."""
        result: np.ndarray = (self.offset + self.maps @ z).T
        return result


def condense(samples: Samples, unknowns: Unknowns, end: np.ndarray) -> Costates:
    """Integrate lambda' = -H_x - mu c_x backwards from lambda(tf) = end (nx,) + unknowns, by Radau collocation.

    Backwards the adjoint equation is as stable as the state equation forwards, so condensing loses no digits there.
    At a joint lambda(t-) = lambda(t+) + jump c_x (Hartl, Sethi, Vickson, SIAM Review 37, 1995, theorem 4.1).
    """
    scheme, v, nx, d = lgr(POINTS), samples.values, samples.x.shape[0], POINTS
    n, nc, nz = samples.t.size, v["cx"].shape[1], unknowns.size
    value = np.zeros((nx, nz + 1))  # the last column is the part without unknowns
    value[:, : unknowns.ends.shape[1]], value[:, -1] = unknowns.ends, end
    table, mu = np.zeros((n, nx, nz + 1)), np.zeros((n, nc, nz))
    inner, outer = np.kron(scheme.A[:, :-1], np.eye(nx)), np.kron(scheme.A[:, -1:], np.eye(nx))
    for k in reversed(range(samples.intervals)):
        first = k * samples.width
        here = slice(first, first + d)
        for jump, (constraint, joint) in enumerate(unknowns.jumps):
            if joint == k + 1:
                value[:, unknowns.jump_column(jump)] += v["cx"][first + d, constraint]
        half = 0.5 * (samples.edges[k + 1] - samples.edges[k])
        forcing = np.zeros((d, nx, nz + 1))
        forcing[:, :, -1] = v["Lx"][:, here].T
        for block, (constraint, interval) in enumerate(unknowns.mu):
            if interval == k:
                columns = np.arange(d) + unknowns.mu_columns(block).start
                forcing[np.arange(d), :, columns] += v["cx"][here, constraint]
                mu[first + np.arange(d), constraint, columns] = 1.0
                mu[first + d, constraint, unknowns.mu_columns(block)] = _extrapolation()
        matrix = inner.copy()
        for j in range(d):
            rows = slice(j * nx, (j + 1) * nx)
            matrix[rows, rows] += half * v["fx"][first + j].T
        nodes = np.linalg.solve(matrix, -outer @ value - half * forcing.reshape(d * nx, nz + 1))
        table[here], table[first + d] = nodes.reshape(d, nx, nz + 1), value
        value = table[first].copy()
    return Costates(table[:, :, -1], table[:, :, :-1], mu)


def _extrapolation() -> np.ndarray:
    """Return the weights (d,) that extend a polynomial from the collocated nodes to the end of an interval."""
    nodes = lgr(POINTS).nodes
    return np.array(
        [np.prod((1.0 - np.delete(nodes[:-1], j)) / (nodes[j] - np.delete(nodes[:-1], j))) for j in range(POINTS)]
    )

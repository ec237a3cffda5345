"""A solution on its own mesh: nodes on every interval, the problem's values there, and the adjoint
equation as a map from the end of a piece to its nodes.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, final

import numpy as np

from socp.model import SAME_TIME, Arc, Problem, Solution, parameters_of
from socp.transcription import lgr
from socp.verdict.nodes import values_at

# collocated nodes a piece: order 7, where a grid's own polynomials are of degree 1 to 4
NODES = 4
_SCHEME = lgr(NODES)
# entries of the matrices of pieces solved at once, 32 MiB of them: of a hundred states those of a
# grid of 400 steps would be half a GiB
_AT_ONCE = 1 << 22


@final
@dataclass(frozen=True, eq=False)
class Pieces:
    """The intervals of a solution's own mesh, cut where they have inner nodes, with nodes of their
    own: d = `NODES` collocated ones and the end of every piece.

    edges (n + 1,): ends of the n pieces; t (n, d + 1); x (n, d + 1, nx); u (n, d + 1, nu); p (np,).
    """

    problem: Problem
    edges: np.ndarray
    t: np.ndarray
    x: np.ndarray
    u: np.ndarray
    p: np.ndarray

    @staticmethod
    def of(problem: Problem, solution: Solution) -> "Pieces":
        """Lay nodes over the mesh of a solution; ValueError where it has no length in time."""
        shortest = SAME_TIME * (solution.final_time - solution.initial_time)
        laid = [_laid(arc) for arc in solution.arcs if arc.t[-1] - arc.t[0] > shortest]
        if not laid:
            raise ValueError("the solution has no length in time")
        t, x, u = (np.concatenate(each) for each in zip(*laid, strict=True))
        edges = np.append(solution.initial_time, t[:, -1])
        return Pieces(problem, edges, t, x, u, parameters_of(problem, solution))

    @property
    def count(self) -> int:
        """Number of pieces n."""
        return int(self.t.shape[0])

    @cached_property
    def weights(self) -> np.ndarray:
        """Weights (n, d) of the collocated nodes; sums with them integrate over the horizon."""
        return np.array(0.5 * np.diff(self.edges)[:, None] * _SCHEME.weights[:-1])

    @cached_property
    def values(self) -> dict[str, np.ndarray]:
        """The problem's functions and slopes at the nodes, (n, d + 1, ..), by the names that
        `socp.verdict.nodes.Samples` has for them.
        """
        n = self.t.size
        columns = (self.x.reshape(n, -1).T, self.u.reshape(n, -1).T, self.t.ravel(), self.p)
        found = values_at(self.problem, columns)
        by_node = {
            name: each if each.ndim == 3 else np.moveaxis(each, -1, 0)
            for name, each in found.items()
        }
        return {
            name: each.reshape(*self.t.shape, *each.shape[1:]) for name, each in by_node.items()
        }

    @cached_property
    def maps(self) -> np.ndarray:
        """The costate at the nodes, (n, d + 1, nx, nx + 1 + nc), as a linear function of its value
        at the end of the piece, of 1, and of the density of every state constraint on the piece.

        lambda' = -H_x - mu c_x backwards by Radau collocation, as `socp.verdict.adjoint.condense`
        does on the judge's own mesh.
        """
        nx, nc = self.x.shape[-1], self.values["c"].shape[-1]
        found = np.zeros((self.count, NODES + 1, nx, nx + 1 + nc))
        found[:, NODES, :, :nx] = np.eye(nx)
        some = max(1, _AT_ONCE // (NODES * nx) ** 2)
        for first in range(0, self.count, some):
            part = slice(first, first + some)
            found[part, :NODES] = self._inner(part)
        return found

    def _inner(self, part: slice) -> np.ndarray:
        """Return the maps (k, d, nx, nx + 1 + nc) to the collocated nodes of some pieces."""
        half = 0.5 * np.diff(self.edges)[part, None, None]
        fx, Lx, cx = (self.values[name][part] for name in ("fx", "Lx", "cx"))
        count, _, nx, _ = fx.shape
        matrix = np.tile(np.kron(_SCHEME.A[:, :-1], np.eye(nx)), (count, 1, 1))
        right = np.zeros((count, NODES * nx, nx + 1 + cx.shape[2]))
        right[:, :, :nx] = -np.kron(_SCHEME.A[:, -1:], np.eye(nx))
        for j in range(NODES):
            rows = slice(j * nx, (j + 1) * nx)
            matrix[:, rows, rows] += half * fx[:, j].transpose(0, 2, 1)
            right[:, rows, nx] = -half[:, 0] * Lx[:, j]
            right[:, rows, nx + 1 :] = -half * cx[:, j].transpose(0, 2, 1)
        return np.linalg.solve(matrix, right).reshape(count, NODES, nx, -1)


def _laid(arc: Arc) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return times (n, d + 1), states (n, d + 1, nx) and controls (n, d + 1, nu) on an arc.

    An interval with inner nodes is cut into more pieces than one: a quadrature at the nodes where a
    method collocates sees nothing of what it misses between them.
    """
    within, tau = np.diff(arc.mesh), (_SCHEME.nodes + 1.0) / 2.0
    ends, parts = arc.t[arc.mesh], np.where(within > 1, -(-within // NODES) + 1, 1)
    inner = [np.linspace(a, b, k + 1)[:-1] for a, b, k in zip(ends, ends[1:], parts, strict=False)]
    corners = np.append(np.concatenate(inner), ends[-1])
    t = corners[:-1, None] + np.diff(corners)[:, None] * tau
    t[:, -1] = corners[1:]
    interval = np.repeat(np.arange(parts.size), parts)
    return t, _sampled(arc, interval, t, "x"), _sampled(arc, interval, t, "u")


def _sampled(arc: Arc, interval: np.ndarray, t: np.ndarray, which: Literal["x", "u"]) -> np.ndarray:
    """Evaluate the polynomials of intervals (n,) of an arc at times (n, q): (n, q, rows).

    As `Arc.at` does, but all intervals of as many nodes at once.
    """
    values: np.ndarray = getattr(arc, which)
    out = np.empty((*t.shape, values.shape[0]))
    spans = [arc.nodes(int(k), which) for k in interval]
    sizes = np.array([span.stop - span.start for span in spans])
    for size in np.unique(sizes):
        here = np.flatnonzero(sizes == size)
        at = np.array([spans[k].start for k in here])[:, None] + np.arange(size)
        nodes, apart = arc.t[at], t[here][:, :, None] - arc.t[at][:, None, :]
        basis = np.ones((here.size, t.shape[1], size))
        for i in range(size):
            for m in range(size):
                if m != i:
                    basis[:, :, i] *= apart[:, :, m] / (nodes[:, i] - nodes[:, m])[:, None]
        out[here] = np.einsum("kqp,rkp->kqr", basis, values[:, at])
    return out

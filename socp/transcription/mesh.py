"""Meshes of a phase: the schemes of its intervals joined into one table."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import accumulate
from typing import final

import casadi
import numpy as np

from socp.errors import MethodError
from socp.model import (
    Arc,
    Problem,
    Solution,
    coincident,
    evaluate,
    legendre_coefficients,
    objective_size,
    of_motion,
    once,
    parameters_of,
    running_costs,
    scales,
    time,
)
from socp.transcription.entries import Entries
from socp.transcription.schemes import Scheme, Side, lgr

Mesh = Sequence[tuple[float, Scheme]]  # intervals of one phase: (share of its length, scheme)


def uniform(scheme: Scheme, intervals: int) -> Mesh:
    """Return a mesh of equal intervals; MethodError for fewer than one."""
    if intervals < 1:
        raise MethodError(f"mesh: {intervals} intervals where 1 or more are needed")
    return [(1.0 / intervals, scheme)] * intervals


@final
@dataclass(frozen=True, eq=False)
class Table:
    """The schemes of a mesh put together on [0, 1]: defects A X - length * B F = 0 over all n nodes
    of a phase.

    tau (n,); A and B (m, n) sparse; weights (n,) sum to 1; mesh (k + 1,) node indices of the
    interval ends; edges (2, k): the weights that every interval by itself gives to its first and
    its last node.
    """

    tau: np.ndarray
    A: Entries
    B: Entries
    weights: np.ndarray
    mesh: np.ndarray
    edges: np.ndarray
    side: Side

    @cached_property
    def collocated(self) -> np.ndarray:
        """Indices of the nodes that carry a control."""
        return np.flatnonzero(self.weights > 0)

    @cached_property
    def at_edges(self) -> list[tuple[Entries, Entries]]:
        """The parts (m, k) of A and B that act on the first nodes of the intervals, and those that
        act on the last.
        """
        return [(self._at(self.A, last), self._at(self.B, last)) for last in (0, 1)]

    def _at(self, matrix: Entries, last: int) -> Entries:
        interval = np.searchsorted(self.mesh, matrix.rows, side="right") - 1
        here = matrix.columns == self.mesh[interval + last]
        shape = matrix.shape[0], self.mesh.size - 1
        return Entries(shape, matrix.rows[here], interval[here], matrix.values[here])


def table(mesh: Mesh) -> Table:
    """Join the intervals of a mesh; neighbours share the node between them.

    Raises MethodError for a mesh without intervals, a share that is not positive, or schemes that
    do not fit together.
    """
    return (_kept if len(mesh) <= _SMALL else _joined)(tuple(mesh))


def nodes_of(mesh: Mesh) -> tuple[np.ndarray, np.ndarray]:
    """Return `tau` and `mesh` as the table of a mesh has them, which takes many times as long;
    raises MethodError as it does.
    """
    _check(mesh)
    shares = np.array([share for share, _ in mesh], dtype=float) / sum(share for share, _ in mesh)
    ends = np.append(0.0, np.cumsum(shares))
    inner = [
        end + size * (scheme.nodes[:-1] + 1.0)
        for end, size, (_, scheme) in zip(ends, shares / 2.0, mesh, strict=False)
    ]
    tau = np.concatenate([*inner, [1.0]])
    corners = np.array(list(accumulate((s.nodes.size - 1 for _, s in mesh), initial=0)))
    tau[corners[:-1]] = ends[:-1]
    return tau, corners


def _joined(mesh: tuple[tuple[float, Scheme], ...]) -> Table:
    tau, corners = nodes_of(mesh)
    shares = np.array([share for share, _ in mesh], dtype=float) / sum(share for share, _ in mesh)
    weights = np.zeros(tau.size)
    edges = np.zeros((2, len(mesh)))
    entries: list[tuple[np.ndarray, ...]] = []
    schemes = [scheme for _, scheme in mesh]
    for scheme in dict.fromkeys(schemes):
        which = np.flatnonzero([each is scheme for each in schemes])
        size, first = shares[which, None] / 2.0, corners[which, None]
        here = first + np.arange(scheme.nodes.size)
        np.add.at(weights, here, size * scheme.weights)
        edges[:, which] = (size * scheme.weights[[0, -1]]).T
        row, column = ((first + place.ravel()).ravel() for place in np.indices(scheme.A.shape))
        a = np.tile(scheme.A.ravel(), which.size)
        entries.append((row, column, a, (size * scheme.B.ravel()).ravel()))
    rows, columns, a, b = (np.concatenate(part) for part in zip(*entries, strict=True))
    shape = int(corners[-1]), tau.size
    A, B = (Entries(shape, rows, columns, data).chosen(data != 0) for data in (a, b))
    return Table(tau, A, B, weights, corners, edges, mesh[0][1].side)


# the arcs of a word are solved on the same meshes again and again; those of large grids are not
_SMALL, _KEPT = 100, 64
_kept = lru_cache(maxsize=_KEPT)(_joined)


def _check(mesh: Mesh) -> None:
    if not mesh:
        raise MethodError("mesh: a phase needs at least one interval")
    for share, scheme in mesh:
        if not 0.0 < share < np.inf:
            raise MethodError(
                f"mesh: an interval has share {share} of its phase where a positive number is "
                "needed"
            )
        if scheme.side != mesh[0][1].side:
            raise MethodError(
                f"mesh: {mesh[0][1].name} and {scheme.name} collocate different ends; use one of "
                "them"
            )


# Of the points squared: a rate of decay times an interval's length. There collocation at n LGR
# points damps tenfold at n = 10, fivefold at n = 20; from 0.9 and 0.74 on what decays grows
_DAMPED = 0.5
_LOOKS = 4  # times in an arc at which its rates are looked at, of those between its ends
_GROWTH = (
    4  # no more than four times the intervals at once: an estimate from a poor mesh exaggerates
)
# Of the tolerance, aimed at by what is split: one more mesh costs more than some more intervals
_BEYOND = 0.01
_CROWD = 64  # intervals in one arc; what is not smooth by then is no arc


def tails(arc: Arc, values: np.ndarray) -> np.ndarray:
    """Return the last two Legendre coefficients of values (rows, n) at an arc's nodes, the largest
    of every interval (k,).
    """
    sizes = np.zeros(len(arc.mesh) - 1)
    for some, nodes in arc.alike():
        t, rows = arc.t[nodes], np.moveaxis(values[:, nodes], 0, -1)
        apart = np.array([not coincident(each) for each in t])
        t, rows = t[apart], rows[apart]
        last = legendre_coefficients(t, rows, (t[:, 0], t[:, -1]))[:, -2:]
        sizes[some[apart]] = np.abs(last).max(axis=(1, 2), initial=0.0)
    return sizes


def unresolved(problem: Problem, solution: Solution) -> list[np.ndarray]:
    """Return, an arc at a time, how much of an interval's motion its polynomials leave out (k,):
    their last two Legendre coefficients.

    Those of the states count relative to their magnitudes. Those of the running cost and of the
    laws of the controls count by what they add up to over the interval, as a share of the objective
    and of the box over the horizon: where a vehicle cruises its states are smooth, while the force
    that balances a hill and the work that it does are not.
    """
    scale, size = scales(problem, solution)[:, None], objective_size(problem, solution)
    width = np.diff(problem.box, axis=0).T
    horizon, p = solution.final_time - solution.initial_time, parameters_of(problem, solution)
    found = []
    for arc in solution.arcs:
        running = running_costs(problem, arc.x, arc.u, arc.t, p) * horizon / size
        share = np.diff(arc.t[arc.mesh]) / horizon
        rates = tails(arc, np.vstack([running, arc.u / width])) * share
        found.append(np.maximum(tails(arc, arc.x / scale), np.nan_to_num(rates)))
    return found


def damping(problem: Problem, solution: Solution, points: int) -> list[int]:
    """Return, an arc at a time, how many intervals of as many LGR points as given it takes so that
    what decays in the motion decays in its collocation, at most 64.

    The left end of an interval is collocated, not the right one: with a polynomial of degree n the
    amplification of x' = -a x is that of the Pade approximant of degrees n over n - 1 (Hairer,
    Wanner, Solving ODEs II, IV.3), which leaves the unit disc where a h is some n^2.
    """
    slopes, p, found = _slopes(problem), parameters_of(problem, solution), []
    for arc in solution.arcs:
        t = np.linspace(arc.t[0], arc.t[-1], _LOOKS + 2)[1:-1]
        (values,) = evaluate(slopes, arc.at(t), arc.at(t, "u"), t, p)
        each = values.reshape(-1, t.size, values.shape[0]).transpose(1, 0, 2)
        fastest = 0.0
        if np.isfinite(each).all():
            fastest = max(0.0, float(-np.linalg.eigvals(each).real.min()))
        count = math.ceil(fastest * float(arc.t[-1] - arc.t[0]) / (_DAMPED * points**2))
        found.append(min(max(count, 1), _CROWD))
    return found


@of_motion
@once
def _slopes(problem: Problem) -> casadi.Function:
    """Return the slopes (nx, nx) of the rate in the states as a function of x, u, t, p."""
    symbols = [problem.x, problem.u, time, problem.p]
    return casadi.Function(
        "slopes", symbols, [casadi.densify(casadi.jacobian(problem.rate, problem.x))]
    )


def refined_meshes(
    arcs: tuple[Arc, ...], left: list[np.ndarray], points: int, tolerance: float
) -> list[Mesh] | None:
    """Return meshes that split every interval into as many as the tolerance needs for what it
    leaves out, None where all have converged.
    """
    meshes: list[Mesh] = []
    grown = False
    for arc, tail in zip(arcs, left, strict=True):
        ends = arc.t[arc.mesh]
        shares = np.full(ends.size - 1, 1.0) if coincident(ends) else np.diff(ends)
        # the error of an interval falls with its length to the power of its degree
        parts = np.ceil(
            np.clip((tail / (_BEYOND * tolerance)) ** (1.0 / points), 1.0, _GROWTH)
        ).astype(int)
        wanted = np.where(tail > tolerance, parts, 1)
        if shares.size >= _CROWD:
            wanted[:] = 1
        grown |= bool((wanted > 1).any())
        meshes.append(
            [
                (float(share) / count, lgr(points))
                for share, count in zip(shares, wanted, strict=True)
                for _ in range(count)
            ]
        )
    return meshes if grown else None

"""The multipliers of a solution on its own mesh as unknowns, and Pontryagin's principle as linear
forms in them.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from scipy.sparse import coo_array, csr_array

from socp.model import (
    EXTREMAL,
    TINY,
    Problem,
    Solution,
    condition_function,
    condition_slopes,
    end_values,
    mayer_slopes,
    numbers,
    scales,
)
from socp.verdict.grading.pieces import NODES, Pieces

# of the range of a state constraint's values: what is further from being met is given no
# multiplier. A multiplier is paid for with that distance, so this only keeps programmes small
_NEAR = 0.05


@final
@dataclass(frozen=True, eq=False)
class Tie:
    """An end condition, or a bound of a final state: its value, and its slopes in x(tf), x(t0), p,
    t0 and tf. The multiplier of one that is `signed` must not be negative.
    """

    value: float
    slopes: list[np.ndarray]
    signed: bool


def ties(problem: Problem, values: list[np.ndarray]) -> list[Tie]:
    """Return what a problem asks of the ends, at values of x(tf), x(t0), p, t0 and tf."""
    found = []
    for each in problem.conditions:
        slopes = [s.ravel() for s in numbers(condition_slopes(problem, each), *values)]
        value = float(condition_function(problem, each)(*values))
        found.append(Tie(value, slopes, not each.equation))
    low, high = problem.end_box
    for i, x in enumerate(values[0]):
        fixed = low[i] == high[i]
        for sign, bound in ((1.0, high[i]), (-1.0, -np.inf if fixed else low[i])):
            if np.isfinite(bound):
                slopes = [np.zeros(np.size(each)) for each in values]
                slopes[0][i] = sign
                found.append(Tie(float(sign * (x - bound)), slopes, not fixed))
    return found


@final
@dataclass(frozen=True, eq=False)
class Form:
    """Linear functions of unknowns z: offset (m,) + matrix (m, unknowns) z."""

    offset: np.ndarray
    matrix: csr_array

    def at(self, z: np.ndarray) -> np.ndarray:
        """Return their values (m,)."""
        return np.array(self.offset + self.matrix @ z)


@final
@dataclass(frozen=True, eq=False)
class Free:
    """A number that the problem leaves free: an initial state, a time, a parameter.

    slope (1,): that of the objective in it; `down` and `up`: how far it may go, by its own size at
    most.
    """

    slope: Form
    down: float
    up: float

    def gain(self, z: np.ndarray) -> float:
        """Return what the objective would gain to first order where it went that far."""
        slope = float(self.slope.at(z)[0])
        return float(max(self.down * slope, -self.up * slope, 0.0))


def free(slope: Form, value: float, box: tuple[float, float], size: float) -> Free:
    """Return a free number within its interval, by its value and its size."""
    down, up = (max(min(each, size), 0.0) for each in (value - box[0], box[1] - value))
    return Free(slope, down, up)


@final
@dataclass(frozen=True, eq=False)
class Unknowns:
    """Multipliers of a solution: the costate at the end of every piece, one of each tie, a density
    of a state constraint on a piece, a jump at an end of one; in this order.
    """

    problem: Problem
    solution: Solution
    pieces: Pieces

    @cached_property
    def ends(self) -> list[np.ndarray]:
        """Values of x(tf), x(t0), p, t0, tf."""
        return end_values(self.problem, self.solution)

    @cached_property
    def ties(self) -> list[Tie]:
        """What the problem asks of the ends."""
        return ties(self.problem, self.ends)

    @cached_property
    def reached(self) -> np.ndarray:
        """Values (ties,) of what is asked of the ends, at the end that the control reaches."""
        x = np.array(self.solution.verified[0].end)
        return np.array([tie.value for tie in ties(self.problem, [x, *self.ends[1:]])])

    @cached_property
    def mayer(self) -> list[np.ndarray]:
        """Slopes of the Mayer term in x(tf), x(t0), p, t0, tf."""
        return [each.ravel() for each in numbers(mayer_slopes(self.problem), *self.ends)]

    @cached_property
    def scale(self) -> np.ndarray:
        """Magnitude of every state (nx,)."""
        return scales(self.problem, self.solution)

    @cached_property
    def joints(self) -> dict[str, np.ndarray]:
        """State constraints and their slopes at the ends of the pieces, (n + 1, nc, ..)."""
        v = self.pieces.values
        names = ("c", "cx", "ct", "cp")
        return {name: np.concatenate([v[name][:1, 0], v[name][:, -1]]) for name in names}

    @cached_property
    def active(self) -> tuple[np.ndarray, np.ndarray]:
        """Where a state constraint may have a multiplier: (2, k) pairs (piece, constraint) of the
        densities, and (end of a piece, constraint) of the jumps.
        """
        c = self.pieces.values["c"]
        near = -_NEAR * np.maximum(np.ptp(c, axis=(0, 1)), TINY) if c.size else np.empty(0)
        densities, jumps = c.max(axis=1) > near, self.joints["c"] > near
        return np.array(np.nonzero(densities)), np.array(np.nonzero(jumps))

    @cached_property
    def first(self) -> tuple[int, int, int, int]:
        """Columns at which ties, densities and jumps begin, and the number of unknowns."""
        counts = (self.pieces.count * self.scale.size, len(self.ties))
        begins = np.cumsum([*counts, *(each.shape[1] for each in self.active)])
        return int(begins[0]), int(begins[1]), int(begins[2]), int(begins[3])

    @cached_property
    def distance(self) -> np.ndarray:
        """How far (unknowns,) what every multiplier belongs to is from being met, ends by the
        returned or the re-integrated motion, and by `EXTREMAL` at least: where an end and a limit
        say the same, their multipliers must not grow against each other for nothing.
        """
        ends, density, jump, count = self.first
        values = np.array([tie.value for tie in self.ties])
        missed = np.maximum(np.abs(values), np.abs(self.reached))
        c = np.abs(self.pieces.values["c"][:, :NODES])
        along = np.einsum("kd,kdj->kj", self.pieces.weights, c)
        far = np.zeros(count)
        far[ends:density] = np.maximum(missed, EXTREMAL / self.unit[ends:density])
        far[density:jump] = along[tuple(self.active[0])]
        far[jump:] = np.abs(self.joints["c"])[tuple(self.active[1])]
        return far

    @cached_property
    def unit(self) -> np.ndarray:
        """Magnitude (unknowns,) of every unknown where the objective's is 1."""
        ends, density, jump, count = self.first
        unit = np.ones(count)
        unit[:ends] = np.tile(1.0 / self.scale, self.pieces.count)
        for k, tie in enumerate(self.ties):
            size = float(np.abs(tie.slopes[0]) @ self.scale + np.abs(tie.slopes[1]) @ self.scale)
            unit[ends + k] = 1.0 / size if size > 0 else 1.0
        steep = np.abs(np.einsum("kjx,x->kj", np.abs(self.joints["cx"]), self.scale)).max(axis=0)
        steep = np.where(steep > 0, steep, 1.0)
        unit[density:jump] = 1.0 / (steep[self.active[0][1]] * np.ptp(self.pieces.edges))
        unit[jump:] = 1.0 / steep[self.active[1][1]]
        return unit

    # -- linear forms

    def adjoint(self) -> Form:
        """Return what vanishes where the costates satisfy the adjoint equation (n nx,): costate at
        the end of a piece, less that at the start of the next one with the jump between them; at
        the last end, less what the ends give.
        """
        n, nx, maps = self.pieces.count, self.scale.size, self.pieces.maps[1:, 0]
        costate, density = np.zeros((n, nx, nx)), np.zeros((n, nx, maps.shape[-1] - nx - 1))
        costate[1:], density[1:] = -maps[:, :, :nx], -maps[:, :, nx + 1 :]
        rows = np.arange(n * nx).reshape(n, nx)
        matrix = self._along(costate, density, np.maximum(rows - nx, 0), n * nx)
        matrix += self._sparse(np.ones(n * nx), rows.ravel(), rows.ravel(), n * nx)
        for k, tie in enumerate(self.ties):
            column = np.full(nx, self.first[0] + k)
            matrix += self._sparse(-tie.slopes[0], rows[-1], column, n * nx)
        at, which = self.active[1]
        inner = np.flatnonzero(at > 0)
        columns = np.repeat(self.first[2] + inner, nx)
        slopes = self.joints["cx"][at[inner], which[inner]]
        matrix += self._sparse(-slopes.ravel(), rows[at[inner] - 1].ravel(), columns, n * nx)
        return Form(-np.append(maps[:, :, nx].ravel(), self.mayer[0]), matrix)

    def switching(self, looks: tuple[int, ...], pieces: np.ndarray) -> Form:
        """Return the switching functions at some nodes of some pieces, (pieces, looks, nu) in a
        row.
        """
        at, nx = np.ix_(pieces, np.array(looks)), self.scale.size
        lines = np.einsum("kdxu,kdxy->kduy", self.pieces.values["G"][at], self.pieces.maps[at])
        rows = np.arange(lines[..., 0].size).reshape(lines.shape[:-1])
        offset = self.pieces.values["L1"][at] + lines[..., nx]
        matrix = self._along(lines[..., :nx], lines[..., nx + 1 :], rows, rows.size, pieces)
        return Form(offset.ravel(), matrix)

    def tied(self) -> Iterator[Free]:
        """Yield the multipliers of equations at the ends, each with what they miss either way."""
        for k, tie in enumerate(self.ties):
            if not tie.signed:
                missed, one = self.distance[self.first[0] + k], np.eye(len(self.ties))[k]
                alone = self._row(one, np.zeros(self.active[1].shape[1]))
                yield Free(Form(np.zeros(1), alone), missed, missed)

    def free(self) -> Iterator[Free]:
        """Yield the numbers that the problem leaves free."""
        problem, pieces = self.problem, self.pieces
        ends = (problem.initial_time_box, problem.final_time_box)
        for k, (low, high) in enumerate(ends):
            if low < high:
                value = pieces.edges[-k]
                yield free(self._time(k), value, (low, high), np.ptp(pieces.edges))
        for i, value in enumerate(pieces.p):
            low, high = problem.parameter_box[:, i]
            size = max(abs(value), *(abs(b) for b in (low, high) if np.isfinite(b)), TINY)
            yield free(self._parameter(i), value, (low, high), size)
        for i, size in enumerate(self.scale):
            low, high = problem.start_box[:, i]
            if low < high:
                yield free(self._start(i), self.ends[1][i], (low, high), size)

    def _time(self, last: int) -> Form:
        """Return the slope of the objective in the initial (0) or final (1) time: the mean of H,
        and what explicit time adds, as the horizon is stretched with all that happens on it.
        """
        v, d, edges = self.pieces.values, NODES, self.pieces.edges
        share = (self.pieces.t[:, :d] - edges[0]) / np.ptp(edges)
        at_joints = (edges - edges[0]) / np.ptp(edges)
        sign = (1.0 if last else -1.0) / np.ptp(edges)
        share, at_joints = (share, at_joints) if last else (1.0 - share, 1.0 - at_joints)
        cost = sign * v["L"][:, :d] + share * v["Lt"][:, :d]
        rate = sign * v["f"][:, :d] + share[..., None] * v["ft"][:, :d]
        held = share[..., None] * v["ct"][:, :d]
        at, which = self.active[1]
        jumps = at_joints[at] * self.joints["ct"][at, which]
        return self._integral(cost, rate, held, (3 + last, 0, jumps))

    def _parameter(self, i: int) -> Form:
        v, d, (at, which) = self.pieces.values, NODES, self.active[1]
        slopes = (v["Lp"][:, :d, i], v["fp"][:, :d, :, i], v["cp"][:, :d, :, i])
        return self._integral(*slopes, (2, i, self.joints["cp"][at, which, i]))

    def _integral(
        self,
        cost: np.ndarray,
        rate: np.ndarray,
        held: np.ndarray,
        ends: tuple[int, int, np.ndarray],
    ) -> Form:
        """Return the integral of cost (n, d) + costate . rate (n, d, nx) + density . held
        (n, d, nc), with the slopes of the ends in symbol `ends[0]`, entry `ends[1]`, and those of
        the jumps.
        """
        w, nx, maps = self.pieces.weights, self.scale.size, self.pieces.maps[:, :NODES]
        symbol, entry, jumps = ends
        line = np.einsum("kd,kdx,kdxy->ky", w, rate, maps)
        offset = float((w * cost).sum() + line[:, nx].sum() + self.mayer[symbol][entry])
        density = line[:, nx + 1 :] + np.einsum("kd,kdj->kj", w, held)
        matrix = self._along(line[:, :nx], density, np.zeros(self.pieces.count, dtype=int), 1)
        tied = np.array([tie.slopes[symbol][entry] for tie in self.ties])
        return Form(np.array([offset]), matrix + self._row(tied, jumps))

    def _start(self, i: int) -> Form:
        """Return the slope of the objective in an initial state: its costate and what ends add."""
        nx, line, (at, which) = self.scale.size, self.pieces.maps[0, 0, i], self.active[1]
        lines = np.zeros((self.pieces.count, line.size))
        lines[0] = line
        rows = np.zeros(self.pieces.count, dtype=int)
        matrix = self._along(lines[:, :nx], lines[:, nx + 1 :], rows, 1)
        tied = np.array([tie.slopes[1][i] for tie in self.ties])
        jumps = np.where(at == 0, self.joints["cx"][at, which, i], 0.0)
        offset = np.array([line[nx] + self.mayer[1][i]])
        return Form(offset, matrix + self._row(tied, jumps))

    # -- matrices

    @cached_property
    def _columns(self) -> np.ndarray:
        """The column of every density (n, nc), -1 where it is none."""
        table = np.full((self.pieces.count, self.joints["c"].shape[1]), -1)
        table[tuple(self.active[0])] = self.first[1] + np.arange(self.active[0].shape[1])
        return table

    def _along(
        self,
        costate: np.ndarray,
        density: np.ndarray,
        rows: np.ndarray,
        m: int,
        pieces: np.ndarray | None = None,
    ) -> csr_array:
        """Return the matrix of forms in the costate at the end of a piece (n, .., nx) and in the
        densities on it (n, .., nc), whose rows are `rows` (n, ..); of all pieces, or of `pieces`.
        """
        some = np.arange(self.pieces.count) if pieces is None else pieces
        nx, deep = self.scale.size, [1] * (rows.ndim - 1)
        own = (some[:, None] * nx + np.arange(nx)).reshape(some.size, *deep, nx)
        held = self._columns[some].reshape(some.size, *deep, -1)
        matrix = csr_array((m, self.first[-1]))
        for each, columns in ((costate, own), (density, held)):
            row, column = np.broadcast_arrays(rows[..., None], columns)
            matrix = matrix + self._sparse(each.ravel(), row.ravel(), column.ravel(), m)
        return matrix

    def _row(self, tied: np.ndarray, jumps: np.ndarray) -> csr_array:
        """Return one row of coefficients of the ties and of the jumps."""
        ends, _, jump, _ = self.first
        columns = np.concatenate([ends + np.arange(tied.size), jump + np.arange(jumps.size)])
        return self._sparse(np.concatenate([tied, jumps]), np.zeros_like(columns), columns, 1)

    def _sparse(
        self, values: np.ndarray, rows: np.ndarray, columns: np.ndarray, m: int
    ) -> csr_array:
        kept = columns >= 0
        data = (values[kept], (rows[kept], columns[kept]))
        return coo_array(data, shape=(m, self.first[-1])).tocsr()

"""Where the variables of a collocated programme stand, and the terms that are made of them."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate
from typing import final

import casadi
import numpy as np

from socp.model import Expr
from socp.transcription.assembly import Point, Programme, Term
from socp.transcription.entries import Entries
from socp.transcription.knots import knot_times
from socp.transcription.mesh import Table
from socp.transcription.phases import PhasedProblem
from socp.transcription.scaling import Scale

# Of a phase: more than the rounding of its times, and nothing beside the error of a grid
_HAIR = 1e-10


@final
@dataclass(frozen=True, eq=False)
class Moments:
    """Times (K,): each the beginning of a phase `k` and a share `tau` of its length."""

    k: np.ndarray
    tau: np.ndarray


@final
@dataclass(frozen=True, eq=False)
class Grid:
    """The variables of a transcription by their places, each measured in its own magnitude.

    sizes (n,): the magnitudes; first: first node of every phase and the last node; lengths
    (phases,); p (np,); X (nx, nodes); V: free controls (nv, collocated) a phase; Y: carried
    quantities (ny, its nodes) a phase; Z: binaries (nz,) a phase, whose symbols are z. The initial
    time is the first variable.
    """

    phased: PhasedProblem
    tables: list[Table]
    scale: Scale
    sizes: np.ndarray
    first: list[int]
    lengths: np.ndarray
    p: np.ndarray
    X: np.ndarray
    V: list[np.ndarray]
    Y: list[np.ndarray]
    Z: list[np.ndarray]
    z: Expr

    @classmethod
    def of(cls, phased: PhasedProblem, tables: list[Table], scale: Scale) -> "Grid":
        """Lay out the variables: times, lengths, parameters, states, free controls, what is
        carried, binaries.
        """
        count, nx = len(tables), phased.of.x.numel()
        first = list(accumulate((t.tau.size - 1 for t in tables), initial=0))
        pairs = list(zip(phased.phases, tables, strict=True))
        shapes = [(1, 1), (count, 1), (phased.of.p.numel(), 1), (nx, first[-1] + 1)]
        shapes += [(f.free.numel(), t.collocated.size) for f, t in pairs]
        shapes += [(f.carried.numel(), t.tau.size) for f, t in pairs]
        shapes += [(f.z.numel(), 1) for f in phased.phases]
        sizes = [np.full(1, scale.time), np.full(count, scale.time), scale.p, scale.x]
        sizes += [scale.control(f) for f in phased.phases]
        sizes += [scale.costate[: f.carried.numel()] for f in phased.phases]
        sizes += [np.ones(f.z.numel()) for f in phased.phases]
        begin = list(accumulate((rows * columns for rows, columns in shapes), initial=0))
        places = [
            np.arange(at, at + rows * columns).reshape((rows, columns), order="F")
            for at, (rows, columns) in zip(begin, shapes, strict=False)
        ]
        _, lengths, p, X, *rest = places
        return cls(
            phased=phased,
            tables=tables,
            scale=scale,
            sizes=np.concatenate(
                [np.tile(size, shape[1]) for size, shape in zip(sizes, shapes, strict=True)]
            ),
            first=first,
            lengths=lengths[:, 0],
            p=p[:, 0],
            X=X,
            V=rest[:count],
            Y=rest[count : 2 * count],
            Z=[each[:, 0] for each in rest[2 * count :]],
            z=casadi.vertcat(casadi.SX(0, 1), *(phase.z for phase in phased.phases)),
        )

    @property
    def count(self) -> int:
        """Number of the variables."""
        return int(self.sizes.size)

    def times(self, k: int) -> Moments:
        """Return the times of all nodes of a phase.

        Where the problem has knots a free control's intervals end a hair before them: at a knot
        itself its functions are those of what follows.
        """
        tau = self.tables[k].tau.copy()
        if self.phased.phases[k].free.numel() and knot_times(self.phased.of):
            tau[self.tables[k].mesh[1:]] -= _HAIR
        return Moments(np.full(tau.size, k), tau)

    @property
    def end(self) -> Moments:
        """The final time."""
        return Moments(np.array([len(self.tables) - 1]), np.ones(1))


Given = np.ndarray | Moments  # places of variables (rows, K), the same everywhere (rows, 1); times


@final
@dataclass(frozen=True, eq=False)
class Terms:
    """Collects the terms of a programme on a grid, those of one point function together."""

    grid: Grid
    found: dict[Point, list[tuple[int, Entries, tuple[np.ndarray, ...], np.ndarray, np.ndarray]]]

    def add(
        self,
        point: Point,
        given: Sequence[Given],
        out: tuple[np.ndarray, np.ndarray, np.ndarray],
        cost: np.ndarray | None = None,
        constants: Sequence[float] = (),
    ) -> None:
        """Add a point function of given `constants` at as many points as are given: the values (ny
        K,), a point's next to one another, enter the rows by entries `out`, rows, places among the
        values and factors, and the objective by `cost` (ny K,).
        """
        sizes = [each.k.size if isinstance(each, Moments) else each.shape[1] for each in given]
        count = max(sizes) if all(sizes) else 0
        weights = np.zeros(point.y.numel() * count) if cost is None else cost
        if count and point.y.numel():
            known = self.found.setdefault(point, [])
            columns = np.repeat(np.reshape(constants, (-1, 1)), count, axis=1)
            known.append((count, self._linear(given, count), out, weights, columns))

    def _linear(self, given: Sequence[Given], count: int) -> Entries:
        """Return E (nw K, n): a point's arguments next to one another."""
        width = sum(1 if isinstance(each, Moments) else each.shape[0] for each in given)
        rows, columns, data, at = [], [], [], 0
        for each in given:
            if isinstance(each, Moments):
                row = width * np.arange(count) + at
                # the time of a point is the initial time, the lengths of the phases before, a share
                # of its own
                before = np.arange(self.grid.lengths.size)[None, :] < each.k[:, None]
                shares = before + np.zeros(before.shape)
                shares[np.arange(count), each.k] = each.tau
                point, phase = np.nonzero(shares)
                rows += [row, row[point]]
                columns += [np.zeros(count, dtype=int), self.grid.lengths[phase]]
                data += [np.ones(count), shares[point, phase]]
                at += 1
            else:
                places = each if each.shape[1] == count else np.repeat(each, count, axis=1)
                row = width * np.arange(count)[None, :] + at + np.arange(each.shape[0])[:, None]
                rows.append(row.ravel())
                columns.append(places.ravel())
                data.append(np.ones(places.size))
                at += each.shape[0]
        row, column, factor = (np.concatenate(each) for each in (rows, columns, data))
        shape = width * count, self.grid.count
        return Entries(shape, row, column, factor * self.grid.sizes[column])

    def programme(
        self, rows: int, linear: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]]
    ) -> Programme:
        """Return the programme of so many rows; `linear` are the entries, in the problem's units,
        of what enters them linearly.
        """
        shape = rows, self.grid.count
        A = Entries.joined(shape, [Entries(shape, *each) for each in linear])
        A = Entries(shape, A.rows, A.columns, A.values * self.grid.sizes[A.columns])
        terms = [
            Term.joined(
                [
                    Term(point, count, E, Entries((rows, cost.size), *out), cost, constants)
                    for count, E, out, cost, constants in parts
                ]
            )
            for point, parts in self.found.items()
        ]
        return Programme(A, terms)

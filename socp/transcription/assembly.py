"""Programmes as sums of point functions, and their derivatives put together from those of the
points.

Everything nonlinear in a collocated programme is a small function of what holds at one node, which
is linear in the variables, and enters rows and objective linearly: with w = E v the points'
arguments and y = F(w), point by point, g = A v + O F(E v). So the Jacobian is A + O F' E and
the Hessian of the Lagrangian E' (mu . F'') E with mu = O' lambda. E and O are numbers, and F' and
F'' cost what one point costs, whatever the mesh: no sparsity is looked for and no column coloured
(Betts, Practical Methods, 4.6.2; casadi's own way grows with a dense column such as a free final
time's).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, cached_property, partial
from itertools import compress
from typing import Any, final

import casadi
import numpy as np

from socp.model import Expr
from socp.solvers import Derivatives
from socp.transcription.entries import Entries, Lines, pattern_of


@final
@dataclass(frozen=True, eq=False)
class Point:
    """A function of what holds at one point, w (nw, 1) to y (ny, 1), with its derivatives; built
    once for every mesh that it is used on, and for all `constants` (nc, 1) in it.
    """

    w: Expr
    y: Expr
    constants: Expr = field(default_factory=partial(casadi.SX, 0, 1))

    @cached_property
    def value(self) -> casadi.Function:
        """Return (w, constants) -> y (ny, 1), dense."""
        return casadi.Function("y", [self.w, self.constants], [casadi.densify(self.y)])

    @cached_property
    def _at_many(self) -> dict[tuple[str, int], casadi.Function]:
        return {}

    def at(self, kind: str, count: int) -> casadi.Function:
        """Return its `value`, `slopes` or `curvature` at so many points."""
        known, key = self._at_many, (kind, count)
        if key not in known:
            known[key] = getattr(self, kind).map(count)
        return known[key]

    @cached_property
    def _slopes(self) -> Expr:
        return casadi.jacobian(self.y, self.w)

    @cached_property
    def pattern(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of what is not zero in the slopes of y."""
        return _pattern(self._slopes)

    @cached_property
    def fixed(self) -> np.ndarray:
        """The values (k,) of these where they are numbers, nan where they are none."""
        entries = self._slopes.nonzeros()
        return np.array([float(each) if each.is_constant() else np.nan for each in entries])

    @cached_property
    def slopes(self) -> casadi.Function:
        """Return (w, constants) -> what is not zero in the slopes of y."""
        return casadi.Function("slopes", [self.w, self.constants], [_entries(self._slopes)])

    @cached_property
    def _mu(self) -> Expr:
        return casadi.SX.sym("mu", self.y.numel())

    @cached_property
    def _curvature(self) -> Expr:
        return casadi.hessian(casadi.dot(self._mu, self.y), self.w)[0]

    @cached_property
    def curved(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of what is not zero in the Hessian of mu . y."""
        return _pattern(self._curvature)

    @cached_property
    def curvature(self) -> casadi.Function:
        """Return (w, constants, mu (ny, 1)) -> what is not zero in the Hessian of mu . y."""
        given = [self.w, self.constants, self._mu]
        return casadi.Function("curvature", given, [_entries(self._curvature)])


def _pattern(matrix: Expr) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = matrix.sparsity().get_triplet()
    return np.array(rows, dtype=int), np.array(columns, dtype=int)


def _entries(matrix: Expr) -> Expr:
    return matrix.nz[:]


@final
@dataclass(frozen=True, eq=False)
class Term:
    """A point function at K points: its arguments are E v (nw K,), a point's next to one
    another, and its values (ny K,) enter the rows by `out` (m, ny K) and the objective by `cost`
    (ny K,). Its `constants` are (nc, K).
    """

    point: Point
    count: int
    E: Entries
    out: Entries
    cost: np.ndarray
    constants: np.ndarray

    @classmethod
    def joined(cls, parts: Sequence["Term"]) -> "Term":
        """Return the term of all points at which the parts have one and the same point function."""
        point = parts[0].point
        before = np.cumsum([0, *(each.count for each in parts)])
        nw, ny = point.w.numel(), point.y.numel()
        count, (m, n) = int(before[-1]), (parts[0].out.shape[0], parts[0].E.shape[1])
        E = [each.E.moved(nw * at, 0) for each, at in zip(parts, before, strict=False)]
        out = [each.out.moved(0, ny * at) for each, at in zip(parts, before, strict=False)]
        return cls(
            point,
            count,
            Entries.joined((nw * count, n), E),
            Entries.joined((m, ny * count), out),
            np.concatenate([each.cost for each in parts]),
            np.hstack([each.constants for each in parts]),
        )

    def called(self, kind: str, w: Any, *more: Any) -> Any:
        """Return a function of its points, by its name, at their arguments, a column each."""
        return self.point.at(kind, self.count)(w, self._given, *more)

    @cached_property
    def _given(self) -> casadi.DM:
        shape, values = self.constants.shape, self.constants.T.ravel().tolist()
        return casadi.DM(casadi.Sparsity.dense(*shape), values) if values else casadi.DM(*shape)

    @cached_property
    def entering(self) -> Entries:
        """By what the values enter the rows and, as one more row, the objective."""
        (m, count), here = self.out.shape, np.flatnonzero(self.cost)
        cost = Entries((m + 1, count), np.full(here.size, m), here, self.cost[here])
        return Entries.joined(cost.shape, [self.out, cost])

    @cached_property
    def arguments(self) -> Lines:
        """The rows of E."""
        return self.E.by_rows()

    def products(self) -> tuple[np.ndarray, ...]:
        """Return the entries of O F' E, rows, columns and factors, and which entries of the
        slopes at the points they come with, O being what it is `entering` by.
        """
        rows, columns = self.point.pattern
        y, w = self._everywhere(rows, self.cost.size), self._everywhere(columns, self.E.shape[0])
        first, row, left = self.entering.by_columns().expanded(y)
        second, column, right = self.arguments.expanded(w[first])
        return row[second], column, left[second] * right, first[second]

    def sandwiched(self) -> tuple[np.ndarray, ...]:
        """Return the same of the upper triangle of E' (mu . F'') E."""
        rows, columns = self.point.curved
        first, row, left = self.arguments.expanded(self._everywhere(rows, self.E.shape[0]))
        at = self._everywhere(columns, self.E.shape[0])[first]
        second, column, right = self.arguments.expanded(at)
        row, left, place = row[second], left[second], first[second]
        upper = row <= column
        return row[upper], column[upper], (left * right)[upper], place[upper]

    def _everywhere(self, places: np.ndarray, count: int) -> np.ndarray:
        """Return places within a point as places within all `count`, a point's next to one
        another.
        """
        each = count // self.count
        return np.asarray((each * np.arange(self.count)[:, None] + places[None, :]).ravel())


@final
@dataclass(frozen=True, eq=False)
class Programme:
    """Rows and objective as the sum of terms and of what is linear: A (m, n)."""

    A: Entries
    terms: Sequence[Term]

    @cached_property
    def _ends(self) -> tuple[list[int], list[int]]:
        """Where the arguments and the values of every term begin among those of all, and the last
        end.
        """
        sizes = [(t.count * t.point.w.numel(), t.count * t.point.y.numel()) for t in self.terms]
        ends = np.cumsum([(0, 0), *sizes], axis=0)
        return ends[:, 0].tolist(), ends[:, 1].tolist()

    @cached_property
    def _given(self) -> casadi.DM:
        """All arguments as a matrix on the variables."""
        parts = [t.E.moved(at, 0) for t, at in zip(self.terms, self._ends[0], strict=False)]
        return Entries.joined((self._ends[0][-1], self.A.shape[1]), parts).matrix()

    @cached_property
    def _entering(self) -> casadi.DM:
        """Rows and, as one more, the objective as a matrix on the variables and all values."""
        (m, n), ends = self.A.shape, self._ends[1]
        parts = [t.entering.moved(0, n + at) for t, at in zip(self.terms, ends, strict=False)]
        return Entries.joined((m + 1, n + ends[-1]), [self.A, *parts]).matrix()

    def _apart(self, values: Any, which: int) -> list[Any]:
        """Return all arguments (0) or values (1) term by term, a column a point."""
        ends, kind = self._ends[which], type(values)
        return [
            kind(casadi.Sparsity.dense((end - at) // t.count, t.count), values[at:end])
            for t, at, end in zip(self.terms, ends, ends[1:], strict=False)
        ]

    def values(self, v: Any) -> tuple[Any, Any]:
        """Return objective (1, 1) and rows (m, 1) for variables v, as expressions of their kind."""
        return self._valued(v, self._apart(_times(self._given, v), 0))

    def _valued(self, v: Any, given: Sequence[Any]) -> tuple[Any, Any]:
        values = [t.called("value", w) for t, w in zip(self.terms, given, strict=True)]
        found, m = _times(self._entering, casadi.veccat(v, *values)), self.A.shape[0]
        costly = [t.cost.any() for t in self.terms]
        objective = found[m]
        if any(costly) and not all(costly):
            # a solver asks for it by itself at times: then nothing else is worked out
            cost = np.concatenate([t.cost for t in compress(self.terms, costly)])
            here = np.flatnonzero(cost)
            row = Entries((1, cost.size), 0 * here, here, cost[here]).matrix()
            objective = _times(row, casadi.veccat(*compress(values, costly)))
        # casadi makes a sparse one of what is always 0
        return casadi.densify(objective), casadi.densify(found[:m])

    @cached_property
    def derivatives(self) -> Derivatives:
        """Derivatives with respect to the variables, for a solver that takes them."""
        m, n = self.A.shape
        v, p = casadi.MX.sym("v", n), casadi.MX.sym("p", 0)
        lam_f, lam_g = casadi.MX.sym("lam_f"), casadi.MX.sym("lam_g", m)
        given = self._apart(_times(self._given, v), 0)
        f, g = self._valued(v, given)
        held = self._apart(_times(self._entering[:, n:].T, casadi.vertcat(lam_g, lam_f)), 1)
        gradient, slopes = _Sum.of((n, 1)), _Sum.of((m, n))
        curvature = _Sum.of((n, n))
        A, one = self.A, np.zeros(self.A.rows.size, dtype=int)
        slopes.parts.append((A.rows, A.columns, A.values, one))
        for term, w, mu in zip(self.terms, given, held, strict=True):
            J, (rows, columns, *rest) = cache(partial(term.called, "slopes", w)), term.products()
            cost, none = rows == m, np.zeros(rows.size, dtype=int)
            fixed = np.tile(term.point.fixed, term.count)
            gradient.add(J, [each[cost] for each in (columns, none, *rest)], fixed)
            slopes.add(J, [each[~cost] for each in (rows, columns, *rest)], fixed)
            if term.point.curved[0].size:
                curvature.add(partial(term.called, "curvature", w, mu), term.sandwiched())
        at, names, unread = [v, p], ["x", "p"], casadi.MX()
        steep, slope = gradient.column(), slopes.matrix()
        return Derivatives(
            nlp=casadi.Function("nlp", at, [f, g], names, ["f", "g"]),
            grad_f=casadi.Function("nlp_grad_f", at, [unread, steep], names, ["f", "grad_f_x"]),
            jac_g=casadi.Function("nlp_jac_g", at, [unread, slope], names, ["g", "jac_g_x"]),
            hess_lag=casadi.Function(
                "nlp_hess_l",
                [*at, lam_f, lam_g],
                [curvature.matrix()],
                [*names, "lam_f", "lam_g"],
                ["triu_hess_gamma_x_x"],
            ),
        )


@final
@dataclass(frozen=True, eq=False)
class _Sum:
    """What enters a sparse matrix of a shape, part after part: the rows, columns and factors of its
    entries, and the place of each entry's source among all sources, of which the first is 1.
    """

    shape: tuple[int, int]
    sources: list[casadi.MX]
    parts: list[tuple[np.ndarray, ...]]

    @classmethod
    def of(cls, shape: tuple[int, int]) -> "_Sum":
        """Return an empty one."""
        none = np.empty(0, dtype=int)
        return cls(shape, [casadi.MX(1)], [(none, none, np.empty(0), none)])

    def add(
        self,
        source: Callable[[], casadi.MX],
        entries: Sequence[np.ndarray],
        fixed: np.ndarray | None = None,
    ) -> None:
        """Add entries, rows, columns, factors and places of a source; what of it is `fixed` (k,) is
        a number there, and nan elsewhere. One of numbers alone is not called for.
        """
        if fixed is not None and not np.isnan(fixed).all():
            value = fixed[entries[3]]
            known = ~np.isnan(value)
            rows, columns, factors, places = (each[known] for each in entries)
            self.parts.append((rows, columns, factors * value[known], 0 * places))
            entries = [each[~known] for each in entries]
        rows, columns, factors, places = entries
        if rows.size:
            before = sum(each.numel() for each in self.sources)
            self.sources.append(source())
            self.parts.append((rows, columns, factors, places + before))

    def column(self) -> casadi.MX:
        """Return the matrix, of one column, dense."""
        rows, _, factors, places = self._whole
        return self._weighted(self.shape[0], rows, factors, places)

    def matrix(self) -> casadi.MX:
        """Return the matrix; entries of one place are added up."""
        rows, columns, factors, places = self._whole
        # column after column, as casadi keeps them
        where, entry = np.unique(columns * self.shape[0] + rows, return_inverse=True)
        ends = np.searchsorted(where, self.shape[0] * np.arange(self.shape[1] + 1))
        pattern = pattern_of(self.shape, ends, where % max(self.shape[0], 1))
        return casadi.MX(pattern, self._weighted(where.size, entry, factors, places))

    @property
    def _whole(self) -> tuple[np.ndarray, ...]:
        return tuple(np.concatenate(each) for each in zip(*self.parts, strict=True))

    def _weighted(
        self, count: int, entry: np.ndarray, factors: np.ndarray, places: np.ndarray
    ) -> casadi.MX:
        """Return a dense column of so many entries, to each of which factors times places of the
        sources are added.
        """
        if len(self.sources) == 1:  # of numbers alone
            return casadi.MX(casadi.DM(np.bincount(entry, factors, count).tolist()))
        given = casadi.veccat(*self.sources)
        return _times(Entries((count, given.numel()), entry, places, factors).matrix(), given)


def _times(matrix: casadi.DM, values: Any) -> Any:
    """Return a sparse matrix of numbers times a dense column, dense: no pattern is worked out."""
    kind = type(values)
    found = casadi.mac(kind(matrix), values, kind.zeros(matrix.size1(), 1))
    return found if found.is_dense() else casadi.densify(found)  # a number times none is none

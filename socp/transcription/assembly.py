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

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, final

import casadi
import numpy as np
from scipy import sparse

from socp.model import Expr
from socp.solvers import Derivatives


@final
@dataclass(frozen=True, eq=False)
class Point:
    """A function of what holds at one point, w (nw, 1) to y (ny, 1), with its derivatives; built
    once for every mesh that it is used on.
    """

    w: Expr
    y: Expr

    @cached_property
    def value(self) -> casadi.Function:
        """Return w -> y (ny, 1), dense."""
        return casadi.Function("y", [self.w], [casadi.densify(self.y)])

    @cached_property
    def _slopes(self) -> Expr:
        return casadi.jacobian(self.y, self.w)

    @cached_property
    def pattern(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of what is not zero in the slopes of y."""
        return _pattern(self._slopes)

    @cached_property
    def slopes(self) -> casadi.Function:
        """Return w -> y, and what is not zero in its slopes."""
        return casadi.Function("slopes", [self.w], [casadi.densify(self.y), _entries(self._slopes)])

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
        """Return (w, mu (ny, 1)) -> what is not zero in the Hessian of mu . y."""
        return casadi.Function("curvature", [self.w, self._mu], [_entries(self._curvature)])


def _pattern(matrix: Expr) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = matrix.sparsity().get_triplet()
    return np.array(rows, dtype=int), np.array(columns, dtype=int)


def _entries(matrix: Expr) -> Expr:
    return casadi.vertcat(casadi.SX(0, 1), *matrix.nonzeros())


@final
@dataclass(frozen=True, eq=False)
class Term:
    """A point function at K points: its arguments are E v (nw K,), a point's next to one
    another, and its values (ny K,) enter the rows by `out` (m, ny K) and the objective by `cost`
    (ny K,).
    """

    point: Point
    count: int
    E: sparse.csr_matrix
    out: sparse.csc_matrix
    cost: np.ndarray

    @cached_property
    def _given(self) -> casadi.DM:
        return _numbers(self.E.tocsc())

    @cached_property
    def entering(self) -> casadi.DM:
        """How values enter the rows: (m, ny K)."""
        return _numbers(self.out)

    @cached_property
    def costing(self) -> casadi.DM:
        """How values enter the objective: (1, ny K)."""
        return _numbers(sparse.csc_matrix(self.cost[None, :]))

    def arguments(self, v: Any) -> Any:
        """Return the arguments (nw, K) for variables v, as expressions of their kind."""
        return casadi.reshape(casadi.densify(casadi.mtimes(self._given, v)), -1, self.count)


@final
@dataclass(frozen=True, eq=False)
class Programme:
    """Rows and objective as the sum of terms and of what is linear: A (m, n)."""

    A: sparse.csr_matrix
    terms: Sequence[Term]

    @cached_property
    def _linear(self) -> casadi.DM:
        return _numbers(self.A.tocsc())

    def values(self, v: Any) -> tuple[Any, Any]:
        """Return objective (1, 1) and rows (m, 1) for variables v, as expressions of their kind."""
        kind = type(v)
        f, g = kind(0), casadi.mtimes(self._linear, v)
        for term in self.terms:
            y = casadi.vec(term.point.value.map(term.count)(term.arguments(v)))
            f, g = self._added(f, g, term, y)
        return f, g

    def _added(self, f: Any, g: Any, term: Term, y: Any) -> tuple[Any, Any]:
        if term.cost.any():
            f = f + casadi.mtimes(term.costing, y)
        if term.out.nnz:
            g = g + casadi.mtimes(term.entering, y)
        return f, g

    @cached_property
    def derivatives(self) -> Derivatives:
        """Derivatives with respect to the variables, for a solver that takes them."""
        m, n = self.A.shape
        v, p = casadi.MX.sym("v", n), casadi.MX.sym("p", 0)
        lam_f, lam_g = casadi.MX.sym("lam_f"), casadi.MX.sym("lam_g", m)
        f, g = casadi.MX(0), casadi.mtimes(self._linear, v)
        gradient, slopes = _Entries.of((1, n)), _Entries.of((m, n))
        slopes.fixed(self.A)
        curvature = _Entries.of((n, n))
        for term in self.terms:
            w = term.arguments(v)
            y, J = term.point.slopes.map(term.count)(w)
            f, g = self._added(f, g, term, casadi.vec(y))
            gradient.add(casadi.vec(J), *_products(term, sparse.csc_matrix(term.cost)))
            slopes.add(casadi.vec(J), *_products(term, term.out))
            mu = casadi.mtimes(term.entering.T, lam_g) + casadi.mtimes(term.costing.T, lam_f)
            if term.point.curved[0].size:
                mu = casadi.reshape(casadi.densify(mu), -1, term.count)
                H = term.point.curvature.map(term.count)(w, mu)
                curvature.add(casadi.vec(H), *_sandwiched(term))
        f, g = casadi.densify(f), casadi.densify(g)
        return Derivatives(
            nlp=casadi.Function("nlp", [v, p], list(self.values(v)), ["x", "p"], ["f", "g"]),
            grad_f=casadi.Function(
                "nlp_grad_f",
                [v, p],
                [f, casadi.densify(gradient.matrix()).T],
                ["x", "p"],
                ["f", "grad_f_x"],
            ),
            jac_g=casadi.Function(
                "nlp_jac_g", [v, p], [g, slopes.matrix()], ["x", "p"], ["g", "jac_g_x"]
            ),
            hess_lag=casadi.Function(
                "nlp_hess_l",
                [v, p, lam_f, lam_g],
                [curvature.matrix()],
                ["x", "p", "lam_f", "lam_g"],
                ["triu_hess_gamma_x_x"],
            ),
        )


@final
@dataclass(frozen=True, eq=False)
class _Entries:
    """What enters a sparse matrix of a shape, part after part: the rows, columns and factors of its
    entries, and the place of each entry's source among all sources.
    """

    shape: tuple[int, int]
    sources: list[casadi.MX]
    parts: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]]

    @classmethod
    def of(cls, shape: tuple[int, int]) -> "_Entries":
        """Return an empty one; its first source is 1."""
        return cls(shape, [casadi.MX(1)], [])

    def fixed(self, matrix: sparse.csr_matrix) -> None:
        """Add a matrix of numbers."""
        each = matrix.tocoo()
        self.parts.append((each.row, each.col, each.data, np.zeros(each.nnz, dtype=int)))

    def add(
        self,
        source: casadi.MX,
        rows: np.ndarray,
        columns: np.ndarray,
        factors: np.ndarray,
        places: np.ndarray,
    ) -> None:
        """Add factors times places of a source at rows and columns."""
        if rows.size:
            before = sum(each.numel() for each in self.sources)
            self.sources.append(source)
            self.parts.append((rows, columns, factors, places + before))

    def matrix(self) -> casadi.MX:
        """Return the matrix; entries of one place are added up."""
        if not self.parts:
            return casadi.MX(*self.shape)
        rows, columns, factors, places = (
            np.concatenate(each) for each in zip(*self.parts, strict=True)
        )
        # column after column, as casadi keeps them
        where, entry = np.unique(columns * self.shape[0] + rows, return_inverse=True)
        given = casadi.vertcat(*self.sources)
        weights = sparse.csc_matrix((factors, (entry, places)), (where.size, given.numel()))
        ends = np.searchsorted(where, self.shape[0] * np.arange(self.shape[1] + 1))
        pattern = casadi.Sparsity(*self.shape, ends.tolist(), (where % self.shape[0]).tolist())
        return casadi.MX(pattern, casadi.densify(casadi.mtimes(_numbers(weights), given)))


def _numbers(matrix: sparse.csc_matrix) -> casadi.DM:
    """Return a sparse matrix as casadi keeps it: its own conversion takes twenty times as long."""
    matrix.sort_indices()
    pattern = casadi.Sparsity(*matrix.shape, matrix.indptr.tolist(), matrix.indices.tolist())
    return casadi.DM(pattern, matrix.data.tolist())


def _products(
    term: Term, out: sparse.csc_matrix
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the entries of out F' E: every entry of F' comes with a column of `out` and a row of
    E.
    """
    rows, columns = term.point.pattern
    y, w = _everywhere(term, rows, term.out.shape[1]), _everywhere(term, columns, term.E.shape[0])
    first, row, left = _expanded(out, y)
    second, column, right = _expanded(term.E, w[first])
    return row[second], column, left[second] * right, first[second]


def _sandwiched(term: Term) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the entries of the upper triangle of E' (mu . F'') E."""
    rows, columns = term.point.curved
    count = term.E.shape[0]
    first, row, left = _expanded(term.E, _everywhere(term, rows, count))
    second, column, right = _expanded(term.E, _everywhere(term, columns, count)[first])
    row, left, place = row[second], left[second], first[second]
    upper = row <= column
    return row[upper], column[upper], (left * right)[upper], place[upper]


def _everywhere(term: Term, places: np.ndarray, count: int) -> np.ndarray:
    """Return places within a point as places within all `count`, a point's next to one another."""
    each = count // term.count
    return np.asarray((each * np.arange(term.count)[:, None] + places[None, :]).ravel())


def _expanded(matrix: Any, which: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return, for the rows of a CSR or the columns of a CSC matrix, all that stands in them: the
    place in `which` that it belongs to, its other index, and its value.
    """
    begin, size = matrix.indptr[which], np.diff(matrix.indptr)[which]
    place = np.repeat(np.arange(which.size), size)
    inside = np.arange(place.size) - np.repeat(np.cumsum(size) - size, size)
    at = np.repeat(begin, size) + inside
    return place, np.asarray(matrix.indices[at], dtype=np.int64), matrix.data[at]

"""Conserved quantities: polynomials of the states and the time that no motion changes."""

import casadi
import numpy as np

from socp.laws import probes
from socp.model import TINY, Expr, Problem, numbers, of_motion, once, time

# Monomials beyond which products of the states are left out: their number grows with the square of
# the states', the work with its cube
_MONOMIALS = 600
_SPREAD = 0.3  # of a symbol's size: how far points are scattered at least
_MORE = 1.5  # rows over unknowns: with as many chance would make some of them dependent
# Of the largest singular value, and of the terms of a derivative: what rounding leaves of zero
_ROUNDING = 1e-9


@of_motion
@once
def conserved(problem: Problem) -> tuple[Expr, ...]:
    """Return independent polynomials of degree two at most in x and t that are constant along every
    motion, whatever the controls are: the norm of a spin, a total population.

    They are the null vectors of the derivatives along f0 and the control fields at random states,
    every symbol at its own size; each is held against as many states again. Linear ones go first,
    and what is a function of those before it, such as the square of a total, is left out.
    """
    z = casadi.vertcat(problem.x, time)
    each = _MORE * _count(z.numel()) / (1 + problem.u.numel())  # a point gives a row a field
    size, points = _points(problem, 2 * int(each + 1))
    half = points.shape[1] // 2
    first, last = (
        _derivatives(problem, size, each) for each in (points[:, :half], points[:, half:])
    )
    if first.shape[0] < first.shape[1]:
        return ()
    n = size.size
    linear = _null(first[:, :n])
    linear = np.hstack([linear, np.zeros((linear.shape[0], first.shape[1] - n))])
    constant = [row for row in (*linear, *_null(first)) if _vanishes(last, row)]
    return tuple(_polynomial(z / size, row) for row in _independent(constant, n))


def _count(n: int) -> int:
    """Return the number of monomials in n symbols that are looked at."""
    full = n + n * (n + 1) // 2
    return full if full <= _MONOMIALS else n


def _points(problem: Problem, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the sizes (n,) of states and time, and points (n + np, count) of them and the
    parameters, scattered around where the problem lives.
    """
    nx, random = problem.x.numel(), np.random.default_rng(5)
    known = probes.admissible(problem)
    known = np.vstack([known[1 : 1 + nx], known[:1], known[1 + nx : 1 + nx + problem.p.numel()]])
    size = np.sqrt(np.mean(known**2, axis=1))
    size = np.where(size > 0, size, 1.0)
    spread = np.maximum(known.std(axis=1), _SPREAD * size)
    middle = known.mean(axis=1)[:, None]
    return size[: nx + 1], middle + spread[:, None] * random.standard_normal(
        (known.shape[0], count)
    )


def _derivatives(problem: Problem, size: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the derivatives (rows, monomials) of all monomials along the drift and every control
    field, at points where these are finite.
    """
    n = size.size
    moving = casadi.horzcat(problem.drift, problem.fields)
    clock = casadi.horzcat(casadi.SX.ones(1, 1), casadi.SX.zeros(1, problem.u.numel()))
    fields = casadi.Function(
        "fields", [problem.x, time, problem.p], [casadi.densify(casadi.vertcat(moving, clock))]
    )
    count = points.shape[1]
    (values,) = numbers(fields, points[: n - 1], points[n - 1 : n], points[n:])
    v = (values / size[:, None]).T  # (count fields, n), those of a point next to one another
    found = v
    if _count(n) > n:
        y = np.repeat(points[:n] / size[:, None], v.shape[0] // count, axis=1).T
        i, j = np.triu_indices(n)
        found = np.hstack([v, v[:, i] * y[:, j] + v[:, j] * y[:, i]])
    finite: np.ndarray = found[np.isfinite(found).all(axis=1)]
    return finite


def _null(rows: np.ndarray) -> np.ndarray:
    """Return a basis (k, n) of what vanishes on rows (m, n), each of them counted alike."""
    terms = np.abs(rows).max(axis=1, keepdims=True)
    _, s, vt = np.linalg.svd(rows / np.where(terms > 0, terms, 1.0), full_matrices=True)
    small = np.append(s, np.zeros(vt.shape[0] - s.size)) <= _ROUNDING * max(float(s[0]), TINY)
    return _echelon(vt[small])


def _independent(polynomials: list[np.ndarray], n: int) -> list[np.ndarray]:
    """Return the polynomials of n symbols whose slopes at a random point are independent of those
    before.
    """
    y, slopes = np.random.default_rng(7).standard_normal(n), np.empty((0, n))
    kept: list[np.ndarray] = []
    for row in polynomials:
        square = np.zeros((n, n))
        if row.size > n:
            square[np.triu_indices(n)] = row[n:]
        slope = row[:n] + (square + square.T) @ y
        more = np.vstack([slopes, slope / max(float(np.linalg.norm(slope)), TINY)])
        if np.linalg.svd(more, compute_uv=False)[-1] > _ROUNDING**0.5 and len(more) <= n:
            kept, slopes = [*kept, row], more
    return kept


def _echelon(null: np.ndarray) -> np.ndarray:
    """Return a basis (k, n) of the rows' span in reduced form: every row has a column of its own,
    so that quantities of separate parts of a problem come out one by one.
    """
    null = null.copy()
    for k in range(null.shape[0]):
        rest = np.abs(null[k:])
        i, j = divmod(int(np.argmax(rest)), rest.shape[1])
        null[[k, k + i]] = null[[k + i, k]]
        null[k] /= null[k, j]
        others = np.arange(null.shape[0]) != k
        null[others] -= null[others, j][:, None] * null[k]
    null[np.abs(null) < _ROUNDING] = 0.0
    return null


def _vanishes(rows: np.ndarray, polynomial: np.ndarray) -> bool:
    """Tell whether the derivative of a polynomial cancels in all rows but for rounding."""
    terms = np.abs(rows * polynomial)
    return bool((np.abs(rows @ polynomial) <= _ROUNDING * terms.sum(axis=1)).all())


def _polynomial(y: Expr, row: np.ndarray) -> Expr:
    n = y.numel()
    pairs = zip(*(each.tolist() for each in np.triu_indices(n)), strict=True)
    monomials = [*casadi.vertsplit(y), *(y[a] * y[b] for a, b in pairs)]
    return sum((c * m for c, m in zip(row.tolist(), monomials, strict=False) if c), casadi.SX(0))

"""Infinite order, proved: conditions whose span over the states is closed under differentiation
leave controls open.
"""

from collections.abc import Sequence

import casadi
import numpy as np

from socp.laws import probes
from socp.laws.brackets import extended_costate, hamiltonian_row, switching_row
from socp.laws.setting import Contact, Setting, homogeneous
from socp.model import TINY, Expr, column

_RANK = 1e-9  # of a row: what is left of it outside a span is round-off below


def spans(setting: Setting, touch: Contact, rows: Sequence[Expr], more: Sequence[Expr]) -> bool:
    """Tell whether every row of `more` is a combination of `rows`, at generic states, while these
    leave a costate.

    Then `more` vanish wherever `rows` do, and so do their derivatives: with x' the coefficients
    change, the span does not. A row that holds no costate is a condition on the states: it is kept,
    and spans nothing.
    """
    problem, n = setting.problem, setting.problem.x.numel()
    candidates = [row for row in more if casadi.sparsify(row).nnz()] or [casadi.SX(1, n + 1)]
    of_states = [row[n] for row in rows if not casadi.sparsify(row[:n]).nnz()]
    at = probes.onto(
        problem, column([*casadi.vertsplit(touch.held), *of_states]), probes.admissible(problem)
    )
    span = [row for row in rows if casadi.sparsify(row[:n]).nnz()] + setting.energy
    if not at.shape[1] or not span:
        return not any(casadi.sparsify(row).nnz() for row in more)
    fields = [hamiltonian_row(problem, casadi.SX.zeros(problem.u.numel(), 1))]
    fields += [switching_row(problem, i) for i in range(problem.u.numel())]
    held, wanted, moving, z = probes.evaluator(
        problem,
        *(casadi.vertcat(*each) for each in (span, candidates, fields)),
        extended_costate(problem),
    )(at)
    size = np.sqrt(np.mean(z[:, :, 0] ** 2, axis=0))
    known = [np.isfinite(each).all(axis=(1, 2)) for each in (held, wanted, moving)]
    a, b, c = (each[np.all(known, axis=0)] * size for each in (held, wanted, moving))
    return bool(len(a) and _spanned(a, b, c if homogeneous(problem) else None).all())


def _spanned(rows: np.ndarray, more: np.ndarray, fields: np.ndarray | None) -> np.ndarray:
    """Tell at every point (p,) whether `more` (p, k, n + 1) lie in the span of `rows` (p, m, n +
    1), and a z with rows z = 0 is a costate's.

    Its last entry must be one. Where its direction alone counts, `fields` (p, nu + 1, n + 1) are
    given, of which one must not vanish: where all do it is the gradient of a conserved quantity,
    which satisfies everything and says nothing.
    """
    basis = _basis(rows)
    last = np.eye(rows.shape[2])[None, -1:]
    possible = _left(last if fields is None else fields, basis).max(axis=1) > _RANK**0.5
    spanned: np.ndarray = possible & (_left(more, basis) <= _RANK).all(axis=1)
    return spanned


def _left(rows: np.ndarray, basis: np.ndarray) -> np.ndarray:
    """Return what share (p, k) of rows (p, k, n) lies outside the span of orthonormal ones (p, r,
    n).
    """
    outside = np.linalg.norm(rows - (rows @ basis.transpose(0, 2, 1)) @ basis, axis=2)
    length = np.linalg.norm(rows, axis=2)
    share: np.ndarray = outside / np.where(length > 0, length, 1.0)
    return share


def _basis(rows: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (p, r, n) of the span of rows (p, m, n), each counted at its own
    size, with zeros in place of the vectors that it needs not.
    """
    length = np.linalg.norm(rows, axis=2, keepdims=True)
    _, s, vt = np.linalg.svd(rows / np.where(length > 0, length, 1.0), full_matrices=False)
    basis: np.ndarray = vt * (s > _RANK * np.maximum(s[:, :1], TINY))[:, :, None]
    return basis

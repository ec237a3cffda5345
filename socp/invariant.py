"""Infinite order, proved: conditions whose span over the states is closed under differentiation leave controls open."""

from collections.abc import Sequence

import casadi
import numpy as np

from socp import points as sampled
from socp.brackets import extended
from socp.extremal import Contact, Setting, homogeneous
from socp.symbols import Expr, column

_RANK = 1e-9  # of a row: what is left of it outside a span is round-off below


def closed(setting: Setting, touch: Contact, rows: Sequence[Expr], more: Sequence[Expr]) -> bool:
    """Tell whether every row of `more` is a combination of `rows`, at generic states, while these leave a costate.

    Then `more` vanish wherever `rows` do, and so do their derivatives: with x' the coefficients change, the span does
    not. A row that holds no costate is a condition on the states: it is kept, and spans nothing.
    """
    problem, n = setting.problem, setting.problem.x.numel()
    candidates = [row for row in more if casadi.sparsify(row).nnz()]
    if not candidates:
        return True
    of_states = [row[n] for row in rows if not casadi.sparsify(row[:n]).nnz()]
    at = sampled.onto(problem, column([*casadi.vertsplit(touch.held), *of_states]), sampled.admissible(problem))
    span = [row for row in rows if casadi.sparsify(row[:n]).nnz()] + setting.energy
    if not at.shape[1] or not span:
        return False
    held, wanted, z = sampled.evaluator(
        problem, casadi.vertcat(*span), casadi.vertcat(*candidates), extended(problem)
    )(at)
    size = np.sqrt(np.mean(z[:, :, 0] ** 2, axis=0))
    verdicts = [
        _spanned(a * size, b * size, direction=homogeneous(problem))
        for a, b in zip(held, wanted, strict=True)
        if np.isfinite(a).all() and np.isfinite(b).all()
    ]
    return bool(verdicts) and all(verdicts)


def _spanned(rows: np.ndarray, more: np.ndarray, *, direction: bool) -> bool:
    """Tell whether `more` (k, n + 1) lie in the span of `rows` (m, n + 1), and a z with rows z = 0 is a costate's.

    Where its direction alone counts it must not be zero; otherwise its last entry must be one.
    """
    basis = _basis(rows)
    last = np.eye(rows.shape[1])[-1]
    if direction:
        possible = _basis(rows[:, :-1]).shape[0] < rows.shape[1] - 1
    else:
        possible = np.linalg.norm(last - basis.T @ (basis @ last)) > _RANK**0.5
    left = more - (more @ basis.T) @ basis
    return bool(possible and (np.linalg.norm(left, axis=1) <= _RANK * np.linalg.norm(more, axis=1)).all())


def _basis(rows: np.ndarray) -> np.ndarray:
    """Return an orthonormal basis (r, n) of the span of rows (m, n), each counted at its own size."""
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    _, s, vt = np.linalg.svd(rows / np.where(length > 0, length, 1.0), full_matrices=False)
    basis: np.ndarray = vt[s > _RANK * max(float(s[0]), 1e-300)]
    return basis

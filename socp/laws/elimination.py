"""Eliminate the costate from a singular control, where the conditions of the arc allow it."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import final

import casadi
import numpy as np

from socp.laws import probes
from socp.laws.algebra import cramer, determinant, ratio
from socp.laws.brackets import extended_costate
from socp.laws.setting import Setting, common_factor
from socp.laws.singular import Derivatives, matrix_of
from socp.model import Expr, column

# Singular values, relative to the largest, that count as zero; points lie on their surface to 1e-11
_RANK = 1e-7
_ALIKE = 1e-7  # relative difference of two values of one law
_MINORS = 7  # rows at most of a determinant by minors: one more takes as many times longer
_CHOICES = 400  # pivot columns tried at most; fewer than this for ten states and three conditions


Sizes = tuple[np.ndarray, np.ndarray]  # of rows (m,) and of z (n,)


@final
@dataclass(frozen=True, eq=False)
class Feedback:
    """Singular controls as feedback (k, 1) in x, t, p; `hamiltonian` tells whether the known value
    of H was needed.
    """

    control: Expr
    hamiltonian: bool


def with_costate(setting: Setting, chain: Derivatives) -> Expr:
    """Return the singular controls (k, 1) as functions of x, lambda, t, p."""
    z = extended_costate(setting.problem)
    numerators, denominator = cramer(
        matrix_of(chain.slopes, z), -column(casadi.mtimes(row, z) for row in chain.rest)
    )
    return column(ratio(numerators[k], denominator) for k in range(numerators.numel()))


def feedback(setting: Setting, chain: Derivatives) -> Feedback | None:
    """Return the singular controls without the costate, by the conditions alone or else with H, or
    None.

    None leaves the law with the costate, which exists wherever a chain does: so does what cannot be
    computed.
    """
    for extra in ([], setting.energy) if setting.energy else ([],):
        rows = casadi.vertcat(*chain.rows, *extra)
        sizes = _sizes(setting, rows)
        if _independent(setting, chain, rows, sizes):
            control = _eliminated(setting, chain, rows, sizes)
            if control is not None:
                return Feedback(control, bool(extra))
    return None


def surface(setting: Setting, chain: Derivatives) -> Expr:
    """Return equations (m, 1) in x, t, p alone that hold on the arc: elsewhere the conditions leave
    no costate.
    """
    rows = casadi.vertcat(*chain.rows, *setting.energy)
    picked, columns = _pivots(setting, chain.points, rows, _sizes(setting, rows))
    if not picked:
        return casadi.SX(0, 1)
    found = []
    for extra in (k for k in range(rows.shape[0]) if k not in picked):
        for free in (k for k in range(rows.shape[1]) if k not in columns):
            minor = determinant(rows[[*picked, extra], [*columns, free]])
            if (
                not minor.is_zero()
                and probes.nonzero(setting.problem, minor, probes.admissible(setting.problem)).any()
            ):
                found.append(minor)
                break
    return column(found)


def _independent(setting: Setting, chain: Derivatives, rows: Expr, sizes: Sizes) -> bool:
    """Tell whether the control is the same for all costates that satisfy the rows, of given sizes,
    at a point.
    """
    problem, k = setting.problem, len(chain.rest)
    entries = [row for line in chain.slopes for row in line] + chain.rest
    values = probes.evaluator(problem, rows, casadi.vertcat(*entries), extended_costate(problem))
    found = values(chain.points)
    finite = np.isfinite(found[0]).all(axis=(1, 2)) & np.isfinite(found[1]).all(axis=(1, 2))
    conditions, parts, z = (each[finite] for each in found)
    width, alike = np.ptp(problem.box[:, list(setting.singular)], axis=0), []
    for e, z0, other in zip(parts, z[:, :, 0], _others(conditions, *sizes), strict=True):
        laws = [_solved(e @ v, k) for v in (z0, other)]
        if np.isfinite(laws).all():
            alike.append(
                bool(
                    (np.abs(laws[0] - laws[1]) <= _ALIKE * (width + np.abs(laws).max(axis=0))).all()
                )
            )
    return bool(np.mean(alike) > 0.5) if alike else False


def _sizes(setting: Setting, rows: Expr) -> Sizes:
    """Return the sizes of rows (m,) and of z (n,) over the admissible points; on the arc some may
    vanish.
    """
    points = probes.admissible(setting.problem)
    matrix, z = probes.evaluator(setting.problem, rows, extended_costate(setting.problem))(points)
    of_z = np.sqrt(np.mean(z[:, :, 0] ** 2, axis=0))
    of_rows = np.nanmedian(np.linalg.norm(matrix * of_z, axis=2), axis=0)
    return np.where(of_rows > 0, of_rows, 1.0), of_z


def _solved(values: np.ndarray, k: int) -> np.ndarray:
    try:
        return np.linalg.solve(values[: k * k].reshape(k, k), -values[k * k :])
    except np.linalg.LinAlgError:
        return np.full(k, np.nan)


def _others(matrices: np.ndarray, of_rows: np.ndarray, of_z: np.ndarray) -> np.ndarray:
    """Return random vectors z (k, n) that matrices (k, m, n), their rows and z of given sizes, send
    to zero.
    """
    _, s, vt = np.linalg.svd(matrices * of_z / of_rows[:, None])
    rank = (s > _RANK * s[:, :1]).sum(axis=1)
    weights = np.random.default_rng(3).standard_normal(vt.shape[:2])
    weights[np.arange(vt.shape[1]) < rank[:, None]] = 0.0
    z: np.ndarray = np.einsum("kij,ki->kj", vt, weights) * of_z
    return z


def _pivots(
    setting: Setting, points: np.ndarray, rows: Expr, sizes: Sizes
) -> tuple[list[int], list[int]]:
    """Return rows, of given sizes, and as many columns whose determinant is farthest from zero at
    the points, earlier rows preferred.

    Both are empty where there are none, or so many that a determinant by minors would take too
    long.
    """
    of_rows, of_z = sizes
    matrix = probes.evaluator(setting.problem, rows)(points)[0] * of_z / of_rows[:, None]
    matrix = matrix[np.isfinite(matrix).all(axis=(1, 2))]
    if not matrix.size:
        return [], []
    picked: list[int] = []
    for k in range(rows.shape[0]):
        s = np.linalg.svd(matrix[:, [*picked, k], :], compute_uv=False)
        if np.median(s[:, -1]) > _RANK:
            picked.append(k)
    filled = [j for j in range(rows.shape[1]) if rows[picked, j].nnz()]
    if not picked or len(picked) > _MINORS:
        return [], []
    choices = [c for c, _ in zip(combinations(filled, len(picked)), range(_CHOICES), strict=False)]
    least = [
        np.quantile(np.abs(np.linalg.det(matrix[:, picked][:, :, list(c)])), 0.25) for c in choices
    ]
    return picked, list(choices[int(np.argmax(least))])


def _eliminated(setting: Setting, chain: Derivatives, rows: Expr, sizes: Sizes) -> Expr | None:
    """Put a costate that satisfies the rows into the law: any will do, so one without quotients."""
    picked, columns = _pivots(setting, chain.points, rows, sizes)
    if not picked:
        return None
    candidates = []
    for free in (k for k in range(rows.shape[1]) if k not in columns):
        z = _null_vector(rows[picked, :], columns, free)
        matrix = matrix_of(chain.slopes, z)
        if (
            matrix.nnz()
            and probes.nonzero(setting.problem, determinant(matrix), chain.points).all()
        ):
            numerators, denominator = cramer(
                matrix, -column(casadi.mtimes(row, z) for row in chain.rest)
            )
            candidates.append(
                column(ratio(numerators[k], denominator) for k in range(numerators.numel()))
            )
    return min(candidates, key=_length) if candidates else None


def _length(expression: Expr) -> int:
    return int(casadi.Function("n", casadi.symvar(expression), [expression]).n_instructions())


def _null_vector(rows: Expr, columns: Sequence[int], free: int) -> Expr:
    """Return a vector (n, 1) with rows z = 0, zero but in the pivot columns and one free column, as
    minors.
    """
    numerators, denominator = cramer(rows[:, list(columns)], -rows[:, free])
    z = casadi.SX(rows.shape[1], 1)
    z[list(columns)] = numerators
    z[free] = denominator
    return common_factor(z.T)[1].T if casadi.sparsify(z).nnz() > 1 else z

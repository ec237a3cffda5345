"""Eliminate the costate from a singular control, where the conditions of the arc allow it."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, islice
from typing import final

import casadi
import numpy as np

from socp.laws import probes
from socp.laws.algebra import cramer, determinant, ratio
from socp.laws.brackets import extended_costate
from socp.laws.setting import Contact, Setting, common_factor
from socp.laws.singular import Derivatives, matrix_of
from socp.model import Expr, column

# Singular values, relative to the largest, that count as zero; points lie on their surface to 1e-11
_RANK = 1e-7
_ALIKE = 1e-7  # relative difference of two values of one law
_MINORS = 7  # rows at most of a determinant by minors: one more takes as many times longer
_CHOICES = 400  # pivot columns tried at most; fewer than this for ten states and three conditions


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


@final
@dataclass(frozen=True, eq=False)
class _Sampled:
    """The conditions of an arc in numbers: rows (m, n) as an expression and at the arc's points (k,
    m, n), parts (k, s s + s, n) there, of the singular controls' slopes and rest, and z (k, n);
    sizes of rows (m,) and of z (n,) over the admissible points, as on the arc some may vanish.
    """

    rows: Expr
    conditions: np.ndarray
    parts: np.ndarray
    z: np.ndarray
    of_rows: np.ndarray
    of_z: np.ndarray

    @classmethod
    def of(cls, setting: Setting, chain: Derivatives, extra: Sequence[Expr]) -> "_Sampled":
        """Evaluate the rows of a chain, and `extra` ones, at all points at once."""
        rows = casadi.vertcat(*chain.rows, *extra)
        parts = casadi.vertcat(*(row for line in chain.slopes for row in line), *chain.rest)
        values = probes.evaluator(setting.problem, rows, parts, extended_costate(setting.problem))
        points = probes.admissible(setting.problem)
        found = values(np.hstack([points, chain.points]))
        count = points.shape[1]
        of_z = np.sqrt(np.mean(found[2][:count, :, 0] ** 2, axis=0))
        lengths = np.linalg.norm(found[0][:count] * of_z, axis=2)
        lengths = lengths[np.isfinite(lengths).all(axis=1)]
        of_rows = np.median(lengths, axis=0) if lengths.size else np.zeros(rows.shape[0])
        conditions, parts, z = (each[count:] for each in found)
        of_rows = np.where(of_rows > 0, of_rows, 1.0)
        return cls(rows, conditions, parts, z[:, :, 0], of_rows, of_z)


def feedback(setting: Setting, chain: Derivatives) -> Feedback | None:
    """Return the singular controls without the costate, by the conditions alone or else with H, or
    None.

    None leaves the law with the costate, which exists wherever a chain does: so does what cannot be
    computed.
    """
    for extra in ([], setting.energy) if setting.energy else ([],):
        sampled = _Sampled.of(setting, chain, extra)
        if _independent(setting, sampled):
            control = _eliminated(setting, chain, sampled)
            if control is not None:
                return Feedback(control, bool(extra))
    return None


def serves(setting: Setting, touch: Contact, chain: Derivatives, known: Feedback) -> bool:
    """Tell whether a feedback that was derived with constant controls left open holds on an arc
    that gives them values: it holds none of them, and at the arc's points it is the control that
    the costates there give.
    """
    problem = setting.problem
    both = zip(casadi.vertsplit(problem.u), touch.control.elements(), strict=True)
    if casadi.depends_on(known.control, column(u for u, value in both if value.is_constant())):
        return False
    z = extended_costate(problem)
    parts = casadi.vertcat(*(row for line in chain.slopes for row in line), *chain.rest)
    laws, values = probes.evaluator(problem, known.control, casadi.mtimes(parts, z))(chain.points)
    return _same(setting, _solved(values), laws[:, :, 0])


def surface(setting: Setting, chain: Derivatives) -> Expr:
    """Return equations (m, 1) in x, t, p alone that hold on the arc: elsewhere the conditions leave
    no costate.
    """
    sampled = _Sampled.of(setting, chain, setting.energy)
    rows, (picked, columns) = sampled.rows, _pivots(sampled)
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


def _independent(setting: Setting, sampled: _Sampled) -> bool:
    """Tell whether the control is the same for all costates that satisfy the rows at a point."""
    finite = np.isfinite(sampled.conditions).all(axis=(1, 2))
    finite &= np.isfinite(sampled.parts).all(axis=(1, 2))
    parts, conditions = sampled.parts[finite], sampled.conditions[finite]
    other = _others(conditions, sampled.of_rows, sampled.of_z)
    own, laws = (_solved(parts @ z[:, :, None]) for z in (sampled.z[finite], other))
    return _same(setting, own, laws)


def _same(setting: Setting, own: np.ndarray, laws: np.ndarray) -> bool:
    """Tell whether two values (n, s) of the singular controls are one at most points where both are
    numbers.
    """
    known = np.isfinite(own).all(axis=1) & np.isfinite(laws).all(axis=1)
    own, laws = own[known], laws[known]
    width = np.ptp(setting.problem.box[:, list(setting.singular)], axis=0)
    size = width + np.maximum(np.abs(own), np.abs(laws))
    alike = (np.abs(own - laws) <= _ALIKE * size).all(axis=1)
    return bool(alike.size and alike.mean() > 0.5)


def _solved(values: np.ndarray) -> np.ndarray:
    """Return the controls (n, s) that slopes and rest (n, s s + s, 1) give, nan where they give
    none.
    """
    s = int((values.shape[1] + 0.25) ** 0.5)  # s s + s is a little less than (s + 1/2) squared
    matrix, right = values[:, : s * s, 0].reshape(-1, s, s), -values[:, s * s :]
    some = np.linalg.det(matrix) != 0
    found = np.full(right.shape[:2], np.nan)
    found[some] = np.linalg.solve(matrix[some], right[some])[:, :, 0]
    return found


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


def _pivots(sampled: _Sampled) -> tuple[list[int], list[int]]:
    """Return rows and as many columns whose determinant is farthest from zero at the arc's points,
    earlier rows preferred.

    Both are empty where there are none, or so many that a determinant by minors would take too
    long.
    """
    rows, matrix = sampled.rows, sampled.conditions * sampled.of_z / sampled.of_rows[:, None]
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
    choices = np.array([*islice(combinations(filled, len(picked)), _CHOICES)])
    minors = matrix[:, picked][:, :, choices].transpose(0, 2, 1, 3)
    least = np.quantile(np.abs(np.linalg.det(minors)), 0.25, axis=0)
    return picked, choices[int(np.argmax(least))].tolist()


def _eliminated(setting: Setting, chain: Derivatives, sampled: _Sampled) -> Expr | None:
    """Put a costate that satisfies the rows into the law: any will do, so one without quotients."""
    rows, (picked, columns) = sampled.rows, _pivots(sampled)
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

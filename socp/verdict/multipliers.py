"""The multipliers that satisfy Pontryagin's principle best along a solution, by least squares and
linear programmes.
"""

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, final

import casadi
import numpy as np

from socp.model import EXTREMAL, ROUNDED, TINY, Condition, Finding, lately
from socp.verdict import margins
from socp.verdict.adjoint import AdjointSystem
from socp.verdict.claims import running_magnitude
from socp.verdict.conditions import Rows
from socp.verdict.newton import inverse
from socp.verdict.nodes import POINTS

_EXACT = (
    0.1 * EXTREMAL
)  # what a row may be broken beyond the programme's own figure: the solver is good to 1e-7
# Of the largest singular value: multipliers told by less are those of rows that say the same
_DEPENDENT = 1e-12
_SETTINGS = {"error_on_fail": False, "print_time": False, "highs": {"output_flag": False}}


@final
@dataclass(frozen=True, eq=False)
class Case:
    """A solution laid out for judging, with all conditions in the unknown multipliers."""

    along: AdjointSystem
    rows: tuple[Rows, ...]

    def magnitude(self, z: np.ndarray) -> float:
        """Return the Hamiltonian's magnitude: the largest sum of its terms' absolute values along
        the solution.

        Not less than the cost's own: multipliers that all vanish satisfy everything, and must not
        be measured by themselves.
        """
        return lately(self, Case.magnitude, (z.tobytes(),), partial(self._magnitude, z))

    def _magnitude(self, z: np.ndarray) -> float:
        v = self.along.samples.values
        terms = np.abs(v["L"]) + np.abs(self.along.costates.at(z) * v["f"]).sum(axis=0)
        return max(float(terms.max()), self.cost, TINY)

    @cached_property
    def cost(self) -> float:
        """Magnitude of the cost in units of the Hamiltonian: running, for the time, and for the
        states at the ends.

        A running cost that stays at zero, but for rounding, is measured by what it changes by when
        every state changes by its own magnitude.
        """
        along, ends = self.along, self.along.ends
        states = float((np.abs(ends.slope_final) + np.abs(ends.slope_initial)) @ along.scale)
        running = float(np.abs(along.samples.values["L"]).max())
        changed = float(running_magnitude(along).max())
        running = running if running > ROUNDED * changed else changed
        return max(running, abs(ends.slope_tf), abs(ends.slope_t0), states / along.horizon)

    def findings(self, z: np.ndarray) -> tuple[Finding, ...]:
        """Return the worst residual of every condition at multipliers z."""
        return lately(self, Case.findings, (z.tobytes(),), partial(self._findings, z))

    def _findings(self, z: np.ndarray) -> tuple[Finding, ...]:
        size = self.magnitude(z)
        found: dict[Condition, Finding] = {}
        for rows in self.rows:
            if not rows.t.size:
                continue
            residuals = rows.residuals(z) / size
            k = int(np.argmax(residuals))
            finding = Finding(
                kind=rows.kind,
                residual=float(residuals[k]),
                place=rows.where[k],
                t=float(rows.t[k]),
                wants=rows.wants(k, z),
            )
            if rows.kind not in found or finding.residual > found[rows.kind].residual:
                found[rows.kind] = finding
        return tuple(found.values())


def multipliers(case: Case) -> tuple[np.ndarray, float | None]:
    """Return the multipliers z that satisfy the principle best, and the proved distance where
    programmes were needed.

    Where none are within tolerance, z has the least sum of residuals: it breaks few conditions, and
    so tells which.
    """
    z = _least_squares(case)
    if _worst(case, z) <= EXTREMAL:
        return _strict(case, z), None
    size = case.magnitude(z)
    if not z.size:  # free ends: the costate is known, and so is how far it fails
        return z, _worst(case, z)
    best, distance = _programme(case, size, z, worst=True)
    if distance is None or _worst(case, best) <= EXTREMAL:
        return _strict(case, best), distance
    return _programme(case, size, z, worst=False)[0], distance


def _worst(case: Case, z: np.ndarray) -> float:
    return max((finding.residual for finding in case.findings(z)), default=0.0)


def _least_squares(case: Case) -> np.ndarray:
    """Return the multipliers of least squares; ArithmeticError names what is not finite."""
    rows = [r for r in case.rows if r.equation and r.decisive]
    matrix, offset = np.vstack([r.matrix for r in rows]), np.concatenate([r.offset for r in rows])
    finite = np.isfinite(matrix).all(axis=1) & np.isfinite(offset)
    if not finite.all():
        lost = int(np.argmin(finite))
        ends = np.cumsum([each.t.size for each in rows])
        kind = rows[int(np.searchsorted(ends, lost, side="right"))].kind
        t = float(np.concatenate([each.t for each in rows])[lost])
        raise ArithmeticError(f"{kind.value}: its terms are not finite at t = {t:.6g}")
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0] = 1.0
    # the singular values of the triangle alone, and only where they are needed: several times as
    # fast as those of all rows
    basis, triangle = np.linalg.qr(matrix / size)
    given = -(basis.T @ offset)
    back = inverse(triangle, _DEPENDENT) if len(triangle) == size.size else None
    found = np.linalg.lstsq(triangle, given, rcond=_DEPENDENT)[0] if back is None else back @ given
    return np.array(found / size)


def _programme(
    case: Case, size: float, start: np.ndarray, *, worst: bool
) -> tuple[np.ndarray, float | None]:
    """Minimise the worst residual, or the sum of residuals, by a linear programme.

    Returns (z, least value), or (start, None) if the programme fails; the least worst residual is
    in the magnitude that belongs to its own multipliers, as their findings are, so that the two
    agree.

    Not all signs enter at once: those that the multipliers found break more than what they leave at
    worst are added, and the programme is solved again, until they break none.
    """
    scale = np.maximum(np.abs(start), 1e-3 * max(float(np.abs(start).max()), TINY))
    kept = [_thinned(rows) for rows in case.rows]
    while True:
        found = _solved(case, (size, scale), kept, worst=worst)
        if found is None:
            return start, None
        z, value = found
        allowed = size * (value if worst else 0.0) + _EXACT * size
        broken = [np.flatnonzero(rows.residuals(z) > allowed) for rows in case.rows]
        grown = [np.union1d(keep, more) for keep, more in zip(kept, broken, strict=True)]
        if all(new.size == old.size for new, old in zip(grown, kept, strict=True)):
            return z, value * size / case.magnitude(z)
        kept = grown


def _solved(
    case: Case, units: tuple[float, np.ndarray], kept: list[np.ndarray], *, worst: bool
) -> tuple[np.ndarray, float] | None:
    """Solve the programme of the rows that are kept, in units of the Hamiltonian and of z (nz,);
    None if that fails.

    In the sum the rows that fix the multipliers' scale count for all others together: breaking
    those alone explains nothing.
    """
    (size, scale), pairs = units, list(zip(case.rows, kept, strict=True))
    matrix = np.vstack([rows.matrix[keep] for rows, keep in pairs]) * scale / size
    offset = np.concatenate([rows.offset[keep] for rows, keep in pairs]) / size
    equation = np.concatenate([np.full(keep.size, rows.equation) for rows, keep in pairs])
    count, nz = matrix.shape
    # (z, excess): offset + matrix z is no more than the excess, and no less than -excess where it
    # is an equation
    excess = casadi.DM.ones(count, 1) if worst else casadi.DM.eye(count)
    both = np.append(np.arange(count), np.flatnonzero(equation))
    sides = np.append(np.ones(count), -np.ones(both.size - count))
    signed = casadi.horzcat(casadi.DM(sides[:, None] * matrix[both]), -excess[both.tolist(), :])
    weight = np.concatenate([_weight(rows, keep.size, count) for rows, keep in pairs])
    cost = np.append(np.zeros(nz), np.ones(1) if worst else weight)
    low = np.append(np.full(nz, -np.inf), np.zeros(cost.size - nz))
    box = np.vstack([low, np.full(cost.size, np.inf)])
    limits = np.vstack([np.full(both.size, -np.inf), -sides * offset[both]])
    found = _linear_programme(cost, signed, limits, box)
    return None if found is None else (found[:nz] * scale, float(cost @ found))


def _linear_programme(
    cost: np.ndarray, matrix: Any, rows: np.ndarray, box: np.ndarray
) -> np.ndarray | None:
    """Return v (n,) of least cost (n,) @ v with rows[0] <= matrix @ v <= rows[1], (2, m), and
    box[0] <= v <= box[1], (2, n); None where HiGHS finds none.

    HiGHS through casadi, which is here anyway: to import scipy's optimisers takes as long as to
    solve a problem.

    `matrix` (m, n) is what casadi keeps, sparse where it is.
    """
    given, n = casadi.DM(matrix), cost.size
    if not given.is_regular():  # HiGHS would report success
        return None
    shapes = {"a": given.sparsity(), "h": casadi.Sparsity(n, n)}
    try:
        solver = casadi.conic("linear", "highs", shapes, _SETTINGS)
        found = solver(g=cost, a=given, lba=rows[0], uba=rows[1], lbx=box[0], ubx=box[1])
    except RuntimeError:
        return None
    return np.array(found["x"]).ravel() if solver.stats()["success"] else None


def _strict(case: Case, z: np.ndarray) -> np.ndarray:
    """Return multipliers as good as z that give every bang stretch its sign, where z gives some
    none and others do.

    They are not unique where the ends leave no choice, and the first that serve may be those that
    vanish.
    """
    along, size = case.along, case.magnitude(z)
    signs = margins.signs(along.problem, along.solution, along.samples)
    offset, matrix = (np.einsum("bkn,kn...->b...", signs, each) / size for each in along.sigma)
    if not z.size or not offset.size or (offset + matrix @ z).min() > EXTREMAL:
        return z
    rows = [each for each in case.rows if each.t.size]
    equations = [each for each in rows if each.equation]
    left = np.vstack(
        [
            -matrix,
            *(each.matrix / size for each in rows),
            *(-each.matrix / size for each in equations),
        ]
    )
    right = np.concatenate(
        [offset, *(0.5 * EXTREMAL - each.offset / size for each in rows)]
        + [0.5 * EXTREMAL + each.offset / size for each in equations]
    )
    margin = np.zeros(right.size)
    margin[: offset.size] = 1.0
    found = _linear_programme(
        np.append(np.zeros(z.size), -1.0),
        np.column_stack([left, margin]),
        np.vstack([np.full(right.size, -np.inf), right]),
        np.array([np.full(z.size + 1, -np.inf), np.append(np.full(z.size, np.inf), 1.0)]),
    )
    better = found is not None and found[-1] > EXTREMAL and _worst(case, found[:-1]) <= EXTREMAL
    return found[:-1] if better and found is not None else z


def _weight(rows: Rows, kept: int, every: int) -> np.ndarray:
    """Return the weights of rows in a sum: a condition at a point counts 1, one along an interval 1
    over its nodes.
    """
    if rows.kind.of_free_time:
        return np.full(kept, float(every))
    return np.full(kept, 1.0 if rows.pointwise else (1.0 if rows.equation else 3.0) / (POINTS + 1))


def _thinned(rows: Rows) -> np.ndarray:
    """Return the rows that a programme begins with: all equations, signs at three nodes of every
    interval.
    """
    n = rows.t.size
    thin = not rows.equation and n > 10 * (POINTS + 1)
    return (
        np.flatnonzero(np.isin(np.arange(n) % (POINTS + 1), (0, POINTS // 2, POINTS)))
        if thin
        else np.arange(n)
    )

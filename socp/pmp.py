"""The judge says whether a solution is an extremal of Pontryagin's principle, and how far it is from one.

It takes a problem and a solution, nothing else. Along the given states and controls every condition is affine in the
multipliers, so the question whether any multipliers satisfy them all is a convex programme. Least squares over the
equations usually finds them; where the result fails, a linear programme finds the multipliers of least worst
residual, or proves by that residual that there are none within tolerance.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from scipy.linalg import lstsq

from socp import claims, margins
from socp.adjoint import POINTS, Samples, condense, sample
from socp.along import Along
from socp.conditions import SCALE, Rows, conditions
from socp.ends import Ends, unknowns_of
from socp.problem import Problem
from socp.solution import Arc, Solution
from socp.verdict import EXTREMAL, Finding, Verdict


@final
@dataclass(frozen=True, eq=False)
class Case:
    """A solution laid out for judging, with all conditions in the unknown multipliers."""

    along: Along
    rows: tuple[Rows, ...]

    def magnitude(self, z: np.ndarray) -> float:
        """Return the Hamiltonian's magnitude: the largest sum of its terms' absolute values along the solution."""
        v = self.along.samples.values
        terms = np.abs(v["L"]) + np.abs(self.along.costates.at(z) * v["f"]).sum(axis=0)
        return max(float(terms.max()), abs(self.along.ends.slope_tf), 1e-300)

    def findings(self, z: np.ndarray) -> tuple[Finding, ...]:
        """Return the worst residual of every condition at multipliers z."""
        size = self.magnitude(z)
        found: dict[str, Finding] = {}
        for rows in self.rows:
            if not rows.t.size:
                continue
            residuals = rows.residuals(z) / size
            k = int(np.argmax(residuals))
            finding = Finding(
                condition=rows.name, residual=float(residuals[k]), where=rows.where[k], t=float(rows.t[k])
            )
            if rows.name not in found or finding.residual > found[rows.name].residual:
                found[rows.name] = finding
        return tuple(found.values())


def multipliers(case: Case) -> tuple[np.ndarray, float | None]:
    """Return the multipliers z that satisfy the principle best, and the proved distance where programmes were needed.

    Where none are within tolerance, z has the least sum of residuals: it breaks few conditions, and so tells which.
    """
    z = _least_squares(case)
    if _worst(case, z) <= EXTREMAL:
        return z, None
    size = case.magnitude(z)
    if not z.size:  # free ends: the costate is known, and so is how far it fails
        return z, _worst(case, z)
    best, distance = _programme(case, size, z, worst=True)
    if distance is None or _worst(case, best) <= EXTREMAL:
        return best, distance
    return _programme(case, size, z, worst=False)[0], distance


def _worst(case: Case, z: np.ndarray) -> float:
    return max((finding.residual for finding in case.findings(z)), default=0.0)


def _least_squares(case: Case) -> np.ndarray:
    rows = [r for r in case.rows if r.equation and r.decisive]
    matrix, offset = np.vstack([r.matrix for r in rows]), np.concatenate([r.offset for r in rows])
    size = np.linalg.norm(matrix, axis=0)
    size[size == 0] = 1.0
    # pivoted QR: several times as fast as the singular values, and as good at telling the rank
    return np.array(lstsq(matrix / size, -offset, cond=1e-12, lapack_driver="gelsy")[0] / size)


def _programme(case: Case, size: float, start: np.ndarray, *, worst: bool) -> tuple[np.ndarray, float | None]:
    """Minimise the worst residual, or the sum of residuals, by a linear programme.

    Returns (z, least value), or (start, None) if the programme fails.

    In the sum the rows that fix the multipliers' scale count for all others together: breaking those alone explains
    nothing.
    """
    import cvxpy

    scale = np.maximum(np.abs(start), 1e-3 * max(float(np.abs(start).max()), 1e-300))
    kept = [(rows, _thinned(rows)) for rows in case.rows]
    matrix = np.vstack([rows.matrix[keep] for rows, keep in kept]) * scale / size
    offset = np.concatenate([rows.offset[keep] for rows, keep in kept]) / size
    equation = np.concatenate([np.full(keep.size, rows.equation) for rows, keep in kept])
    z = cvxpy.Variable(start.size)
    excess = cvxpy.Variable(nonneg=True) if worst else cvxpy.Variable(offset.size, nonneg=True)
    value = offset + matrix @ z
    constraints = [value <= excess, -value[equation] <= (excess if worst else excess[equation])]
    weight = np.concatenate([_weight(rows, keep.size, offset.size) for rows, keep in kept])
    programme = cvxpy.Problem(cvxpy.Minimize(excess if worst else weight @ excess), constraints)
    try:
        programme.solve(solver=cvxpy.HIGHS)
    except cvxpy.error.SolverError:
        return start, None
    if z.value is None:
        return start, None
    return np.asarray(z.value) * scale, float(programme.value)


def _weight(rows: Rows, kept: int, every: int) -> np.ndarray:
    """Return the weights of rows in a sum: a condition at a point counts 1, one along an interval 1 over its nodes."""
    if rows.name.startswith(SCALE):
        return np.full(kept, float(every))
    return np.full(kept, 1.0 if rows.pointwise else (1.0 if rows.equation else 3.0) / (POINTS + 1))


def _thinned(rows: Rows) -> np.ndarray:
    """Return the rows of a programme: all equations, signs at the first, middle and last node of every interval."""
    n = rows.t.size
    thin = not rows.equation and n > 10 * (POINTS + 1)
    return np.flatnonzero(np.isin(np.arange(n) % (POINTS + 1), (0, POINTS // 2, POINTS))) if thin else np.arange(n)


def case(problem: Problem, solution: Solution) -> Case:
    """Lay out a solution for judging: choose the unknowns, condense the adjoint, write down every condition."""
    samples = sample(problem, solution)
    ends = Ends.of(problem, solution, samples)
    unknowns = unknowns_of(problem, samples, ends)
    along = Along(problem, solution, samples, unknowns, condense(samples, unknowns, ends.slope_final), ends)
    return Case(along, tuple(conditions(along)))


# -- the verdict


def certify(problem: Problem, solution: Solution) -> tuple[Verdict, tuple[Arc, ...]]:
    """Judge a solution; returns the verdict and the arcs with the principle's own costates and multipliers.

    `solution` needs its structure and its verification (`socp.chain.judge` fills both in).
    """
    laid = case(problem, solution)
    along, samples = laid.along, laid.along.samples
    z, distance = multipliers(laid)
    costate, size = along.costates.at(z), laid.magnitude(z)
    offset, matrix = along.sigma
    switching = offset + matrix @ z
    density = np.einsum("ncz,z->cn", along.costates.mu, z)
    slack = np.abs(density * samples.values["c"])
    findings = _worst_of(
        (
            *laid.findings(z),
            *claims.claims(along, density, size),
            *_complementary(along, slack, z, size),
            *_without_length(solution),
        )
    )
    certain = all(finding.holds for finding in findings)
    # where all holds, the gain would measure the judge
    gain = slack.sum(axis=0) + (0.0 if certain else _gain(problem, samples, switching))
    error = margins.objective_error(problem, solution, samples, costate, gain)
    clebsch, unknown = margins.legendre_clebsch(problem, solution, samples, costate)
    verdict = Verdict(
        miss=max((f.worst for f in solution.verified), default=float("inf")),
        findings=findings,
        distance=distance,
        normality=max(float(np.abs(samples.values["L"]).max()), abs(along.ends.slope_tf)) / size,
        legendre_clebsch=clebsch,
        notes=tuple(unknown),
        margins=margins.strictness(problem, solution, samples, switching, size),
        ringing=margins.ringing(problem, solution),
        objective_error=error,
        switch_errors=margins.switch_errors(problem, solution, samples, switching),
        digits=_digits(error, solution.objective) if certain else 0,
    )
    return verdict, _with_multipliers(along, z)


def _worst_of(findings: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """Keep the worst finding of every condition."""
    worst: dict[str, Finding] = {}
    for each in findings:
        if each.condition not in worst or each.residual > worst[each.condition].residual:
            worst[each.condition] = each
    return tuple(worst.values())


def _complementary(along: Along, slack: np.ndarray, z: np.ndarray, size: float) -> Iterator[Finding]:
    """Yield multipliers of what is not quite active: slack (nc, n) is density times distance, jumps count likewise."""
    samples, title = along.samples, "multipliers only where a constraint is met"
    for j, constraint in enumerate(along.problem.constraints):
        k = int(np.argmax(slack[j]))
        yield Finding(
            condition=title, residual=float(slack[j, k]) / size, where=constraint.name, t=float(samples.t[k])
        )
    for jump, (j, joint) in enumerate(along.unknowns.jumps):
        off = abs(float(z[along.unknowns.jump_column(jump)] * samples.values["c"][j, joint * samples.width - 1]))
        where, t = along.problem.constraints[j].name, float(samples.edges[joint])
        yield Finding(condition=title, residual=off / along.horizon / size, where=where, t=t)


def _gain(problem: Problem, samples: Samples, switching: np.ndarray) -> np.ndarray:
    """Return the Hamiltonian (n,) that the best admissible controls would gain at every node."""
    low, high = problem.box
    gap = np.maximum(switching * (samples.u - low[:, None]), switching * (samples.u - high[:, None]))
    return np.array(gap.sum(axis=0))


def _digits(error: float, objective: float) -> int:
    relative = error / max(abs(objective), 1e-300)
    return int(np.clip(np.floor(-np.log10(max(relative, 1e-13))), 0, 13)) if np.isfinite(relative) else 0


def _without_length(solution: Solution) -> tuple[Finding, ...]:
    """Find the arcs of a word that have no length: the word has too many."""
    shortest = 1e-9 * (solution.final_time - solution.initial_time)  # rounding of a length, some digits to spare
    return tuple(
        Finding(
            condition="arc without length, drop it from the word", residual=1.0, where=f"arc {k}", t=float(arc.t[0])
        )
        for k, arc in enumerate(solution.arcs, start=1)
        if arc.t[-1] - arc.t[0] <= shortest
    )


def _with_multipliers(along: Along, z: np.ndarray) -> tuple[Arc, ...]:
    """Return the arcs, those that follow laws with the costates and densities of z in place of their programme's.

    Along a law the nonlinear programme's multipliers are not the principle's: they take the law for part of the
    dynamics.
    """
    costate = along.costates.at(z)
    density = np.einsum("ncz,z->cn", along.costates.mu, z)
    names = [constraint.name for constraint in along.problem.constraints]
    arcs = []
    for index, arc in enumerate(along.solution.arcs):
        if "*" in arc.modes:
            arcs.append(arc)
            continue
        own = dict(zip(names, margins.on_arc(along.samples, index, arc, density), strict=True))
        arcs.append(replace(arc, costate=margins.on_arc(along.samples, index, arc, costate), multipliers=own))
    return tuple(arcs)

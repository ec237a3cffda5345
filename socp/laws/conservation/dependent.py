"""End conditions that depend on one another, because motions conserve what they ask for.

Of a unit quaternion whose four end values are given, one follows from the others: to ask for it
once more makes equations dependent, and inconsistent for a scheme that does not conserve the norm.
Where one end value alone says all, as the pole of a sphere does, the others follow: a problem
without them has no multipliers there, since its end condition touches what motions can reach.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, final

import casadi
import numpy as np

from socp.laws import probes
from socp.laws.conservation.quantities import conserved
from socp.laws.drawing import guessed_ends, horizon
from socp.model import (
    FEASIBLE,
    Expr,
    Problem,
    column,
    end_symbols,
    hand_on,
    numbers,
    once,
    shown_sizes,
    time,
)

_PASSES = 80  # Gauss-Newton steps; at a touching point each halves the distance
_STRAY = 0.3  # of sizes: how far free ends are moved first, off points that are special
_RANK = 1e-6  # of unit rows: what Gauss-Newton leaves of a dependence at a touching point
_EXACT = 1e-9  # of sizes: an implied value as near to zero is zero
_IMPLIED = 2  # times that implied values may imply others


@once
def completed(problem: Problem) -> Problem:
    """Return the problem with the end values that its end conditions imply by what motions
    conserve; itself where there are none.

    Its motions are the same. At the pole of a sphere on which the states move, z = -1 implies x = y
    = 0, and only with these is there a multiplier for every direction in which the end is held.
    """
    for _ in range(_IMPLIED):
        found = _implied(problem)
        if not found:
            break
        problem = _with_ends(problem, found)
    return problem


@once
def independent(problem: Problem) -> Problem:
    """Return the problem without end values that follow from others by what motions conserve;
    itself where there are none.

    What is implied is asked for in their place (see `completed`). A value that a linear conserved
    quantity determines is left free. One that is determined up to a sign, by a quadratic one, is
    kept to the half of its size nearest to it: its motions are the same, while a scheme that
    conserves the quantity badly still has a solution.
    """
    problem = completed(problem)
    ways = _Ends.of(problem)
    if ways is None:
        return problem
    loose = _redundant(ways)
    if not loose:
        return problem
    return _with_ends(problem, loose)


def _with_ends(problem: Problem, ends: Mapping[Expr, Any]) -> Problem:
    """Return a problem with other end values, and with all that is worked out of its motion."""
    found = replace(problem, end={**problem.end, **ends})
    hand_on(problem, found)
    return found


@final
@dataclass(frozen=True, eq=False)
class _Ends:
    """What holds at the ends of a problem, at a point that satisfies it.

    w (n, 1): the symbols of the ends, each over its size (n,); at (n,): the point; held (m, 1): the
    equations that the problem states, the first `fixed` of them fixed final states, by number;
    kept (k, 1): conserved quantities at the end less those at the start.
    """

    problem: Problem
    w: Expr
    at: np.ndarray
    held: Expr
    fixed: tuple[int, ...]
    kept: Expr
    size: np.ndarray

    @classmethod
    def of(cls, problem: Problem) -> "_Ends | None":
        """Lay out the ends of a problem; None where nothing is conserved or no end is held."""
        fixed = np.flatnonzero(problem.end_box[0] == problem.end_box[1]).tolist()
        equations = [c.expression for c in problem.conditions if c.equation]
        quantities = conserved(problem) if fixed or equations else ()
        if not quantities:
            return None
        xf, x0, p, t0, tf = end_symbols(problem)
        start, last = guessed_ends(problem)
        first = problem.initial_time_box[0] if np.isfinite(problem.initial_time_box[0]) else 0.0
        times = np.array([first, first + horizon(problem)])
        given = np.concatenate([last, start, np.clip(0.0, *problem.parameter_box), times])
        known = np.array(
            [probes.spread(problem)[1 : 1 + last.size], shown_sizes(problem, last[:, None])]
        )
        size = np.concatenate([known.max(axis=0)] * 2 + [np.ones(p.numel()), [np.ptp(times)] * 2])
        held = [xf[i] - last[i] for i in fixed] + equations
        held += [x0[i] - v for i, v in _fixed(problem.start_box)]
        held += [t0 - v for _, v in _fixed(_column(problem.initial_time_box))]
        held += [tf - v for _, v in _fixed(_column(problem.final_time_box))]
        kept = [
            casadi.substitute(q, casadi.vertcat(problem.x, time), casadi.vertcat(xf, tf))
            - casadi.substitute(q, casadi.vertcat(problem.x, time), casadi.vertcat(x0, t0))
            for q in quantities
        ]
        w = casadi.SX.sym("w", size.size)
        symbols = casadi.vertcat(xf, x0, p, t0, tf)
        held_, kept_ = casadi.substitute([column(held), column(kept)], [symbols], [w * size])
        free = np.random.default_rng(6).standard_normal(size.size)
        fixed_at = {*fixed, *(last.size + i for i, _ in _fixed(problem.start_box))}
        free[list(fixed_at)] = 0.0
        at = given / size + _STRAY * free
        held_, kept_ = (_measured(each, w, at) for each in (held_, kept_))
        return _met(cls(problem, w, at, held_, tuple(fixed), kept_, size))

    @property
    def all(self) -> Expr:
        """What is kept, then what is held, as one column (k + m, 1)."""
        return casadi.vertcat(self.kept, self.held)

    def slopes(self) -> np.ndarray:
        """Return the slopes (k + m, n) of what is kept and held."""
        function = casadi.Function("s", [self.w], [casadi.jacobian(self.all, self.w)])
        return numbers(function, self.at)[0]

    def dependences(self) -> np.ndarray:
        """Return factors (r, k + m) of the equations with which their slopes cancel, a conserved
        quantity among them.
        """
        rows, k = self.slopes(), self.kept.numel()
        u, s, _ = np.linalg.svd(rows, full_matrices=True)
        left = u[:, np.append(s, np.zeros(u.shape[0] - s.size)) <= _RANK * max(s[0], 1.0)].T
        some: np.ndarray = left[np.abs(left[:, :k]).max(axis=1, initial=0.0) > _RANK**0.5]
        return some


def _fixed(box: np.ndarray) -> list[tuple[int, float]]:
    return [(int(i), float(box[0, i])) for i in np.flatnonzero(box[0] == box[1])]


def _measured(equations: Expr, w: Expr, at: np.ndarray) -> Expr:
    """Return equations (m, 1), each over the length of its slope at a point."""
    (slopes,) = numbers(casadi.Function("s", [w], [casadi.jacobian(equations, w)]), at)
    length = np.linalg.norm(slopes, axis=1)
    return equations / casadi.DM(np.where((length > 0) & np.isfinite(length), length, 1.0))


def _column(interval: tuple[float, float]) -> np.ndarray:
    return np.array([interval]).T


def _met(ways: _Ends) -> _Ends | None:
    """Return the ends at a point where all equations hold, by Gauss-Newton; None where none is
    found.
    """
    function = casadi.Function("e", [ways.w], [ways.all, casadi.jacobian(ways.all, ways.w)])
    at = ways.at.copy()
    for _ in range(_PASSES):
        value, slope = numbers(function, at)
        if not (np.isfinite(value).all() and np.isfinite(slope).all()):
            return None
        at = at - np.linalg.pinv(slope, rcond=1e-12) @ value[:, 0]
    if not np.abs(numbers(function, at)[0]).max() <= FEASIBLE:
        return None
    return replace(ways, at=at)


def _curvature(ways: _Ends, factors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return slope (n,) and curvature (n, n) of the combination of equations with such factors."""
    sum_ = casadi.dot(casadi.DM(factors), ways.all)
    hessian, gradient = casadi.hessian(sum_, ways.w)
    function = casadi.Function("h", [ways.w], [gradient, hessian])
    slope, curvature = numbers(function, ways.at)
    return slope.ravel(), curvature


def _implied(problem: Problem) -> dict[Expr, float]:
    """Return the final states that follow, with their values.

    Where slopes cancel with factors c, c . equations has no slope at the end, and vanishes in the
    directions that the equations leave free only where its curvature does. Where that is definite
    in some of them, these directions are closed.
    """
    ways = _Ends.of(problem)
    if ways is None:
        return {}
    slopes, nx = ways.slopes(), problem.x.numel()
    _, s, vt = np.linalg.svd(slopes, full_matrices=True)
    free = vt[np.append(s, np.zeros(vt.shape[0] - s.size)) <= _RANK].T
    total, first = np.zeros((free.shape[1],) * 2), np.zeros(free.shape[1])
    for factors in ways.dependences():
        gradient, hessian = _curvature(ways, factors)
        inside = free.T @ hessian @ free
        values = np.linalg.eigvalsh(inside) if inside.size else np.zeros(1)
        if values.min() < -_RANK and values.max() > _RANK:
            continue
        sign = 1.0 if values.max() > _RANK else -1.0
        total, first = total + sign * inside, first + sign * free.T @ gradient
    values, vectors = np.linalg.eigh(total)
    closed = free @ vectors[:, values > _RANK]
    if not closed.size:
        return {}
    at = ways.at - free @ np.linalg.pinv(total, rcond=_RANK) @ first
    share = (closed**2).sum(axis=1)  # 1 for a symbol all of whose directions are closed
    found = [i for i in range(nx) if share[i] > 1.0 - _RANK and i not in ways.fixed]
    exact = np.where(np.abs(at) <= _EXACT, 0.0, at) * ways.size
    return {problem.x[i]: float(exact[i]) for i in found}


def _redundant(ways: _Ends) -> dict[Expr, tuple[float | None, float | None]]:
    """Return the final states whose values follow from what else holds, with intervals that tell
    them from the other values that would do.
    """
    k, count = ways.kept.numel(), len(ways.fixed)
    dependences = ways.dependences()
    among = dependences[:, k : k + count]
    if not among.size or np.abs(among).max() <= _RANK**0.5:
        return {}
    from scipy.linalg import qr  # where there are such

    _, triangle, order = qr(among, mode="economic", pivoting=True)
    rank = int((np.abs(np.diag(triangle)) > _RANK**0.5 * abs(triangle[0, 0])).sum())
    found: dict[Expr, tuple[float | None, float | None]] = {}
    for j in order[:rank].tolist():
        i = ways.fixed[j]
        factors = dependences[np.argmax(np.abs(among[:, j]))]
        quantity = casadi.dot(casadi.DM(factors[:k]), ways.kept)
        second, first = casadi.hessian(quantity, ways.w[i])
        slope, curve = casadi.Function("c", [ways.w], [first, second])(ways.at)
        apart = abs(2.0 * float(slope) / float(curve)) if float(curve) else np.inf
        value, half = ways.problem.end_box[0, i], apart * ways.size[i] / 2.0
        sides = np.clip([value - half, value + half], *ways.problem.state_box[:, [i]])
        low, high = (float(side) if np.isfinite(side) else None for side in sides)
        found[ways.problem.x[i]] = low, high
    return found

"""Estimates of what a solution leaves open: the errors of its objective and of its switching
times.
"""

import itertools
import math
from collections.abc import Sequence
from functools import cache

import numpy as np

from socp.model import Problem, Solution, differentiation, lagrange
from socp.transcription import lgr
from socp.verdict import claims
from socp.verdict.adjoint import AdjointSystem
from socp.verdict.nodes import POINTS, Samples

_SCHEME = lgr(POINTS)
# Each time also moves with the others, and by more than the residual shows: a digit in hand
_SAFETY = 10.0
# Times what misses are worth to first order: the second is less than the first for misses that
# count
_SECOND = 2.0
# Of the Hamiltonian's magnitude: a switching function that small along an interval is nothing but
# noise
_NOISE = 1e-9
_ROUNDED = 1e-15  # of the same: what rounding leaves of a switching function at its zero
# Of the largest term of sigma over an interval: what counts as its slope, not as a residual
_LEADS = 1e-2
_LOOKS = np.logspace(
    -16.0, 0.0, 65
)  # shares of an interval at which sigma is looked at beside a switch, four a decade


def objective_error(
    solution: Solution, samples: Samples, costate: np.ndarray, gain: np.ndarray
) -> float:
    """Estimate the error of the objective, in its own units, by the dual-weighted residual.

    The sum of four: costate (nx, n) times the defect f - x' of the returned states, arc by arc
    (within one the errors of collocation cancel), and times the miss of the re-integrated end; the
    difference between the returned objective and its own quadrature; and the Hamiltonian `gain`
    (n,) that better controls would have over the horizon.
    """
    v, half = samples.values, 0.5 * np.diff(samples.edges)
    shape = (-1, samples.intervals, samples.width)
    x, f, costates = (
        each.reshape(shape)[:, :, :each_width]
        for each, each_width in ((samples.x, None), (v["f"], -1), (costate, -1))
    )
    slope = np.einsum("dj,ikj->ikd", _SCHEME.A, x) / half[:, None]
    weights = half[:, None] * _SCHEME.weights[:-1]
    per_interval = (weights * (costates * (f - slope)).sum(axis=0)).sum(axis=1)
    first = np.flatnonzero(np.diff(samples.arc[:: samples.width], prepend=-1))
    defect = float(np.abs(np.add.reduceat(per_interval, first)).sum())
    missed = integral(samples, gain)
    ends = [np.array(seen.end) for seen in solution.verified if seen.end]
    end = max(
        (float(np.abs(costate[:, -1] @ (x - solution.arcs[-1].x[:, -1]))) for x in ends),
        default=0.0,
    )
    return defect + end + abs(claims.cost(samples, solution)[0] - solution.objective) + missed


def integral(samples: Samples, values: np.ndarray) -> float:
    """Return the integral over the horizon of values (n,) at the judge's nodes."""
    weights = 0.5 * np.diff(samples.edges)[:, None] * _SCHEME.weights[:-1]
    return float((weights * values.reshape(samples.intervals, samples.width)[:, :-1]).sum())


def worth_of_misses(
    along: AdjointSystem, z: np.ndarray, sigma: np.ndarray, density: np.ndarray
) -> float:
    """Return what the conditions that a solution misses are worth: every miss times its multiplier,
    and as much again.

    Those are the ends of states and times, end conditions, state constraints along the way as
    re-integration finds them, and the box of the controls. sigma (nu, n), density (nc, n).
    """
    problem, solution, samples, ends = along.problem, along.solution, along.samples, along.ends
    count = ends.signs.size
    equations = ends.signs == 0
    worth = float(np.abs(z[:count] * ends.values)[equations].sum())
    worth += float(
        np.abs(along.costates.at(z)[:, 0]) @ _outside(samples.x[:, 0], problem.start_box)
    )
    H = along.hamiltonian[0][[0, -1]] + along.hamiltonian[1][[0, -1]] @ z
    slopes = (
        -H[0] + ends.slope_t0 + ends.psi_t0 @ z[:count],
        H[1] + ends.slope_tf + ends.psi_tf @ z[:count],
    )
    times = solution.initial_time, solution.final_time
    boxes = problem.initial_time_box, problem.final_time_box
    for slope, t, box in zip(slopes, times, boxes, strict=True):
        worth += abs(float(slope)) * float(_outside(np.array([t]), np.array([box]).T)[0])
    low, high = problem.box
    worth += integral(
        samples, (np.abs(sigma) * _outside(samples.u, (low[:, None], high[:, None]))).sum(axis=0)
    )
    violated = max((seen.path for seen in solution.verified if not seen.error), default=0.0)
    for j in range(len(problem.constraints)):
        jumps = [
            (
                float(z[along.unknowns.jump_column(k)]),
                float(samples.values["c"][j, joint * samples.width - 1]),
            )
            for k, (of, joint) in enumerate(along.unknowns.jumps)
            if of == j
        ]
        worth += sum(abs(jump * c) for jump, c in jumps)
        mass = integral(samples, np.abs(density[j])) + sum(abs(jump) for jump, _ in jumps)
        size = float(np.max(np.abs(samples.values["cx"][:, j]) @ along.scale))
        worth += mass * size * violated
    return _SECOND * worth


def _outside(values: np.ndarray, box: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """Return how far values are outside a box of lower and upper bounds."""
    return np.array(np.maximum(np.maximum(box[0] - values, values - box[1]), 0.0))


def switch_errors(
    problem: Problem, solution: Solution, samples: Samples, sigma: np.ndarray, size: float
) -> tuple[tuple[float, float], ...]:
    """Estimate the error of every switching time: how far the switching function's nearest zero is,
    on the bang side.

    sigma (nu, n). Where sigma leaves with slope zero, as it leaves a singular arc, the slope's zero
    is the switch. Where sigma does not stand out of what counts as zero, next to the Hamiltonian's
    magnitude `size`, or has no zero within an interval, the error is infinite: the time is not
    determined.
    """
    found: dict[float, float] = {}
    missed = max((max(seen.worst, seen.drift) for seen in solution.verified), default=np.inf)
    # all times move with the end of the re-integrated control, and none is known better than its
    # own rounding
    least = (solution.final_time - solution.initial_time) * max(min(_SAFETY * missed, 1.0), 1e-14)
    width = np.diff(problem.box, axis=0)[0]
    for i, name in enumerate(problem.control_names):
        row = solution.structure[name]
        for (before, _, t), (after, _, _) in itertools.pairwise(row):
            side = -1 if before in {"+", "-"} else 1 if after in {"+", "-"} else 0
            k = int(np.argmin(np.abs(samples.edges - t)))
            interval = k - 1 if side < 0 else k
            if side == 0 or not 0 <= interval < samples.intervals:
                continue
            noise = _NOISE * size / width[i]
            error = least + _SAFETY * _nearest_zero(
                samples, sigma[i], (interval, noise), at_end=side < 0
            )
            found[t] = max(found.get(t, 0.0), error)
    return tuple(sorted(found.items()))


def _nearest_zero(
    samples: Samples, sigma: np.ndarray, where: tuple[int, float], *, at_end: bool
) -> float:
    """Return how far the nearest zero of sigma is from an end of an interval; `where`: which one,
    and sigma's noise.
    """
    interval, noise = where
    first = interval * samples.width
    nodes = slice(first, first + samples.width)
    length = float(np.ptp(samples.t[nodes]))
    terms = np.abs(_terms()[-1 if at_end else 0] @ sigma[nodes])
    # the first term that the others do not drown: sigma leaves a bang arc with a slope, a singular
    # one with a curve
    order = next((k for k in (1, 2, 3) if terms[k] >= _LEADS * terms.max()), 1)
    ratio = terms[order - 1] / (order * terms[order]) if terms[order] > 0 else np.inf
    return length * float(ratio) if ratio < 1.0 and terms.max() > noise else np.inf


@cache
def _terms() -> np.ndarray:
    """Return what makes the first four terms, at both ends of an interval, of the Taylor series
    over the interval's length, (2, 4, nodes), from the values at the judge's nodes.
    """
    D = differentiation((_SCHEME.nodes + 1.0) / 2.0)
    powers = [np.linalg.matrix_power(D, k) / math.factorial(k) for k in range(4)]
    return np.stack(powers, axis=1)[[0, -1]]


def flat(
    problem: Problem, solution: Solution, samples: Samples, sigma: np.ndarray, size: float
) -> tuple[tuple[float, float], ...]:
    """Return for every switch from bound to bound how far around it sigma is as small as at the
    switch itself.

    A time within that reach would do as well; it is infinite where it fills an interval. sigma (nu,
    n).
    """
    found: dict[float, float] = {}
    width = np.diff(problem.box, axis=0)[0]
    for i, name in enumerate(problem.control_names):
        for (before, _, t), (after, _, _) in itertools.pairwise(solution.structure[name]):
            k = int(np.argmin(np.abs(samples.edges - t)))
            if {before, after} != {"+", "-"} or not 0 < k < samples.intervals:
                continue
            last = k * samples.width - 1
            level = 2.0 * max(np.abs(sigma[i, last : last + 2]).max(), _ROUNDED * size / width[i])
            sides = (
                _reach(samples, sigma[i], k - 1, level, -1),
                _reach(samples, sigma[i], k, level, 1),
            )
            found[t] = max(found.get(t, 0.0), *sides)
    return tuple(sorted(found.items()))


def _reach(samples: Samples, sigma: np.ndarray, interval: int, level: float, side: int) -> float:
    """Return how far into an interval sigma stays within a level, from its start (side 1) or its
    end (-1).
    """
    nodes = slice(interval * samples.width, (interval + 1) * samples.width)
    t = samples.t[nodes]
    distance = (t[-1] - t[0]) * _LOOKS
    at = t[0] + distance if side > 0 else t[-1] - distance
    above = np.flatnonzero(np.abs(lagrange(t, sigma[None, nodes], at)[0]) > level)
    return float(distance[above[0]]) if above.size else np.inf

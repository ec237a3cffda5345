"""What a verdict says beyond residuals: strictness, ringing, errors of objective and switching times."""

import itertools
import math
from collections.abc import Iterator, Sequence

import casadi
import numpy as np

from socp import claims, laws
from socp.adjoint import POINTS, Samples
from socp.along import Along
from socp.conditions import mode_at
from socp.errors import MethodError
from socp.problem import Problem
from socp.schemes import lgr
from socp.solution import Arc, Solution, lagrange
from socp.symbols import time
from socp.word import Mode

_SCHEME = lgr(POINTS)
_SAFETY = 10.0  # each time also moves with the others, and by more than the residual shows: a digit in hand
_NOISE = 1e-9  # of the Hamiltonian's magnitude: a switching function that small along an interval is nothing but noise
_LEADS = 1e-2  # of the largest term of sigma over an interval: what counts as its slope, not as a residual


def strictness(
    problem: Problem, solution: Solution, samples: Samples, sigma: np.ndarray, size: float
) -> dict[str, float]:
    """Return, for every bang stretch, how far its switching function comes to the right side of zero.

    sigma (nu, n) at the judge's nodes; the figure is sigma times the width of the box over the Hamiltonian's
    magnitude. One that is not positive belongs to an arc that the principle does not ask for.
    """
    found = {}
    width = np.diff(problem.box, axis=0)[0]
    for i, name in enumerate(problem.control_names):
        for number, (mode, start, end) in enumerate(solution.structure[name], start=1):
            inside = (samples.t >= start) & (samples.t <= end)
            if mode in {"+", "-"} and inside.any() and end > start:
                sign = 1.0 if mode == "-" else -1.0
                found[f"{name}, stretch {number} ({mode})"] = float((sign * sigma[i, inside]).max() * width[i] / size)
    return found


def signs(problem: Problem, solution: Solution, samples: Samples) -> np.ndarray:
    """Return, for every bang stretch, weights (stretches, nu, n) that make sigma its mean margin in energy."""
    found = []
    width = np.diff(problem.box, axis=0)[0]
    for i, name in enumerate(problem.control_names):
        for mode, start, end in solution.structure[name]:
            inside = (samples.t >= start) & (samples.t <= end)
            if mode in {"+", "-"} and inside.any() and end > start:
                found.append(np.zeros((len(width), samples.t.size)))
                found[-1][i, inside] = (1.0 if mode == "-" else -1.0) * width[i] / inside.sum()
    return np.array(found).reshape(len(found), len(width), samples.t.size)


def ringing(problem: Problem, solution: Solution) -> dict[str, float]:
    """Return every control's total variation over that of its running mean (1, 2, 1) / 4: 1 if it does not ring.

    The mean leaves nothing of a zigzag from value to value, and all of a jump between longer levels. What is less
    than a thousandth of the width of the box counts as no variation.
    """
    found = {}
    for i, name in enumerate(problem.control_names):
        values = np.concatenate([_once(arc)[i] for arc in solution.arcs])
        least = 1e-3 * float(problem.box[1, i] - problem.box[0, i])
        calm = np.convolve(np.pad(values, 1, mode="edge"), [0.25, 0.5, 0.25], mode="valid")
        found[name] = float((np.abs(np.diff(values)).sum() + least) / (np.abs(np.diff(calm)).sum() + least))
    return found


def legendre_clebsch(
    problem: Problem, solution: Solution, samples: Samples, costate: np.ndarray
) -> tuple[dict[str, float], list[str]]:
    """Return the generalised Legendre-Clebsch expression on every arc with singular controls, and why not elsewhere.

    The least eigenvalue of the matrix (-1)^q d/du d^(2q) sigma / dt^(2q) along the arc over its largest entry there, to
    be non-negative (Kelley, Kopp, Moyer, Topics in Optimization, 1967, chapter 3).
    """
    found: dict[str, float] = {}
    unknown: list[str] = []
    for arc, inside in _joint_arcs(problem, solution, samples):
        singular = [i for i, (mode, _) in enumerate(arc) if mode == "s"]
        if not singular:
            continue
        label = ", ".join(f"{problem.control_names[i]}, stretch {arc[i][1]} (s)" for i in singular)
        try:
            law = laws.extremal_arc(problem, tuple(Mode.parse(mode) for mode, _ in arc))
        except MethodError as error:
            unknown.append(f"the Legendre-Clebsch condition on {label} is unknown: {error}")
            continue
        symbols = [problem.x, problem.u, problem.costate, time, problem.p]
        function = casadi.Function("clebsch", symbols, [casadi.densify(law.legendre_clebsch)])
        p = np.repeat(samples.p[:, None], int(inside.sum()), axis=1)
        values = function.map(p.shape[1])(
            samples.x[:, inside], samples.u[:, inside], costate[:, inside], samples.t[None, inside], p
        ).full()
        matrices = values.reshape(len(singular), p.shape[1], len(singular)).transpose(1, 0, 2)
        size = max(float(np.abs(matrices).max()), 1e-300)
        least = float(np.linalg.eigvalsh((matrices + matrices.transpose(0, 2, 1)) / 2.0).min()) / size
        found[label] = min(found.get(label, np.inf), least)
    return found, unknown


def _joint_arcs(
    problem: Problem, solution: Solution, samples: Samples
) -> Iterator[tuple[tuple[tuple[str, int], ...], np.ndarray]]:
    """Yield (mode and number of its stretch by control, mask (n,) of nodes) for every arc of all controls together."""
    middle = 0.5 * (samples.edges[1:] + samples.edges[:-1])
    joint = [tuple(mode_at(solution, name, float(t)) for name in problem.control_names) for t in middle]
    for arc in dict.fromkeys(joint):
        yield arc, np.repeat([each == arc for each in joint], samples.width)


def _once(arc: Arc) -> np.ndarray:
    """Return the controls (nu, n) at the collocated nodes of an arc, every node once."""
    return np.array(arc.u[:, (arc.side == "right") : arc.t.size - (arc.side == "left")])


def objective_error(
    problem: Problem, solution: Solution, samples: Samples, costate: np.ndarray, gain: np.ndarray
) -> float:
    """Estimate the error of the objective, in its own units, by the dual-weighted residual.

    The sum of four: costate (nx, n) times the defect f - x' of the returned states, arc by arc (within one the errors
    of collocation cancel), and times the miss of the re-integrated end; the difference between the returned objective
    and its own quadrature; and the Hamiltonian `gain` (n,) that better controls would have over the horizon.
    """
    v, half = samples.values, 0.5 * np.diff(samples.edges)
    shape = (-1, samples.intervals, samples.width)
    x, f, costates = (
        each.reshape(shape)[:, :, :each_width] for each, each_width in ((samples.x, None), (v["f"], -1), (costate, -1))
    )
    slope = np.einsum("dj,ikj->ikd", _SCHEME.A, x) / half[:, None]
    weights = half[:, None] * _SCHEME.weights[:-1]
    per_interval = (weights * (costates * (f - slope)).sum(axis=0)).sum(axis=1)
    first = np.flatnonzero(np.diff(samples.arc[:: samples.width], prepend=-1))
    defect = float(np.abs(np.add.reduceat(per_interval, first)).sum())
    missed = integral(samples, gain)
    ends = [np.array(seen.end) for seen in solution.verified if seen.end]
    end = max((float(np.abs(costate[:, -1] @ (x - solution.arcs[-1].x[:, -1]))) for x in ends), default=0.0)
    return defect + end + abs(claims.cost(problem, solution, samples)[0] - solution.objective) + missed


def integral(samples: Samples, values: np.ndarray) -> float:
    """Return the integral over the horizon of values (n,) at the judge's nodes."""
    weights = 0.5 * np.diff(samples.edges)[:, None] * _SCHEME.weights[:-1]
    return float((weights * values.reshape(samples.intervals, samples.width)[:, :-1]).sum())


def worth_of_misses(along: Along, z: np.ndarray, sigma: np.ndarray, density: np.ndarray) -> float:
    """Return what the conditions that a solution misses are worth: every miss times its multiplier, to first order.

    Those are the ends of states and times, end conditions, state constraints along the way as re-integration finds
    them, and the box of the controls. sigma (nu, n), density (nc, n).
    """
    problem, solution, samples, ends = along.problem, along.solution, along.samples, along.ends
    count = ends.signs.size
    equations = ends.signs == 0
    worth = float(np.abs(z[:count] * ends.values)[equations].sum())
    worth += float(np.abs(along.costates.at(z)[:, 0]) @ _outside(samples.x[:, 0], problem.start_box))
    H = along.hamiltonian[0][[0, -1]] + along.hamiltonian[1][[0, -1]] @ z
    slopes = -H[0] + ends.slope_t0 + ends.psi_t0 @ z[:count], H[1] + ends.slope_tf + ends.psi_tf @ z[:count]
    times = solution.initial_time, solution.final_time
    boxes = problem.initial_time_box, problem.final_time_box
    for slope, t, box in zip(slopes, times, boxes, strict=True):
        worth += abs(float(slope)) * float(_outside(np.array([t]), np.array([box]).T)[0])
    low, high = problem.box
    worth += integral(samples, (np.abs(sigma) * _outside(samples.u, (low[:, None], high[:, None]))).sum(axis=0))
    violated = max((seen.path for seen in solution.verified if not seen.error), default=0.0)
    for j in range(len(problem.constraints)):
        jumps = [
            (float(z[along.unknowns.jump_column(k)]), float(samples.values["c"][j, joint * samples.width - 1]))
            for k, (of, joint) in enumerate(along.unknowns.jumps)
            if of == j
        ]
        worth += sum(abs(jump * c) for jump, c in jumps)
        mass = integral(samples, np.abs(density[j])) + sum(abs(jump) for jump, _ in jumps)
        size = float(np.max(np.abs(samples.values["cx"][:, j]) @ along.scale))
        worth += mass * size * violated
    return worth


def _outside(values: np.ndarray, box: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """Return how far values are outside a box of lower and upper bounds."""
    return np.array(np.maximum(np.maximum(box[0] - values, values - box[1]), 0.0))


def switch_errors(
    problem: Problem, solution: Solution, samples: Samples, sigma: np.ndarray, size: float
) -> tuple[tuple[float, float], ...]:
    """Estimate the error of every switching time: how far the switching function's nearest zero is, on the bang side.

    sigma (nu, n). Where sigma leaves with slope zero, as it leaves a singular arc, the slope's zero is the switch.
    Where sigma does not stand out of what counts as zero, next to the Hamiltonian's magnitude `size`, or has no zero
    within an interval, the error is infinite: the time is not determined.
    """
    found: dict[float, float] = {}
    missed = max((seen.worst for seen in solution.verified), default=np.inf)
    # all times move with the end of the re-integrated control, and none is known better than its own rounding
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
            error = least + _SAFETY * _nearest_zero(samples, sigma[i], (interval, noise), at_end=side < 0)
            found[t] = max(found.get(t, 0.0), error)
    return tuple(sorted(found.items()))


def _nearest_zero(samples: Samples, sigma: np.ndarray, where: tuple[int, float], *, at_end: bool) -> float:
    """Return how far the nearest zero of sigma is from an end of an interval; `where`: which one, and sigma's noise."""
    interval, noise = where
    first = interval * samples.width
    nodes = slice(first, first + samples.width)
    t = samples.t[nodes] - samples.t[nodes][-1 if at_end else 0]
    polynomial = np.polynomial.Polynomial.fit(t, sigma[nodes], POINTS)
    length = float(np.ptp(t))
    terms = np.array([abs(float(polynomial.deriv(k)(0.0))) * length**k / math.factorial(k) for k in range(4)])
    # the first term that the others do not drown: sigma leaves a bang arc with a slope, a singular one with a curve
    order = next((k for k in (1, 2, 3) if terms[k] >= _LEADS * terms.max()), 1)
    ratio = terms[order - 1] / (order * terms[order]) if terms[order] > 0 else np.inf
    return length * float(ratio) if ratio < 1.0 and terms.max() > noise else np.inf


def on_arc(samples: Samples, index: int, arc: Arc, values: np.ndarray) -> np.ndarray:
    """Carry values (rows, n) from the judge's nodes to an arc's; arcs without length take the neighbouring value."""
    out = np.empty((values.shape[0], arc.t.size))
    mine = np.unique(np.flatnonzero(samples.arc == index) // samples.width)
    if not mine.size:
        nearest = int(np.argmin(np.abs(samples.t - arc.t[0])))
        return np.repeat(values[:, [nearest]], arc.t.size, axis=1)
    place = mine[np.clip(np.searchsorted(samples.edges[mine], arc.t, side="right") - 1, 0, mine.size - 1)]
    for k in np.unique(place):
        nodes = slice(k * samples.width, (k + 1) * samples.width)
        out[:, place == k] = lagrange(samples.t[nodes], values[:, nodes], arc.t[place == k])
    return out

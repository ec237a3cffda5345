"""The grade of a solution that is no extremal: an estimate of its objective's error.

By duality, and to first order, the objective of the extremal nearby is that of the Lagrangian at
the given point, or less by what better controls would gain.
"""

import numpy as np

from socp.model import (
    Grade,
    Mode,
    Place,
    Problem,
    Solution,
    lately,
    mayer_function,
)
from socp.verdict.accuracy import values_of
from socp.verdict.grading.pieces import NODES, Pieces
from socp.verdict.grading.unknowns import Unknowns
from socp.verdict.grading.weighing import Weights, weights
from socp.verdict.reintegration import moved

# Times what better controls gain at the given costate: a switch moves the costate as it moves, and
# is worth more than that where this makes its minimum flatter. Of grids whose error is known
# (benchmarks/graded.py) none asks for more than twice
_GAIN = 3.0
# of the horizon: a shorter singular arc may be what a grid shows of a switch. Its curvature is
# worth no more than the cube of its share over 32, of the objective's terms (Goh's transformation,
# a control of one sign, then of the other): 3e-5, which is next to nothing to APPROXIMATE
_SHORT = 0.1


def grade(problem: Problem, solution: Solution) -> Grade | None:
    """Return how far the objective of a solution, as returned and as its control reaches, may be
    from that of the extremal nearby; None where no multipliers are found.

    With states x, controls u, multipliers lambda, mu >= 0 and nu of the right signs, the Lagrangian
    J + integral of (lambda . (f - x') + mu c) + nu psi is stationary in the states, so to first
    order it differs from the extremal's objective by what the controls change in it, at most the
    integral of H(x, u, lambda) - min H(x, ., lambda) over the box (dual-weighted residuals: Becker,
    Rannacher, Acta Numerica 10, 2001, proposition 2.2, with residuals of the controls as Meidner,
    Vexler, SIAM J. Control Optim. 46, 2007, have them). Of the second order are added what two
    Lagrangians differ by, that of the returned motion and that of the re-integrated one, and what
    the first order comes to times how far the two motions are apart, relative.
    """
    weighed = _weighed(problem, solution)
    if weighed is None:
        return None
    unknowns, found = weighed
    cost, size = _cost(unknowns)
    seen = solution.verified[0]
    dynamics = float(sum(each.sum() for each in _motion(unknowns, found)))
    ends, path = _ends(unknowns, found), _path(unknowns, found)
    value = cost + dynamics + ends + path
    gain = float(_gain(unknowns, found).sum()) + found.gain
    off = max(abs(each - value) for each in (solution.objective, seen.objective))
    second = abs(seen.objective + float(found.tie @ unknowns.reached) - value)
    second += (abs(dynamics) + abs(ends) + abs(path)) * _apart(unknowns, found)
    error = off + _GAIN * gain + second
    return Grade(
        objective=value,
        error=float(error),
        gain=gain,
        dynamics=dynamics,
        ends=ends,
        path=path,
        size=size,
        curvature=_curvature(solution),
    )


def error_shares(problem: Problem, solution: Solution) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the ends (n + 1,) of the pieces of a verified solution and what each adds (n,) to the
    error of its objective, in the objective's units: what better controls would gain there, and the
    costate times what its motion misses. None where no multipliers are found.

    They tell where a grid is to be finer (Becker, Rannacher, Acta Numerica 10, 2001, section 5).
    """
    weighed = _weighed(problem, solution)
    if weighed is None:
        return None
    along, leaps, _ = _motion(*weighed)
    shares = _gain(*weighed) + np.abs(along)
    shares[1:] += np.abs(leaps)
    return weighed[0].pieces.edges, shares


def _weighed(problem: Problem, solution: Solution) -> tuple[Unknowns, Weights] | None:
    """Lay out a verified solution, and find the multipliers under which it has the least to gain;
    of the one that was asked for last they are kept.
    """

    def made() -> tuple[Unknowns, Weights] | None:
        unknowns = Unknowns(problem, solution, Pieces.of(problem, solution))
        _, size = _cost(unknowns)
        found = weights(unknowns, size) if np.isfinite(size) and size > 0 else None
        return None if found is None else (unknowns, found)

    return lately(problem, _weighed, values_of(solution), made)


def _apart(unknowns: Unknowns, found: Weights) -> float:
    """Return how far the re-integrated motion is from the returned one or misses, relative: states
    by what their magnitudes are worth to the objective at the costates found.

    At the far end of a chain a state may be any number of its own magnitudes off, and be worth
    nothing: what nothing depends on has no part in an error.
    """
    problem, solution = unknowns.problem, unknowns.solution
    seen, reached = solution.verified[0], moved(problem, solution)
    if reached is solution:
        return max(seen.drift, seen.off)
    off = np.abs(reached.rows("x") - solution.rows("x")).max(axis=1)
    worth = np.abs(found.costate).max(axis=(0, 1))
    largest = float((worth * unknowns.scale).max(initial=0.0))
    drift = float((worth * off).max(initial=0.0)) / largest if largest > 0 else seen.drift
    return max(min(drift, seen.drift), seen.off)


def _curvature(solution: Solution) -> float:
    """Return the Legendre-Clebsch expression at its worst on singular arcs that are no switches."""
    horizon, found = solution.final_time - solution.initial_time, 0.0
    lengths = {
        f", {Place(control=name, stretch=k, mode=Mode.parse(mode))}": end - start
        for name, row in solution.structure.items()
        for k, (mode, start, end) in enumerate(row, start=1)
    }
    worst = {} if solution.verdict is None else solution.verdict.legendre_clebsch
    for label, value in worst.items():
        of = [length for place, length in lengths.items() if place in f", {label}"]
        if min(of, default=0.0) >= _SHORT * horizon:
            found = min(found, value)
    return found


def _cost(unknowns: Unknowns) -> tuple[float, float]:
    """Return the objective by quadrature over the pieces, and the magnitude of its terms."""
    pieces = unknowns.pieces
    L = pieces.values["L"][:, :NODES]
    mayer = float(mayer_function(unknowns.problem)(*unknowns.ends))
    w = pieces.weights
    return float((w * L).sum()) + mayer, float((w * np.abs(L)).sum()) + abs(mayer)


def _motion(unknowns: Unknowns, found: Weights) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the costate times what the motion misses: f - x' on the pieces (n,), by parts, and the
    leaps between them (n - 1,) and from where it may start ().
    """
    pieces, v, costate = unknowns.pieces, unknowns.pieces.values, found.costate
    inner = costate[:, :NODES]
    slope = -(
        np.einsum("kdyx,kdy->kdx", v["fx"][:, :NODES], inner)
        + v["Lx"][:, :NODES]
        + np.einsum("kdjx,kj->kdx", v["cx"][:, :NODES], found.density)
    )
    rates = (inner * v["f"][:, :NODES] + slope * pieces.x[:, :NODES]).sum(axis=-1)
    ends = (costate[:, 0] * pieces.x[:, 0] - costate[:, -1] * pieces.x[:, -1]).sum(axis=-1)
    along = (pieces.weights * rates).sum(axis=1) + ends
    leaps = (costate[1:, 0] * (pieces.x[1:, 0] - pieces.x[:-1, -1])).sum(axis=-1)
    start = costate[0, 0] + found.jump[0] @ unknowns.joints["cx"][0]
    x = pieces.x[0, 0]
    return along, -leaps, -(start @ (x - np.clip(x, *unknowns.problem.start_box)))


def _ends(unknowns: Unknowns, found: Weights) -> float:
    """Return the multipliers of the ends times what these miss."""
    return float(found.tie @ np.array([tie.value for tie in unknowns.ties]))


def _path(unknowns: Unknowns, found: Weights) -> float:
    """Return the multipliers of the state constraints times their values."""
    c = unknowns.pieces.values["c"][:, :NODES]
    along = np.einsum("kd,kdj,kj->", unknowns.pieces.weights, c, found.density)
    return float(along + (found.jump * unknowns.joints["c"]).sum())


def _gain(unknowns: Unknowns, found: Weights) -> np.ndarray:
    """Return the integral over every piece (n,) of the Hamiltonian that better controls would gain,
    and of what controls outside their box have gained.
    """
    pieces, v = unknowns.pieces, unknowns.pieces.values
    sigma = v["L1"][:, :NODES] + np.einsum(
        "kdxu,kdx->kdu", v["G"][:, :NODES], found.costate[:, :NODES]
    )
    low, high = unknowns.problem.box
    u = pieces.u[:, :NODES]
    gain = np.abs(np.maximum(sigma * (u - low), sigma * (u - high)))
    return np.array((pieces.weights[..., None] * gain).sum(axis=(1, 2)))

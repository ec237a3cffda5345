"""Programmes with more equations than unknowns: solved by least squares, where the equations agree
with each other.
"""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import casadi
import numpy as np

from socp.model import Stop
from socp.process import seconds_left
from socp.solvers.contract import NLP, NLPPoint

# Gauss-Newton steps: near a solution it takes a few, and equations that contradict each other take
# no more
_STEPS = 25
# Share of the sum of squares that a step has to take away: towards agreement every step takes
# nearly all
_WORTH = 1e-3
_SHARES = (1.0, 0.5, 0.25, 0.0625)  # of a step, tried in turn
_RANK = 1e-14  # keeps the system of a step regular where equations leave a direction open
# Of the variables' magnitudes, 1 at least: what equations that agree leave, rounding and some
# digits
_MET = 1e-10


def equations_and_unknowns(nlp: NLP) -> tuple[int, int]:
    """Return how many equations and how many unknowns a programme has, fixed variables left out."""
    return int((nlp.g_box[0] == nlp.g_box[1]).sum()), int((nlp.v_box[0] != nlp.v_box[1]).sum())


def met(nlp: NLP, guess: NLPPoint, most: int) -> NLPPoint:
    """Return the point that meets more equations than there are unknowns, if they agree; nothing is
    left to minimise.

    Such is a word where controls switch at one time by symmetry: every control asks for its own
    ends. The equations are redundant there and determine the point alone. Without agreement it is
    the guess, infeasible.
    """
    began = time.perf_counter()
    low, high = nlp.v_box
    free, rows = np.flatnonzero(low != high), np.flatnonzero(nlp.g_box[0] == nlp.g_box[1])
    given: np.ndarray = np.clip(guess.v, low, high)
    g = nlp.g[rows.tolist()] - casadi.DM(nlp.g_box[0, rows])
    slopes = casadi.jacobian(g, nlp.v)[:, free.tolist()]
    system = casadi.Function("system", [nlp.v], [g, slopes])
    every = casadi.Function("all", [nlp.v], [nlp.g, nlp.f])

    def at(part: np.ndarray) -> tuple[np.ndarray, Any]:
        value, slope = system(_whole(given, free, part))
        return value.full().ravel(), slope.sparse()

    equations, unknowns = equations_and_unknowns(nlp)
    said = f"{equations} equations for {unknowns} unknowns"
    part, steps = _descended(at, given[free], min(most, _STEPS))
    if part is None:
        return replace(guess, stop=Stop.INFEASIBLE, message=said)
    v = _whole(given, free, part)
    all_g, f = (each.full().ravel() for each in every(v))
    beyond = _beyond(all_g, nlp.g_box), _beyond(v, nlp.v_box)  # bounds have no say on the way
    off = max(float(each.max(initial=0.0)) for each in beyond)
    if not off <= _MET * max(1.0, float(np.abs(v).max(initial=0.0))):
        return replace(guess, stop=Stop.INFEASIBLE, message=said, iterations=steps)
    return NLPPoint(
        v=np.clip(v, low, high),
        objective=float(f[0]),
        stop=Stop.SOLVED,
        message=f"{said}, which agree: least squares",
        iterations=steps,
        seconds={"build": 0.0, "solve": time.perf_counter() - began},
    )


def _whole(given: np.ndarray, free: np.ndarray, part: np.ndarray) -> np.ndarray:
    v: np.ndarray = given.copy()
    v[free] = part
    return v


def _descended(
    at: Callable[[np.ndarray], tuple[np.ndarray, Any]], x: np.ndarray, most: int
) -> tuple[np.ndarray | None, int]:
    """Return where Gauss-Newton steps lead, and their number; None where values are not finite.

    A step d minimises |J d + F|: with the residual s it solves s + J d = -F, J' s = 0, which is
    sparse where the normal equations are not. It is halved while it takes nothing away.
    """
    values, slopes = at(x)
    scale = np.maximum(np.abs(x), 1.0)
    for step in range(most):
        square = float(values @ values)
        if not np.isfinite(square) or not np.isfinite(slopes.data).all():
            return None, step
        if square == 0.0 or seconds_left() <= 0.0:
            return x, step
        move = scale * _step(values, slopes.multiply(scale[None, :]))
        for share in _SHARES:
            new = x + share * move
            after, turned = at(new)
            if float(after @ after) < square:
                break
        else:
            return x, step
        x, values, slopes = new, after, turned
        if square - float(values @ values) <= _WORTH * square:
            return x, step + 1
    return x, most


def _step(values: np.ndarray, slopes: Any) -> np.ndarray:
    from scipy import sparse  # where there are such programmes
    from scipy.sparse.linalg import splu

    m, n = slopes.shape
    matrix = sparse.bmat(
        [[sparse.identity(m), slopes], [slopes.T, -_RANK * sparse.identity(n)]], format="csc"
    )
    try:
        found: np.ndarray = splu(matrix).solve(np.concatenate([-values, np.zeros(n)]))[m:]
    except RuntimeError:  # exactly singular
        return np.zeros(n)
    return found


def _beyond(values: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Return how far values (n,) are outside a box (2, n)."""
    return np.array(np.maximum(np.maximum(box[0] - values, values - box[1]), 0.0))

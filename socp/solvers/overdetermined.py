"""Programmes with more equations than unknowns: solved by least squares, where the equations agree
with each other.
"""

import time
from dataclasses import replace

import casadi
import numpy as np
from scipy.optimize import least_squares

from socp.model import Stop
from socp.solvers.contract import NLP, NLPPoint

# Gauss-Newton steps: near a solution it takes a few, and equations that contradict each other take
# no more
_STEPS = 25
# Share of the sum of squares that a step has to take away: towards agreement every step takes
# nearly all
_WORTH = 1e-3
# Of the variables' magnitudes, 1 at least: what equations that agree leave, rounding and some
# digits
_MET = 1e-10


def counted(nlp: NLP) -> tuple[int, int]:
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
    slopes = casadi.Function("slopes", [nlp.v], [casadi.jacobian(g, nlp.v)[:, free.tolist()]])
    values, every = (
        casadi.Function("values", [nlp.v], [g]),
        casadi.Function("all", [nlp.v], [nlp.g, nlp.f]),
    )

    def whole(part: np.ndarray) -> np.ndarray:
        v: np.ndarray = given.copy()
        v[free] = part
        return v

    equations, unknowns = counted(nlp)
    said = f"{equations} equations for {unknowns} unknowns"
    try:
        found = least_squares(
            lambda part: values(whole(part)).full().ravel(),
            given[free],
            jac=lambda part: slopes(whole(part)).full(),
            method="lm",
            x_scale=np.maximum(np.abs(given[free]), 1.0),
            ftol=_WORTH,
            xtol=1e-15,
            gtol=1e-15,
            max_nfev=min(most, _STEPS),
        )
    except (ValueError, np.linalg.LinAlgError):  # values that are not finite
        return replace(guess, stop=Stop.INFEASIBLE, message=said)
    v = whole(found.x)
    all_g, f = (each.full().ravel() for each in every(v))
    beyond = _beyond(all_g, nlp.g_box), _beyond(v, nlp.v_box)  # bounds have no say on the way
    off = max(float(each.max(initial=0.0)) for each in beyond)
    if not off <= _MET * max(1.0, float(np.abs(v).max(initial=0.0))):
        return replace(guess, stop=Stop.INFEASIBLE, message=said, iterations=int(found.nfev))
    return NLPPoint(
        v=np.clip(v, low, high),
        objective=float(f[0]),
        stop=Stop.SOLVED,
        message=f"{said}, which agree: least squares",
        iterations=int(found.nfev),
        seconds={"build": 0.0, "solve": time.perf_counter() - began},
    )


def _beyond(values: np.ndarray, box: np.ndarray) -> np.ndarray:
    """Return how far values (n,) are outside a box (2, n)."""
    return np.array(np.maximum(np.maximum(box[0] - values, values - box[1]), 0.0))

"""Meshes of arcs: how far the polynomials have converged, and how many intervals an arc therefore needs."""

import math

import numpy as np

from socp.collocate import Mesh, uniform
from socp.schemes import lgr
from socp.solution import Arc

_GROWTH = 4  # no more than four times the intervals at once: an estimate from a poor mesh exaggerates
_CROWD = 64  # intervals in one arc; what is not smooth by then is no arc


def tails(arc: Arc, scale: np.ndarray) -> np.ndarray:
    """Estimate the error of every interval (k,): the last two Legendre coefficients of its states relative to scale (nx,)."""
    found = []
    for k in range(len(arc.mesh) - 1):
        nodes = arc.nodes(k)
        t, x = arc.t[nodes], arc.x[:, nodes]
        if np.ptp(t) <= 0:
            found.append(0.0)
            continue
        tau = 2.0 * (t - t[0]) / (t[-1] - t[0]) - 1.0
        coefficients = np.linalg.solve(np.polynomial.legendre.legvander(tau, t.size - 1), x.T)
        found.append(float(np.max(np.abs(coefficients[-2:]) / scale)))
    return np.array(found)


def refined(arcs: tuple[Arc, ...], scale: np.ndarray, points: int, tolerance: float) -> list[Mesh] | None:
    """Return meshes with as many equal intervals an arc as the tolerance needs at this degree, None where all have converged."""
    meshes, grown = [], False
    for arc in arcs:
        count = len(arc.mesh) - 1
        worst = float(tails(arc, scale).max())
        # the error of an interval falls with its length to the power of its degree
        factor = (worst / tolerance) ** (1.0 / points) if worst > tolerance else 1.0
        wanted = min(math.ceil(count * min(factor, _GROWTH)), _CROWD)
        grown |= wanted > count
        meshes.append(uniform(lgr(points), max(wanted, count)))
    return meshes if grown else None

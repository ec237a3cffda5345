"""Meshes of arcs: how far the polynomials have converged, and how many intervals an arc therefore needs."""

import numpy as np

from socp.collocate import Mesh
from socp.schemes import lgr
from socp.solution import Arc

_GROWTH = 4  # no more than four times the intervals at once: an estimate from a poor mesh exaggerates
_BEYOND = 0.01  # of the tolerance, aimed at by what is split: one more mesh costs more than some more intervals
_CROWD = 64  # intervals in one arc; what is not smooth by then is no arc


def tails(arc: Arc, scale: np.ndarray) -> np.ndarray:
    """Return the last two Legendre coefficients of every interval's states (k,), relative to scale (nx,)."""
    found = []
    for k in range(len(arc.mesh) - 1):
        nodes = arc.nodes(k)
        t, x = arc.t[nodes], arc.x[:, nodes]
        if _merged(t):
            found.append(0.0)
            continue
        tau = 2.0 * (t - t[0]) / (t[-1] - t[0]) - 1.0
        coefficients = np.linalg.solve(np.polynomial.legendre.legvander(tau, t.size - 1), x.T)
        found.append(float(np.max(np.abs(coefficients[-2:]) / scale)))
    return np.array(found)


def refined(arcs: tuple[Arc, ...], scale: np.ndarray, points: int, tolerance: float) -> list[Mesh] | None:
    """Return meshes that split every interval into as many as the tolerance needs, None where all have converged."""
    meshes: list[Mesh] = []
    grown = False
    for arc in arcs:
        ends = arc.t[arc.mesh]
        shares = np.full(ends.size - 1, 1.0) if _merged(ends) else np.diff(ends)
        # the error of an interval falls with its length to the power of its degree
        tail = tails(arc, scale)
        parts = np.ceil(np.clip((tail / (_BEYOND * tolerance)) ** (1.0 / points), 1.0, _GROWTH)).astype(int)
        wanted = np.where(tail > tolerance, parts, 1)
        if shares.size >= _CROWD:
            wanted[:] = 1
        grown |= bool((wanted > 1).any())
        meshes.append(
            [
                (float(share) / count, lgr(points))
                for share, count in zip(shares, wanted, strict=True)
                for _ in range(count)
            ]
        )
    return meshes if grown else None


def _merged(t: np.ndarray) -> bool:
    """Tell whether an arc has shrunk until rounding merges its times t (n,), or turns their order."""
    return bool(np.diff(t).min() <= 4 * np.spacing(np.abs(t).max()))

"""Linear motions by the method of Gauss, many at once."""

from functools import cache

import numpy as np


def stages(
    A: np.ndarray, driven: np.ndarray, y: np.ndarray, rule: tuple[float, np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Return solutions of xi' = A xi + driven at the Gauss points (s, ny, k) and at the end
    (ny, k), from y (ny, k); `rule` is the step with weights (s,) and matrix (s, s).
    """
    step, weights, matrix = rule
    count, ny = A.shape[:2]
    left = np.eye(count * ny) - step * np.einsum("ij,jab->iajb", matrix, A).reshape(count * ny, -1)
    right = y[None] + step * np.einsum("ij,jak->iak", matrix, driven)
    inside = np.linalg.solve(left, right.reshape(count * ny, -1)).reshape(right.shape)
    slopes = np.einsum("jab,jbk->jak", A, inside) + driven
    return inside, y + step * np.einsum("j,jak->ak", weights, slopes)


@cache
def gauss(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return nodes (s,), weights (s,) and matrix (s, s) of the Gauss method on [0, 1] (Hairer,
    Norsett, Wanner, Solving ODEs I, II.7).
    """
    nodes, weights = np.polynomial.legendre.leggauss(count)
    nodes, weights = 0.5 * (nodes + 1.0), 0.5 * weights
    powers = np.vander(nodes, count, increasing=True)
    integrals = nodes[:, None] * powers / np.arange(1, count + 1)
    return nodes, weights, np.linalg.solve(powers.T, integrals.T).T

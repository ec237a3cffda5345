"""Polynomials through values at nodes: barycentric weights, evaluation, slopes, and Legendre
coefficients.

Everything is as for Lagrange interpolation in Berrut, Trefethen, Barycentric Lagrange
Interpolation, SIAM Review 46, 2004; nodes are in any unit, in increasing order, no two the same.
"""

import math

import numpy as np

from socp.model.tolerances import ROUNDED


def coincident(nodes: np.ndarray) -> bool:
    """Tell whether nodes (p,) stand so close that rounding merges two of them, or turns their
    order.
    """
    least = (nodes[1:] - nodes[:-1]).min(initial=np.inf)
    return bool(least <= ROUNDED * max(abs(nodes[0]), abs(nodes[-1])))


def barycentric(nodes: np.ndarray) -> np.ndarray:
    """Return the barycentric weights (p,) of nodes (p,), p >= 2, up to a factor that is common to
    all.
    """
    # an interval of length 4 has capacity 1: products of 60 gaps neither over- nor underflow
    gaps = (4.0 / (nodes[-1] - nodes[0])) * (nodes[:, None] - nodes)
    gaps.ravel()[:: nodes.size + 1] = 1.0
    weights: np.ndarray = 1.0 / gaps.prod(axis=1)
    return weights


def lagrange(nodes: np.ndarray, values: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Evaluate the polynomial through (nodes (p,), values (r, p)) at t (k,); returns (r, k).

    Where rounding merges nodes it is straight lines from one to the next.
    """
    span = float(nodes[-1] - nodes[0])
    if nodes.size == 1 or span == 0.0:
        return np.repeat(values[:, :1], t.size, axis=1)
    if coincident(nodes):
        return np.array([np.interp(t, nodes, row) for row in values])
    weights = barycentric(nodes)
    distance = t[:, None] - nodes
    # as near as this the quotient overflows, and the value is the node's
    where, node = np.nonzero(np.abs(distance) <= ROUNDED * span)
    distance[where, node] = 1.0
    terms = weights / distance
    total = terms.sum(axis=1)
    total[where] = 1.0  # at a node the sum means nothing, and may be zero
    with np.errstate(invalid="ignore"):  # an infinite value is nan but at its own node
        result: np.ndarray = (values @ terms.T) / total
    result[:, where] = values[:, node]
    return result


def piecewise(nodes: np.ndarray, values: np.ndarray, t: np.ndarray, on: np.ndarray) -> np.ndarray:
    """Evaluate, at every time of t (k,), that of m polynomials through (nodes (m, p), values
    (r, m, p)) whose number stands in `on` (k,); returns (r, k). Each is as `lagrange` has it.
    Polynomials that no time asks for cost nothing.
    """
    if on.size < len(nodes):
        asked, on = np.unique(on, return_inverse=True)
        nodes, values = nodes[asked], values[:, asked]
    size = nodes.shape[1]
    least = ROUNDED * np.abs(nodes).max(axis=1)[:, None]
    merged = (nodes[:, 1:] - nodes[:, :-1] <= least).any(axis=1)
    merged |= size == 1
    if merged.any():
        out, whole = np.empty((values.shape[0], t.size)), ~merged[on]
        for j in np.unique(on[~whole]):
            out[:, on == j] = lagrange(nodes[j], values[:, j], t[on == j])
        out[:, whole] = _piecewise(nodes, values, t[whole], on[whole])
        return out
    return _piecewise(nodes, values, t, on)


def _piecewise(nodes: np.ndarray, values: np.ndarray, t: np.ndarray, on: np.ndarray) -> np.ndarray:
    """Return the same where no time falls on a polynomial whose nodes rounding merges."""
    size, span = nodes.shape[1], nodes[:, -1] - nodes[:, 0]
    gaps = nodes[:, :, None] - nodes[:, None, :]
    gaps.reshape(len(nodes), size * size)[:, :: size + 1] = 1.0
    with np.errstate(divide="ignore", invalid="ignore"):  # merged nodes, and infinite values
        weights = 1.0 / (gaps * (4.0 / span[:, None, None])).prod(axis=2)
        distance = t[:, None] - nodes[on]
        where, node = np.nonzero(np.abs(distance) <= ROUNDED * span[on, None])
        distance[where, node] = 1.0
        terms = weights[on] / distance
        total = terms.sum(axis=1)
        total[where] = 1.0
        found = np.einsum("kp,rkp->rk", terms, values[:, on]) / total
    found = np.ascontiguousarray(found)  # sums over rows that lie elsewhere round otherwise
    found[:, where] = values[:, on[where], node]
    return found


def differentiation(nodes: np.ndarray) -> np.ndarray:
    """Return D (p, p), D_ij = l_j'(nodes_i), of the Lagrange polynomials l_j (Berrut, Trefethen,
    9.3).
    """
    weights = barycentric(nodes)
    gaps = nodes[:, None] - nodes[None, :]
    np.fill_diagonal(gaps, 1.0)
    D: np.ndarray = (weights[None, :] / weights[:, None]) / gaps
    np.fill_diagonal(D, 0.0)
    np.fill_diagonal(D, -D.sum(axis=1))  # rows of a differentiation matrix sum to zero
    return D


def legendre(degree: int, tau: np.ndarray) -> np.ndarray:
    """Return P_0 .. P_degree at tau in [-1, 1] (..., n), as (degree + 1, ..., n), in the precision
    of tau.

    By the three-term recurrence (k + 1) P_{k+1} = (2 k + 1) tau P_k - k P_{k-1}.
    """
    P = np.ones((max(degree, 1) + 1, *tau.shape), dtype=tau.dtype)
    P[1] = tau
    for k in range(1, degree):
        P[k + 1] = ((2 * k + 1) * tau * P[k] - k * P[k - 1]) / (k + 1)
    return P[: degree + 1]


def legendre_coefficients(
    nodes: np.ndarray, values: np.ndarray, span: tuple[float | np.ndarray, float | np.ndarray]
) -> np.ndarray:
    """Return the Legendre coefficients (p, ...) on an interval, `span`, of the polynomial through
    values (p, ...) at nodes (p,); of m of them at once where all have an axis (m,) before.

    The first one is the polynomial's mean over the interval; the last ones measure how smooth it
    is: of a smooth function they fall geometrically.
    """
    first, last = (np.asarray(each)[..., None] for each in span)
    tau = (2.0 * nodes - first - last) / (last - first)
    table = np.moveaxis(legendre(nodes.shape[-1] - 1, tau), 0, -1)
    rest = math.prod(values.shape[nodes.ndim :])  # no other size where there are no intervals
    flat = np.linalg.solve(table, values.reshape(*nodes.shape, rest))
    coefficients: np.ndarray = flat.reshape(values.shape)
    return coefficients

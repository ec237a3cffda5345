"""Linear motions and quadratic forms on pieces of them by the method of Gauss, many at once."""

from functools import cache

import numpy as np

Rule = tuple[np.ndarray, np.ndarray, np.ndarray]


def stages(
    A: np.ndarray, driven: np.ndarray, y: np.ndarray, rule: Rule
) -> tuple[np.ndarray, np.ndarray]:
    """Return solutions of xi' = A xi + driven on n pieces at their Gauss points (n, s, ny, k) and
    ends (n, ny, k), from y (ny, k) each; `rule` holds the steps (n,), weights (s,) and the matrix
    (s, s).
    """
    step, weights, matrix = rule
    n, count, ny, k = driven.shape
    inner = step[:, None, None] * matrix
    right = y + (inner @ driven.reshape(n, count, -1)).reshape(driven.shape)
    coupled = inner[:, :, None, :, None] * A.swapaxes(1, 2)[:, None]
    left = np.eye(count * ny) - coupled.reshape(n, count * ny, -1)
    inside = np.linalg.solve(left, right.reshape(n, -1, k)).reshape(right.shape)
    slopes = (A @ inside + driven).reshape(n, count, -1)
    return inside, y + step[:, None, None] * (weights @ slopes).reshape(n, ny, k)


def pieces(
    at: dict[str, np.ndarray], size: np.ndarray, values: np.ndarray, rule: Rule
) -> tuple[np.ndarray, np.ndarray]:
    """Return where y ends (n, ny, ny + c m) on n pieces and what it costs, square, as functions of
    y where they begin and of c numbers of each of the m controls, one number after the other: by
    these w is `values` (s, c) at the Gauss points, measured in `size` (n, s, m). `at` holds the
    coefficients (n, s, ..) of the second variation by name.
    """
    (n, count, m), ny, own = size.shape, at["A"].shape[2], values.shape[1] * size.shape[2]
    driven = np.zeros((n, count, ny, ny + own))
    by = (at["B1"] * size[:, :, None])[:, :, :, None] * values[:, None, :, None]
    driven[..., ny:] = by.reshape(n, count, ny, own)
    xi, ends = stages(at["A"], driven, np.eye(ny, ny + own), rule)
    measure = (rule[0][:, None] * rule[1])[:, :, None, None]
    rows = n, count * ny, -1
    form = xi.reshape(rows).swapaxes(1, 2) @ (measure * (at["Q"] @ xi)).reshape(rows)
    mixed = (measure * size[..., None] * (at["M"] @ xi)).reshape(n, count, -1)
    mixed = (values.T @ mixed).reshape(n, own, -1)
    form[:, ny:] += mixed
    form[:, :, ny:] += mixed.swapaxes(1, 2)
    bent = (measure * size[:, :, :, None] * size[:, :, None] * at["R"]).reshape(n, count, -1)
    pairs = (values[:, :, None] * values[:, None]).reshape(count, -1).T
    bent = (pairs @ bent).reshape(n, own // m, own // m, m, m).swapaxes(2, 3)
    form[:, ny:, ny:] += bent.reshape(n, own, own)
    return ends, form


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


@cache
def spread(parts: int, count: int) -> np.ndarray:
    """Return the Gauss points (parts count,) of so many equal parts of [0, 1]."""
    return np.array((np.arange(parts)[:, None] + gauss(count)[0]) / parts).ravel()


@cache
def halved(count: int) -> np.ndarray:
    """Return the values (2 s, s) of `_taken` at the Gauss points of both halves of a piece."""
    nodes, weights, _ = gauss(count)
    both = np.concatenate([0.5 * nodes, 0.5 + 0.5 * nodes])
    return _taken(count, both, np.tile(0.5 * weights, 2))


@cache
def lowered(count: int, among: int) -> np.ndarray:
    """Return the values (k, s) of `_taken` at as many Gauss points of a piece as `among` says."""
    nodes, weights, _ = gauss(among)
    return _taken(count, nodes, weights)


def _taken(count: int, at: np.ndarray, measure: np.ndarray) -> np.ndarray:
    """Return the values (k, s) at points (k,) of weights `measure` (k,) of the polynomials that are
    a piece's own values at its s Gauss points, all times the roots of their weights: its columns
    are orthonormal.
    """
    nodes, weights, _ = gauss(count)
    roots = np.sqrt(measure[:, None] / weights)
    basis, wanted = (np.vander(each, count, increasing=True) for each in (nodes, at))
    return np.array(roots * np.linalg.solve(basis.T, wanted.T).T)


@cache
def hermite(steps: int, nodes: tuple[float, ...], among: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the weights (k, s + 1) of values at the ends of s equal steps of [0, 1] and of slopes
    there, by the step, in values at k nodes: of the polynomials that have both at those `among` the
    ends that are next to a node.
    """
    at, own = steps * np.array(nodes), np.arange(among)
    first = np.clip(np.rint(at - 0.5 * (among - 1)).astype(int), 0, steps + 1 - among)
    away = (at - first)[:, None] - own
    apart = own[:, None] - own + np.eye(among)
    others = np.where(np.eye(among, dtype=bool), 1.0, away[:, None, :])
    basis = (others / apart).prod(axis=2)
    slopes = (1.0 / apart).sum(axis=1) - 1.0
    values, turns = np.zeros((2, len(nodes), steps + 1))
    places = np.arange(len(nodes))[:, None], first[:, None] + own
    values[places] = (1.0 - 2.0 * slopes * away) * basis**2
    turns[places] = away * basis**2
    return values, turns

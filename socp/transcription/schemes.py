"""Collocation schemes as tables: nodes, A, B and weights of the defects A X - (h/2) B F = 0 on [-1,
1].
"""

from dataclasses import dataclass
from functools import cache
from typing import Literal, final

import numpy as np

from socp.errors import MethodError
from socp.model import differentiation, legendre

Side = Literal["left", "right", "both"]


@final
@dataclass(frozen=True, eq=False)
class Scheme:
    """A collocation scheme on one interval of length h, mapped to [-1, 1].

    nodes (p,) with nodes[0] = -1 and nodes[-1] = 1; A (m, p) and B (m, p) give the m = p - 1
    defects per state; weights (p,) integrate over [-1, 1]; a node of weight zero carries no
    control. `order` is that of the global error.
    """

    name: str
    nodes: np.ndarray
    A: np.ndarray
    B: np.ndarray
    weights: np.ndarray
    order: int

    @property
    def side(self) -> Side:
        """Which end nodes are collocated."""
        left, right = self.weights[0] > 0, self.weights[-1] > 0
        return "both" if left and right else "left" if left else "right"


Row = list[float]


def _scheme(name: str, nodes: Row, A: list[Row], B: list[Row], weights: Row, order: int) -> Scheme:
    return Scheme(name, np.array(nodes), np.array(A), np.array(B), np.array(weights), order)


@cache
def euler() -> Scheme:
    """Implicit Euler: x1 - x0 = h f1."""
    return _scheme("implicit Euler", [-1, 1], [[-1, 1]], [[0, 2]], [0, 2], 1)


@cache
def trapezoid() -> Scheme:
    """Trapezoid rule: x1 - x0 = h/2 (f0 + f1)."""
    return _scheme("trapezoid", [-1, 1], [[-1, 1]], [[1, 1]], [1, 1], 2)


@cache
def hermite_simpson() -> Scheme:
    """Hermite-Simpson, separated form (Betts, Practical Methods, 4.6): Lobatto IIIA with three
    points.
    """
    return _scheme(
        "Hermite-Simpson",
        [-1, 0, 1],
        [[-1 / 2, 1, -1 / 2], [-1, 0, 1]],
        [[1 / 4, 0, -1 / 4], [1 / 3, 4 / 3, 1 / 3]],
        [1 / 3, 4 / 3, 1 / 3],
        4,
    )


@cache
def lgr(points: int) -> Scheme:
    """Legendre-Gauss-Radau with -1 collocated and +1 not (Garg et al., Automatica 46, 2010, section
    3.3).
    """
    tau, weights = radau(points)
    nodes = np.append(tau, 1.0)
    B = np.hstack([np.eye(points), np.zeros((points, 1))])
    return Scheme(
        f"LGR {points}",
        nodes,
        differentiation(nodes)[:-1],
        B,
        np.append(weights, 0.0),
        2 * points - 1,
    )


@cache
def radau_iia(points: int) -> Scheme:
    """Radau IIA: the flipped LGR points, +1 collocated and -1 not (Hairer, Wanner, Solving ODEs II,
    IV.5).
    """
    tau, weights = radau(points)
    nodes = np.append(-1.0, -tau[::-1])
    B = np.hstack([np.zeros((points, 1)), np.eye(points)])
    A, weights = differentiation(nodes)[1:], np.append(0.0, weights[::-1])
    return Scheme(f"Radau IIA {points}", nodes, A, B, weights, 2 * points - 1)


def radau(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the LGR points (n,) on [-1, 1), roots of P_{n-1} + P_n, and their weights (n,)."""
    if points < 1:
        raise MethodError(f"LGR points: {points} where 1 or more are needed")
    # the weights lose a digit or two to the recurrence: keep spare ones
    tau = np.append(-1.0, _roots(points - 1)).astype(np.longdouble)
    for _ in range(2):  # Newton takes the last digits
        value, slope = _radau_polynomial(points, tau[1:])
        tau[1:] -= value / slope
    weights = (1.0 - tau) / (points * legendre(points, tau)[points - 1]) ** 2
    weights[0] = np.longdouble(2.0) / points**2
    return tau.astype(float), weights.astype(float)


def _roots(count: int) -> np.ndarray:
    """Return the roots (n,) of the Jacobi polynomial P_n^(0, 1), eigenvalues of the matrix of its
    recurrence (Golub, Welsch, Math. Comp. 23, 1969).
    """
    k = np.arange(count)
    beside = np.sqrt(k * (k + 1.0)) / (2.0 * k + 1.0)
    matrix = np.diag(1.0 / ((2.0 * k + 1.0) * (2.0 * k + 3.0))) + np.diag(beside[1:], -1)
    roots: np.ndarray = np.linalg.eigvalsh(matrix)
    return roots


def _radau_polynomial(points: int, tau: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return P_{n-1} + P_n and its derivative at tau inside (-1, 1)."""
    P = legendre(points, tau)
    derivative = [
        n * (P[n - 1] - tau * P[n]) / (1.0 - tau**2) if n else 0.0 * tau
        for n in (points - 1, points)
    ]
    return P[points - 1] + P[points], derivative[0] + derivative[1]

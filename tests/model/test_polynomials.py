"""Polynomials through nodes, against 40-digit arithmetic and against closed forms."""

import tracemalloc
from typing import Literal

import mpmath
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from socp.model.polynomials import (
    barycentric,
    coincident,
    differentiation,
    lagrange,
    legendre,
    legendre_coefficients,
    piecewise,
)
from socp.model.result.arc import Arc, Which, in_arcs
from socp.model.word import Mode
from socp.transcription.schemes import lgr

POINTS = [1, 2, 3, 4, 5, 7, 10, 15, 20, 30, 40, 50, 60]


@given(st.integers(1, 40), st.floats(1e-6, 1e6), st.floats(-1e3, 1e3), st.integers(0, 2**32 - 1))
def test_the_nodes_themselves_are_met_to_the_bit(
    points: int, span: float, start: float, seed: int
) -> None:
    nodes = start + span * (lgr(points).nodes + 1) / 2
    values = np.random.default_rng(seed).normal(size=(2, points + 1))
    np.testing.assert_array_equal(lagrange(nodes, values, nodes), values)


@pytest.mark.parametrize("points", POINTS)
def test_differentiation_is_exact_for_every_polynomial_it_can_hold(points: int) -> None:
    nodes = lgr(points).nodes
    D = differentiation(nodes)
    for degree in range(points + 1):
        coefficients = np.eye(points + 1)[degree]
        slope = np.polynomial.legendre.legval(nodes, np.polynomial.legendre.legder(coefficients))
        x = np.polynomial.legendre.legval(nodes, coefficients)
        np.testing.assert_allclose(D @ x, slope, atol=3e-15 * np.abs(D).max() * nodes.size)


@pytest.mark.parametrize("points", [2, 5, 20, 60])
def test_differentiation_against_40_digits(points: int) -> None:
    nodes = lgr(points).nodes
    D = differentiation(nodes)
    with mpmath.workdps(40):
        exact = [mpmath.mpf(node) for node in nodes]
        weights = [1 / mpmath.fprod(a - b for b in exact if b != a) for a in exact]
        i, j = points // 2, 0  # an entry between the middle and an end, where cancellation is worst
        value = weights[j] / weights[i] / (exact[i] - exact[j])
    assert D[i, j] == pytest.approx(float(value), rel=1e-13)


def test_barycentric_weights_neither_overflow_nor_vanish() -> None:
    weights = barycentric(lgr(60).nodes)
    assert np.isfinite(weights).all()
    assert np.abs(weights).max() < 1e3
    assert np.abs(weights).min() > 1e-6 * np.abs(weights).max()
    assert (np.sign(weights[1:]) == -np.sign(weights[:-1])).all()


def test_barycentric_weights_of_three_nodes_by_hand() -> None:
    # 1 / ((a - b) (a - c)): 1/2, -1, 1/2 on -1, 0, 1
    weights = barycentric(np.array([-1.0, 0.0, 1.0]))
    np.testing.assert_allclose(weights / weights[0], [1.0, -2.0, 1.0], rtol=1e-15)


def test_legendre_polynomials_by_formula() -> None:
    tau = np.linspace(-1, 1, 7)
    rows = [np.ones(7), tau, (3 * tau**2 - 1) / 2, (5 * tau**3 - 3 * tau) / 2]
    for degree in range(4):
        np.testing.assert_allclose(legendre(degree, tau), rows[: degree + 1], atol=1e-15)


@pytest.mark.parametrize("points", [1, 4, 10])
def test_coefficients_give_the_polynomial_back_and_begin_with_its_mean(points: int) -> None:
    t = 3.0 + 0.25 * (lgr(points).nodes + 1.0)  # on (3, 3.5)
    exact = np.random.default_rng(points).normal(size=(points + 1, 2, 3))
    values = np.einsum("kn,kij->nij", legendre(points, lgr(points).nodes), exact)
    found = legendre_coefficients(t, values, (3.0, 3.5))
    np.testing.assert_allclose(found, exact, atol=1e-12)
    mean = legendre_coefficients(t, np.sin(t), (3.0, 3.5))[0]
    if points == 10:
        assert mean == pytest.approx((np.cos(3.0) - np.cos(3.5)) / 0.5, rel=1e-14)


def test_nodes_merge_where_rounding_is_all_that_parts_them() -> None:
    assert coincident(np.array([1.0, 1.0 + 2e-16]))
    assert coincident(np.array([1.0, 0.5]))
    assert not coincident(np.array([1.0, 1.0 + 1e-14]))
    assert not coincident(np.array([2.0]))
    # straight lines where they do
    t = np.array([1.0, 1.0 + 2e-16, 1.0 + 4e-16])
    np.testing.assert_array_equal(lagrange(t, np.array([[0.0, 1.0, 2.0]]), t[:1]), [[0.0]])


@pytest.mark.parametrize("side", ["left", "right", "both"])
@pytest.mark.parametrize("which", ["x", "u"])
def test_many_intervals_at_once_are_what_each_is(
    side: Literal["left", "right", "both"], which: Literal["x", "u"]
) -> None:
    random = np.random.default_rng(3)
    mesh = np.cumsum([0, 4, 2, 5, 4, 4, 2, 5, 2, 4])  # of several counts of nodes
    t = np.arange(mesh[-1] + 1.0) + 0.2 * random.random(mesh[-1] + 1)
    t[3:5] = t[3]  # two nodes in one
    values = random.standard_normal((3, t.size))
    values[0, 7] = np.inf
    arc = Arc(t=t, x=values, u=values, costate=values, mesh=mesh, side=side, modes=())
    at = np.concatenate([np.linspace(t[0], t[-1], 200), t])
    interval = np.clip(np.searchsorted(t[mesh], at, side="right") - 1, 0, mesh.size - 2)
    wanted = np.empty((3, at.size))
    for k in range(mesh.size - 1):
        nodes = arc.nodes(k, which)
        wanted[:, interval == k] = lagrange(t[nodes], values[:, nodes], at[interval == k])
    assert arc.at(at, which) == pytest.approx(wanted, rel=1e-13, abs=1e-13, nan_ok=True)


@pytest.mark.parametrize("which", ["x", "u"])
def test_arcs_looked_at_together_have_each_its_own_values(which: Which) -> None:
    """The time to the power of the arc's number, for a state that goes on and for one that jumps
    where arcs meet; at such a time each arc has its own.
    """
    meshes = np.array([0, 3, 5, 8]), np.array([0, 4]), np.array([0, 4, 8])
    arcs, times = [], []
    for k, mesh in enumerate(meshes):
        t = k + np.arange(mesh[-1] + 1.0) / mesh[-1]
        rows = np.array([t, t**k])
        modes = (Mode("free"),) * 2
        arcs.append(Arc(t=t, x=rows, u=rows, costate=rows, mesh=mesh, side="left", modes=modes))
        times.append(np.concatenate([np.linspace(k, k + 1.0, 7 + k), t[mesh]]))
    for k, found in enumerate(in_arcs(arcs, which, times)):
        assert found == pytest.approx(np.array([times[k], times[k] ** k]), rel=1e-13)
        assert found == pytest.approx(arcs[k].at(times[k], which), rel=1e-13)


def test_of_many_polynomials_those_asked_for_are_worked_on_alone() -> None:
    """The parabola t^2 on a hundred thousand intervals, at three times."""
    many, on = 100_000, np.array([70_000, 5, 70_000])
    nodes = np.arange(many)[:, None] + np.array([0.0, 0.5, 1.0])
    values, t = nodes[None] ** 2, on + np.array([0.2, 0.5, 0.9])
    tracemalloc.start()
    found = piecewise(nodes, values, t, on)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    np.testing.assert_allclose(found[0], t**2, rtol=1e-9)
    assert most < 0.1 * nodes.nbytes


def test_coefficients_of_many_intervals_are_those_of_each() -> None:
    random = np.random.default_rng(3)
    nodes, values = np.sort(random.uniform(size=(5, 4))), random.normal(size=(5, 4, 2))
    first, last = nodes[:, 0] - 0.1, nodes[:, -1] + 0.2
    together = legendre_coefficients(nodes, values, (first, last))
    for k in range(5):
        own = legendre_coefficients(nodes[k], values[k], (first[k], last[k]))
        assert together[k] == pytest.approx(own, rel=1e-13)
    none = legendre_coefficients(nodes[:0], values[:0], (first[:0], last[:0]))
    assert none.shape == (0, 4, 2)


@pytest.mark.parametrize("side", ["left", "right", "both"])
def test_means_over_intervals_are_those_of_the_polynomials_through_their_nodes(
    side: Literal["left", "right", "both"],
) -> None:
    """Of t^2 over intervals with 4, 3 and 4 nodes, all but those that a side leaves out."""
    mesh = np.array([0, 3, 5, 8])
    t = np.array([0.0, 0.2, 0.7, 1.0, 1.4, 2.0, 2.3, 2.9, 3.5])
    rows = np.zeros((1, t.size))
    arc = Arc(t=t, x=rows, u=rows, costate=rows, mesh=mesh, side=side, modes=(Mode("free"),))
    ends = t[mesh]
    wanted = (ends[1:] ** 3 - ends[:-1] ** 3) / 3 / np.diff(ends)
    if side != "both":  # two nodes are left in the middle: a straight line between them
        a, b = (t[3], t[4]) if side == "left" else (t[4], t[5])
        wanted[1] = (a + b) * 1.5 - a * b
    assert arc.means(t**2) == pytest.approx(wanted, rel=1e-13)

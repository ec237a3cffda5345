"""Collocation tables against 40-digit arithmetic, and the identities that make them collocation."""

from functools import cache
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from known_schemes import every

from socp.errors import MethodError
from socp.transcription.schemes import Scheme, euler, lgr, radau, radau_iia

POINTS = [1, 2, 3, 4, 5, 7, 10, 15, 20, 30, 40, 50, 60]
SCHEMES = every(POINTS)
NAMES = [scheme.name for scheme in SCHEMES]


@cache
def exact_radau(points: int) -> tuple[list[mpmath.mpf], list[mpmath.mpf]]:
    """Return the LGR points and weights to 40 digits: Newton on P_{n-1} + P_n, weights (1 - tau) /
    (n P_{n-1})^2.
    """
    with mpmath.workdps(40):
        found = [mpmath.mpf(-1)]
        for guess in radau(points)[0][1:]:
            root = mpmath.findroot(
                lambda tau: mpmath.legendre(points - 1, tau) + mpmath.legendre(points, tau),
                mpmath.mpf(guess),
            )
            found.append(root)
        weights = [(1 - tau) / (points * mpmath.legendre(points - 1, tau)) ** 2 for tau in found]
        return found, weights


@pytest.mark.parametrize("points", POINTS)
def test_radau_nodes_and_weights_have_14_digits(points: int) -> None:
    tau, weights = radau(points)
    exact_tau, exact_weights = exact_radau(points)
    with mpmath.workdps(40):
        assert abs(mpmath.fsum(exact_weights) - 2) < 1e-35  # the reference itself
        assert all(a < b for a, b in pairwise(exact_tau))  # as many roots as points
        assert max(abs(mpmath.mpf(a) - b) for a, b in zip(tau, exact_tau, strict=True)) < 1e-14
        assert (
            max(abs(mpmath.mpf(a) - b) for a, b in zip(weights, exact_weights, strict=True)) < 1e-14
        )


@pytest.mark.parametrize("points", POINTS)
def test_radau_quadrature_is_exact_to_degree_2n_minus_2(points: int) -> None:
    tau, weights = radau(points)
    for degree in {0, 1, points, 2 * points - 2}:
        if degree <= 2 * points - 2:
            exact = 2.0 / (degree + 1) if degree % 2 == 0 else 0.0
            assert weights @ tau**degree == pytest.approx(exact, abs=2e-14)
    squared = (
        np.polynomial.legendre.legval(tau, np.eye(points + 1)[points]) ** 2
    )  # degree 2n: not integrated exactly
    assert abs(weights @ squared - 2.0 / (2 * points + 1)) > 1e-3 / points


@pytest.mark.parametrize("scheme", SCHEMES, ids=NAMES)
def test_shapes_and_ends(scheme: Scheme) -> None:
    p = scheme.nodes.size
    assert scheme.A.shape == scheme.B.shape == (p - 1, p)
    assert (scheme.nodes[0], scheme.nodes[-1]) == (-1.0, 1.0)
    assert (np.diff(scheme.nodes) > 0).all()
    assert (scheme.weights >= 0).all()
    assert scheme.weights.sum() == pytest.approx(2.0, abs=1e-14)
    collocated = {"left": slice(0, -1), "right": slice(1, None), "both": slice(0, None)}[
        scheme.side
    ]
    assert (scheme.weights[collocated] > 0).all()
    assert np.count_nonzero(scheme.weights) == scheme.weights[collocated].size


@pytest.mark.parametrize("scheme", SCHEMES, ids=NAMES)
def test_constants_and_straight_lines_have_no_defect(scheme: Scheme) -> None:
    size = np.abs(scheme.A).max()
    ones = np.ones(scheme.nodes.size)
    np.testing.assert_allclose(scheme.A @ ones, 0.0, atol=1e-14 * size)
    np.testing.assert_allclose(scheme.A @ scheme.nodes, scheme.B @ ones, atol=1e-14 * size)


def polynomial_degree(scheme: Scheme) -> int:
    """Return the degree of the polynomials x(tau) that the defects reproduce: the stage order of
    the method.
    """
    return scheme.nodes.size - (scheme.side != "both")  # one more for every collocated node


@pytest.mark.parametrize("scheme", SCHEMES, ids=NAMES)
def test_defects_vanish_for_polynomials_up_to_the_schemes_degree_and_no_further(
    scheme: Scheme,
) -> None:
    top = polynomial_degree(scheme)
    scale = np.abs(scheme.A).max() * scheme.nodes.size
    for degree in range(top + 2):
        coefficients = np.eye(top + 2)[
            degree
        ]  # Legendre polynomials: powers would lose the digits themselves
        x = np.polynomial.legendre.legval(scheme.nodes, coefficients)
        rate = np.polynomial.legendre.legval(
            scheme.nodes, np.polynomial.legendre.legder(coefficients)
        )
        defect = np.abs(scheme.A @ x - scheme.B @ rate).max()
        if degree <= top:
            assert defect < 1e-13 * scale
        else:
            assert defect > 1e-2


@pytest.mark.parametrize("scheme", SCHEMES, ids=NAMES)
def test_the_weights_are_what_the_defects_integrate(scheme: Scheme) -> None:
    # some combination c of the defects is x(1) - x(-1) = weights . f: the quadrature the covector
    # map rests on
    difference = np.zeros(scheme.nodes.size)
    difference[[0, -1]] = -1.0, 1.0
    c = np.linalg.lstsq(scheme.A.T, difference, rcond=None)[0]
    np.testing.assert_allclose(scheme.A.T @ c, difference, atol=1e-12)
    np.testing.assert_allclose(scheme.B.T @ c, scheme.weights, atol=1e-13)


def test_every_scheme_is_found() -> None:
    names = {scheme.name for scheme in every([2])}
    assert {"implicit Euler", "trapezoid", "Hermite-Simpson", "LGR 2", "Radau IIA 2"} <= names


def test_radau_iia_with_one_point_is_implicit_euler() -> None:
    np.testing.assert_allclose(radau_iia(1).A, euler().A / 2, atol=1e-16)
    np.testing.assert_allclose(radau_iia(1).B, euler().B / 2, atol=1e-16)
    np.testing.assert_array_equal(radau_iia(1).weights, euler().weights)


@pytest.mark.parametrize("points", [0, -3])
def test_no_points_are_refused(points: int) -> None:
    with pytest.raises(MethodError, match=f"LGR points: {points} where 1 or more are needed"):
        lgr(points)


def test_the_smallest_tables_by_hand() -> None:
    np.testing.assert_allclose(radau(1)[0], [-1.0])
    np.testing.assert_allclose(radau(2)[0], [-1.0, 1.0 / 3.0], atol=1e-16)
    np.testing.assert_allclose(radau(2)[1], [1.0 / 2.0, 3.0 / 2.0], atol=1e-15)

"""Minima and maxima of a word told apart, and what is claimed of either."""

from math import cos, pi, sin

import casadi
import numpy as np
import pytest
from saddles import HORIZON, along, held, saddle, slope, thrown
from scipy.optimize import brentq

from socp import (
    Problem,
    Solution,
    controls,
    default_guess,
    final_time,
    run,
    states,
    time,
)
from socp.model.data.files import from_json, to_json
from socp.model.ladder.second_order import Minimum, SecondOrder
from socp.registry.plugins import Registry
from socp.registry.standard import regulator
from socp.verdict.minimum.induced import Pair, induced
from socp.verdict.minimum.order import second_order, with_second_order
from socp.view.outcomes import Outcome, outcome_of


def ordered(problem: Problem, solution: Solution) -> SecondOrder:
    assert solution.verdict is not None
    assert solution.extremal, solution.verdict.reasons
    return second_order(problem, solution)


@pytest.mark.parametrize("k", [-3.0, -1.0, -0.5, 1.5, 2.0, 5.0])
def test_the_saddle_family_in_closed_form(k: float) -> None:
    """J''(s) = 2 (1 - 2 k) at s = 3 (k - 1) / (2 k - 1); with both lengths moved by T / sqrt 2 that
    is 9 (1 - 2 k).
    """
    switch = HORIZON * (k - 1) / (2 * k - 1)
    problem = saddle(k)
    found = ordered(problem, held(problem, "u: + -", [switch, HORIZON - switch]))
    assert found.word is not None
    assert found.word.free == 1
    assert found.word.least == pytest.approx(9 * (1 - 2 * k), rel=1e-9)
    assert found.word.error < 1e-6
    if k < 0:
        assert found.kind is Minimum.STRONG
        assert found.margin is not None
        assert found.margin > 1
        assert found.theorem.startswith("Agrachev, Stefani, Zezza")
    else:
        assert found.kind is Minimum.NONE
        assert found.descent is not None
        moved = found.descent.times[1]  # J is a parabola in s: the prediction is exact
        assert found.descent.found == pytest.approx((1 - 2 * k) * moved**2, rel=1e-6)
        assert found.descent.predicted == pytest.approx(found.descent.found, rel=1e-6)


def test_the_margin_of_strict_signs_in_closed_form() -> None:
    """At k = -1 and s = 2 the switching function is t - 3 + x(3) = t - 2, and the terms of H add up
    to at most 2. The slope is 1 over the horizon of 3: 3000 times 1e-3; the looks nearest to the
    switch are a fortieth of an arc away, 0.025 on the second one: 2500 times 1e-5.
    """
    problem = saddle(-1.0)
    found = ordered(problem, held(problem, "u: + -", [2.0, 1.0]))
    assert found.margin == pytest.approx(2500, rel=1e-6)


@pytest.mark.parametrize(("k", "a"), [(2.0, 0.1), (3.0, -0.2), (-1.0, 0.2), (-2.0, -0.3)])
def test_the_saddle_family_with_a_drift(k: float, a: float) -> None:
    switch = brentq(slope, 0.05, 2.95, args=(k, a), xtol=1e-14)
    problem = saddle(k, a)
    curvature = (slope(switch + 1e-4, k, a) - slope(switch - 1e-4, k, a)) / 2e-4
    found = ordered(problem, held(problem, "u: + -", [switch, HORIZON - switch]))
    assert found.word is not None
    assert found.word.least == pytest.approx(4.5 * curvature, rel=1e-6)
    assert found.kind is (Minimum.STRONG if curvature > 0 else Minimum.NONE)


def test_an_extremal_that_is_none_of_the_lowest_is_no_answer() -> None:
    problem = saddle(2.0)
    solution = with_second_order(problem, held(problem, "u: + -", [1.0, 2.0]))
    assert solution.extremal
    assert outcome_of(solution) is Outcome.NO_MINIMUM
    again = from_json(to_json(solution))
    assert again.verdict is not None
    assert solution.verdict is not None
    assert again.verdict.second_order == solution.verdict.second_order


def test_where_every_switch_is_as_good_the_second_order_decides_nothing() -> None:
    """With k = 1/2 and 3/2 x(3) the objective is -9/4 for every switch: J(s) = -3 s + 9/4 + 3/2 (2
    s - 3).
    """
    problem = saddle(0.5, tilt=1.5)
    found = ordered(problem, held(problem, "u: + -", [1.2, 1.8]))
    assert found.kind is Minimum.DEGENERATE
    assert found.word is not None
    assert abs(found.word.least) < 1e-6


def dubins(turns: list[float]) -> Problem:
    """Shortest path of turns left, right, left by given angles, between its ends."""
    x, y, theta = states("x y theta")
    u = controls("u")
    at, heading = np.zeros(2), 0.0
    for sign, turn in zip((1, -1, 1), turns, strict=True):
        new = heading + sign * turn
        at = at + sign * np.array([sin(new) - sin(heading), cos(heading) - cos(new)])
        heading = new
    return Problem(
        name="dubins",
        minimise=final_time,
        dynamics={x: casadi.cos(theta), y: casadi.sin(theta), theta: u},
        bounds={u: (-1, 1)},
        start={x: 0, y: 0, theta: 0},
        end={x: at[0], y: at[1], theta: heading},
    )


@pytest.mark.slow
def test_three_turns_on_both_sides_of_pi() -> None:
    """H = 1 + p cos(theta - phi) - |sigma| = 0 with sigma = 0 at the ends of the middle arc: it
    turns by 2 arccos(-1/p) > pi. Three lengths meet three conditions.
    """
    turns = [0.7, 4.2, 0.9]
    problem = dubins(turns)
    solution = along(problem, "u: + - +", turns, held(problem, "u: + - +", turns))
    found = ordered(problem, solution)
    assert found.kind is Minimum.STRONG
    assert found.word is not None
    assert found.word.free == 0
    turns = [0.7, 2.2, 0.9]
    assert pi > 2.2
    problem = dubins(turns)
    solution = along(problem, "u: + - +", turns, held(problem, "u: + - +", turns))
    assert np.diff([0, *solution.junctions]) == pytest.approx(turns[:2], abs=1e-6)
    assert not solution.extremal


def test_minimum_time_of_van_der_pol_to_a_circle() -> None:
    """From (1, 1) to the circle of radius 0.2: one switch at 0.713936, tf = 2.864192, positive
    definite (Maurer, Büskens, Kim, Kaya, Optim. Control Appl. Meth. 26, 2005, section 5).
    """
    x, v = states("x v")
    u = controls("u")
    problem = Problem(
        name="vdp_time",
        minimise=final_time,
        dynamics={x: v, v: -x + v * (1 - x**2) + u},
        bounds={u: (-1, 1)},
        start={x: 1, v: 1},
        target={"circle": x**2 + v**2 == 0.04},
    )
    solution = along(problem, "u: - +", [0.7, 2.1])
    assert solution.junctions[0] == pytest.approx(0.713936, abs=1e-6)
    assert solution.final_time == pytest.approx(2.864192, abs=1e-6)
    found = ordered(problem, solution)
    assert found.kind is Minimum.STRONG
    assert found.word is not None
    assert found.word.free == 1


def test_a_singular_arc_in_closed_form() -> None:
    """Integral of x^2 with x' = u: after Goh's transformation the second variation is the integral
    of w^2 over the singular arc, half of the horizon T = 2; in units of 2 T for w and a norm over
    the horizon that is 1/2 64 |w|^2. Moving the switch is a change of w.
    """
    problem = regulator().problem
    found = ordered(problem, along(problem, "u: - s", [1.0, 1.0]))
    assert found.kind is Minimum.WORD
    assert found.singular is not None
    assert found.singular.least == pytest.approx(64.0, rel=1e-9)
    assert found.singular.positive
    assert found.limits[0].endswith("an impulse where a singular arc ends costs nothing")


def test_a_bang_arc_behind_a_singular_one_in_closed_form() -> None:
    """Integral of x^2 with y' = x, x' = u, less l^2 x and 1/4 (y - l^2 / 2)^2 at the end: at rest,
    and then u = 1 for a time l. Changes are w at rest, that of x behind it is h, and the form is
    the integral of w^2 with l h^2 less 1/4 (integral of w + l h)^2. In units of 2 T and over the
    horizon for w, only its mean and h are coupled.
    """
    y, x = states("y x")
    u, horizon, last = controls("u"), 2.0, 0.5
    problem = Problem(
        name="behind",
        minimise=-(last**2) * x - (y - last**2 / 2) ** 2 / 4,
        running=x**2,
        dynamics={y: x, x: u},
        bounds={u: (-1, 1)},
        start={y: 0, x: 0},
        final_time=horizon,
    )
    found = ordered(problem, along(problem, "u: s +", [horizon - last, last]))
    mean = 2 * horizon * np.array([np.sqrt(horizon * (horizon - last)), last])
    own = np.diag(2 * (2 * horizon) ** 2 * np.array([horizon, last]))
    assert found.singular is not None
    wanted = np.linalg.eigvalsh(own - 0.5 * np.outer(mean, mean))[0]
    assert found.singular.least == pytest.approx(wanted, rel=1e-9)
    assert found.singular.positive


@pytest.mark.parametrize("coupling", [0.0, 1.0])
def test_a_singular_arc_beside_a_boundary_arc(coupling: float) -> None:
    """Integral of x^2 - y with x' = u, y' = v + c u and y <= 1: v keeps y at 1 whatever u does, so
    that w costs what it does without y. With c, the law along the boundary is another with u free.
    """
    x, y = states("x y")
    u, v = controls("u v")
    problem = Problem(
        name="beside",
        running=x**2 - y,
        dynamics={x: u, y: v + coupling * u},
        bounds={u: (-1, 1), v: (-3, 3), y: (-5, 1)},
        start={x: 1, y: 0.5},
        final_time=2,
    )
    first = 0.5 / (3.0 - coupling)
    found = ordered(problem, along(problem, "u: - - s; v: + b b", [first, 1.0 - first, 1.0]))
    assert found.kind is Minimum.WORD
    assert found.singular is not None
    assert found.singular.least == pytest.approx(64.0, rel=1e-9)
    assert "boundary arcs kept, is positive definite" in found.limits[1]


@pytest.mark.parametrize(("horizon", "positive"), [(1.2, True), (1.5, True), (1.65, False)])
def test_a_conjugate_point_on_a_singular_arc(horizon: float, positive: bool) -> None:
    """Integral of x^2 - y^2 with y' = x, x' = u from rest: at rest all is singular, and with w for
    x the form is the integral of w^2 - y^2, y' = w: positive up to T = pi / 2.

    At y = sin(pi t / 2 T) its eigenvalue is 2 (1 - (2 T / pi)^2) in w^2, which is measured in 2 T
    and over the horizon.
    """
    y, x = states("y x")
    u = controls("u")
    problem = Problem(
        name="conjugate",
        running=x**2 - y**2,
        dynamics={y: x, x: u},
        bounds={u: (-1, 1)},
        start={y: 0, x: 0},
        final_time=horizon,
    )
    found = ordered(problem, along(problem, "u: s", [horizon]))
    assert found.singular is not None
    wanted = 2 * (1 - (2 * horizon / pi) ** 2) * (2 * horizon) ** 2 * horizon
    assert found.singular.least == pytest.approx(wanted, rel=1e-6)
    assert found.singular.positive is positive
    assert found.singular.negative is not positive
    assert ("negative" in found.limits[0]) is not positive


@pytest.mark.parametrize(
    ("cycles", "kappa", "amplitude", "settles"),
    [
        (4, 9.0, 0.5, True),
        (4, 10.5, 0.5, True),
        (112, 14.0, 0.5, False),
        (64, 9.0, 0.9, False),
        (88, 9.0, 0.5, False),
    ],
)
def test_coefficients_that_vary_faster_than_the_points_of_their_pieces(
    registry: Registry, cycles: int, kappa: float, amplitude: float, *, settles: bool
) -> None:
    """Integral of a (q^2 - kappa p^2) with p' = a q, q' = u from rest to p = 0, a = 1 + A cos(2 pi
    cycles t): in the time that is the integral of a, which ends at 1, the form in q of zero mean is
    positive up to kappa = pi^2 whatever a is. A cycle or more between points looks like another a.
    """
    p, q = states("p q")
    u = controls("u")
    a = 1 + amplitude * casadi.cos(2 * pi * cycles * time)
    problem = Problem(
        name="uneven",
        running=a * (q**2 - kappa * p**2),
        dynamics={p: a * q, q: u},
        bounds={u: (-1, 1)},
        start={p: 0, q: 0},
        end={p: 0},
        final_time=1,
    )
    method = registry.method("lgr-multiphase")(word="u: s")
    found = ordered(problem, run(method, problem, default_guess(problem)))
    assert (found.singular is not None) is settles
    if found.singular is not None:
        assert found.singular.positive is (kappa < pi**2)
        assert found.singular.negative is (kappa > pi**2)


@pytest.mark.parametrize(
    ("text", "start", "lengths"),
    [("u: - s; v: - s", 1.0, [1.0, 1.0]), ("u: - - s; v: - s s", 0.5, [0.5, 0.5, 1.0])],
)
def test_two_singular_controls_in_closed_form(
    text: str, start: float, lengths: list[float]
) -> None:
    """Integral of x^2 + y^2 + x y with x' = u, y' = v over T = 2: with w and z for x and y the form
    is that integral of w and z itself. Its matrix (2, 1; 1, 2) has 1 for its least eigenvalue, in
    units of 2 T and over the horizon. The arcs begin at one time, or one after the other.
    """
    x, y = states("x y")
    u, v = controls("u v")
    problem = Problem(
        name="regulators",
        running=x**2 + y**2 + x * y,
        dynamics={x: u, y: v},
        bounds={u: (-1, 1), v: (-1, 1)},
        start={x: 1, y: start},
        final_time=2,
    )
    found = ordered(problem, along(problem, text, lengths))
    assert found.kind is Minimum.WORD
    assert found.singular is not None
    assert found.singular.least == pytest.approx(32.0, rel=1e-9)
    assert found.singular.positive
    assert "no theorem is checked for singular arcs" in found.limits[-1]


@pytest.mark.parametrize(("horizon", "positive"), [(1.05, True), (1.2, False)])
def test_a_conjugate_point_of_two_singular_controls(horizon: float, positive: bool) -> None:
    """Integral of x^2 + y^2 - z^2 with z' = x + y, x' = u, y' = v from rest: with w for x and for y
    it is that of 2 w^2 - z^2, z' = 2 w, at its least: positive up to T = pi / (2 sqrt 2).
    """
    x, y, z = states("x y z")
    u, v = controls("u v")
    problem = Problem(
        name="conjugate",
        running=x**2 + y**2 - z**2,
        dynamics={z: x + y, x: u, y: v},
        bounds={u: (-1, 1), v: (-1, 1)},
        start={x: 0, y: 0, z: 0},
        final_time=horizon,
    )
    found = ordered(problem, along(problem, "u: s; v: s", [horizon]))
    assert found.singular is not None
    wanted = 2 * (1 - 2 * (2 * horizon / pi) ** 2) * (2 * horizon) ** 2 * horizon
    assert found.singular.least == pytest.approx(wanted, rel=1e-6)
    assert (found.singular.positive, found.singular.negative) == (positive, not positive)


def test_two_singular_controls_whose_fields_do_not_commute() -> None:
    """At rest all of x' = u, y' = v, z' = x v - y u is singular with z(T) to be least, and a fast
    circle of radius r, which takes 2 pi r, lowers z by 2 pi r^2: costs of the order of r^2 T do not
    outweigh the rounds that T has time for. Goh's condition, lambda_z = 0, does not hold.
    """
    x, y, z = states("x y z")
    u, v = controls("u v")
    problem = Problem(
        name="heisenberg",
        minimise=z,
        running=(x**2 + y**2) / 2,
        dynamics={x: u, y: v, z: x * v - y * u},
        bounds={u: (-1, 1), v: (-1, 1)},
        start={x: 0, y: 0, z: 0},
        final_time=1,
    )
    found = ordered(problem, along(problem, "u: s; v: s", [1.0]))
    assert found.singular is not None
    assert found.singular.negative
    assert "is negative (Goh's condition does not hold on arc 1)" in found.limits[0]


def pair_of(problem: Problem, solution: Solution) -> Pair:
    found = induced(problem, solution)
    assert isinstance(found, Pair)
    return found


def test_the_matrix_of_the_word_in_closed_form() -> None:
    """One direction moves both lengths against each other, one the speed, each in its own unit."""
    problem = thrown()
    solution = along(problem, "u: + -", [2.0, 1.0])
    assert solution.junctions[0] == pytest.approx(2.0, abs=1e-9)
    found = pair_of(problem, solution)
    units = np.array([HORIZON / np.sqrt(2), found.fine.conditions.size[4]])
    wanted = np.array([[8.8, 3.2], [3.2, 4.8]]) * units[:, None] * units
    values, _, _ = found.fine.spectrum(weak=True)
    assert values == pytest.approx(np.linalg.eigvalsh(wanted), rel=1e-9)
    assert ordered(problem, solution).kind is Minimum.STRONG

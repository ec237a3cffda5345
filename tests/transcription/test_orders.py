"""Observed orders of every scheme in state, objective and costate, on problems whose solutions are
known exactly.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise

import casadi
import numpy as np
import pytest
from known_schemes import FAMILIES, every

from socp.methods.contract import solve_collocated
from socp.methods.guess import default_guess
from socp.model.problem import Problem
from socp.model.result.solution import Solution, Stop
from socp.model.symbols import controls, final_time, initial_time, parameters, states, time
from socp.model.word import Word
from socp.solvers.backends.ipopt import Ipopt
from socp.transcription.mesh import Mesh, uniform
from socp.transcription.phases import PhasedProblem, follow, single_phase
from socp.transcription.schemes import Scheme, euler, hermite_simpson, lgr, radau_iia, trapezoid

x, y, v = states("x y v")
u = controls("u")
k = parameters("k")

SHARP = Ipopt({"tol": 1e-12})

decay = Problem(
    # minimise x(1) + integral of x^2 with x' = -u x^2, 1 <= u <= 2. The control stays at 2 (sigma =
    # -lambda x^2 < 0), so x = 1 / (1 + 2 t); H = x^2 - 2 lambda x^2 is constant and lambda(1) = 1,
    # so H = -1/9 and lambda = (1 + (1 + 2 t)^2 / 9) / 2
    name="decay",
    minimise=x,
    running=x**2,
    dynamics={x: -u * x**2},
    bounds={u: (1, 2)},
    start={x: 1},
    final_time=1,
)
brake = Problem(
    # double integrator to rest in minimum time: tf = 1 + 2 sqrt(3/2), u = - + with the switch at 1
    # + sqrt(3/2); H = lambda_x v + lambda_v u = -1, and lambda_v = 0 at the switch, give lambda_x =
    # 1 / sqrt(3/2), the rate at which lambda_v falls
    name="brake",
    minimise=final_time,
    dynamics={x: v, v: u},
    bounds={u: (-1, 1)},
    start={x: 1, v: 1},
    end={x: 0, v: 0},
)


def solved(phased: PhasedProblem, meshes: list[Mesh], backend: Ipopt = SHARP) -> Solution:
    solution = solve_collocated(phased, meshes, backend, default_guess(phased.of))
    assert solution.stop is Stop.SOLVED
    return solution


@cache
def decay_errors(scheme: Scheme, intervals: int) -> np.ndarray:
    """Return the errors of the state, the objective and the costate at the nodes."""
    solution = solved(single_phase(decay), [uniform(scheme, intervals)])
    (arc,) = solution.arcs
    exact_x, exact_costate = 1 / (1 + 2 * arc.t), (1 + (1 + 2 * arc.t) ** 2 / 9) / 2
    np.testing.assert_allclose(arc.u, 2.0, atol=1e-7)
    ends = arc.mesh  # within the intervals the order is that of the stages
    return np.array(
        [
            np.abs(arc.x[0] - exact_x)[ends].max(),
            abs(solution.objective - 2 / 3),
            np.abs(arc.costate[0] - exact_costate)[ends].max(),
        ]
    )


@pytest.mark.parametrize(
    ("scheme", "order"),
    [(euler(), 1), (trapezoid(), 2), (hermite_simpson(), 4), (radau_iia(2), 3), (lgr(2), 3)],
    ids=lambda value: getattr(value, "name", None),
)
def test_orders_are_those_of_the_books(scheme: Scheme, order: int) -> None:
    assert scheme.order == order


# those of a higher order are down to rounding before it shows; test_schemes has their degrees
SLOW_ENOUGH = [scheme for scheme in every([2]) if scheme.order <= 4]


@pytest.mark.parametrize("scheme", SLOW_ENOUGH, ids=lambda scheme: scheme.name)
def test_observed_order(scheme: Scheme) -> None:
    order, intervals = scheme.order, {1: 100, 2: 40, 3: 16, 4: 10}[scheme.order]
    coarse, fine = decay_errors(scheme, intervals), decay_errors(scheme, 2 * intervals)
    observed = np.log2(coarse / fine)
    assert (observed > order - 0.15).all(), observed
    assert (observed < order + 0.6).all(), observed


@pytest.mark.parametrize("family", FAMILIES)
def test_spectral_convergence(family: Callable[[int], Scheme]) -> None:
    errors = np.array([decay_errors(family(points), 1) for points in (2, 4, 6, 8, 10)])
    # 1 / (1 + 2 t) is analytic within the Bernstein ellipse of radius 2 + sqrt 3 about [0, 1]: that
    # much a point
    assert (errors[1:-1] < errors[:-2] / 3.7**2).all(), errors
    assert (errors[-1] < 1e-9).all(), errors


PIECEWISE = [trapezoid(), hermite_simpson(), lgr(3), lgr(8), radau_iia(3), radau_iia(8)]


@pytest.mark.parametrize("scheme", PIECEWISE, ids=lambda scheme: scheme.name)
def test_sign_and_size_of_the_costate_on_an_analytic_problem(scheme: Scheme) -> None:
    word = Word.parse("- +", ["u"])
    solution = solved(follow(brake, word), [uniform(scheme, 3)] * 2)
    switch, slope = 1 + math.sqrt(1.5), 1 / math.sqrt(1.5)
    assert solution.final_time == pytest.approx(1 + 2 * math.sqrt(1.5), abs=1e-10)
    assert solution.arcs[0].t[-1] == pytest.approx(switch, abs=1e-9)
    assert solution.arcs[0].costate[:, 0] == pytest.approx([0.8164965809, 1.8164965809], abs=1e-9)
    for arc in solution.arcs:
        np.testing.assert_allclose(arc.costate[0], slope, atol=1e-9)
        np.testing.assert_allclose(arc.costate[1], slope * (switch - arc.t), atol=1e-8)
        hamiltonian = arc.costate[0] * arc.x[1] + arc.costate[1] * arc.u[0]
        np.testing.assert_allclose(hamiltonian, -1.0, atol=1e-8)


def test_euler_gives_the_costate_to_first_order() -> None:
    word = Word.parse("- +", ["u"])
    errors = []
    for steps in (50, 100):
        costate = solved(follow(brake, word), [uniform(euler(), steps)] * 2).arcs[0].costate[:, 0]
        errors.append(np.abs(costate - [0.8164965809, 1.8164965809]).max())
    assert 0.8 < math.log2(errors[0] / errors[1]) < 1.2


RATE = 0.7
growth = Problem(
    name="which rate",
    minimise=k,
    dynamics={x: -k * x},
    bounds={},
    start={x: 1},
    end={x: math.exp(-RATE)},
    final_time=1,
)


def test_a_parameter_without_any_control_by_euler_is_known_in_closed_form() -> None:
    # Euler solves (1 + k/N)^-N = exp(-rate)
    steps = 25
    solution = solved(single_phase(growth), [uniform(euler(), steps)])
    assert solution.parameters["k"] == pytest.approx(steps * math.expm1(RATE / steps), abs=1e-10)


def test_a_parameter_by_the_trapezoid_is_known_in_closed_form() -> None:
    # ((1 - k/2N) / (1 + k/2N))^N = exp(-rate), that is k = 2 N tanh(rate / 2N)
    steps = 5
    solution = solved(single_phase(growth), [uniform(trapezoid(), steps)])
    assert solution.parameters["k"] == pytest.approx(
        2 * steps * math.tanh(RATE / (2 * steps)), abs=1e-10
    )


capped = Problem(
    # From rest over a distance of 10 to rest with v <= 3/2: accelerate 3/2, cruise 31/6, brake 3/2,
    # tf = 49/6. On the cruise H = lambda_x v = -1 gives lambda_x = -2/3 for all time, and lambda_v
    # = 0 there with lambda_v' = -lambda_x - mu gives the density mu = 2/3 of the constraint's
    # multiplier: its mass is 2/3 * 31/6 = 31/9. No jump is needed: lambda_v = 2/3 (t - 3/2) on the
    # first arc and 2/3 (t - 20/3) on the last are -1 and +1 at the two ends, so H = -1 there.
    name="capped",
    minimise=final_time,
    dynamics={x: v, v: u},
    bounds={u: (-1, 1), v: (-10, 1.5)},
    start={x: 0, v: 0},
    end={x: 10, v: 0},
)


@pytest.mark.parametrize(
    "scheme", [euler(), radau_iia(2), radau_iia(3), lgr(3)], ids=lambda scheme: scheme.name
)
def test_multiplier_of_a_state_constraint(scheme: Scheme) -> None:
    steps = 200
    (arc,) = solved(single_phase(capped), [uniform(scheme, steps)]).arcs
    h = 49 / 6 / steps  # the switches lie within an interval: all is right to first order
    weights = np.zeros(arc.t.size)
    for first, last in pairwise(arc.mesh):
        weights[first : last + 1] += (arc.t[last] - arc.t[first]) / 2 * scheme.weights
    carried, density = weights > 0, arc.multipliers["v.upper"]
    assert np.isnan(density[~carried]).all()
    assert density[carried] @ weights[carried] == pytest.approx(31 / 9, abs=h)
    np.testing.assert_allclose(arc.costate[0], -2 / 3, atol=h / 10)
    cruise = (arc.t > 2.0) & (arc.t < 6.0)
    np.testing.assert_allclose(density[cruise & carried], 2 / 3, atol=h / 10)
    np.testing.assert_allclose(
        density[cruise & carried], -arc.costate[0, cruise & carried], atol=1e-7
    )
    np.testing.assert_allclose(
        arc.costate[1, arc.mesh[(arc.t[arc.mesh] > 2.0) & (arc.t[arc.mesh] < 6.0)]], 0, atol=h
    )
    outside = (np.abs(arc.t - 49 / 12) > 31 / 12 + h) & carried
    np.testing.assert_allclose(density[outside], 0.0, atol=1e-6)
    np.testing.assert_allclose(arc.multipliers["v.lower"][carried], 0.0, atol=1e-6)


def test_the_start_value_keeps_its_multiplier_from_the_bound() -> None:
    # v = 0 at both ends lies on a bound v >= 0 here: its multiplier is a costate, no part of the
    # constraint's
    from_rest = replace(capped, bounds={u: (-1, 1), v: (0, 1.5)})
    (arc,) = solved(single_phase(from_rest), [uniform(trapezoid(), 49)]).arcs
    assert arc.costate[1, 0] == pytest.approx(-1.0, abs=1e-2)
    np.testing.assert_allclose(arc.multipliers["v.lower"], 0.0, atol=1e-6)


def test_explicit_time_is_time() -> None:
    # x' = u + 3 t^2 with u at its upper bound 1: x(2) - x(1) = 1 + 7
    moving = Problem(
        name="clock",
        minimise=-x,
        dynamics={x: u + 3 * time**2},
        bounds={u: (0, 1)},
        start={x: 0},
        initial_time=1,
        final_time=2,
    )
    assert solved(single_phase(moving), [uniform(lgr(3), 2)]).objective == pytest.approx(
        -8.0, abs=1e-9
    )


def test_a_free_initial_time_is_found() -> None:
    # x' = u cos t, 0 <= u <= 1, over a window of length pi at most: -pi/2 .. pi/2 is where cos is
    # positive
    window = Problem(
        name="window",
        minimise=-x,
        dynamics={x: u * casadi.cos(time)},
        bounds={u: (0, 1)},
        start={x: 0},
        initial_time=(-3, 3),
        final_time=(-3, 3),
        target={"length": final_time - initial_time <= math.pi},
        guess={initial_time: -1, final_time: 1},
    )
    solution = solved(follow(window, Word.parse("+", ["u"])), [uniform(lgr(12), 2)])
    assert solution.objective == pytest.approx(-2.0, abs=1e-8)
    assert solution.initial_time == pytest.approx(-math.pi / 2, abs=1e-4)

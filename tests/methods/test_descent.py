"""Controls improved along their own motion, with values known in closed form."""

import pytest
from casadi import exp

from socp import Problem, controls, states
from socp.methods import default_guess, descended, motions

x, v = states("x v")
u = controls("u")


def test_a_bang_and_rest_is_found_without_a_grid() -> None:
    # x = 1 - t up to t = 1, then 0: the integral of its square is 1/3
    problem = Problem(
        name="rest",
        running=x**2,
        dynamics={x: u},
        bounds={u: (-1, 1)},
        start={x: 1},
        final_time=2,
    )
    found = descended(problem, default_guess(problem))
    assert found is not None
    assert found.objective == pytest.approx(1 / 3, rel=1e-3)


@pytest.mark.slow
def test_ends_and_limits_are_met() -> None:
    # up to the speed limit in 0.5, down in 0.5: the way is 0.5 * (2 - 0.5)
    problem = Problem(
        name="trip",
        minimise=-x,
        dynamics={x: v, v: u},
        bounds={u: (-1, 1), v: (None, 0.5)},
        start={x: 0, v: 0},
        end={v: 0},
        final_time=2,
    )
    found = descended(problem, default_guess(problem))
    assert found is not None
    assert found.objective == pytest.approx(-0.75, rel=1e-2)
    assert abs(found.at(2.0)[1]) <= 1e-3


def test_ends_that_no_control_meets_lead_to_nothing() -> None:
    problem = Problem(
        name="far",
        running=x**2,
        dynamics={x: u},
        bounds={u: (-1, 1)},
        start={x: 0},
        end={x: 3},
        final_time=2,
    )
    assert descended(problem, default_guess(problem)) is None


def test_a_product_without_a_rate_at_the_start_is_followed() -> None:
    # repressed by exp(-25) at v = 5, made as v falls to 0: (1 - exp(-25)) / 5
    problem = Problem(
        name="repressed",
        minimise=-x,
        dynamics={x: exp(-5 * v), v: u - 1},
        bounds={u: (0, 2)},
        start={x: 0, v: 5},
        final_time=5,
    )
    made = max(each.rows("x")[0].max() for each in motions(problem, default_guess(problem)))
    assert made == pytest.approx(0.2, rel=1e-4)


@pytest.mark.slow
def test_a_substrate_below_zero_does_not_pay() -> None:
    """Park and Ramirez 1988: grids jump over the pole at x4 = -0.4, and a product that is repressed
    at the start shows no magnitude there. Known: -32.6952 (own phases; -32.686 in print).
    """
    x1, x2, x3, x4, x5 = states("x1 x2 x3 x4 x5")
    g3 = 21.87 * x4 / ((x4 + 0.4) * (x4 + 62.5))
    problem = Problem(
        name="secreted_protein",
        minimise=-x1 * x5,
        dynamics={
            x1: 4.75 * g3 / (0.12 + g3) * (x2 - x1) - u / x5 * x1,
            x2: x4 / (0.1 + x4) * exp(-5 * x4) * x3 - u / x5 * x2,
            x3: g3 * x3 - u / x5 * x3,
            x4: -7.3 * g3 * x3 + u / x5 * (20 - x4),
            x5: u,
        },
        bounds={u: (0, 2)},
        start={x1: 0, x2: 0, x3: 1, x4: 5, x5: 1},
        final_time=15,
    )
    found = descended(problem, default_guess(problem))
    assert found is not None
    assert found.objective == pytest.approx(-32.6952, rel=2e-3)

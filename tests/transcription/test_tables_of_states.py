"""Tables of states: splines that expressions call."""

import math

import casadi
import numpy as np
import pytest

from socp.model import Minimum, controls, final_time, states, time
from socp.model.problem import Problem
from socp.registry import solve
from socp.transcription.kinks import decided, kinks, linear_tables

h, v, m, x = states("h v m x")
thrust = controls("thrust")
KNOTS = [2e3 * k for k in range(-5, 101)]
DENSITY = [1.225 * math.exp(-k / 7400) for k in KNOTS]


def table(degree: int) -> casadi.Function:
    return casadi.interpolant("rho", "bspline", [KNOTS], DENSITY, {"degree": [degree]})


def test_a_table_and_its_slopes_have_no_kink_and_do_not_stand_in_the_way_of_others() -> None:
    rho = table(5)(h)
    slope = casadi.jacobian(casadi.jacobian(rho, h), h)
    given = casadi.vertcat(h, v)
    assert kinks(casadi.vertcat(rho, slope), given).is_empty()
    found = kinks(slope + casadi.fabs(v), given)
    assert casadi.is_equal(found, v)


@pytest.mark.parametrize(
    "expression",
    [
        casadi.fabs(table(5)(h) - 1),
        casadi.fmax(table(5)(h), 1),
        casadi.if_else(table(5)(h) > 1, h, 2 * h),
    ],
    ids=["distance", "greater", "branch"],
)
def test_what_is_made_of_a_table_turns_where_the_table_says_so(expression: casadi.SX) -> None:
    found = casadi.Function("turns", [h], [kinks(expression, h)])
    away = np.array([float(found(at)) for at in (1e3, 1.4e3, 1.6e3, 2e3)])  # 1.225 exp(-0.203) = 1
    assert len(set(np.sign(away[:2]))) == len(set(np.sign(away[2:]))) == 1
    assert away[1] * away[2] < 0


def forced(force: casadi.SX) -> Problem:
    """Return a unit mass, moved by 2 in least time, on which a small force acts."""
    return Problem(
        name="forced",
        minimise=final_time,
        dynamics={x: v, v: thrust - 1e-6 * force},
        bounds={thrust: (-4, 4)},
        start={x: 0, v: 0},
        end={x: 2, v: 0},
    )


NODES = [0.2 * k for k in range(-20, 21)]
SQUARES = [k**2 for k in NODES]


def test_a_kink_of_a_table_stands_against_theorems_as_any_other() -> None:
    square = casadi.interpolant("square", "bspline", [NODES], SQUARES, {"degree": [5]})
    found = solve(forced(casadi.fabs(square(x) - 1))).verdict
    assert found is not None
    assert found.second_order is not None
    assert found.second_order.kind is Minimum.WORD
    assert "kink" in "".join(found.second_order.limits)


def test_a_linear_table_has_kinks_and_a_spline_has_none() -> None:
    lines = casadi.interpolant("lines", "linear", [NODES], SQUARES)
    own = casadi.MX.sym("own")
    inside = casadi.Function("inside", [own], [lines(own) ** 2])
    spline = casadi.interpolant("spline", "bspline", [NODES], SQUARES, {"degree": [5]})
    assert [linear_tables(forced(each(x))) for each in (lines, inside, spline)] == [1, 1, 0]


def test_a_branch_in_time_beside_a_table_is_left_as_it_is() -> None:
    rho = table(3)(h) * casadi.fabs(time - 3)
    value = casadi.Function("f", [h, time], [decided(rho, 1.0)])(6000.0, 1.0)
    assert float(value) == pytest.approx(2 * 1.225 * math.exp(-6000 / 7400), rel=1e-12)


@pytest.mark.slow
def test_a_rocket_through_air_from_a_table_flies_as_through_the_air_itself() -> None:
    """Goddard's rocket, singular along the density's second derivative."""
    rho = table(5)
    gravity = 9.81 * (6371e3 / (6371e3 + h)) ** 2
    own = Problem(
        name="rocket",
        minimise=-h,
        dynamics={
            h: v,
            v: (thrust - 0.005 * rho(h) * v**2) / m - gravity,
            m: -thrust / 2200,
        },
        bounds={thrust: (0, 6000), m: (40, None), h: (0, None)},
        start={h: 0, v: 0, m: 150},
        end={m: 40},
    )
    found = solve(own)
    assert found.extremal
    # with exp(-h / 7400) in place of the table, certified: 278430.0424
    assert found.objective == pytest.approx(-278430.042, abs=0.01)

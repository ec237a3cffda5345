"""States that nothing depends on: their costates vanish, and the laws know it."""

from dataclasses import replace
from math import sqrt

import casadi
import numpy as np
import pytest
from casadi import cos, sin

from socp.errors import MethodError
from socp.laws.principle import derive
from socp.model import Family, Problem, controls, final_time, states

way, height, speed, path = states("way height speed path")
turn = controls("turn")
CLIMB = Problem(
    name="climb",
    minimise=final_time,
    dynamics={
        way: speed * cos(path),
        height: speed * sin(path),
        speed: 6 - 0.0008 * speed**2 - 9.81 * sin(path),
        path: turn,
    },
    bounds={turn: (-0.1, 0.1)},
    start={way: 0, height: 100, speed: 40, path: 0},
    end={height: 2000, speed: 60, path: 0},
)


def test_the_way_of_a_climb_is_left_out_and_its_order_is_two() -> None:
    found = derive(CLIMB, ("turn",))
    assert found.orders == {"turn": 2}
    assert not casadi.depends_on(found.conditions, CLIMB.costate[0])


def test_the_singular_climb_is_the_one_of_most_energy() -> None:
    """With H = 0 and sigma = 0: the energy v (6 - 0.0008 v^2) gained per second is the greatest,
    v^2 = 6 / 0.0024, and sin(gamma) = 4 / 9.81 keeps that speed; no turn keeps the angle.
    """
    found = derive(CLIMB, ("turn",))
    v, angle = sqrt(2500.0), np.arcsin(4 / 9.81)
    costate = np.array([0.0, -9.81 / 4 / v, -1 / 4, 0.0])
    values = casadi.Function(
        "f", [CLIMB.x, CLIMB.costate, CLIMB.u], [found.control, found.conditions]
    )([0, 1000, v, angle], costate, 0)
    assert float(values[0]) == pytest.approx(0.0, abs=1e-12)
    assert np.abs(values[1].full()).max() < 1e-12


def test_an_idle_state_takes_no_length_from_the_costates_that_tell() -> None:
    """A cart with cost x v at its end: on a singular arc lambda_v = 0, so lambda_x = 0 as well, and
    no costate is left, whether an odometer runs or not.
    """
    x, v, odometer = states("x v odometer")
    u = controls("u")
    cart = Problem(
        name="cart",
        minimise=x * v,
        dynamics={x: v, v: u},
        bounds={u: (-1, 1)},
        start={x: 1, v: 0},
        final_time=3,
    )
    measured = replace(cart, dynamics={**cart.dynamics, odometer: v**2})
    for each in (cart, measured):
        with pytest.raises(MethodError, match="no such arc was found"):
            derive(each, ("u",))


def test_an_end_of_the_way_brings_its_costate_back() -> None:
    end = {**CLIMB.end, way: 4000}
    assert derive(replace(CLIMB, end=end), ("turn",)).orders == {"turn": 1}
    near = Family(CLIMB, ("end.way",))
    derive(near.base, ("turn",))  # what is worked out for a free end is not handed on
    assert derive(near.at({"end.way": 4000.0}), ("turn",)).orders == {"turn": 1}

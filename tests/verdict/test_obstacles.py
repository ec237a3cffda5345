"""A motion through an obstacle that is small beside its way."""

from math import hypot

import numpy as np
import pytest
from casadi import cos, interpolant, sin
from saddles import along

from socp import Problem, Solution, controls, default_guess, final_time, run, states
from socp.registry import Registry
from socp.verdict.reintegration import path_miss

x, y, heading = states("x y heading")
turn = controls("turn")
FAR, AWAY = 40.0, 20.0  # the end of the way, and where the obstacle stands


def ride(radius: float, aside: float, path: object = None) -> Problem:
    """Return a car that goes straight on, past a pillar or through it."""
    pillar = radius**2 - (x - AWAY) ** 2 - (y - aside) ** 2 <= 0
    return Problem(
        name="ride",
        minimise=final_time,
        dynamics={x: cos(heading), y: sin(heading), heading: turn},
        bounds={turn: (-1, 1)},
        start={x: 0, y: 0, heading: 0},
        end={x: FAR, y: 0, heading: 0},
        path={"pillar": pillar if path is None else path},
    )


def straight(problem: Problem) -> tuple[float, str]:
    """Return what is missed on the straight line, all states but the far end's of no magnitude."""
    s = np.linspace(0, FAR, 4001)
    motion = s, np.stack([s, 0 * s, 0 * s]), 0 * s[None]
    return path_miss(problem, np.empty(0), np.array([FAR, 1.0, 1.0]), motion)


@pytest.mark.parametrize("radius", [0.5, 1.0, 4.0])
def test_the_midst_of_an_obstacle_is_as_far_off_as_states_have_to_move(radius: float) -> None:
    # from its middle m (40, 1) has to be as long as the radius
    missed, which = straight(ride(radius, 0.0))
    assert which == "pillar"
    assert missed == pytest.approx(radius / hypot(FAR, 1.0), rel=1e-3)


def test_two_that_go_through_each_other_both_have_to_move() -> None:
    """Head on, either of them by a share m of its own size: (80, 2) m is as long as the gap."""
    xa, ya, xb, yb = states("xa ya xb yb")
    a, b = controls("a b")
    gap = 1 - (xa - xb) ** 2 - (ya - yb) ** 2 <= 0
    problem = Problem(
        name="two",
        minimise=final_time,
        dynamics={xa: 1, ya: a, xb: -1, yb: b},
        bounds={a: (-1, 1), b: (-1, 1)},
        start={xa: 0, ya: 0, xb: FAR, yb: 0},
        end={xa: FAR, xb: 0},
        path={"gap": gap},
    )
    s, size = np.linspace(0, FAR, 4001), np.array([FAR, 1.0, FAR, 1.0])
    for aside in (0.0, 1e-9):  # where slopes are small they do not tell
        motion = s, np.stack([s, 0 * s + aside, FAR - s, 0 * s]), np.zeros((2, s.size))
        missed, which = path_miss(problem, np.empty(0), size, motion)
        assert which == "gap"
        assert missed == pytest.approx(1.0 / hypot(2 * FAR, 2.0), rel=1e-6)


def test_beside_the_middle_first_and_second_order_tell() -> None:
    # at x = 20, y = 0: 2 (aside) m + (40^2 + 1) m^2 = radius^2 - aside^2
    aside, radius = 0.3, 0.5
    missed, _ = straight(ride(radius, aside))
    here = np.roots([FAR**2 + 1, 2 * aside, aside**2 - radius**2]).max()
    assert here <= missed < 1.05 * here


def test_a_grid_that_jumps_over_an_obstacle_is_not_feasible(registry: Registry) -> None:
    problem = ride(1.0, 0.05)
    solution = run(registry.method("euler-ipopt")(steps=17), problem, default_guess(problem))
    assert solution.stop.ok
    assert np.hypot(solution.rows("x")[0] - AWAY, solution.rows("x")[1] - 0.05).min() > 1.0
    through = np.abs(solution.rows("x")[1]).max() < 0.5
    assert through
    assert solution.verdict is not None
    assert not solution.verdict.feasible


def test_what_is_straight_is_missed_as_before() -> None:
    missed, _ = straight(ride(1.0, 0.0, x <= 38))
    assert missed == pytest.approx(2 / FAR, rel=1e-12)


def test_a_table_has_no_curvature_that_could_not_be_asked() -> None:
    roof = interpolant("roof", "linear", [[0.0, 10.0, 30.0, 40.0]], [1.0, -0.1, 0.2, 1.0])
    missed, _ = straight(ride(1.0, 0.0, y <= roof(x)))
    assert missed == pytest.approx(0.1 / (1 + 0.3 / 20 * FAR), rel=1e-2)  # on its flatter side


def test_touching_is_no_miss() -> None:
    problem = ride(1.0, 1.0)
    solution: Solution = along(problem, "turn: s", [FAR])
    assert solution.verified[0].path < 1e-12

"""Scenes: what they show along a solution is what the problem's own expressions say."""

from typing import Any

import numpy as np
import pytest
from casadi import cos, sin, tanh
from records import revised

from socp.methods.guess import default_guess
from socp.model.problem import Problem
from socp.model.symbols import controls, final_time, states
from socp.registry.plugins import Registry
from socp.view.picture import picture_of

x, y, z, w, a = states("x y z w a")
v = controls("v")


@pytest.fixture(scope="module")
def auv() -> Problem:
    return Registry.load().problem("auv")


def test_a_scene_shows_path_heading_target_and_current(auv: Problem) -> None:
    guess = default_guess(auv)
    seen = picture_of(auv, guess)
    np.testing.assert_array_equal(seen.path, guess.rows("x")[:2])
    np.testing.assert_array_equal(seen.heading, guess.rows("x")[2])
    assert seen.target == (0, 0, pytest.approx(0.05**0.5))
    points, current = seen.flow
    np.testing.assert_allclose(
        current, [0.8 * np.tanh(points[1]), np.zeros(points.shape[1])], atol=1e-15
    )
    assert ((seen.box[:, :1] < points) & (points < seen.box[:, 1:])).all()


def test_it_is_evaluated_at_any_times(auv: Problem) -> None:
    guess, t = default_guess(auv), np.array([0.1, 1.0])
    np.testing.assert_array_equal(picture_of(auv, guess, t).path, guess.at(t)[:2])


def test_switches_are_marked_where_they_happen(auv: Problem) -> None:

    guess = default_guess(auv)
    half = 0.5 * guess.final_time
    guess = revised(guess, structure={"r": (("+", 0.0, half), ("s", half, guess.final_time))})
    (mark,) = picture_of(auv, guess).marks
    assert (mark.t, mark.label) == (half, "r: + s")
    np.testing.assert_allclose(mark.place, guess.at(half)[:2, 0])


@pytest.mark.parametrize("dynamics", [{x: v}, {x: y, y: v}, {x: y, y: z, z: v}])
def test_without_one_the_phase_plane_of_the_first_states_is_shown(
    dynamics: dict[object, object],
) -> None:
    problem = Problem(
        name="chain",
        minimise=final_time,
        dynamics=dynamics,
        bounds={v: (-1, 1)},
        start={x: 0},
        end={x: 1},
        units={x: "m"},
    )
    guess = default_guess(problem)
    seen = picture_of(problem, guess)
    expected = guess.rows("x")[:2] if len(dynamics) > 1 else [guess.t, guess.rows("x")[0]]
    np.testing.assert_array_equal(seen.path, expected)
    assert seen.labels == (("x (m)", "y") if len(dynamics) > 1 else ("t", "x (m)"))
    assert not seen.spatial
    assert (np.diff(seen.box, axis=1) > 0).all()


def planar(dynamics: dict[Any, Any]) -> Problem:
    return Problem(
        name="planar",
        minimise=final_time,
        dynamics=dynamics,
        bounds={v: (-1, 1)},
        start=dict.fromkeys(dynamics, 0),
        end={next(iter(dynamics)): 1},
    )


@pytest.mark.parametrize(
    ("rates", "equal"),
    [
        ((cos(a), sin(a)), True),
        ((z * sin(a) + tanh(y), z * cos(a) - 1), True),  # from north, through a current
        ((2 * z * cos(a), z * sin(a)), False),
        ((cos(a), a), False),
        ((a, z), False),
    ],
    ids=str,
)
def test_a_plane_that_an_angle_turns_has_equal_scales(
    rates: tuple[Any, Any], *, equal: bool
) -> None:
    problem = planar({x: rates[0], y: rates[1], a: v, z: -z})
    assert picture_of(problem, default_guess(problem)).spatial is equal


def test_a_plane_whose_speeds_an_angle_turns_has_equal_scales() -> None:
    flown = {x: z, y: w, z: -2 * sin(a), w: 2 * cos(a) - 1, a: v}
    problem, other = planar(flown), planar({a: v, **flown})
    assert picture_of(problem, default_guess(problem)).spatial
    assert not picture_of(other, default_guess(other)).spatial

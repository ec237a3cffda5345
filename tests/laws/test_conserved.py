"""What motions conserve, and end conditions that depend on others by it."""

import math
from typing import Any

import casadi
import numpy as np
import pytest
from socp_problems.auv import problem as auv

from socp.laws import completed, independent
from socp.laws.conservation.quantities import conserved
from socp.model.problem import Problem
from socp.model.symbols import controls, final_time, states, time

x, y, z = states("x y z")
a, b, c = states("a b c")
u, w = controls("u w")
SPIN = {x: -y, y: x - u * z, z: u * y}
OTHER = {a: -2 * b, b: 2 * a - u * c, c: u * b}


def problem(**parts: Any) -> Problem:
    given = {"name": "own", "minimise": final_time, "bounds": {u: (-1, 1)}}
    return Problem(**given | parts)


def slopes(own: Problem, at: list[float]) -> np.ndarray:
    """Return unit slopes of what is conserved at states, a row each, their largest entry
    positive.
    """
    symbols = casadi.vertcat(own.x, time)
    rows = casadi.jacobian(casadi.vertcat(*conserved(own)), symbols)
    found = casadi.Function("s", [symbols], [rows])([*at, 0.0]).full()
    found /= np.linalg.norm(found, axis=1, keepdims=True)
    largest = found[np.arange(len(found)), np.abs(found).argmax(axis=1)]
    return np.array(found * np.sign(largest)[:, None])


# -- what is conserved


def test_the_norm_of_a_spin_is_conserved() -> None:
    own = problem(dynamics=SPIN, start={x: 0, y: 0, z: 1}, end={z: 0})
    assert slopes(own, [1, 2, 2]) == pytest.approx(np.array([[1 / 3, 2 / 3, 2 / 3, 0]]))


def test_two_spins_conserve_two_norms_one_by_one() -> None:
    start = {x: 0, y: 0, z: 1, a: 0, b: 0, c: 1}
    own = problem(dynamics={**SPIN, **OTHER}, start=start, end={z: 0})
    found = slopes(own, [1, 2, 2, 2, 1, 2])
    wanted = {(1 / 3, 2 / 3, 2 / 3, 0, 0, 0, 0), (0, 0, 0, 2 / 3, 1 / 3, 2 / 3, 0)}
    assert {tuple(np.round(row, 12)) for row in found} == {tuple(np.round(w, 12)) for w in wanted}


def test_a_population_that_only_moves_keeps_its_total() -> None:
    rate = 0.3 * x * y * (1 - 0.5 * u)
    own = problem(
        dynamics={x: -rate, y: rate - 0.1 * y, z: 0.1 * y},
        start={x: 990, y: 10, z: 0},
        end={y: 1},
        bounds={u: (0, 1)},
        final_time=50,
        minimise=z,
    )
    assert slopes(own, [500, 300, 200])[0] == pytest.approx(np.array([1, 1, 1, 0]) / math.sqrt(3))


def test_a_clock_less_the_time_is_conserved() -> None:
    own = problem(dynamics={x: u, y: 1.0}, start={x: 0, y: 3}, end={x: 1})
    assert np.abs(slopes(own, [0, 0])) == pytest.approx(np.array([[0, 1, 1]]) / math.sqrt(2))


@pytest.mark.parametrize(
    "dynamics",
    [
        {x: y, y: u},
        {x: u, y: 1e-13 * x},  # slow is not conserved
        {x: -y, y: x + u},  # nor is what the control changes
        {x: u * casadi.sin(y), y: u * casadi.cos(y) + casadi.exp(-x)},
    ],
)
def test_nothing_is_made_up(dynamics: dict[Any, Any]) -> None:
    assert conserved(problem(dynamics=dynamics, start={x: 0, y: 0}, end={x: 1, y: 1})) == ()


# -- which end conditions depend


def test_ends_that_do_not_depend_stay_as_they_are() -> None:
    own = problem(dynamics=SPIN, start={x: 0, y: 0, z: 1}, end={z: 0})
    free = problem(dynamics={x: y, y: u}, start={x: 0, y: 0}, end={x: 1, y: 0})
    for each in (auv, own, free):
        assert completed(each) is each
        assert independent(each) is each


def test_the_pole_of_a_sphere_implies_the_other_states() -> None:
    own = problem(dynamics=SPIN, start={x: 0, y: 0, z: 1}, end={z: -1})
    full = completed(own)
    assert full.end[x] == full.end[y] == 0
    assert full.end[z] == -1
    loose = independent(own)
    assert loose.end[z] == pytest.approx((-2, 0))  # the other pole would do too, and lies outside
    assert independent(loose) is loose


def test_the_poles_of_two_spheres_imply_all_states() -> None:
    start = {x: 0, y: 0, z: 1, a: 0, b: 0, c: 1}
    own = problem(dynamics={**SPIN, **OTHER}, start=start, end={z: -1, c: -1})
    assert {completed(own).end[each] for each in (x, y, a, b)} == {0}
    assert independent(own).end[c] == pytest.approx((-2, 0))


@pytest.mark.parametrize("size", [1.0, 1e-6, 1e6])
def test_of_cosine_and_sine_one_end_value_follows(size: float) -> None:
    own = problem(
        dynamics={x: -y * z, y: x * z, z: u},
        start={x: size, y: 0, z: 0},
        end={x: 0.6 * size, y: 0.8 * size, z: 0},
    )
    loose = independent(own).end
    assert loose[x] == 0.6 * size
    assert loose[y] == pytest.approx((0, 1.6 * size), abs=1e-9 * size)


def test_end_values_of_few_digits_still_depend() -> None:
    own = problem(
        dynamics={x: -y * z, y: x * z, z: u},
        start={x: 1, y: 0, z: 0},
        end={x: 0.259, y: 0.966, z: 0},  # of 75 degrees: their squares sum to 1.0002
    )
    low, high = independent(own).end[y]
    assert low < 0.96592 < high


def test_what_a_total_determines_is_left_free() -> None:
    own = problem(
        dynamics={x: -u * x, y: u * x - w * y, z: w * y},
        bounds={u: (0, 1), w: (0, 1)},
        start={x: 1, y: 0, z: 0},
        end={x: 0.2, y: 0.3, z: 0.5},
    )
    assert np.isinf(independent(own).end_box).all(axis=0).sum() == 1


def test_a_free_start_leaves_the_end_as_it_is() -> None:
    own = problem(dynamics={x: -y * z, y: x * z, z: u}, start={z: 0}, end={x: 0.6, y: 0.8, z: 0})
    assert independent(own) is own

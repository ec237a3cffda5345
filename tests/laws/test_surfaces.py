"""Points move onto the surface on which conditions hold, by the shortest steps, where there is
one.
"""

from collections.abc import Callable
from typing import Any

import casadi
import numpy as np
import pytest

from socp import Problem, controls, final_time, laws, states
from socp.errors import MethodError
from socp.laws import probes
from socp.laws.links import contradictory

random = np.random.default_rng(2)
x, v = states("x v")
u = controls("u")


def problem() -> Problem:
    return Problem(
        name="cart",
        minimise=final_time,
        dynamics={x: v, v: u},
        bounds={u: (-1, 1), v: (None, 1.5)},
        start={x: 0, v: 0},
        end={x: 10, v: 0},
    )


def rows(kind: str) -> np.ndarray:
    """Return matrices (7, 3, 5): of independent rows, with one that says another again, with one
    that says nothing, with one that nearly says another again.
    """
    matrix = random.standard_normal((7, 3, 5))
    if kind == "again":
        matrix[2:, 2] = 2 * matrix[2:, 0]
    if kind == "nothing":
        matrix[2:, 1] = 0
    if kind == "nearly":
        matrix[2:, 2] = matrix[2:, 0] + 1e-6 * matrix[2:, 2]
    return matrix


@pytest.mark.parametrize("kind", ["independent", "again", "nothing", "nearly"])
def test_steps_are_the_shortest_that_come_nearest(kind: str) -> None:
    matrix, right = rows(kind), random.standard_normal((7, 3))
    step = probes._least(matrix, right)
    inverse = np.linalg.pinv(matrix, rcond=1e-9)
    np.testing.assert_allclose(step, np.einsum("nij,nj->ni", inverse, right), rtol=1e-6)


def test_states_that_equations_fix_are_put_in_place(monkeypatch: pytest.MonkeyPatch) -> None:
    own = problem()
    wanted = probes.admissible(own)
    wanted[1], wanted[2] = 40.0, 1.5
    monkeypatch.setattr(probes, "onto", None)
    at = probes.points_on(own, casadi.vertcat(2 * v - 3, x - 40))
    np.testing.assert_array_equal(at, wanted)


def test_points_arrive_on_a_surface_and_are_shared() -> None:
    own = problem()
    at = probes.points_on(own, own.constraints[0].expression)
    assert at.shape[1] == probes.COUNT
    np.testing.assert_allclose(at[2], 1.5)
    assert probes.points_on(own, own.constraints[0].expression) is at
    assert not at.flags.writeable


@pytest.mark.parametrize(
    ("conditions", "wanted"),
    [
        (lambda a, b: [b, -a, x * a + v * b + 1], True),
        (lambda a, b: [b, b - a, x * a - 2], True),
        (lambda a, b: [b, b, x * a - 2], False),
        (lambda a, b: [x * a, b - 1, x - 2], False),
    ],
)
def test_conditions_that_leave_a_number_contradict_one_another(
    conditions: Callable[..., list[casadi.SX]], wanted: bool
) -> None:
    a, b = casadi.vertsplit(problem().costate)
    assert contradictory(casadi.vertcat(*conditions(a, b))) is wanted


def test_no_point_is_moved_where_no_costate_can_be(monkeypatch: pytest.MonkeyPatch) -> None:
    """Time-optimal carts have no singular arc: sigma = lambda_v and its derivative -lambda_x vanish
    on one, while H = lambda_x v + lambda_v u = -1.
    """
    moved, onto = [], probes.onto

    def counted(own: Problem, equations: casadi.SX, *rest: Any, **given: Any) -> np.ndarray:
        moved.append(equations.numel())
        return onto(own, equations, *rest, **given)

    monkeypatch.setattr(probes, "onto", counted)
    with pytest.raises(MethodError, match="no such arc was found"):
        laws.derive(problem(), ("u",))
    assert moved  # onto sigma = 0 and H = -1, never onto all three
    assert set(moved) == {2}

"""What can be told of a problem once its first grids have found no point: nothing in general, all
of it where everything is affine.
"""

from typing import Any

import pytest
from casadi import floor, if_else, sign, sin

from socp import Problem, Solution, controls, default_guess, free, parameters, run, solve, states
from socp.model import Stop
from socp.registry import Registry
from socp.search import impossible

x, v = states("x v")
u = controls("u")
p = parameters("p")


def reach(**changes: Any) -> Problem:
    """From rest to rest over 1: within 2 and no less, by one half forwards and one back."""
    given: dict[str, Any] = {
        "name": "reach",
        "running": x,
        "dynamics": {x: v, v: u},
        "bounds": {u: (-1, 1)},
        "start": {x: 0, v: 0},
        "end": {x: 1, v: 0},
        "final_time": 1.9,
    }
    return Problem(**{**given, **changes})


def grid(problem: Problem, registry: Registry) -> Solution:
    return run(registry.method("trapezoidal")(steps=50), problem, default_guess(problem))


def test_an_affine_problem_that_no_grid_can_meet_is_told_at_once() -> None:
    found = solve(reach())
    assert found.stop is Stop.INFEASIBLE
    assert "no other start finds a point on this grid" in found.message
    assert found.starts is not None
    assert found.starts.tried < 12
    # the most that is left of the way is what 1.9 seconds do not do
    assert found.verified[0].end[0] == pytest.approx((1.9 / 2) ** 2, rel=1e-2)


def test_the_same_with_a_little_more_time_is_solved() -> None:
    found = solve(reach(final_time=2.1))
    assert found.extremal
    # to wait for 0.1 and go in 2, with x(t) + x(2 - t) = 1 on the way, comes to 1
    assert found.objective < 1


@pytest.mark.parametrize(
    "changes",
    [
        {"dynamics": {x: v, v: u - 2 * sin(x)}},  # not affine
        {"final_time": (0.1, 1.9)},  # its lengths are products with the horizon
        {"dynamics": {x: v, v: p * u}, "bounds": {u: (-1, 1), p: (0, 1)}},
        {"path": {"pillar": 0.01 - (x - 0.5) ** 2 <= 0}},
        {"target": {"both": x * v == 1}},
        {"target": {"far": floor(x) == 1}},  # steps, which have no slopes
        {"target": {"far": sign(x - 0.3) == 1}},
        {"dynamics": {x: v, v: u * if_else(x > 0.1, 1, 1)}},
    ],
)
def test_where_products_are_another_start_may_do(
    changes: dict[str, Any], registry: Registry
) -> None:
    problem, plain = reach(**changes), reach()
    known = grid(plain, registry)
    assert known.stop is Stop.INFEASIBLE
    assert impossible(plain, [known])
    assert not impossible(problem, [known])


def test_limits_and_parameters_may_be_affine(registry: Registry) -> None:
    problem = reach(bounds={u: (-1, 1), v: (None, 0.9), p: (0, 1)}, target={"level": x - p == 0.5})
    assert impossible(problem, [grid(reach(), registry)])
    assert not impossible(problem, [])
    assert not impossible(reach(final_time=free), [grid(reach(), registry)])

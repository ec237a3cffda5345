"""A motion that takes its running cost to zero, and stays there: what is left is rounding."""

from casadi import cos

from socp import Problem, controls, default_guess, run, states, time
from socp.process import time_limit
from socp.registry import Registry
from socp.verdict import verify

x, u = states("x"), controls("u")
# within reach from its start: x = 1 - cos t with u = sin t
REACHED = Problem(
    name="reached",
    running=(x - (1 - cos(time))) ** 2,
    dynamics={x: u},
    bounds={u: (-2, 2)},
    start={x: 0},
    final_time=5,
)


def test_a_target_that_is_followed_exactly_is_integrated_again_and_certified() -> None:
    method = Registry.load().method("lgr-multiphase")(word="s")
    found = run(method, REACHED, default_guess(REACHED))
    assert found.extremal
    assert abs(found.objective) < 1e-20


def test_a_motion_is_integrated_no_further_than_time_allows() -> None:
    guess = default_guess(REACHED)
    with time_limit(0.0):
        (seen,) = verify(REACHED, guess)
    assert "the time for it is over" in seen.error
    assert seen.off == float("inf")

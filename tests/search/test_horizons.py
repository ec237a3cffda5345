"""Free horizons that are much longer than a straight way takes: what swings comes to rest late."""

from math import pi

import numpy as np
import pytest

from socp import Problem, controls, default_guess, final_time, run, states
from socp.methods.direct import scouts
from socp.registry import Registry

x, v = states("x v")
u = controls("u")


def swinging(amplitude: float) -> Problem:
    return Problem(
        name="swinging",
        minimise=final_time,
        dynamics={x: v, v: u - x},
        bounds={u: (-1, 1)},
        start={x: amplitude, v: 0},
        end={x: 0, v: 0},
    )


def test_a_horizon_that_is_held_leads_to_one_of_many_swings() -> None:
    # of amplitude 2 N, each half turn takes 2 off (Pontryagin et al., chapter 1): N half turns
    problem = swinging(10)
    guess = default_guess(problem)
    assert guess.final_time < 5 * pi / 8
    found = scouts(problem, guess, 3)
    assert found
    assert found[0].final_time == pytest.approx(5 * pi, rel=0.1)


def test_an_oscillator_of_many_swings_comes_to_rest() -> None:
    # switches are half turns apart, and the first and the last stretch no longer than these
    # (Pontryagin et al., chapter 1)
    problem = swinging(9)
    solution = run(Registry.load().method("auto")(), problem, default_guess(problem))
    assert solution.extremal
    assert len(solution.switches) == 5
    assert np.diff(solution.switches) == pytest.approx(np.full(4, pi), abs=1e-9)
    assert solution.switches[0] <= pi
    assert solution.final_time - solution.switches[-1] <= pi

"""How well the times of an abnormal extremal are known."""

from math import pi

import numpy as np
import pytest
from saddles import held

from socp import Problem, controls, final_time, states
from socp.verdict.accuracy import accuracy


@pytest.mark.parametrize("off", [1e-9, 4e-8, 1e-7])
@pytest.mark.parametrize(("start", "text"), [(4.0, "u: + -"), (10.0, "u: + - + - +")])
def test_errors_where_the_ends_are_stationary(start: float, text: str, off: float) -> None:
    """An oscillator that begins at rest at an even distance comes to rest after half turns, each of
    length pi: all other words of as many arcs miss by the square of what their lengths are off, so
    that rounding alone leaves 1e-8 to these, though no step of Newton is longer than 1e-13.
    """
    x, v = states("x v")
    u = controls("u")
    problem = Problem(
        name="swing",
        minimise=final_time,
        dynamics={x: v, v: u - x},
        bounds={u: (-1, 1)},
        start={x: start, v: 0},
        end={x: 0, v: 0},
    )
    count = len(text.split()) - 1
    solution = held(problem, text, [pi + off, *[pi] * (count - 2), pi - off])
    assert solution.extremal
    found = accuracy(problem, solution)
    assert found is not None
    wrong = np.abs([*solution.junctions, solution.final_time] - pi * np.arange(1, count + 1))
    assert (wrong <= found.times[1:]).all()
    assert abs(solution.objective - pi * count) <= found.objective
    assert found.times.max() < 1e-5
    assert solution.verdict is not None
    assert all(error >= 0.5 * off for _, error in solution.verdict.switch_errors)

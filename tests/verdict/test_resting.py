"""A costate that turns while the states rest: no node of a solver's need be where it shows."""

import numpy as np
import pytest
from socp_plugins.lgr_multiphase import LgrMultiphase

from socp import Problem, Solution, controls, default_guess, run, states

x, v, w = states("x v w")
u = controls("u")


def pushed(horizon: float, word: str) -> Solution:
    """Return x'' = u - x from rest, as far as it comes with a push of 1 in all, along a word."""
    problem = Problem(
        name="pushed",
        minimise=-x,
        dynamics={x: v, v: u - x, w: u},
        bounds={u: (0, 1)},
        start={x: 0, v: 0, w: 0},
        end={w: 1},
        final_time=horizon,
    )
    return run(LgrMultiphase(word=word), problem, default_guess(problem))


@pytest.mark.parametrize("horizon", [5.0, 9.0, 50.0, 100.0, 200.0, 1000.0])
@pytest.mark.parametrize("word", ["- + -", "- + - + -"])
def test_pushes_that_leave_a_better_moment_out_are_no_extremal(horizon: float, word: str) -> None:
    """The costate of v is -sin(T - t): pushes at the last one or two of its peaks, as long as there
    are others, where u = 0 has the wrong sign.
    """
    found = pushed(horizon, word)
    switches = np.array(found.switches)
    level = np.sin(horizon - switches)
    at = np.linspace(0, horizon, 200_001)
    on = np.searchsorted(switches, at) % 2 == 1
    gain = np.where(on, level.mean() - np.sin(horizon - at), np.sin(horizon - at) - level.mean())
    right = bool(np.ptp(level) < 1e-6 and gain.max() < 1e-4)
    assert found.extremal == right
    assert right == (horizon < 6 if word == "- + -" else 6 < horizon < 10)

"""Motions that end where a function of their rates does."""

import numpy as np
from casadi import sqrt

from socp import Problem, controls, states
from socp.methods import default_guess, guess_of
from socp.verdict import verify

h = states("h")
q = controls("q")


def test_a_root_that_ends_is_named() -> None:
    # h' = -sqrt(h) - 1 from 1: empty before t = 1, and below there are no rates
    tank = Problem(
        name="tank",
        running=h,
        dynamics={h: q - sqrt(h) - 1},
        bounds={q: (0, 1)},
        start={h: 1},
        final_time=2,
    )
    t = default_guess(tank).t
    guess = guess_of(tank, t, np.ones((1, t.size)), np.zeros((1, t.size)))
    seen = verify(tank, guess)[0]
    assert "sqrt has no value where h < 0: a path constraint keeps a motion off" in seen.error
    full = guess_of(tank, t, np.ones((1, t.size)), np.ones((1, t.size)))
    assert seen.error.startswith("integration broke down at t = 0.6")
    assert "no value" not in verify(tank, full)[0].error

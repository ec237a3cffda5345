"""Motions that end where a function of their rates does."""

import numpy as np
from casadi import interpolant, sqrt

from socp import Problem, controls, states
from socp.methods import default_guess, guess_of
from socp.verdict import verify
from socp.verdict.simulation.domains import domain_ended

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


def test_a_root_of_a_table_ends_where_the_table_says_so() -> None:
    nodes = [0.25 * k for k in range(-4, 13)]
    table = interpolant("table", "bspline", [nodes], [k**2 for k in nodes], {"degree": [3]})
    tank = Problem(
        name="tank",
        running=h,
        dynamics={h: q - sqrt(1 - h * table(h))},
        bounds={q: (0, 1)},
        start={h: 1},
        final_time=2,
    )
    inside, end = (
        domain_ended(tank, np.array([at]), 0.0, np.zeros(0), np.ones(1)) for at in (0.5, 1.0)
    )
    assert inside == ""
    assert end.startswith("; sqrt has no value where")

"""Arcs so short that a switching function on them drowns in what the conditions leave."""

from dataclasses import replace

import numpy as np
import pytest

from socp import Problem, Solution, controls, default_guess, judge, silent, solve, states
from socp.methods import Follower, split
from socp.model import Word
from socp.verdict.signs.short import _Taylor

x = states("x")
u = controls("u")


def valley(start: float) -> Problem:
    """Minimise the integral of x^2 / 2 with x' = u, from near 0 to 1/2 in a time of 1: a bang of
    the start's size, x = 0, and + for 1/2.
    """
    return Problem(
        name="valley",
        running=x**2 / 2,
        dynamics={x: u},
        bounds={u: (-1, 1)},
        start={x: start},
        end={x: 0.5},
        final_time=1,
    )


@pytest.mark.parametrize("length", [1e-2, 1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_short_bang_onto_a_singular_arc_is_certified(length: float, side: float) -> None:
    found = solve(valley(side * length), watch=silent)
    assert found.extremal
    assert found.word == ("u: - s +" if side > 0 else "u: + s +")
    assert found.switches[0] == pytest.approx(length, rel=1e-4)
    assert found.objective == pytest.approx((length**3 + 0.5**3) / 6.0, rel=1e-6)


def test_a_bump_in_a_singular_arc_is_none() -> None:
    """Out of x = 0 and back again: what that costs is below the residuals' tolerance."""
    problem, h = valley(0.0), 1e-4
    word = Word.parse("u: s +", problem.control_names)
    whole = Follower()(problem, word, split(default_guess(problem), [0.5, 0.5]))
    assert judge(problem, whole).extremal
    first, last = whole.arcs
    modes = [first.modes, last.modes, (replace(last.modes[0], kind="lower"),), first.modes]
    edges = [0.0, 0.2, 0.2 + h, 0.2 + 2 * h, 0.5]
    slopes = (0.0, 1.0, -1.0, 0.0)
    arcs, level = [], 0.0
    for mode, a, b, slope in zip(modes, edges[:-1], edges[1:], slopes, strict=True):
        share = (first.t - first.t[0]) / np.ptp(first.t)
        t = a + (b - a) * share
        values = level + slope * (t - a)
        own = np.full_like(first.u, slope)
        arcs.append(replace(first, t=t, x=values[None, :], u=own, modes=mode))
        level = float(values[-1])
    bump: Solution = judge(problem, replace(whole, arcs=(*arcs, last)))
    assert not bump.extremal


def test_bounds_of_a_polynomial_hold_its_values() -> None:
    known = _Taylor(np.array([0.0, 0.0, 1.0, 2.0]), np.array([0.0, 0.0, 1.5, 3.0]), -0.1)
    shares = np.linspace(0.1, 1.0, 10)
    low, high = known(shares, 0)
    t = -0.1 * shares
    assert (low <= 1.2 * t**2 / 2 + 2.5 * t**3 / 6).all()
    assert (high >= 1.2 * t**2 / 2 + 2.5 * t**3 / 6).all()
    assert low[-1] == pytest.approx(1.0 * 0.1**2 / 2 - 3.0 * 0.1**3 / 6)

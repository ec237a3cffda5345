"""Words whose motion decays far faster than its arcs last."""

import numpy as np
import pytest

from socp.methods import default_guess, guess_of
from socp.model import Problem, controls, states
from socp.registry import solve
from socp.transcription import damping, lgr

T, L, A, V = states("T L A V")
x, y = states("x y")
u = controls("u")


def amplification(points: int, decay: float) -> float:
    """Return what collocation at LGR points makes of x' = -decay x over an interval of length 1."""
    scheme = lgr(points)
    matrix = scheme.A + decay / 2.0 * scheme.B
    return abs(float(np.linalg.solve(matrix[:, 1:], -matrix[:, 0])[-1]))


@pytest.mark.parametrize("points", [5, 10, 15])
def test_collocation_damps_what_an_interval_is_allowed_and_lets_grow_twice_as_much(
    points: int,
) -> None:
    assert amplification(points, 0.5 * points**2) < 0.2
    assert amplification(points, 1.2 * points**2) > 1.0


def test_intervals_are_counted_by_the_fastest_decay() -> None:
    own = Problem(
        name="lag",
        running=y + u,
        dynamics={x: -0.1 * x - u, y: 40 * (x - y)},
        bounds={u: (0, 1)},
        start={x: 1, y: 0},
        final_time=10,
    )
    assert damping(own, default_guess(own), 10) == [8]  # 40 times 10 over 50
    growing = Problem(
        name="grows", minimise=x, dynamics={x: 40 * x - u}, bounds={u: (0, 1)}, start={x: 1}
    )
    t = np.linspace(0.0, 10.0, 3)
    guess = guess_of(growing, t, np.ones((1, 3)), np.zeros((1, 3)))
    assert damping(growing, guess, 10) == [1]


def test_a_treatment_that_outlasts_the_virus_is_certified() -> None:
    """HIV of Kirschner, Lenhart, Serbin (J. Math. Biol. 35, 1997), treated at a linear cost: virus
    decays within half a day, over 500 of them.
    """
    infected = 2.4e-5 * V * T
    own = Problem(
        name="hiv",
        running=-T + 100 * u,
        dynamics={
            T: 10 / (1 + V) - 0.02 * T + 0.03 * T * (1 - (T + L + A) / 1500) - (1 - u) * infected,
            L: (1 - u) * infected - 0.023 * L,
            A: 3e-3 * L - 0.24 * A,
            V: 288 * A - infected - 2.4 * V,
        },
        bounds={u: (0, 0.9)},
        start={T: 982.2, L: 0.05155, A: 6.175e-4, V: 0.0769},
        final_time=500,
    )
    found = solve(own)
    assert found.extremal
    assert str(found.word) == "u: + -"
    # 300 steps with held controls, Runge-Kutta 4 and Ipopt give -480841.757
    assert found.objective == pytest.approx(-480841.76077, abs=1e-4)

"""A problem in other units has the same solution: certified, with the same word and the objective
in its units.
"""

from collections.abc import Callable

import numpy as np
import pytest

from socp.methods import default_guess, run
from socp.model import Problem, controls, final_time, states
from socp.registry import Registry

x, v, s = states("x v s")
u = controls("u")
# Of length, worth, time and force: as cells are counted, chemists weigh, and grids are powered
UNITS = [(1e9, 1e-5, 1e3, 1e-4), (1e-6, 1e6, 1e-6, 1e6), (1e4, 1e12, 3600.0, 1e-6)]


def cart(length: float, worth: float, second: float, force: float) -> Problem:
    """Return a cart that goes 1 and stops, its speed 0.8 at most: 0.8 + 1 / 0.8 long."""
    speed = length / second
    return Problem(
        name="cart",
        minimise=worth * final_time / second,
        dynamics={x: v, v: speed / second * u / force},
        bounds={u: (-force, force), v: (0, 0.8 * speed)},
        start={x: 0, v: 0},
        end={x: length, v: 0},
    )


def harvest(length: float, worth: float, second: float, force: float) -> Problem:
    """Return the largest harvest u x, u <= 1, of a population that grows by x (1 - x), from 0.2 to
    0.5 within 6: where x = 1/2, as d/dx x (1 - x) = 0, from the time log 4 on at a rate of 1/4.
    """
    part = x / length
    return Problem(
        name="harvest",
        running=-worth * u / force * part / second,
        dynamics={x: length * part * (1 - part - u / force) / second},
        bounds={u: (0, force)},
        start={x: 0.2 * length},
        end={x: 0.5 * length},
        final_time=6 * second,
    )


def turn(length: float, worth: float, second: float, force: float) -> Problem:
    """Return a needle that turns by a right angle, its end given by both cosine and sine."""
    return Problem(
        name="turn",
        minimise=worth * final_time / second,
        dynamics={x: -s * v / second, s: x * v / second, v: u / force / second},
        bounds={u: (-force, force)},
        start={x: length, s: 0, v: 0},
        end={x: 0, s: length, v: 0},
    )


CASES = [
    (cart, 2.05, "u: + b[v.upper] -"),
    (harvest, -(6 - np.log(4)) / 4, "u: - s"),
    (turn, np.sqrt(2 * np.pi), "u: + -"),
]


@pytest.mark.slow
@pytest.mark.parametrize("units", UNITS[:2])
@pytest.mark.parametrize(("made", "truth", "word"), CASES, ids=["cart", "harvest", "turn"])
def test_other_units_have_the_same_solution(
    registry: Registry,
    made: Callable[..., Problem],
    truth: float,
    word: str,
    units: tuple[float, ...],
) -> None:
    own = made(*units)
    found = run(registry.method("auto")(seconds=300.0), own, default_guess(own))
    assert found.extremal, found.verdict and found.verdict.reasons
    assert found.objective / units[1] == pytest.approx(truth, rel=1e-8)
    assert str(found.word) == word
    assert found.final_time / units[2] == pytest.approx(6.0 if made is harvest else truth, rel=1e-8)

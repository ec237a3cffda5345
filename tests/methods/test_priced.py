"""Words whose laws carry costates converge from a coarse direct solution, however the cost is
written.
"""

from typing import Any

import pytest

from socp import Problem, controls, default_guess, states
from socp.methods import Follower, guess_along, solve_directly
from socp.model import Mode, Word
from socp.transcription import euler, uniform

i, v, x, e = states("i v x e")
u = controls("u")
# An electric car, 100 m in 10 s: current, speed, place; voltage 150, its energy the cost
RATES = {i: 20 * (150 * u - 0.03 * i - 8.2 * v), v: 0.0327 * i - 0.294 - 0.0025 * v**2, x: v}
POWER = 150 * u * i + 0.05 * i**2
WORD = "+ b[i.upper] s b[i.lower] +"


def car(**given: Any) -> Problem:
    dynamics = {**RATES, **given.pop("more", {})}
    return Problem(
        name="car",
        dynamics=dynamics,
        bounds={u: (-1, 1), i: (-150, 150)},
        start=dict.fromkeys(dynamics, 0),
        end={x: 100},
        final_time=10,
        **given,
    )


def iterations_along(own: Problem, steps: int) -> tuple[int, float]:
    """Return the iterations along the word from a grid of so many steps, and the objective."""
    coarse = solve_directly(own, uniform(euler(), steps), Follower().backend, default_guess(own))
    word = Word(own.control_names, tuple((Mode.parse(each),) for each in WORD.split()))
    found = Follower(intervals=2)(own, word, guess_along(own, coarse, word))
    assert found.stop.ok
    return found.effort.iterations, found.objective


@pytest.mark.parametrize("steps", [60, 90])
def test_a_cost_that_is_a_state_takes_no_more_iterations_than_one_under_an_integral(
    steps: int,
) -> None:
    count, energy = iterations_along(car(running=POWER), steps)
    its, same = iterations_along(car(minimise=e, more={e: POWER}), steps)
    assert same == pytest.approx(energy, rel=1e-9)
    assert its <= 2 * count <= 70


@pytest.mark.parametrize("steps", [60])
def test_costates_of_a_length_that_is_left_open_converge_as_well(steps: int) -> None:
    drained = 150 * u * (1 - 1e-6 * e)  # the voltage falls as the battery drains
    more = {i: 20 * (drained - 0.03 * i - 8.2 * v), e: drained * i + 0.05 * i**2}
    assert iterations_along(car(minimise=e, more=more), steps)[0] <= 60

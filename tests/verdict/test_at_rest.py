"""Solutions that stay on a constraint, or at zero: their own range is rounding and measures
nothing.
"""

import numpy as np
import pytest

from socp import Problem, Solution, Word, controls, default_guess, states
from socp.methods import Follower
from socp.model import scales
from socp.verdict import judge, structure_of
from socp.verdict.structure import nearness

x, y = states("x y")
u, d = controls("u d")


def floor(unit: float = 1.0, level: float = 0.0) -> Problem:
    """Return a fall held by a floor at a level all the time, in other units of length."""
    return Problem(
        name="floor",
        running=x,
        dynamics={x: unit * u},
        bounds={u: (-1, 1)},
        path={"floor": x >= level * unit},
        start={x: level * unit},
        final_time=3,
    )


def along(problem: Problem, text: str) -> Solution:
    word = Word.parse(text, problem.control_names)
    return judge(problem, Follower()(problem, word, default_guess(problem)))


@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("level", [0.0, -2.0, 2.0])
def test_what_stays_on_its_floor_is_an_extremal(unit: float, level: float) -> None:
    found = along(floor(unit, level), "b[floor]")
    assert found.extremal
    assert found.objective == pytest.approx(3 * level * unit, abs=1e-12 * unit)


@pytest.mark.parametrize("word", ["+", "- +"])
def test_what_could_be_lower_is_none(word: str) -> None:
    found = along(floor(), word)
    assert not found.extremal


def test_a_state_at_zero_has_the_size_of_what_its_control_could_do() -> None:
    problem = floor(unit=5.0)
    found = along(problem, "b[floor]")
    assert scales(problem, found) == pytest.approx([15.0])


def test_rounding_off_a_constraint_is_on_it() -> None:
    problem = floor()
    found = along(problem, "b[floor]")
    assert nearness(found, problem) == pytest.approx([3e-8])
    assert [mode for mode, *_ in structure_of(problem, found)["u"]] == ["b[floor]"]


def test_a_pair_held_by_two_floors() -> None:
    problem = Problem(
        name="two floors",
        running=x + 1e3 * y,
        dynamics={x: u, y: 1e-3 * d},
        bounds={u: (-1, 1), d: (-1, 2), x: (0, None), y: (0, None)},
        start={x: 0, y: 0},
        final_time=2,
    )
    found = along(problem, "u: b[x.lower]; d: b[y.lower]")
    assert found.extremal
    assert np.abs(found.rows("x")).max() < 1e-12

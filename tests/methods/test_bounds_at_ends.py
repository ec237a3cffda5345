"""Bounds of states that are met where the horizon ends, such as a stock that is used up: conditions
of a word as the ends are.
"""

from typing import Any

import pytest

from socp import Problem, Solution, Word, controls, default_guess, initial, judge, states, time
from socp.methods import Follower
from socp.methods.polish import polished
from socp.transcription import Shooting, follow
from socp.verdict.sensitivity import derivatives

x, y, z = states("x y z")
u = controls("u")


def solved(problem: Problem, text: str) -> Solution:
    """Return a word's extremal to rounding, judged."""
    found = Follower(intervals=4)(problem, Word.parse(text, ("u",)), default_guess(problem))
    sharp = polished(problem, found)
    assert sharp is not None
    return judge(problem, sharp)


def dosed(limit: float = 1.0) -> Problem:
    """Return a course in which the dose is limited as a state: it is given at once."""
    return Problem(
        name="dosed",
        running=x,
        dynamics={x: -u, y: u},
        bounds={u: (0, 1), y: (None, limit)},
        start={x: 2, y: 0},
        final_time=3,
    )


def stock(**more: Any) -> Problem:
    """Return a stock that is sold while the price rises, down to its bound."""
    return Problem(
        name="stock",
        running=-time * u,
        dynamics={y: -u, **more.pop("dynamics", {})},
        bounds={u: (0, 1), y: (0, None), **more.pop("bounds", {})},
        start={y: 1, **more.pop("start", {})},
        final_time=3,
        **more,
    )


def test_a_dose_that_is_used_up_holds_the_switch() -> None:
    # a dose A costs 2 A - A^2/2 + (2 - A) (3 - A) = 6 - 3 A + A^2/2
    solution = solved(dosed(), "+ -")
    assert solution.extremal
    assert solution.switches == pytest.approx([1.0], abs=1e-13)
    assert solution.objective == pytest.approx(3.5, abs=1e-13)
    (slope,) = derivatives(dosed(), solution, ["y.upper"])
    assert slope.objective == pytest.approx(-2.0, abs=1e-6)
    assert slope.junctions == pytest.approx([1.0], abs=1e-6)


def test_a_stock_is_sold_down_to_its_bound_at_the_end() -> None:
    # what is sold from 2 + L on, L being left, earns (9 - (2 + L)^2) / 2
    solution = solved(stock(), "- +")
    assert solution.extremal
    assert solution.switches == pytest.approx([2.0], abs=1e-13)
    assert solution.objective == pytest.approx(-2.5, abs=1e-13)
    (slope,) = derivatives(stock(), solution, ["y.lower"])
    assert slope.objective == pytest.approx(2.0, abs=1e-6)


def test_what_decays_towards_a_bound_is_not_held_by_it() -> None:
    problem = stock(dynamics={z: -6 * z}, bounds={z: (0, None)}, start={z: 1})
    solution = solved(problem, "- +")
    assert solution["z"][-1] < 1e-7
    assert solution.objective == pytest.approx(-2.5, abs=1e-13)


def test_a_bound_that_another_condition_implies_is_no_condition_of_its_own() -> None:
    # the stock is at its bound at the start, filled, and sold: by the target it ends there
    problem = Problem(
        name="round",
        running=-(time - 1) * u,
        dynamics={y: -u},
        bounds={u: (-1, 1), y: (0, None)},
        start={y: 0},
        target={"round": y == initial(y)},
        final_time=2,
    )
    solution = solved(problem, "- +")
    names = [row.name for row in Shooting(follow(problem, solution.followed), solution, ()).ends]
    assert [name for name in names if "on" in name.split()] == []
    assert solution.objective == pytest.approx(-1.0, abs=1e-13)

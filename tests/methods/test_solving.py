"""Laws that leave the box of their controls: when a word is solved once more, and what is kept."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from carts import cart

from socp.methods.guess import guess_of
from socp.methods.solving import kept_in_box
from socp.model.result.solution import Solution, Stop

problem = cart()


def solved(push: float, stop: Stop) -> Solution:
    t = np.linspace(0.0, 1.0, 3)
    return replace(guess_of(problem, t, np.zeros((2, 3)), np.full((1, 3), push)), stop=stop)


def solver(first: Solution, again: Solution, asked: list[bool]) -> Callable[[bool], Solution]:
    def solve(boxed: bool) -> Solution:
        asked.append(boxed)
        return again if boxed else first

    return solve


@pytest.mark.parametrize(
    ("push", "stop"), [(0.5, Stop.SOLVED), (1.0 + 1e-7, Stop.SOLVED), (2.0, Stop.INFEASIBLE)]
)
def test_one_solve_is_enough_for_a_law_in_its_box_and_for_none(push: float, stop: Stop) -> None:
    asked: list[bool] = []
    first = solved(push, stop)
    assert kept_in_box(problem, solver(first, solved(1.0, Stop.SOLVED), asked)) is first
    assert asked == [False]


@pytest.mark.parametrize(
    ("stop", "taken"), [(Stop.SOLVED, True), (Stop.INFEASIBLE, False), (Stop.INTERRUPTED, True)]
)
def test_a_law_that_leaves_its_box_is_solved_again_inside(stop: Stop, taken: bool) -> None:
    asked: list[bool] = []
    first, again = solved(2.0, Stop.SOLVED), solved(1.0, stop)
    assert kept_in_box(problem, solver(first, again, asked)) is (again if taken else first)
    assert asked == [False, True]

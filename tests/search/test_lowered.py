"""A search leaves an extremal that is no minimum, on both sides."""

from dataclasses import replace

import pytest

from socp import (
    Ipopt,
    Problem,
    Solution,
    Word,
    controls,
    default_guess,
    follow,
    judge,
    solve_collocated,
    states,
    uniform,
)
from socp.methods.guess import split
from socp.search.effort import Ration
from socp.search.refinement import lowered
from socp.transcription.schemes import lgr


def saddle() -> tuple[Problem, Solution]:
    """Minimise -y(3) - x(3)^2 with y' = x, x' = u from rest; `+ -` with its switch s at 1 is the
    highest of its word: -3/2, against -9/2 at s = 0 and -27/2 at s = 3.
    """
    y, x = states("y x")
    u = controls("u")
    problem = Problem(
        name="saddle",
        minimise=-y - x**2,
        dynamics={y: x, x: u},
        bounds={u: (-1, 1)},
        start={y: 0, x: 0},
        final_time=3,
    )
    phased = follow(problem, Word.parse("u: + -", problem.control_names))
    first, last = phased.phases
    phased = replace(phased, phases=(replace(first, length=(1.0, 1.0)), last))
    guess = split(default_guess(problem), [1.0, 2.0])
    found = solve_collocated(phased, [uniform(lgr(10), 2)] * 2, Ipopt({"tol": 1e-11}), guess)
    return problem, judge(problem, found)


def test_the_better_of_both_sides_of_a_maximum() -> None:
    problem, solution = saddle()
    assert solution.extremal
    assert solution.objective == pytest.approx(-1.5)
    found = lowered(problem, solution, Ration())
    assert found.extremal
    assert found.word == "u: +"
    assert found.objective == pytest.approx(-13.5, rel=1e-9)
    assert lowered(problem, found, Ration()) is found

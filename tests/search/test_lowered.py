"""A search leaves an extremal that is no minimum, on both sides."""

import pytest
from saddles import held, saddle

from socp import Problem, Solution
from socp.search.effort import Ration
from socp.search.refinement import lowered


def highest() -> tuple[Problem, Solution]:
    """Return the saddle with k = 2: `+ -` with its switch s at 1 is the highest of its word, -3/2,
    against -9/2 at s = 0 and -27/2 at s = 3.
    """
    problem = saddle(2)
    return problem, held(problem, "u: + -", [1.0, 2.0])


@pytest.mark.slow
def test_the_better_of_both_sides_of_a_maximum() -> None:
    problem, solution = highest()
    assert solution.extremal
    assert solution.objective == pytest.approx(-1.5)
    found = lowered(problem, solution, Ration())
    assert found.extremal
    assert found.word == "u: +"
    assert found.objective == pytest.approx(-13.5, rel=1e-9)
    assert lowered(problem, found, Ration()) is found

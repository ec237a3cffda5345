"""Joints of words: where the law of a boundary arc has to be at the bound that its control goes to
or comes from.
"""

from collections.abc import Callable
from dataclasses import replace

from socp.laws import tangential_joints
from socp.methods.solving import Follower, kept_in_box
from socp.model import Problem, Solution, Stop, Watch, Word, silent


def follow_word(
    problem: Problem,
    word: Word,
    guess: Solution,
    follower: Follower,
    watch: Watch = silent,
    telling: Callable[[Solution], bool] = lambda _: False,
) -> Solution:
    """Solve along a word, its laws boxed where they would leave the box, unless what they do
    outside of it is telling.

    Joints at which a word needs a law at its bound may be too much for a wrong word: with these
    left free it has a solution that shows what is wrong. Raises MethodError as the follower does.
    """

    def solve(how: Follower) -> Solution:
        return kept_in_box(
            problem, lambda boxed: replace(how, boxed=boxed)(problem, word, guess, watch), telling
        )

    solution = solve(follower)
    stopped = {Stop.INFEASIBLE, Stop.FAILED, Stop.LIMIT}
    if solution.stop in stopped and tangential_joints(problem, word, guess):
        return solve(replace(follower, loose=True)).after(solution)
    return solution

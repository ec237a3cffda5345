"""Joints at which the law of a boundary arc is at its control's bound: arcs that are met or left
tangentially.
"""

import math

import numpy as np
import pytest
from casadi import exp, pi, sin

from socp import Problem, Solution, Word, controls, default_guess, final_time, states
from socp.laws import Tie, tangential_joints
from socp.methods import Follower, follow_word, guess_along, guess_of, scouts, split
from socp.model import time
from socp.verdict import judge

x, h, w, p, v = states("x h w p v")
u, d = controls("u d")

# filled as fast as may be, with a leak that grows until it exceeds the inflow at t = 2
LEAK = Problem(
    name="leak",
    running=-x,
    dynamics={x: u - time / 2},
    bounds={u: (0, 1), x: (None, 1)},
    start={x: 0.5},
    final_time=3,
)
# a full reservoir before a flood of more than the outlet takes, from 3 - r to 3 + r
DAM = Problem(
    name="dam",
    running=-x,
    dynamics={x: 0.2 + 1.3 * exp(-((time - 3) ** 2)) - u},
    bounds={u: (0, 1), x: (None, 1)},
    start={x: 1},
    final_time=6,
)
# low above a hill, of order 2
GLIDER = Problem(
    name="glider",
    running=h,
    dynamics={h: w, w: u},
    bounds={u: (-1, 1)},
    path={"ground": h >= exp(-((time - 4) ** 2) / 2)},
    start={h: 1, w: 0},
    final_time=8,
)
# a slot car, one lap, the limit on its speed along the way
SLOT = Problem(
    name="slot",
    minimise=final_time,
    dynamics={p: v, v: u - v},
    bounds={u: (0, 1)},
    path={"limit": v <= 1 - sin(2 * pi * p) / 2},
    start={p: 0, v: 0},
    end={p: 1},
)
BOTH = Problem(
    name="both",
    minimise=final_time,
    dynamics={p: v, v: u - d - v},
    bounds={u: (0, 1), d: (0, 1)},
    path={"limit": v <= 1 - sin(2 * pi * p) / 2},
    start={p: 0, v: 0},
    end={p: 1},
)


# the same of the level's square, which the inflow drives up where the level is positive alone
SQUARE = Problem(
    name="square",
    running=-x,
    dynamics={x: u - time / 2},
    bounds={u: (0, 1)},
    path={"limit": x**2 <= 1},
    start={x: 0.5},
    final_time=3,
)


def along(problem: Problem, text: str) -> Solution:
    word = Word.parse(text, problem.control_names)
    start = guess_along(problem, scouts(problem, default_guess(problem), 1)[0], word)
    return judge(problem, follow_word(problem, word, start, Follower()))


def ties(problem: Problem, text: str) -> frozenset[Tie]:
    return tangential_joints(problem, Word.parse(text, problem.control_names))


@pytest.mark.parametrize(
    ("problem", "word", "wanted"),
    [
        (LEAK, "+ b +", {Tie(1, 0, -1)}),
        (LEAK, "+ b -", set()),
        (LEAK, "- b +", {Tie(1, 0, 0), Tie(1, 0, -1)}),
        (DAM, "b + b", {Tie(2, 0, 0)}),
        (GLIDER, "- + b[ground] +", set()),  # of order 2: climbing before it and after it
        (GLIDER, "- b[ground] -", {Tie(1, 0, 0), Tie(1, 0, -1)}),
        (BOTH, "u: + b[limit] +; d: - - -", {Tie(1, 0, -1)}),
        (BOTH, "u: + b[limit] +; d: - - +", set()),  # the brake may have made room for it
        (BOTH, "u: + b[limit] +; d: - - b[limit]", set()),  # the brake goes on along it
    ],
)
def test_a_bang_towards_a_constraint_needs_the_law_at_its_bound(
    problem: Problem, word: str, wanted: set[Tie]
) -> None:
    assert ties(problem, word) == wanted


@pytest.mark.parametrize(("level", "wanted"), [(0.9, {Tie(1, 0, -1)}), (-0.9, {Tie(1, 0, 0)})])
def test_the_states_at_a_joint_tell_which_bang_goes_towards_a_constraint(
    level: float, wanted: set[Tie]
) -> None:
    assert ties(SQUARE, "+ b[limit] +") == set()
    t = np.linspace(0, 3, 7)
    near = split(guess_of(SQUARE, t, np.full((1, 7), level), np.ones((1, 7))), [1, 1, 1])
    word = Word.parse("+ b[limit] +", SQUARE.control_names)
    assert tangential_joints(SQUARE, word, near) == wanted
    assert tangential_joints(SQUARE, word, split(near, [1, 1])) == set()


@pytest.mark.parametrize("leak", [LEAK, SQUARE])
def test_an_arc_ends_where_its_law_reaches_the_bound_that_the_control_stays_at(
    leak: Problem,
) -> None:
    found = along(leak, "+ b +")
    assert found.extremal
    assert found.switches == pytest.approx([2 - math.sqrt(2), 2], abs=1e-9)
    # 1/2 + t - t^2/4 up to the limit, 1 along it, t - t^2/4 after it
    first = 2 - math.sqrt(2)
    area = first / 2 + first**2 / 2 - first**3 / 12 + (2 - first) + 5 / 2 - 19 / 12
    assert found.objective == pytest.approx(-area, rel=1e-9)


def test_an_arc_begins_where_its_law_comes_back_from_the_bound() -> None:
    found = along(DAM, "b + b")
    assert found.extremal
    begins, ends = found.switches
    assert ends == pytest.approx(3 + math.sqrt(math.log(1.3 / 0.8)), abs=1e-9)
    erf = np.vectorize(math.erf)
    fallen = 1.3 * math.sqrt(math.pi) / 2 * np.diff(erf(np.array([begins, ends]) - 3))
    assert fallen[0] == pytest.approx(0.8 * (ends - begins), abs=1e-9)


def test_an_arc_is_left_tangentially_where_the_limit_rises_faster_than_the_car() -> None:
    found = along(SLOT, "+ b[limit] +")
    assert found.extremal
    assert found.objective == pytest.approx(1.90468227143, abs=1e-10)
    place, speed = found.at(np.array([found.switches[-1]]))[:, 0]
    limit = 1 - math.sin(2 * math.pi * place) / 2
    assert speed == pytest.approx(limit, abs=1e-9)
    law = speed - math.pi * math.cos(2 * math.pi * place) * speed
    assert law == pytest.approx(1.0, abs=1e-8)


@pytest.mark.slow
def test_a_word_whose_joints_cannot_be_has_a_solution_with_the_joints_left_free() -> None:
    word = Word.parse("+ - b +", LEAK.control_names)
    start = guess_along(LEAK, scouts(LEAK, default_guess(LEAK), 1)[0], word)
    assert not Follower(longer=False)(LEAK, word, start).stop.ok
    assert follow_word(LEAK, word, start, Follower(longer=False)).stop.ok

"""Touches: a state constraint of order two that is met at single times, which are unknowns."""

import math
from dataclasses import replace

import numpy as np
import pytest

from socp import Problem, Solution, Word, controls, default_guess, final_time, states
from socp.methods import Follower, follow_word, guess_of, polished, split
from socp.model import constraint_function
from socp.verdict import judge

x, v, q, w = states("x v q w")
u = controls("u")

# an oscillator to rest in least time: where braking all the way its first swing ends at -1.2, and
# where it need not brake at first it goes further
WALL = 1.21
OSCILLATOR = Problem(
    name="oscillator",
    minimise=final_time,
    dynamics={x: v, v: -x + u},
    bounds={u: (-0.4, 0.4)},
    path={"wall": x >= -WALL},
    start={x: 2, v: 0},
    end={x: 0, v: 0},
)
# a trolley with a swinging load from rest to rest: on |q| = 1.5 no admissible control keeps it
CRANE = Problem(
    name="crane",
    minimise=final_time,
    dynamics={x: v, v: u, q: w, w: -q - u},
    bounds={u: (-1, 1), q: (-1.5, 1.5)},
    start={x: 0, v: 0, q: 0, w: 0},
    end={x: 12, v: 0, q: 0, w: 0},
    guess={final_time: 8},
)

CUTS = [1.8, 0.3, 0.9, 1.0, 1.0, 0.9, 0.3, 1.8]  # roughly the lengths of the crane's arcs


def along(problem: Problem, text: str, start: Solution) -> Solution:
    word = Word.parse(text, problem.control_names)
    return judge(problem, follow_word(problem, word, start, Follower()))


def swung(wall: float) -> Solution:
    """Return the oscillator's motion with the wall in a place, from circles around -+0.4."""
    z, rows = 2.0 + 0.0j, []
    lengths, share = np.array([0.1, 3.3, 3.1, 1.5]), np.linspace(0.0, 1.0, 50)
    for centre, length in zip((-0.4, 0.4, -0.4, 0.4), lengths, strict=True):
        rows.append(centre + (z - centre) * np.exp(-1j * length * share))
        z = rows[-1][-1]
    begins = np.cumsum([0.0, *lengths[:-1]])
    t = np.concatenate([a + n * share[:-1] for a, n in zip(begins, lengths, strict=True)])
    path = np.concatenate([row[:-1] for row in rows])
    guess = guess_of(OSCILLATOR, t, np.array([path.real, path.imag]), np.zeros((1, t.size)))
    problem = replace(OSCILLATOR, path={"wall": x >= -wall})
    return along(problem, "- + - +", split(guess, lengths.tolist()))


def highest(problem: Problem, solution: Solution, name: str) -> tuple[float, float]:
    """Return the largest value of a constraint at many times, and one of these."""
    constraint = next(each for each in problem.constraints if each.name == name)
    times = np.linspace(solution.initial_time, solution.final_time, 20001)
    c = constraint_function(problem, constraint)
    values = np.array(c(solution.at(times), times[None, :], np.zeros((0, times.size))).full())[0]
    return float(values.max()), float(times[values.argmax()])


def test_a_swing_ends_at_the_wall() -> None:
    found = swung(WALL)
    assert found.extremal
    # around -0.4 by the angle s, around 0.4 up to the wall: circles with x + iv on them
    s = found.switches[0]
    reached = abs(complex(2.4 * math.cos(s) - 0.8, -2.4 * math.sin(s)))
    assert reached == pytest.approx(WALL + 0.4, abs=1e-9)
    worst, _ = highest(OSCILLATOR, found, "wall")
    assert abs(worst) < 1e-8


def test_a_costate_jumps_at_a_touch_alone() -> None:
    found = swung(WALL)
    _, t = highest(OSCILLATOR, found, "wall")
    before, after = found.at(np.array([t - 1e-3, t + 1e-3]), "costate").T
    assert abs(before[0] - after[0]) > 0.01  # lambda of x jumps by the multiplier
    assert before[1] == pytest.approx(after[1], abs=1e-2)


def test_a_load_that_swings_touches_its_limit_twice() -> None:
    found = along(CRANE, "+ - + - + - + -", split(default_guess(CRANE), CUTS))
    assert found.extremal
    for name in ("q.lower", "q.upper"):
        assert abs(highest(CRANE, found, name)[0]) < 1e-7
    # by symmetry of rest to rest: time reversed the control changes its sign
    forwards, backwards = np.array(found.switches), np.array(found.switches[::-1])
    assert forwards + backwards == pytest.approx(np.full(7, found.final_time), abs=1e-8)
    newton = polished(CRANE, found)
    assert newton is not None
    assert newton.objective == pytest.approx(found.objective, rel=1e-10)


@pytest.mark.slow
def test_a_limit_that_is_not_met_is_no_touch() -> None:
    found = swung(WALL)
    free = swung(1.3)
    assert free.extremal
    assert free.objective < found.objective
    assert highest(OSCILLATOR, free, "wall")[0] > 1e-3

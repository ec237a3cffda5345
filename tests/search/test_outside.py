"""A law that leaves its box: what it shows there, and the word that comes of it."""

from math import cos, pi
from math import sin as sine

import numpy as np
import pytest
from casadi import sin
from scipy.optimize import brentq

from socp import Problem, controls, default_guess, states, time
from socp.methods import sound
from socp.model import Mode
from socp.search import Ration
from socp.search.candidate import Candidate
from socp.search.mending import mends
from socp.search.refinement import solve_word

x, u = states("x"), controls("u")
# follow a wave at bounded speed: too fast at its start and where it falls
WAVE = Problem(
    name="wave",
    running=(x - 1.2 * sin(time)) ** 2,
    dynamics={x: u},
    bounds={u: (-1, 1)},
    start={x: 0},
    final_time=5,
)
# what is passed on a bang arc is made up for on it: it meets the wave where 1.2 sin d = d
D = brentq(lambda d: 1.2 * sine(d) - d, 0.5, 1.5)
# of every half of a bang arc, of which there are three
COST = 3.0 * (D**3 / 3.0 - 2.4 * (sine(D) - D * cos(D)) + 1.44 * (D / 2.0 - sine(2.0 * D) / 4.0))


def test_bounds_come_where_a_law_leaves_its_box_on_both_sides_at_once() -> None:
    word = Candidate(((Mode("singular"),),), (0.0, 5.0), default_guess(WAVE))
    free = solve_word(WAVE, word, Ration(), lambda _: None)
    assert free is not None
    assert not sound(WAVE, free)  # as it is, not pressed into the box
    assert free.verdict is not None
    assert free.verdict.residual < 1e-9
    mended = next(mends(WAVE, word, free))
    assert mended.key == "0: + s - s"
    found = solve_word(WAVE, mended, Ration(), lambda _: None)
    assert found is not None
    assert found.extremal
    np.testing.assert_allclose(found.switches, (D, pi - D, pi + D), atol=1e-8)
    assert found.objective == pytest.approx(COST, rel=1e-10)

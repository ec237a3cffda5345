"""Default guesses: finite, within bounds, where the file says, and of the right order of
magnitude.
"""

import math
from typing import Any

import carts
import numpy as np
import pytest
from carts import u, v, x
from socp_problems.auv import problem as auv

from socp.methods.guess import default_guess, guess_along, guess_of, split
from socp.model import Mode
from socp.model.problem import Problem
from socp.model.result.solution import Solution
from socp.model.symbols import final_time, initial_time, parameters, time
from socp.model.word import Word
from socp.registry.plugins import Registry
from socp.verdict.structure import structure_of

k = parameters("k")


def cart(**changes: Any) -> Problem:
    return carts.cart(**{"end": {x: 100, v: 0}} | changes)


def test_states_run_straight_from_start_to_end() -> None:
    guess = default_guess(cart())
    middle = (guess.initial_time + guess.final_time) / 2
    np.testing.assert_allclose(
        guess.at([guess.initial_time, middle, guess.final_time]), [[0, 50, 100], [0, 0, 0]]
    )
    assert guess.at(middle, "u").tolist() == [[0]]
    assert guess.state_names == ("x", "v")
    assert guess.control_names == ("u",)


def test_the_time_is_of_the_right_order() -> None:
    # the minimum time over a distance d from rest to rest is 2 sqrt(d)
    for distance in (1e-4, 1.0, 100.0, 1e6):
        guess = default_guess(cart(end={x: distance, v: 0}))
        assert 0.2 < guess.final_time / (2 * math.sqrt(distance)) < 5
    assert 0.1 < default_guess(auv).final_time / auv.reference.objective < 10


def test_nothing_to_do_takes_a_time_all_the_same() -> None:
    assert default_guess(cart(end={x: 0, v: 0})).final_time > 0


def test_the_file_has_the_first_word() -> None:
    told = default_guess(
        cart(
            dynamics={x: v, v: u * k},
            guess={x: (10, 20), v: time**2, u: 0.5, k: 3, initial_time: 1, final_time: 9},
            initial_time=(0, 2),
        )
    )
    assert (told.initial_time, told.final_time) == (1, 9)
    np.testing.assert_allclose(told.at([1, 5, 9])[0], [10, 15, 20])
    np.testing.assert_allclose(
        told.at([1, 5, 9])[1], [1, 25, 81], atol=1e-2
    )  # piecewise linear between 101 nodes
    np.testing.assert_allclose(told.at([1, 9], "u"), [[0.5, 0.5]])
    assert told.parameters == {"k": 3.0}


def test_a_numpy_pair_is_a_pair() -> None:
    told = default_guess(cart(guess={x: np.array([1.0, 3.0])}))
    np.testing.assert_allclose(told.at([told.initial_time, told.final_time])[0], [1, 3])


def test_times_keep_to_their_intervals() -> None:
    assert default_guess(cart(final_time=7)).final_time == 7
    assert default_guess(cart(final_time=(1, 5))).final_time == 5
    assert default_guess(cart(final_time=(500, 900))).final_time == 500
    assert default_guess(cart(initial_time=(3, 4))).initial_time == 3
    assert default_guess(cart(final_time=(1, 5), guess={final_time: 80})).final_time == 5


def test_values_keep_to_their_boxes() -> None:
    guess = default_guess(
        cart(
            bounds={u: (0.25, 1), v: (2, 5), k: (4, 6)},
            dynamics={x: v, v: u * k},
            start={x: 0},
            end={x: (5, 9)},
        )
    )
    assert (guess.rows("u") == 0.25).all()
    assert (guess.rows("x")[1] == 2).all()
    assert guess.rows("x")[0, -1] == 5
    assert guess.parameters == {"k": 4.0}


def test_a_free_end_stays_where_the_other_one_is() -> None:
    guess = default_guess(cart(start={x: 3, v: 1}, end={v: 0}))
    np.testing.assert_allclose(guess.rows("x")[0], 3.0)


def test_the_end_meets_the_target() -> None:
    disc = default_guess(auv).at([1e9])[:, 0]
    assert disc[0] ** 2 + disc[1] ** 2 == pytest.approx(0.05, abs=1e-6)
    line = default_guess(cart(end={v: 0}, target={"far": x - 40 == 2}, start={x: 1, v: 0}))
    assert line.rows("x")[0, -1] == pytest.approx(42)


def test_every_problem_has_a_finite_guess_within_its_boxes(registry: Registry) -> None:
    assert len(registry.problems) >= 6
    for name in registry.problems:
        problem = registry.problem(name)
        guess = default_guess(problem)
        assert np.isfinite(guess.rows("x")).all(), name
        assert np.isfinite(guess.rows("u")).all(), name
        assert guess.final_time > guess.initial_time, name
        low, high = problem.box[:, :, None]
        assert ((guess.rows("u") >= low) & (guess.rows("u") <= high)).all(), name


def test_splitting_keeps_the_values_and_rescales_the_lengths() -> None:
    t = np.linspace(2, 6, 401)
    guess = guess_of(cart(), t, np.array([np.sin(t), t]), t[None, :])
    parts = split(guess, [1, 2, 5])
    assert [float(arc.t[-1]) for arc in parts.arcs] == pytest.approx([2.5, 3.5, 6])
    at = np.linspace(2, 6, 33)
    np.testing.assert_allclose(parts.at(at), guess.at(at), atol=1e-3)
    np.testing.assert_allclose(parts.at(at, "u"), guess.at(at, "u"), atol=1e-9)


def bang(switches: list[float], values: list[float], last: float) -> Solution:
    t = np.linspace(0, last, 1001)
    level = np.array(values)[np.searchsorted(switches, t, side="right")]
    return guess_of(cart(), t, np.array([t, 0 * t]), level[None, :])


def test_arranging_cuts_a_solution_where_its_controls_switch() -> None:
    parts = guess_along(cart(), bang([2.0, 7.0], [1, 0.3, -1], 10.0), Word.parse("+ s -", ["u"]))
    cuts = [float(arc.t[-1]) for arc in parts.arcs]
    assert cuts == pytest.approx([2.0, 7.0, 10.0], abs=0.11)  # one cell of its grid
    assert [arc.modes for arc in parts.arcs] == [(Mode("free"),)] * 3


def test_arranging_keeps_an_interval_for_an_arc_that_is_not_there() -> None:
    parts = guess_along(cart(), bang([5.0], [1, -1], 10.0), Word.parse("+ - + -", ["u"]))
    lengths = [float(arc.t[-1] - arc.t[0]) for arc in parts.arcs]
    assert min(lengths) > 0
    assert sum(lengths) == pytest.approx(10.0)
    assert structure_of(cart(), parts)["u"][0][0] == "+"

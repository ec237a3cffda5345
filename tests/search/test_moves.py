"""Moves of a search: what follows from a word that left its box, or that did not converge."""

from dataclasses import replace

import numpy as np
import pytest

from socp import Problem, controls, default_guess, states
from socp.methods import split
from socp.model import Mode
from socp.search.candidate import Candidate, held
from socp.search.effort import Search
from socp.search.indifference import with_bangs_for
from socp.search.mending import collapsed

x = states("x")
u = controls("u")
problem = Problem(
    name="line",
    running=x**2,
    dynamics={x: u},
    bounds={u: (0, 1)},
    start={x: 0},
    final_time=10,
    guess={u: 0.25},
)
UP, DOWN, SINGULAR = Mode("upper"), Mode("lower"), Mode("singular")
guess = default_guess(problem)


def word(*arcs: Mode, edges: tuple[float, ...]) -> Candidate:
    return Candidate(tuple((arc,) for arc in arcs), edges, guess)


def test_a_bound_takes_the_place_of_a_law_for_as_long_as_it_is_outside() -> None:
    now = held(word(UP, SINGULAR, edges=(0, 2, 10)), 0, DOWN, (3.0, 5.5))
    assert now.key == "0: + s - s"
    assert now.edges == pytest.approx((0, 2, 3, 5.5, 10))


def test_at_an_edge_no_arc_is_left_before_the_bound() -> None:
    now = held(word(UP, SINGULAR, edges=(0, 2, 10)), 0, DOWN, (1.9, 4.0))
    assert now.key in {"0: + - s", "0: + - + s"} or now.edges[1] == pytest.approx(1.9)
    later = held(word(UP, SINGULAR, edges=(0, 2, 10)), 0, DOWN, (2.0, 4.0))
    assert (later.key, later.edges) == ("0: + - s", pytest.approx((0, 2, 4, 10)))


def test_arcs_that_a_solver_made_as_good_as_none_are_left_out() -> None:
    tried = word(UP, DOWN, SINGULAR, UP, edges=(0, 2, 4, 8, 10))
    unsolved = split(guess, [3.0, 1e-5, 4.0, 3.0])
    (only,) = collapsed(tried, unsolved)
    assert only.key == "0: + s +"
    assert only.edges == pytest.approx((0, 4, 8, 10))
    assert not list(collapsed(tried, split(guess, [3.0, 1.0, 3.0, 3.0])))


def test_a_bang_has_the_integral_of_what_it_replaces() -> None:
    now = with_bangs_for(problem, word(UP, SINGULAR, DOWN, edges=(0, 2, 8, 10)), [1])
    assert now.key == "0: + - + -"
    begin, end = now.edges[2], now.edges[3]
    assert end - begin == pytest.approx(0.25 * 6)  # a quarter of the box over six
    assert 0.5 * (begin + end) == pytest.approx(5)


def test_a_word_is_tried_again_from_a_better_solution_of_another_alone() -> None:
    search = Search()
    search.solved["0: + -"] = 3.0
    arc = replace(guess.arcs[0], modes=(UP,))
    along = replace(guess, arcs=(arc,), objective=2.0)
    now = word(UP, DOWN, edges=(0, 5, 10))
    assert search.known(now)  # from a direct solution
    assert not search.known(replace(now, source=along))
    assert search.known(replace(now, source=replace(along, objective=3.0)))
    assert search.known(replace(now, source=replace(along, objective=np.nan)))
    assert not search.known(word(DOWN, UP, edges=(0, 5, 10)))


def test_a_word_is_not_tried_again_from_a_start_that_has_led_nowhere_better() -> None:
    search = Search()
    arc = replace(guess.arcs[0], modes=(UP,))
    along = replace(guess, arcs=(arc,), objective=2.0)
    now = word(UP, DOWN, edges=(0, 5, 10))
    search.solve(replace(now, source=along), replace(guess, objective=3.0))
    assert search.known(replace(now, source=along))
    assert not search.known(replace(now, source=replace(along, objective=1.0)))

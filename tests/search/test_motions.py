"""Direct solutions by the motion of their own controls, what a search returns of them, and in what
time.
"""

from itertools import islice
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq

from socp import (
    Ipopt,
    Problem,
    Solution,
    controls,
    default_guess,
    final_time,
    single_phase,
    solve_collocated,
    states,
    uniform,
)
from socp.methods import Follower
from socp.model import Word
from socp.process import time_limit
from socp.search import Search, conclude, conclusion, with_agreement
from socp.search.budget import lead
from socp.search.motions import adapted, held_solution, leaves_box, own_motion, stated_error
from socp.transcription import equidistributed, euler, radau_iia
from socp.verdict import certified, error_shares, judge, verify

x, v = states("x v")
u = controls("u")

GROWTH = Problem(
    name="growth",
    minimise=-x,
    running=3 * u,
    dynamics={x: x * (1 - u)},
    bounds={u: (0, 1)},
    start={x: 1},
    final_time=2,
)  # without control x grows to e^2
RETURN = Problem(
    name="return",
    minimise=final_time,
    dynamics={x: v, v: u},
    bounds={u: (-1, 1)},
    start={x: 1, v: 0.5},
    end={x: 0, v: 0},
)


def direct(problem: Problem, scheme: Any, steps: int) -> Solution:
    mesh = uniform(scheme, steps)
    return solve_collocated(single_phase(problem), [mesh], Ipopt(), default_guess(problem))


def along(problem: Problem, word: str) -> Solution:
    given = Word.parse(word, problem.control_names)
    return certified(problem, Follower()(problem, given, default_guess(problem)))


def test_a_grid_that_misses_its_claim_is_told_by_its_own_motion() -> None:
    """Ten Euler steps claim 1 / 0.8^10 for e^2; the control is none, and reaches e^2."""
    coarse = direct(GROWTH, euler(), 10)
    assert coarse.objective == pytest.approx(-(0.8**-10), rel=1e-6)
    assert verify(GROWTH, coarse)[0].off > 0.1
    found = own_motion(GROWTH, coarse)
    (seen,) = found.verified
    assert found.objective == pytest.approx(-np.exp(2), rel=1e-6)
    assert (found.arcs[0].x[0, -1], seen.off) == pytest.approx((np.exp(2), 0.0), abs=1e-5)
    assert seen.drift < 1e-8
    assert "its grid claims -9.31" in found.message


def test_a_search_returns_what_the_control_reaches() -> None:
    coarse = direct(GROWTH, euler(), 10)
    with time_limit(0.0):
        found = conclude(GROWTH, Search(), [coarse])
    assert found.verdict is not None
    assert found.verdict.feasible
    assert found.told == found.objective == pytest.approx(-np.exp(2), rel=1e-6)


def test_a_fine_grid_stays_as_it_is() -> None:
    fine = direct(GROWTH, radau_iia(2), 50)
    found = own_motion(GROWTH, fine)
    assert found.arcs is fine.arcs
    assert found.objective == fine.objective


def test_a_control_that_leaves_its_box_between_nodes_is_held_inside() -> None:
    """Its line through two nodes is beyond the bound by half the box where it switches."""
    grid = direct(RETURN, radau_iia(2), 25)
    assert verify(RETURN, grid)[0].box > 0.01
    found = own_motion(RETURN, grid)
    (seen,) = found.verified
    assert seen.box < 1e-6
    assert seen.off < 0.02
    true = 0.5 + 2 * np.sqrt(1 + 0.5**2 / 2)
    assert found.objective == pytest.approx(true, rel=1e-2)


def test_where_no_motion_is_followed_in_time_a_control_inside_its_box_goes_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A line through two nodes leaves the box where it switches within an interval; a held control
    does not.
    """
    outside, inside = direct(RETURN, radau_iia(2), 75), direct(RETURN, euler(), 100)
    assert leaves_box(RETURN, outside)
    assert outside.arcs[0].t.size > inside.arcs[0].t.size
    assert verify(RETURN, outside)[0].box > 0.01
    assert not leaves_box(RETURN, inside)

    def untold(_: Problem, grid: Solution) -> Solution:
        return grid

    monkeypatch.setattr(conclusion, "own_motion", untold)  # as where the time ends first
    with time_limit(0.0):
        found = conclude(RETURN, Search(), [outside, inside])
    assert found.arcs[0].t is inside.arcs[0].t
    assert found.verdict is not None
    assert found.verdict.feasible


def test_nothing_more_is_solved_once_the_time_is_over(monkeypatch: pytest.MonkeyPatch) -> None:
    solutions = [direct(GROWTH, euler(), 50), direct(GROWTH, euler(), 200)]
    word = along(GROWTH, "u: -")
    assert word.extremal

    def late(*_: Any, **__: Any) -> Solution:
        raise AssertionError("a solve after the deadline")

    monkeypatch.setattr(conclusion, "solve_collocated", late)
    monkeypatch.setattr("socp.search.digits.polished", late)
    monkeypatch.setattr("socp.search.digits.Follower", late)
    with time_limit(0.0):
        found = conclude(GROWTH, Search(), solutions)
        assert with_agreement(GROWTH, word, 9, Ipopt()) is word
    assert found.reached == pytest.approx(-np.exp(2), rel=1e-6)


def test_a_round_begins_with_what_the_judge_misses_in_the_best_word() -> None:
    wrong = along(GROWTH, "u: +")
    assert not wrong.extremal
    search = Search(best=wrong, other=wrong)
    lead(GROWTH, search)
    assert search.best is not None
    assert search.best.extremal
    assert search.best.objective == pytest.approx(-np.exp(2), rel=1e-9)
    idle = Search()
    lead(GROWTH, idle)
    assert idle.count == 0


def test_held_controls_do_what_they_claim_where_motion_is_fast_at_first() -> None:
    fast = Problem(
        name="fast at first",
        running=v,
        dynamics={x: -100 * x * x + u, v: x - v},
        bounds={u: (0, 1), x: (0, None)},
        start={x: 1, v: 0},
        final_time=20,
    )
    found = held_solution(fast, direct(fast, euler(), 50), Ipopt())
    assert found is not None
    assert found.stop.ok
    assert verify(fast, found)[0].off <= 1e-6  # on a uniform grid of as many intervals: 0.2
    # without control x is 1 / (1 + 100 t), and what has come into v is its integral
    spent = found.objective + found.rows("x")[1, -1]
    assert spent == pytest.approx(np.log1p(100 * 20) / 100, rel=1e-4)


def test_equal_shares_of_a_motion_are_short_where_it_is_fast() -> None:
    known = direct(RETURN, euler(), 40)  # two arcs, one switch
    (arc,), t = known.arcs, known.t
    mesh = equidistributed(RETURN, euler(), 30, known)
    shares = np.array([share for share, _ in mesh])
    assert shares.sum() == pytest.approx(1)
    switch = t[np.argmax(np.abs(np.diff(arc.u[0])))] / t[-1]
    ends = np.append(0.0, np.cumsum(shares))
    assert abs(0.5 * (ends[np.argmin(shares)] + ends[np.argmin(shares) + 1]) - switch) < 2 / 40
    assert shares.min() < 1 / 40 / 3


def test_what_is_over_within_a_thousandth_of_the_horizon_is_found_on_grids_that_are_cut() -> None:
    """A dose ends when a day of it costs what it saves on all days to come."""
    kill, days = 50.0, 100.0
    treatment = Problem(
        name="treatment",
        running=x + kill * u,
        dynamics={x: -kill * u * x},
        bounds={u: (0, 1)},
        start={x: 1},
        final_time=days,
    )
    stop = brentq(lambda t: (days - t) * np.exp(-kill * t) - 1, 0, 1)
    left = np.exp(-kill * stop)
    true = (1 - left) / kill + (days - stop) * left + kill * stop
    coarse = direct(treatment, euler(), 50)
    grids = list(islice(adapted(treatment, coarse, Ipopt()), 5))
    best = min(grids, key=stated_error)
    assert best.arcs[0].mesh.size < 300
    assert best.verdict is not None
    assert best.verdict.feasible
    assert abs(best.reached - true) <= stated_error(best) < 1e-2 * true
    assert stated_error(grids[0]) > 10 * stated_error(best)
    assert stop < 1e-3 * days


def test_most_of_the_error_of_held_controls_is_where_they_switch() -> None:
    known = held_solution(RETURN, direct(RETURN, euler(), 20), Ipopt())
    assert known is not None
    found = error_shares(RETURN, judge(RETURN, known))
    assert found is not None
    edges, shares = found
    switch = 0.5 + np.sqrt(1 + 0.5**2 / 2)  # it brakes from x + v^2 / 2 = 1 + 0.5^2 / 2, half way
    k = int(np.argmax(shares))
    assert edges[k - 1] <= switch <= edges[k + 2]
    assert shares[k - 1 : k + 2].sum() > 0.8 * shares.sum()

"""Branches over a number of a problem: events at values known in closed form, every point
certified.
"""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from casadi import cos
from ponds import POND, rate, u, x

from socp.errors import MethodError, ProblemError, SolveError
from socp.model import (
    Problem,
    Progress,
    Solution,
    final_time,
    states,
    time,
)
from socp.registry import solve
from socp.study import Branch, Point, follow, followed_to
from socp.study.walk import predicted

v = states("v")
# rest to rest over 10, |u| <= 1: the speed has its peak sqrt(10) half way
REST = Problem(
    name="rest",
    minimise=final_time,
    dynamics={x: v, v: u},
    bounds={u: (-1, 1), v: (None, 4)},
    start={x: 0, v: 0},
    end={x: 10, v: 0},
)


@pytest.fixture(scope="module")
def along() -> Solution:
    """Return the pond at T = 2, with its singular arc."""
    return solve(POND.with_(final_time=2), method="lgr-multiphase", word="- s +")


@pytest.fixture(scope="module")
def limited() -> Solution:
    """Return the way with a speed of at most 3."""
    return solve(REST.with_({"bounds.v.upper": 3}), method="lgr-multiphase", word="+ b[v.upper] -")


@pytest.fixture(scope="module")
def shortened(along: Solution) -> Branch:
    """Return the pond as time gets short, from 2 to 1."""
    return follow(POND, {"final_time": (2, 1)}, along, steps=4)


def whole(found: Branch, last: float, words: list[str]) -> None:
    """Check that a branch ends at a value, with these words, all points certified."""
    assert (found.ended, found.interrupted, found.points[-1].value) == ("", False, last)
    assert all(each.solution.extremal for each in found.points)
    seen = dict.fromkeys(each.solution.word for each in found.points)
    assert list(seen) == words
    assert [(each.before, each.after) for each in found.events] == list(pairwise(words))


def test_a_singular_arc_vanishes_as_time_gets_short(shortened: Branch) -> None:
    found = shortened
    whole(found, 1.0, ["u: - s +", "u: - +"])
    (event,) = found.events
    assert (event.kind, event.where) == ("arc vanishes", "u")
    assert event.value == pytest.approx(1.5, abs=1e-8)
    assert event.time == pytest.approx(0.75, abs=1e-8)
    for each in found.points:
        left = max(0.25, 1 - each.value / 2)
        assert each.solution.objective == pytest.approx(
            2 / 3 * (0.75**3 - (left - 0.25) ** 3), rel=1e-9
        )


@pytest.mark.slow
def test_a_singular_arc_appears_as_time_gets_long(along: Solution) -> None:
    """Past the end of its word the judge still certifies it within his tolerance: margins tell."""
    short = follow(POND, {"final_time": (2, 1.25)}, along, steps=2).points[-1].solution
    found = follow(POND, {"final_time": (1.25, 1.75)}, short, steps=2)
    whole(found, 1.75, ["u: - +", "u: - s +"])
    (event,) = found.events
    assert event.kind == "arc appears"
    assert event.value == pytest.approx(1.5, abs=1e-8)


@pytest.mark.slow
def test_a_constant_is_followed_through_an_event(along: Solution) -> None:
    """The level is out of reach in T = 2 where it is at 0."""
    found = follow(POND.with_(final_time=2), {"level": (0.25, -0.25)}, along, steps=3)
    whole(found, -0.25, ["u: - s +", "u: - +"])
    assert found.events[0].value == pytest.approx(0.0, abs=0.5e-8)


@pytest.mark.slow
def test_a_start_crosses_a_singular_surface() -> None:
    """From x = 1 to the level, wherever that is: its distance d costs d^3 / 3."""
    free = POND.with_({"end": {x: (None, None)}, "final_time": 2})
    below = solve(free, method="lgr-multiphase", word="- s")
    found = follow(free, {"level": (0.75, 1.2)}, below, steps=3)
    whole(found, 1.2, ["u: - s", "u: + s"])
    (event,) = found.events
    assert (event.kind, event.where) == ("bound changes", "u")
    assert event.value == pytest.approx(1.0, abs=1e-8)
    assert event.time == pytest.approx(0.0, abs=1e-8)
    assert found.points[-1].solution.objective == pytest.approx(0.2**3 / 3, rel=1e-9)


@pytest.mark.slow
def test_two_arcs_turn_at_once() -> None:
    """Both ends are at 1/2: below and above the level cost the same, 2/3 |1/2 - level|^3."""
    even = POND.with_({"start": {x: 0.5}, "end": {x: 0.5}, "final_time": 2})
    start = solve(even.with_(level=0.3), method="lgr-multiphase", word="- s +")
    found = follow(even, {"level": (0.3, 0.7)}, start, steps=2)
    whole(found, 0.7, ["u: - s +", "u: + s -"])
    assert found.events[0].value == pytest.approx(0.5, abs=1e-8)
    for each in found.points:
        exact = 2 / 3 * abs(0.5 - each.value) ** 3
        assert each.solution.objective == pytest.approx(exact, rel=1e-7)


@pytest.mark.slow
def test_an_event_at_the_last_value_is_one(along: Solution) -> None:
    found = follow(POND, {"final_time": (2, 1.5)}, along, steps=2)
    whole(found, 1.5, ["u: - s +", "u: - +"])
    assert found.events[0].value == pytest.approx(1.5, abs=1e-8)


@pytest.mark.slow
def test_a_limit_is_touched_at_the_free_peak() -> None:
    free = solve(REST, method="lgr-multiphase", word="+ -")
    found = follow(REST, {"bounds.v.upper": (4, 2.5)}, free, steps=3)
    whole(found, 2.5, ["u: + -", "u: + b[v.upper] -"])
    (event,) = found.events
    assert (event.kind, event.where) == ("constraint touched", "v.upper")
    assert event.value == pytest.approx(np.sqrt(10), abs=1e-8)
    assert event.time == pytest.approx(np.sqrt(10), abs=1e-6)
    last = found.points[-1].solution
    assert last.objective == pytest.approx(10 / 2.5 + 2.5, rel=1e-10)


@pytest.mark.slow
def test_a_boundary_arc_vanishes_at_the_free_peak(limited: Solution) -> None:
    found = follow(REST, {"bounds.v.upper": (3, 4)}, limited, steps=3)
    whole(found, 4.0, ["u: + b[v.upper] -", "u: + -"])
    (event,) = found.events
    assert (event.kind, event.where) == ("constraint left", "v.upper")  # "touched", the other way
    assert event.value == pytest.approx(np.sqrt(10), abs=1e-8)


@pytest.mark.slow
def test_a_law_leaves_its_box() -> None:
    """X' = u, integral of (x - rate (1 - cos t))^2 in 2.5: the law is rate sin t, which the box
    holds up to 1, and which is at its height at pi / 2.
    """
    wave = Problem(
        name="wave",
        running=1 + (x - rate * (1 - cos(time))) ** 2,
        dynamics={x: u},
        bounds={u: (-1, 1)},
        start={x: 0},
        final_time=2.5,
    )
    slow = solve(wave.with_(rate=0.8), method="lgr-multiphase", word="s")
    found = follow(wave, {"rate": (0.8, 1.05)}, slow, steps=1)
    whole(found, 1.05, ["u: s", "u: s + s"])
    (event,) = found.events
    assert (event.kind, event.where) == ("law leaves its box", "u")
    assert event.value == pytest.approx(1.0, abs=1e-8)
    assert event.time == pytest.approx(np.pi / 2, abs=1e-6)


@pytest.mark.slow
def test_without_a_guess_a_start_is_looked_for() -> None:
    found = follow(REST, {"end.x": (10, 11)}, steps=1)
    assert [each.solution.word for each in found.points] == ["u: + -"] * 2
    assert found.points[-1].solution.objective == pytest.approx(2 * np.sqrt(11), rel=1e-9)


@pytest.mark.slow
def test_a_branch_that_ends_says_so() -> None:
    """In T = 2 one gets from 1 to -1 and no further."""
    far = POND.with_({"end.x": -0.8, "final_time": 2})
    start = solve(far, method="lgr-multiphase", word="- s -")
    found = follow(far, {"end.x": (-0.8, -1.2)}, start, steps=4)
    assert found.ended
    assert -1.0 <= found.points[-1].value < -0.8
    assert all(each.value == pytest.approx(-1.0, abs=1e-6) for each in found.events)


def test_a_watch_may_stop_it(along: Solution) -> None:
    told: list[Progress] = []

    def stop(now: Progress, /) -> bool:
        told.append(now)
        return len(told) > 2

    found = follow(POND, {"final_time": (2, 1)}, along, steps=8, watch=stop)
    assert found.interrupted
    assert 0 < len(found.points) < 5
    assert told[0].stage.startswith("final_time = 1.875, 1 points, 0 events")


def test_rows_are_plain_values_in_order(shortened: Branch) -> None:
    rows = shortened.rows
    values = [row["value"] for row in rows]
    assert values == sorted(values, reverse=True)
    event = next(row for row in rows if row["event"])
    assert (event["word"], event["after"]) == ("u: - s +", "u: - +")
    assert event["objective"] == pytest.approx(2 / 3 * 0.75**3, rel=1e-9)
    assert rows[0]["rung"] == "strict local minimum among controls of its word"
    assert rows[0]["switches"] == pytest.approx([0.75, 1.25])


def test_a_prediction_is_on_the_line_through_two_solutions(along: Solution) -> None:
    points = follow(POND, {"final_time": (2, 1.9)}, along, steps=1).points
    ahead = predicted(points[0], points[1], 1.8)
    assert ahead is not None
    assert ahead.junctions == pytest.approx([0.75, 1.05])
    near = predicted(points[0], points[1], 1.0)  # an arc keeps a fifth of its length
    assert near is not None
    assert np.ptp(near.arcs[1].t) == pytest.approx(0.2 * 0.4)
    other = Point(2.0, replace(along, arcs=along.arcs[:2]))
    assert predicted(other, points[1], 1.8) is None


@pytest.mark.parametrize(
    ("given", "error", "said"),
    [
        ({"final_time": (1, 1)}, MethodError, "give two different values"),
        ({}, MethodError, "followed in one number, but 0 are given"),
        ({"level": (0, 1), "rate": (1, 2)}, MethodError, "but 2 are given"),
        ({"leve": (0, 1)}, ProblemError, "there is no 'leve' to change; did you mean 'level'?"),
        ({"final_time": (2, -1)}, ProblemError, "final_time: -1.0 is not after"),
    ],
)
def test_what_cannot_be_followed_is_named(
    given: dict[str, Any], error: type[Exception], said: str
) -> None:
    with pytest.raises(error, match=said):
        follow(POND, given)


def test_a_guess_that_leads_nowhere_is_refused(along: Solution) -> None:
    with pytest.raises(SolveError, match="the guess leads to no extremal at the first value"):
        follow(POND, {"end.x": (9, 8)}, along)


def test_an_easier_problem_leads_to_one(along: Solution) -> None:
    """The level is met at T = 2 and is not at T = 1."""
    short = POND.with_(final_time=1)
    found = followed_to(short, {"final_time": 2}, along)
    assert (found.word, found.extremal) == ("u: - +", True)
    assert found.objective == pytest.approx(2 / 3 * (0.75**3 - 0.25**3), rel=1e-9)
    assert found.problem == "pond"


@pytest.mark.parametrize(
    ("given", "error", "said"),
    [
        ({"final_time": 4}, MethodError, "give two different values"),
        ({"leve": 1.0}, ProblemError, "did you mean 'level'?"),
        ({"end.x": 1.5, "level": 0.1}, MethodError, "but 2 are given"),
    ],
)
def test_what_cannot_lead_is_named(
    given: dict[str, float], error: type[Exception], said: str
) -> None:
    with pytest.raises(error, match=said):
        followed_to(POND, given)


@pytest.mark.slow
def test_a_branch_that_does_not_arrive_leads_nowhere() -> None:
    """In T = 2 one gets from 1 to -1 and no further."""
    far = POND.with_({"end.x": -1.2, "final_time": 2})
    start = solve(far.with_({"end.x": -0.8}), method="lgr-multiphase", word="- s -")
    with pytest.raises(SolveError, match=r"pond: followed from end\.x = -0\.8, but end\.x = "):
        followed_to(far, {"end.x": -0.8}, start)

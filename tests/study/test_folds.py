"""Branches whose number turns back, extremals that cease to be minima, and events of more than one
control: all at values known in closed form.

With y' = x, x' = u from rest over T the word `+ -` with its switch at s ends at x = 2s - T, and
dJ/ds = x - T + 2 g'(x) where J = -y(T) + g(x(T)). The switching function is linear in time with its
zero at s, so that the principle holds whatever g is: `bent` makes dJ/ds any function.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from casadi import SX, cos
from ponds import level, rate, u, x

from socp.model import Problem, Solution, constants, controls, states, time
from socp.registry import solve
from socp.study import Branch, follow
from socp.study.events import minimality
from socp.study.monitors import CURVATURE, Margin

T = 3.0
y, z, w = states("y z w")
v = controls("v")
a = constants(a=1.0)


def bent(name: str, potential: SX) -> Problem:
    """Return the problem whose dJ/ds is the slope of a potential at x(T)."""
    return Problem(
        name=name,
        minimise=-y + (T * x - x**2 / 2 + potential) / 2,
        dynamics={x: u, y: x},
        bounds={u: (-1, 1)},
        start={x: 0, y: 0},
        final_time=T,
    )


def along(problem: Problem, word: str, lengths: str = "") -> Solution:
    more = {"lengths": lengths} if lengths else {}
    return solve(problem, method="lgr-multiphase", word=word, **more)


def ends(found: Branch) -> list[float]:
    """Return what the last state x is at the points."""
    return [2 * each.solution.junctions[0] - T for each in found.points]


def events(found: Branch) -> list[tuple[str, str]]:
    return [(each.kind, each.where) for each in found.events]


@pytest.mark.slow
def test_a_branch_goes_round_its_fold() -> None:
    """DJ/ds = x^2 - a: a minimum at sqrt(a) meets a maximum at -sqrt(a)."""
    fold = bent("fold", x**3 / 3 - a * x)
    found = follow(fold, {"a": (0.25, -0.5)}, along(fold.with_(a=0.25), "+ -"), steps=3)
    assert events(found) == [("fold", "a")]
    (event,) = found.events
    assert event.value == pytest.approx(0.0, abs=1e-8)
    assert event.solution is not None
    assert event.solution.junctions[0] == pytest.approx(T / 2, abs=1e-6)
    assert (event.before, event.after) == ("u: + -", "u: + -")
    assert all(each.solution.extremal for each in found.points)
    signs = np.where(np.arange(len(found.points)) < event.place, 1.0, -1.0)
    roots = signs * np.sqrt([each.value for each in found.points])
    assert ends(found) == pytest.approx(roots, abs=1e-9)
    rungs = [row["rung"] for row in found.rows if not row["event"]]
    assert set(rungs[: event.place]) == {"strict strong local minimum"}
    assert set(rungs[event.place :]) == {"extremal"}
    assert found.points[-1].value == 0.25
    assert "a = 0.25: the branch is back at the value that it began at" in found.ended


@pytest.mark.slow
def test_two_folds_lead_on_to_the_last_value() -> None:
    """DJ/ds = x^3 - x - a: folds where x is 1 / sqrt(3), and a -+2 / (3 sqrt(3))."""
    twice = bent("twice", x**4 / 4 - x**2 / 2 - a * x)
    start = along(twice.with_(a=-1), "+ -", "0.8 2.2")
    found = follow(twice, {"a": (-1, 0.9)}, start, steps=6)
    assert (found.ended, found.points[-1].value) == ("", 0.9)
    assert [each.kind for each in found.events] == ["fold", "fold"]
    there = 2 / (3 * np.sqrt(3))
    assert [each.value for each in found.events] == pytest.approx([there, -there], abs=1e-8)
    heights = np.array(ends(found))
    assert heights**3 - heights == pytest.approx([each.value for each in found.points], abs=1e-8)


@pytest.mark.slow
def test_a_fold_in_a_bound() -> None:
    """With |u| <= a the end is x = a (2s - T), and dJ/ds = x - a (1 + x^2) here: a = 1/2 at most,
    where x is 1.
    """
    bound = Problem(
        name="bound",
        minimise=-y + (T - 1) / 2 * x - x**3 / 6,
        dynamics={x: u, y: x},
        bounds={u: (-a, a)},
        start={x: 0, y: 0},
        final_time=T,
    )
    start = along(bound.with_(a=0.48), "+ -", "2.2 0.8")
    found = follow(bound, {"a": (0.48, 0.52)}, start, steps=2)
    assert events(found) == [("fold", "a")]
    assert found.events[0].value == pytest.approx(0.5, abs=1e-8)
    values = np.array([each.value for each in found.points])
    heights = values * ends(found)
    assert heights == pytest.approx(values * (1 + heights**2), abs=1e-8)
    assert heights[-1] > 1


@pytest.mark.slow
def test_a_word_with_a_singular_arc_folds() -> None:
    """From the level up by h at the end costs h^3 / 3: dJ/dh = (h - 0.4)^2 - a in all."""
    h = x - level
    pond = Problem(
        name="left",
        running=h**2,
        minimise=-(h**3) / 3 + (h - 0.4) ** 3 / 3 - a * h,
        dynamics={x: u},
        bounds={u: (-rate, rate)},
        start={x: 1},
        final_time=2,
    )
    start = along(pond.with_(a=0.02), "- s +", "0.75 0.65 0.6")
    found = follow(pond, {"a": (0.02, -0.02)}, start, steps=3)
    assert events(found) == [("fold", "a")]
    (event,) = found.events
    assert event.value == pytest.approx(0.0, abs=1e-8)
    for k, each in enumerate(found.points):
        side = 1 if k < event.place else -1
        assert each.solution.extremal
        left = 2.0 - (0.4 + side * np.sqrt(each.value))
        assert each.solution.junctions == pytest.approx([0.75, left], abs=1e-8)


@pytest.mark.slow
def test_an_extremal_ceases_to_be_a_minimum() -> None:
    """DJ/ds = a x + x^3: the switch stays where it is, of which the curvature is a."""
    fork = bent("fork", a * x**2 / 2 + x**4 / 4)
    found = follow(fork, {"a": (0.3, -0.2)}, along(fork.with_(a=0.3), "+ -"), steps=2)
    assert (found.ended, events(found)) == ("", [("minimum lost", "a")])
    assert found.events[0].value == pytest.approx(0.0, abs=1e-8)
    assert found.events[0].error < 1e-8
    assert ends(found) == pytest.approx([0.0] * len(found.points), abs=1e-8)
    assert found.points[-1].solution.extremal
    back = follow(fork, {"a": (-0.2, 0.3)}, found.points[-1].solution, steps=2)
    assert events(back) == [("minimum gained", "a")]


@pytest.mark.slow
def test_switches_of_two_controls_meet() -> None:
    """With -y(T) - k/2 x(T)^2 the switch is at T (k - 1) / (2k - 1)."""
    pair = Problem(
        name="pair",
        minimise=-y + x**2 / 2 - w - a * z**2 / 2,
        dynamics={x: u, y: x, z: v, w: z},
        bounds={u: (-1, 1), v: (-1, 1)},
        start={x: 0, y: 0, z: 0, w: 0},
        final_time=T,
    )
    start = along(pair.with_(a=-2), "u: + + -; v: + - -", "1.8 0.2 1")
    found = follow(pair, {"a": (-2, -0.5)}, start, steps=2)
    assert (found.ended, events(found)) == ("", [("switches meet", "u, v")])
    assert found.events[0].value == pytest.approx(-1.0, abs=1e-8)
    assert found.events[0].time == pytest.approx(2.0, abs=1e-8)
    assert found.points[-1].solution.junctions == pytest.approx([2.0, 2.25], abs=1e-9)


@pytest.mark.slow
def test_a_constraint_is_left_where_its_multiplier_is_zero() -> None:
    """X is wanted at 1 + a + 0.2 cos(2t - 0.3), but may be 1 at most: its density is twice what it
    is wanted above that.
    """
    held = Problem(
        name="held",
        running=(x - 1 - a - 0.2 * cos(2 * time - 0.3)) ** 2,
        dynamics={x: u},
        bounds={u: (-1, 1), x: (None, 1)},
        start={x: 1},
        final_time=np.pi,
    )
    found = follow(held, {"a": (0.25, 0.17)}, along(held.with_(a=0.25), "b[x.upper]"), steps=2)
    assert (found.ended, events(found)) == ("", [("constraint left", "x.upper")])
    assert found.events[0].value == pytest.approx(0.2, abs=1e-8)
    assert found.events[0].time == pytest.approx(np.pi / 2 + 0.15, abs=1e-6)
    assert found.points[-1].solution.word == "u: b[x.upper] s b[x.upper]"


def test_round_a_fold_nearby() -> None:
    fold = bent("fold", x**3 / 3 - a * x)
    found = follow(fold, {"a": (1e-3, -1.0)}, along(fold.with_(a=1e-3), "+ -"), steps=1)
    assert [each.value for each in found.events] == pytest.approx([0.0], abs=1e-8)
    assert ends(found)[-1] == pytest.approx(-np.sqrt(1e-3), abs=1e-9)


def test_where_a_minimum_is_lost_lies_between_what_shows_it() -> None:
    """Near the zero the curvature hardly changes: a polynomial leads a thousand steps away."""
    solution = SimpleNamespace(word="u: +")

    def trial(value: float, curvature: float) -> Any:
        found = {CURVATURE: Margin(curvature, 0.0)}
        return SimpleNamespace(value=value, solution=solution, margins=found)

    def tried(value: float, _near: Any) -> Any:
        return trial(value, 1.0 + 1e-3 * value)

    walk: Any = SimpleNamespace(name="n", width=1.0, points=[], tried=tried)
    (event,) = minimality(walk, trial(0.0, 1.0), trial(1.0, -1.0))
    assert (event.kind, event.value, event.error) == ("minimum lost", 0.5, np.inf)

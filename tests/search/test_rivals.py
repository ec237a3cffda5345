"""Rivals: better extremals than a certified one, found by shooting along short words of bangs."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from socp import Problem, Solution, controls, default_guess, final_time, run, states
from socp.registry import Registry
from socp.search import Search
from socp.search.rivals import _Shooting, outdo, rivals

x, v = states("x v")
u = controls("u")

# to a distance of 1 on either side in a current: 2/3 with it, 2 against it, both extremals
CURRENT = Problem(
    name="current",
    minimise=final_time,
    dynamics={x: 0.5 + u},
    bounds={u: (-1, 1)},
    start={x: 0},
    target={"either side": x**2 == 1},
    guess={x: (0, -1), final_time: 2},
)
REST = Problem(
    name="rest",
    minimise=final_time,
    dynamics={x: v, v: u},
    bounds={u: (-1, 1)},
    start={x: 1, v: 1},
    end={x: 0, v: 0},
)


def along(problem: Problem, word: str) -> Solution:
    method = Registry.load().method("lgr-multiphase")(word=word)
    return run(method, problem, default_guess(problem))


def test_a_rival_is_met_by_shooting() -> None:
    worse = along(CURRENT, "-")
    assert worse.extremal
    assert worse.objective == pytest.approx(2.0)
    found = rivals(CURRENT, worse)
    assert found[0].objective == pytest.approx(2.0 / 3.0)
    assert all(each.objective < worse.objective for each in found)


def test_shots_that_come_no_nearer_are_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """From the best extremal every shot comes to a least miss in three steps or so."""
    counts, corrected = list[int](), _Shooting._corrected

    def counted(self: _Shooting, shots: Any, *given: Any) -> Any:
        counts.append(len(shots.lengths))
        return corrected(self, shots, *given)

    monkeypatch.setattr(_Shooting, "_corrected", counted)
    assert rivals(CURRENT, along(replace(CURRENT, guess={x: (0, 1)}), "+")) == []
    assert counts[2] < counts[1] / 4
    none = len(counts)
    assert rivals(CURRENT, along(CURRENT, "-"))
    assert len(counts) - none > none


@pytest.mark.slow
def test_the_search_goes_on_from_a_rival() -> None:
    search, points = Search(), list[Solution]()
    search.keep(along(CURRENT, "-"))
    outdo(CURRENT, search, points)
    assert search.best is not None
    assert search.best.extremal
    assert search.best.objective == pytest.approx(2.0 / 3.0)
    assert points


@pytest.mark.slow
def test_the_best_extremal_has_no_rivals() -> None:
    assert rivals(CURRENT, along(replace(CURRENT, guess={x: (0, 1)}), "+")) == []
    best = along(REST, "- +")
    assert best.objective == pytest.approx(1 + np.sqrt(6))
    assert rivals(REST, best) == []


@pytest.mark.slow
def test_the_aircraft_is_brought_to_trim_by_three_switches() -> None:
    """Garrard and Jordan's F-8: coarse grids show an extremal of 5.73 alone; the best known has
    3.78086 (mintoc.de).
    """
    a, pitch, rate = states("a pitch rate")
    w = controls("w")
    xi = 0.05236
    e = xi * (2 * w - 1)
    aircraft = Problem(
        name="aircraft",
        minimise=final_time,
        dynamics={
            a: -0.877 * a
            + rate
            - 0.088 * a * rate
            + 0.47 * a**2
            - 0.019 * pitch**2
            - a**2 * rate
            + 3.846 * a**3
            - 0.215 * e
            + 0.28 * a**2 * e
            + 0.47 * a * xi**2
            + 0.63 * xi**2 * e,
            pitch: rate,
            rate: -4.208 * a
            - 0.396 * rate
            - 0.47 * a**2
            - 3.564 * a**3
            - 20.967 * e
            + 6.265 * a**2 * e
            + 46 * a * xi**2
            + 61.4 * xi**2 * e,
        },
        bounds={w: (0, 1)},
        start={a: 0.4655, pitch: 0, rate: 0},
        end={a: 0, pitch: 0, rate: 0},
    )
    found = run(Registry.load().method("auto")(), aircraft, default_guess(aircraft))
    assert found.extremal
    assert found.word == "w: + - + -"
    assert found.objective == pytest.approx(3.78085577, rel=1e-8)


@pytest.mark.slow
def test_another_aircraft_is_brought_to_trim_by_three_switches() -> None:
    """With other signs of its drag shots come near in nine steps, and to the ends in some more:
    grids alone show an extremal of 5.03324.
    """
    a, pitch, rate = states("a pitch rate")
    w, e = controls("w"), 0.05236
    up = 1 - 2 * w
    drag = (0.215 * e - 0.28 * a**2 * e + 0.63 * e**3) * up
    lift = -0.877 * a + rate - 0.088 * a * rate + 0.47 * a**2 - 0.019 * pitch**2 - a**2 * rate
    turn = -4.208 * a - 0.396 * rate - 0.47 * a**2 - 3.564 * a**3 + 46 * a * e**2
    aircraft = Problem(
        name="aircraft",
        minimise=final_time,
        dynamics={
            a: lift + 3.846 * a**3 - drag + 0.47 * a * e**2,
            pitch: rate,
            rate: turn + (20.967 * e - 6.265 * a**2 * e + 61.4 * e**3) * up,
        },
        bounds={w: (0, 1)},
        start={a: 0.4655, pitch: 0, rate: 0},
        end={a: 0, pitch: 0, rate: 0},
        final_time=(1, 20),
    )
    found = run(Registry.load().method("auto")(), aircraft, default_guess(aircraft))
    assert found.extremal
    assert found.word == "w: + - + -"
    assert found.objective < 4.0


@pytest.mark.parametrize("problem", [REST, replace(REST, minimise=x**2, final_time=(4, 4))])
def test_slopes_of_what_shots_miss_are_those_of_differences(problem: Problem) -> None:
    guess = default_guess(problem)
    shooting = _Shooting.of(problem, guess)
    shots = shooting.drawn()[np.arange(24)]
    off, _ = shooting.residuals(shots)
    slopes = shooting._slopes(shots, shooting._flight(shots), off)
    step = 1e-5 * (guess.final_time - guess.initial_time)
    for k in range(shots.lengths.shape[1]):
        moved = np.where(shots.lengths > 0.0, step * (np.arange(4) == k), 0.0)
        there, back = (
            shooting.residuals(shooting._kept(shots, shots.lengths + way * moved))[0]
            for way in (1.0, -1.0)
        )
        # the last rows, of limits and of the cost, have kinks
        assert ((there - back) / (2.0 * step))[:, :-2] == pytest.approx(
            slopes[:, :-2, k], rel=1e-4, abs=1e-4
        )

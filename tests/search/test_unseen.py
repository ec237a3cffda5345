"""Problems that nobody has tuned anything to: motions and horizons as guesses, rounds, and a search
that ends in its time.
"""

import sys
from dataclasses import replace

import numpy as np
import pytest
from casadi import cos, sin

from socp import Problem, Solution, controls, default_guess, final_time, run, states
from socp.methods import Scouted, motions, scouts, scouts_from_motions, solve_directly
from socp.methods.driving import horizons, other_horizons
from socp.model import Stop, Watch
from socp.process import seconds_left, time_limit
from socp.registry import Registry
from socp.search import Search, escalate
from socp.solvers import NLP, Ipopt, NLPPoint
from socp.transcription import euler, uniform

x, v, i, s = states("x v i s")
u = controls("u")

GROWTH = Problem(
    name="growth",
    running=u,
    dynamics={i: 0.2 * i * (1 - i) - u * i},
    bounds={u: (0, 0.8), i: (None, 0.02)},
    start={i: 1e-5},
    final_time=200,
)
PENDULUM = Problem(
    name="pendulum",
    minimise=final_time,
    dynamics={x: v, v: u - 9.81 * sin(x)},
    bounds={u: (-2, 2)},
    start={x: 0, v: 0},
    end={x: float(np.pi), v: 0},
)
ESCAPE = Problem(
    name="escape",
    minimise=-x,
    dynamics={x: x**2 + u},
    bounds={u: (0, 1)},
    start={x: 1},
    final_time=5,
)

SUBSTRATE, BIOMASS, PRODUCT, VOLUME = states("S X P V")
RATE = SUBSTRATE / (0.2 + SUBSTRATE + SUBSTRATE**2)
FED = Problem(
    name="fed",
    minimise=-PRODUCT * VOLUME,
    dynamics={
        BIOMASS: RATE * BIOMASS - u / VOLUME * BIOMASS,
        SUBSTRATE: -2 * RATE * BIOMASS + u / VOLUME * (10 - SUBSTRATE),
        PRODUCT: 0.5 * BIOMASS * SUBSTRATE / (0.1 + SUBSTRATE + 4 * SUBSTRATE**2)
        - (0.05 + u / VOLUME) * PRODUCT,
        VOLUME: u,
    },
    bounds={u: (0, 1), VOLUME: (None, 5)},
    start={BIOMASS: 1, SUBSTRATE: 0.2, PRODUCT: 0, VOLUME: 2},
)


def auto(problem: Problem, watch=None, **options) -> Solution:  # noqa: ANN001, ANN003
    method = Registry.load().method("auto")(**options)
    guess = default_guess(problem)
    return run(method, problem, guess) if watch is None else run(method, problem, guess, watch)


# -- time


def test_time_is_kept_inside_time() -> None:
    assert seconds_left() == float("inf")
    with time_limit(100.0):
        assert 99.0 < seconds_left() <= 100.0
        with time_limit(1000.0):
            assert seconds_left() <= 100.0
        with time_limit(0.0):
            assert seconds_left() == 0.0
        assert seconds_left() > 99.0
    assert seconds_left() == float("inf")


def test_a_solve_ends_in_the_time_around_it() -> None:
    with time_limit(0.0):
        assert scouts(GROWTH, default_guess(GROWTH), 12) == []
        found = auto(GROWTH)
    assert found.stop is Stop.LIMIT
    assert "the time for it is over" in found.message


# -- guesses


def test_motions_follow_the_dynamics_and_those_in_the_box_go_first() -> None:
    made = list(motions(GROWTH, default_guess(GROWTH)))
    assert [each.rows("u")[0, 0] for each in made] == pytest.approx([0.2, 0.4, 0.6, 0.8, 0.0])
    decayed = np.exp(-0.2 * made[1].t)  # u = 0.4: i' = -0.2 i - 0.2 i^2
    exact = 1e-5 * decayed / (1 + 1e-5 * (1 - decayed))
    assert made[1].rows("x")[0] == pytest.approx(exact, rel=1e-3, abs=1e-9)
    assert made[-1].rows("x").max() == 0.02  # u = 0 leaves the box, and is held in it


def test_a_motion_that_escapes_is_a_finite_guess() -> None:
    for made in motions(ESCAPE, default_guess(ESCAPE)):
        assert np.isfinite(made.rows("x")).all()
        assert made.final_time == 5.0


def test_horizons_are_tried_where_the_final_time_is_free() -> None:
    guess = default_guess(PENDULUM)
    spans = [each.final_time / guess.final_time for each in other_horizons(PENDULUM, guess)]
    assert sorted(spans) == pytest.approx([0.125, 0.25, 0.5, 2.0, 4.0, 8.0])
    assert horizons(GROWTH) == (1.0,)
    assert list(other_horizons(GROWTH, default_guess(GROWTH))) == []


@pytest.mark.slow
def test_a_horizon_far_from_its_estimate_is_met() -> None:
    """The pendulum needs five swings where the straight way is one; a coarse grid is 5 % off."""
    met = scouts_from_motions(PENDULUM, default_guess(PENDULUM))
    assert met[0].final_time == pytest.approx(5.70060832624, rel=0.06)


class OwnUnits:
    """A solver that solves programmes in the problem's own units alone."""

    def within(self, *_: float) -> "OwnUnits":
        return self

    limited = within

    def __call__(self, nlp: NLP, guess: NLPPoint, watch: Watch) -> NLPPoint:
        return Ipopt()(nlp, guess, watch) if nlp.unit == 1.0 else replace(guess, stop=Stop.FAILED)


def test_where_magnitudes_lead_nowhere_the_own_units_are_tried() -> None:
    """From rest to rest in a time of 2 sqrt(40)."""
    line = Problem(
        name="line",
        minimise=final_time,
        dynamics={x: v, v: u},
        bounds={u: (-1, 1)},
        start={x: 0, v: 0},
        end={x: 40, v: 0},
    )
    guess = default_guess(line)
    assert scouts(line, guess, 1, backend=OwnUnits())[0].objective == pytest.approx(160**0.5, 1e-2)
    mesh = uniform(euler(), 40)
    found = solve_directly(line, mesh, OwnUnits(), guess)
    assert found.objective == pytest.approx(160**0.5, rel=0.1)


# -- rounds


def test_nothing_more_is_tried_without_time_and_it_is_said() -> None:
    search, hand = Search(), [default_guess(GROWTH)]
    with time_limit(0.0):
        escalate(GROWTH, search, hand, (hand[0], 100, Ipopt()))
    assert search.late
    assert search.grids == []
    assert len(hand) == 1


def test_one_start_is_held_once_whatever_it_claims(monkeypatch: pytest.MonkeyPatch) -> None:
    """A coarse grid misses its end, so that its motion stays what it claims to be."""
    coarse = solve_directly(PENDULUM, uniform(euler(), 10), Ipopt(), default_guess(PENDULUM))
    wrong, starts = replace(coarse, objective=coarse.objective / 2), list[Solution]()
    held = "socp.search.budget.held_solution"
    monkeypatch.setattr(held, lambda _, each, *__: starts.append(each))
    monkeypatch.setattr("socp.search.budget._rounds", lambda *_: None)
    escalate(PENDULUM, Search(), [wrong], (None, 10, Ipopt()))
    assert [each.objective for each in starts] == [wrong.objective]


@pytest.mark.slow
def test_what_scouting_met_is_gone_on_from_where_its_round_has_no_time_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    regulator = Problem(
        name="regulator",
        running=x**2,
        dynamics={x: u},
        bounds={u: (-1, 1)},
        start={x: 1},
        final_time=2,
    )
    met = scouts(regulator, default_guess(regulator), 1)
    plugin = sys.modules[Registry.load().method("auto").__module__]
    monkeypatch.setattr(plugin, "time_shares", lambda _: (60.0, 60.0, 0.0, 0.0))
    monkeypatch.setattr(plugin, "scouted", lambda *_: Scouted(tuple((each, 1) for each in met), 1))
    monkeypatch.setattr("socp.search.budget.scouts_from_motions", lambda *_: [])
    found = auto(regulator)
    assert found.extremal
    assert found.objective == pytest.approx(1 / 3, rel=1e-9)


@pytest.mark.slow
def test_a_fed_batch_at_a_free_time_is_certified() -> None:
    """Its law is stiff: from a large barrier its word is not found again, from its own solution
    neither.
    """
    found = auto(FED)
    assert found.extremal
    assert found.objective == pytest.approx(-10.23765295, rel=1e-9)
    assert str(found.word) == "u: - s -"


@pytest.mark.slow
def test_an_unseen_problem_is_certified() -> None:
    """Its straight lines lead nowhere; the value is that of the word, solved by itself."""
    found = auto(GROWTH)
    assert found.extremal
    assert found.objective == pytest.approx(31.7313267365, rel=1e-10)
    assert str(found.word) == "u: - b[i.upper]"


def test_a_robot_that_starts_straight_across_is_scouted() -> None:
    """Two pairs of jets (Sakawa 1999), least fuel in 12: 7.91014 by phases of free lengths, and 20
    intervals are some thousandths off.
    """
    th, vx, vy, turn, y = states("th vx vy turn y")
    jets = controls("u1 u2 u3 u4")
    one, other = jets[0] - jets[1], jets[2] - jets[3]
    robot = Problem(
        name="robot",
        running=sum(jets),
        dynamics={
            x: vx,
            y: vy,
            th: turn,
            vx: (one + other) * cos(th),
            vy: (one + other) * sin(th),
            turn: 0.2 * (one - other),
        },
        bounds=dict.fromkeys(jets, (0, 1)),
        start={x: -10, y: -10, th: float(np.pi) / 2, vx: 0, vy: 0, turn: 0},
        end={x: 0, y: 0, th: 0, vx: 0, vy: 0, turn: 0},
        final_time=12,
    )
    met = scouts(robot, default_guess(robot), 3)
    assert met[0].objective == pytest.approx(7.91014, rel=3e-3)


# -- reading


@pytest.mark.slow
def test_bursts_shorter_than_a_step_are_found() -> None:
    """Rendezvous near a circular orbit (Hill, Clohessy, Wiltshire) with four jets and least fuel,
    in metres and seconds; the value is that of phases of free lengths on two grids.
    """
    y, vx, vy = states("y vx vy")
    jets = controls("xp xn yp yn")
    n = 0.00113
    rendezvous = Problem(
        name="rendezvous",
        running=sum(jets),
        dynamics={
            x: vx,
            y: vy,
            vx: 3 * n**2 * x + 2 * n * vy + jets[0] - jets[1],
            vy: -2 * n * vx + jets[2] - jets[3],
        },
        bounds=dict.fromkeys(jets, (0, 0.005)),
        start={x: 1500, y: -6000, vx: 0.4, vy: -1.0},
        end={x: 0, y: 0, vx: 0, vy: 0},
        final_time=5400,
    )
    found = auto(rendezvous)
    assert found.extremal
    assert found.objective == pytest.approx(5.295090157, rel=1e-9)
    assert found.word == "xp: -; xn: + - +; yp: - +; yn: + - + -"


@pytest.mark.slow
def test_a_finer_grid_shows_what_no_mend_leads_to() -> None:
    """A load under a trolley with a speed limit, from rest to rest: a coarse grid shows a short
    bang as an arc inside the box. The value is that of closed forms on the word's arcs. The search
    is ended by its words and its work, on a busy machine as on any other.
    """
    th, om = states("th om")
    crane = Problem(
        name="trolley",
        minimise=final_time,
        dynamics={x: v, v: u, th: om, om: -(9.81 * th + u) / 12},
        bounds={u: (-0.4, 0.4), v: (-2, 2)},
        start={x: 0, v: 0, th: 0, om: 0},
        end={x: 25, v: 0, th: 0, om: 0},
    )
    found = auto(crane, seconds=36000.0)
    assert found.extremal
    assert found.objective == pytest.approx(17.8597196437, rel=1e-9)
    assert found.word == "u: + - + b[v.upper] - + -"

"""Programmes in magnitudes of their own: nothing in them depends on the units of a problem."""

from typing import Any

import casadi
import numpy as np
import pytest
from casadi import cos
from chains import masses, rod
from scipy.integrate import solve_ivp

from socp.methods import default_guess
from socp.model import Problem, controls, final_time, states
from socp.model.word import Mode, Word
from socp.solvers import default_backend
from socp.transcription import collocate, follow, lgr, radau_iia, single_phase, uniform
from socp.transcription.scaling import state_magnitudes

x, v = states("x v")
u = controls("u")


def braking(length: float = 1.0, second: float = 1.0, worth: float = 1.0) -> Problem:
    """Return a cart that goes 100 with a speed limit 5 for least time and fuel, in units that are
    so much smaller.
    """
    speed = length / second
    force = speed / second
    return Problem(
        name="cart",
        minimise=worth * final_time / second,
        running=worth * 0.1 * u / force / second,
        dynamics={x: v, v: u},
        bounds={u: (-force, force), v: (0, None)},
        path={"limit": v <= 5 * speed},
        start={x: 0, v: 0},
        end={v: 0},
        target={"far": x == 100 * length},
    )


UNITS = [(1e6, 1e-6, 1e4), (1e-6, 1e3, 1e-5), (1e5, 1e6, 1.0)]


def programme(problem: Problem) -> Any:
    return collocate(single_phase(problem), [uniform(radau_iia(2), 6)], default_guess(problem))


@pytest.mark.parametrize("units", UNITS)
def test_the_programme_is_the_same_in_other_units(units: tuple[float, float, float]) -> None:
    one, other = programme(braking()), programme(braking(*units))
    start = one.push(default_guess(braking())).v
    assert other.push(default_guess(braking(*units))).v == pytest.approx(start, rel=1e-9)
    assert other.problem.v_box == pytest.approx(one.problem.v_box, rel=1e-9)
    assert other.problem.g_box == pytest.approx(one.problem.g_box, rel=1e-9)
    at = start + 0.1 * np.random.default_rng(1).standard_normal(start.size)
    values = [
        casadi.Function("nlp", [each.problem.v], [each.problem.f, each.problem.g])(at)
        for each in (one, other)
    ]
    assert float(values[1][0]) == pytest.approx(float(values[0][0]), rel=1e-9)
    assert values[1][1].full() == pytest.approx(values[0][1].full(), rel=1e-9, abs=1e-9)


def test_variables_and_the_objective_are_of_size_one_and_ten() -> None:
    own = braking(1e9, 1e-5, 1e12)
    reduced = programme(own)
    assert np.abs(reduced.push(default_guess(own)).v).max() < 10
    assert reduced.problem.unit * 10 == pytest.approx(
        1e12 * default_guess(own).final_time / 1e-5, rel=0.3
    )


def test_points_come_back_in_the_units_of_the_problem() -> None:
    own = braking(1e4, 1e-3, 1e2)
    guess, mesh = default_guess(own), [uniform(radau_iia(2), 8)]
    with_units = collocate(single_phase(own), mesh)
    scaled = collocate(single_phase(own), mesh, guess)
    back = scaled.lift(scaled.push(guess))
    assert back.rows("x") == pytest.approx(with_units.lift(with_units.push(guess)).rows("x"))
    found = scaled.lift(default_backend()(scaled.problem, scaled.push(guess)))
    plain = programme(braking())
    known = plain.lift(default_backend()(plain.problem, plain.push(default_guess(braking()))))
    assert found.stop.ok
    assert found.objective == pytest.approx(1e2 * known.objective, rel=0.1)
    assert found.effort.trace["objective"][-1] == pytest.approx(found.objective)


@pytest.mark.parametrize("units", UNITS)
def test_costates_and_multipliers_are_those_of_the_problem(
    units: tuple[float, float, float],
) -> None:
    length, second, worth = units
    known, found = (
        reduced.lift(default_backend()(reduced.problem, reduced.push(default_guess(own))))
        for own, reduced in ((each, programme(each)) for each in (braking(), braking(*units)))
    )
    assert found.objective == pytest.approx(worth * known.objective, rel=1e-8)
    size = worth / np.array([[length], [length / second]])
    assert found.rows("costate") / size == pytest.approx(known.rows("costate"), rel=1e-4, abs=1e-6)
    limit = [each.arcs[0].multipliers["limit"] for each in (known, found)]
    factor = worth / second / (length / second)
    assert limit[1][1:] / factor == pytest.approx(limit[0][1:], rel=1e-3, abs=1e-5)


def test_arcs_along_a_word_are_scaled_as_well() -> None:
    arcs = tuple((mode,) for mode in (Mode("upper"), Mode("boundary", "limit"), Mode("lower")))
    one, other = (
        collocate(follow(each, Word(("u",), arcs)), [uniform(lgr(4), 1)] * 3, default_guess(each))
        for each in (braking(), braking(1e6, 1e-6, 1e4))
    )
    assert other.problem.g_box == pytest.approx(one.problem.g_box, rel=1e-9)
    at = np.random.default_rng(2).uniform(0.5, 1.0, one.problem.v.numel())
    values = [casadi.Function("g", [e.problem.v], [e.problem.g])(at).full() for e in (one, other)]
    assert values[1] == pytest.approx(values[0], rel=1e-9, abs=1e-9)


def test_a_speed_whose_rate_is_rounding_at_the_start_has_the_size_that_motions_give_it() -> None:
    """A jet straight across: cos(pi / 2) is 6e-17, and the speed still comes to some units."""
    th = states("th")
    push, turn = controls("push turn")
    robot = Problem(
        name="robot",
        running=push,
        dynamics={x: v, v: push * cos(th), th: turn},
        bounds={push: (-1, 1), turn: (-1, 1)},
        start={x: -10, v: 0, th: np.pi / 2},
        end={x: 0, v: 0, th: 0},
        final_time=12,
    )
    assert 0.3 < state_magnitudes(robot, default_guess(robot))[1] < 12.0


def test_a_state_of_which_nothing_is_known_is_no_smaller_than_a_share_of_its_bound(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Motions may have been followed for a moment alone, as of what is made from a stiff thing."""
    made = Problem(
        name="made",
        minimise=-x,
        dynamics={x: v, v: u},
        bounds={u: (0, 1), x: (0, 50)},
        start={x: 0, v: 0},
        final_time=1,
    )
    monkeypatch.setattr("socp.transcription.scaling.admissible", lambda _: np.full((6, 4), 1e-5))
    found = state_magnitudes(made, default_guess(made))
    assert found.tolist() == pytest.approx([0.5, 1e-5])


@pytest.mark.parametrize("problem", [masses(20), rod(40), rod(50)])
def test_states_far_along_a_chain_have_the_size_that_a_motion_gives_them(problem: Problem) -> None:
    """Steps of explicit methods blow up where rates are stiff, and come to a chain's end late."""
    function = casadi.Function("rate", [problem.x, problem.u], [problem.rate])
    horizon, start = problem.final_time_box[0], problem.start_box[0]

    def rate(_: float, at: np.ndarray) -> np.ndarray:
        found: np.ndarray = function(at, problem.box[1]).full().ravel()
        return found

    motion = solve_ivp(rate, (0, horizon), start, method="LSODA")
    reached = np.abs(motion.y).max(axis=1)
    found = state_magnitudes(problem, default_guess(problem))
    near = reached > 1e-2 * reached.max()  # what moves next to nothing may be taken for more
    assert np.count_nonzero(near) > 20
    assert (found[near] > reached[near] / 50).all()
    assert (found[near] < reached[near] * 50).all()
    assert found.min() > 1e-4
    assert found.max() < 30.0

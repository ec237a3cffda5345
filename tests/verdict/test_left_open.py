"""Controls that act through another one: open while that is off, held to a law while it is on."""

import math
from dataclasses import replace

import numpy as np
import pytest
from casadi import cos
from saddles import along

from socp import Problem, Solution, controls, final_time, run, states
from socp.laws import principle
from socp.methods.guess import default_guess
from socp.model.ladder.second_order import Minimum
from socp.model.word import Mode
from socp.registry.plugins import Registry
from socp.verdict.conditions import stretches
from socp.verdict.lessons import left_open
from socp.verdict.margins import definite
from socp.verdict.minimum.order import second_order

s, v, angle = states("s v angle")
thrust, turn = controls("thrust turn")
LOWER, UPPER = Mode("lower"), Mode("upper")

# A cart whose engine turns goes 3 in 4: it turns into the way, burns, and coasts
COAST = Problem(
    name="coast",
    running=thrust,
    dynamics={s: v, v: thrust * cos(angle), angle: turn},
    bounds={thrust: (0, 1), turn: (-1, 1)},
    start={s: 0, v: 0, angle: 1},
    end={s: 3},
    final_time=4,
)


@pytest.fixture(scope="module")
def coasting(registry: Registry) -> Solution:
    method = registry.method("lgr-multiphase")(word="thrust: -, +, -; turn: -, s, -")
    return run(method, COAST, default_guess(COAST))


def test_a_control_is_open_while_what_it_acts_through_is_off() -> None:
    assert left_open(COAST, 1, (LOWER, LOWER))
    assert not left_open(COAST, 1, (UPPER, LOWER))


@pytest.mark.parametrize(
    ("bound", "price", "wanted"), [(UPPER, -1.0, 0.5), (UPPER, 1.0, None), (LOWER, -1.0, None)]
)
def test_what_holds_a_control_is_told_along_an_arc_whatever_the_bounds(
    bound: Mode, price: float, wanted: float | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    # sigma_turn'' = lambda_v thrust cos(angle) turn + ..., and so its matrix is -lambda_v thrust
    # cos(angle), over its largest entry
    def none(*_given: object) -> None:
        raise AssertionError("a law was looked for with the values of the bounds")

    monkeypatch.setattr(principle, "at_values", none)
    x = np.array([[0.0, 1.0], [1.0, 1.0], [0.0, math.pi / 3]])
    u = np.array([[float(bound == UPPER)] * 2, [0.0, 0.0]])
    costate = np.array([[0.0, 0.0], [price, price], [0.0, 0.0]])
    at = x, u, costate, np.array([0.0, 1.0]), np.zeros(0)
    found = definite(COAST, (bound, Mode("singular")), at)
    assert found == (None if wanted is None else pytest.approx(wanted, rel=1e-12))


def test_turning_with_the_engine_off_is_as_good_an_extremal_as_any(coasting: Solution) -> None:
    # thrust at t carries for 4 - t, by cos(1 - t) until t = 1: on where cos(1 - t) (4 - t) exceeds
    # 4 - b, b the end of it, as to start at a is worth what to stop at b is
    assert coasting.extremal
    a, turned, b = coasting.switches[:3]
    assert turned == pytest.approx(1, abs=1e-9)
    assert cos(1 - a) * (4 - a) == pytest.approx(4 - b, abs=1e-9)
    assert coasting.objective == pytest.approx(b - a, abs=1e-9)
    assert coasting.verdict is not None
    assert any("turn, stretch 3 (-) open" in note for note in coasting.verdict.notes)


@pytest.mark.parametrize(
    "text", ["thrust: - + + -; turn: - - s s", "thrust: - + + -; turn: - - s -"]
)
def test_no_minimum_is_strict_where_a_control_is_open(text: str) -> None:
    """With the engine off any turn does: along the law of the arc before or at the switch that the
    engine's is at, which may be moved alone.
    """
    found = second_order(COAST, along(COAST, text, [0.25, 0.75, 0.25, 2.75]))
    assert found.word is not None
    assert found.word.positive
    assert found.kind is Minimum.DEGENERATE
    (limit,) = found.limits
    assert limit.startswith("the principle leaves turn, stretch ")


def test_another_verdict_on_the_same_solution_is_asked_anew() -> None:
    solution = along(COAST, "thrust: - + + -; turn: - - s -", [0.25, 0.75, 0.25, 2.75])
    assert second_order(COAST, solution).kind is Minimum.DEGENERATE
    assert solution.verdict is not None
    middles = tuple(float(arc.t[[0, -1]].mean()) for arc in solution.arcs)
    strict = dict.fromkeys(stretches(solution, "turn", middles), 1.0)
    verdict = replace(solution.verdict, margins={**solution.verdict.margins, **strict})
    again = solution.with_judgement(verdict=verdict)
    assert second_order(COAST, again).kind is Minimum.WORD


def test_an_open_bang_from_end_to_end_has_no_switch_to_move() -> None:
    """Of what has no effect at all there is one control of the word."""
    x, y, idle = *states("x y"), controls("idle")
    u = controls("u")
    problem = Problem(
        name="idle",
        minimise=final_time,
        dynamics={x: u, y: idle},
        bounds={u: (-1, 1), idle: (0, 1)},
        start={x: 1, y: 0},
        end={x: 0},
    )
    found = second_order(problem, along(problem, "u: -; idle: -", [1.0]))
    assert found.kind is Minimum.WORD
    (limit,) = found.limits
    assert limit == "the switching function of idle vanishes on stretch 1"


def test_turning_out_of_the_way_with_the_engine_on_is_no_extremal(registry: Registry) -> None:
    method = registry.method("lgr-multiphase")(word="thrust: - + -; turn: - +")
    solution = run(method, COAST, default_guess(COAST))
    assert solution.verdict is not None
    assert solution.verdict.feasible
    assert not solution.extremal

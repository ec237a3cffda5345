"""Controls that act through another one: open while that is off, held to a law while it is on."""

import pytest
from casadi import cos

from socp import Problem, Solution, controls, run, states
from socp.methods.guess import default_guess
from socp.model.word import Mode
from socp.registry.plugins import Registry
from socp.verdict.lessons import left_open

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


def test_turning_out_of_the_way_with_the_engine_on_is_no_extremal(registry: Registry) -> None:
    method = registry.method("lgr-multiphase")(word="thrust: - + -; turn: - +")
    solution = run(method, COAST, default_guess(COAST))
    assert solution.verdict is not None
    assert solution.verdict.feasible
    assert not solution.extremal

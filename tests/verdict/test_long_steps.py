"""What is narrow against a long arc is seen by re-integration: in rates, and in constraints."""

import math

import casadi
import numpy as np
import pytest

from socp import Problem, controls, states
from socp.methods import default_guess
from socp.model import time
from socp.verdict.motion import RTOL, Log, _integrate, _Looks, travel
from socp.verdict.reintegration import path_miss
from socp.verdict.simulation.pieces import Piece

x, v = states("x v")
u = controls("u")


def flown(rates: dict[casadi.SX, casadi.SX], **given: object) -> tuple[np.ndarray, Log, Problem]:
    """Return where u = 1 leads from 0 on one arc of length 1, and the points looked at."""
    problem = Problem(
        name="narrow",
        minimise=-v,
        dynamics=rates,
        bounds={u: (-1, 1)},
        start={x: 0, v: 0},
        final_time=1,
        **given,
    )
    log, plan = Log(), (np.zeros(1), np.ones((1, 1)))
    y, error = travel(problem, default_guess(problem), [[Piece(0.0, 1.0, plan)]], log)
    assert not error
    return y, log, problem


@pytest.mark.parametrize("at", [0.437, 0.53])
@pytest.mark.parametrize("width", [0.02, 0.01])
@pytest.mark.parametrize("of_state", [False, True])
def test_a_narrow_pulse_in_a_rate_is_not_stepped_over(
    *, of_state: bool, width: float, at: float
) -> None:
    """V' = u + exp(-(s - at)^2 / width^2), s time or x = t: its integral has an erf."""
    pulse = casadi.exp(-((((x if of_state else time) - at) / width) ** 2))
    y, _, _ = flown({x: 1 + 0 * v, v: u + pulse})
    area = math.erf((1 - at) / width) + math.erf(at / width)
    assert y[1] == pytest.approx(1 + width * math.sqrt(math.pi) / 2 * area, abs=1e-9)


def test_a_narrow_obstacle_on_a_long_arc_is_seen() -> None:
    """X = t passes within 1/100 of 0.525, in the middle between two of twenty points."""
    _, log, problem = flown({x: 1 + 0 * v, v: u}, path={"obstacle": (x - 0.525) ** 2 >= 0.01**2})
    assert path_miss(problem, np.empty(0), np.ones(2), log.motion)[0] > 1e-5


def test_a_motion_on_which_time_stands_still_is_at_an_end() -> None:
    """X' = -1/x from 1 is sqrt(1 - 2 t), which ends at 1/2: a method for stiff motions takes steps
    of no length there for ever.
    """
    log, y = Log(), np.array([1.0, 0.0])
    log.steps = 10_000  # what was taken for stiff before
    arc = default_guess(flown({x: 1 + 0 * v, v: u})[2]).arcs[0]
    piece, looks = Piece(0.0, 1.0, (np.zeros(1), np.ones((1, 1)))), _Looks(log, arc, [], [])
    size = np.ones(2), 1.0, RTOL
    _, error = _integrate(piece, lambda _, z: np.array([-1 / z[0], 0.0]), y, size, looks)
    assert error == "integration came to a halt at t = 0.5"

"""Compiled steps of DOP853 go where scipy's go, and to closed forms."""

import math

import casadi
import numpy as np
import pytest
from scipy.integrate import DOP853

from socp.model import fast
from socp.transcription import DOP853_ERRORS, DOP853_STAGES, DOP853_THROUGH, DOP853_TIMES
from socp.verdict.simulation.steps import Steps

RTOL, ATOL = 1e-10, 1e-10 * np.ones(3)
X, U, T, P = casadi.SX.sym("x", 2), casadi.SX.sym("u"), casadi.SX.sym("t"), casadi.SX.sym("p")
# a driven pendulum with friction, and its energy's integral
RATES = casadi.vertcat(X[1], U - P * X[1] - casadi.sin(X[0]), X[1] ** 2 * casadi.cos(T))
FLOW = casadi.Function("flow", [X, U, T, P], [RATES])
FRICTION = np.array([0.3])


def plan(t: np.ndarray) -> np.ndarray:
    """Return a control (1, k) over times (k,)."""
    return (0.5 + t * np.cos(2.0 * t))[None, :]


def test_coefficients_are_those_of_scipy() -> None:
    rows = [*DOP853.A, DOP853.B, *DOP853.A_EXTRA]
    for k, (mine, theirs) in enumerate(zip(DOP853_STAGES, rows, strict=True)):
        assert mine == theirs[:k].tolist()
    assert DOP853_TIMES.tolist() == [*DOP853.C, 1.0, *DOP853.C_EXTRA]
    assert np.array_equal(DOP853_ERRORS, np.column_stack([DOP853.E5, DOP853.E3]))
    assert np.array_equal(DOP853_THROUGH, DOP853.D.T)


@pytest.mark.parametrize("first", [None, 3.0], ids=["chosen", "rejected"])
def test_steps_are_those_of_scipy(first: float | None) -> None:
    rates, start = fast(FLOW), np.array([1.0, -0.5, 0.0])
    mine = Steps((FLOW, plan, FRICTION), (0.0, 5.0, 5.0), start, first, rtol=RTOL, atol=ATOL)
    theirs = DOP853(
        lambda t, y: rates(y[:-1], plan(np.array([t]))[:, 0], t, FRICTION),
        *(0.0, start, 5.0),
        rtol=RTOL,
        atol=ATOL,
        first_step=first,
    )
    while theirs.status == "running":
        assert mine.step() == ""
        theirs.step()
        assert (mine.t, mine.status) == (pytest.approx(theirs.t, rel=1e-6), theirs.status)
        at = np.linspace(mine.t_old, mine.t, 7)
        assert mine.between(at) == pytest.approx(theirs.dense_output()(at), abs=1e-10)
    assert mine.y == pytest.approx(theirs.y, abs=1e-11)


def test_a_motion_in_closed_form_is_met() -> None:
    """X' = x, with the integral of x from 0 to 2: e^2 and e^2 - 1."""
    x, u = casadi.SX.sym("x"), casadi.SX.sym("u", 0)
    flow = casadi.Function("flow", [x, u, T, P], [casadi.vertcat(x, x)])
    nothing = (flow, lambda t: np.empty((0, t.size)), FRICTION)
    steps = Steps(nothing, (0.0, 2.0, 2.0), np.array([1.0, 0.0]), None, rtol=RTOL, atol=ATOL[:2])
    while steps.status == "running":
        steps.step()
    assert steps.y == pytest.approx([math.exp(2.0), math.exp(2.0) - 1.0], rel=1e-10)


def test_what_escapes_fails() -> None:
    """X' = x^2 from 1 is infinite at 1."""
    x, u = casadi.SX.sym("x"), casadi.SX.sym("u", 0)
    flow = casadi.Function("flow", [x, u, T, P], [casadi.vertcat(x**2, 0)])
    nothing = (flow, lambda t: np.empty((0, t.size)), FRICTION)
    steps = Steps(nothing, (0.0, 2.0, 2.0), np.array([1.0, 0.0]), None, rtol=RTOL, atol=ATOL[:2])
    with np.errstate(all="ignore"):
        for _ in range(2000):
            said = steps.step()
            if steps.status != "running":
                break
    assert steps.status == "failed"
    assert said
    assert steps.t == pytest.approx(1.0, abs=1e-6)


def test_rates_see_no_time_after_the_latest() -> None:
    """A rate that jumps where the motion ends is that before the jump."""
    x, u = casadi.SX.sym("x"), casadi.SX.sym("u", 0)
    flow = casadi.Function("flow", [x, u, T, P], [casadi.vertcat(casadi.if_else(T < 1, 1, 9), 0)])
    nothing = (flow, lambda t: np.empty((0, t.size)), FRICTION)
    span = (0.0, 1.0, math.nextafter(1.0, 0.0))
    steps = Steps(nothing, span, np.zeros(2), 1.0, rtol=RTOL, atol=ATOL[:2])
    steps.step()
    assert steps.status == "finished"
    assert steps.y[0] == pytest.approx(1.0, abs=1e-15)


def test_a_motion_at_rest_is_known_between_steps() -> None:
    """X' = 4 - x^2 next to 2: it stays there, however long a step that its end allows."""
    x, u = casadi.SX.sym("x"), casadi.SX.sym("u", 0)
    flow = casadi.Function("flow", [x, u, T, P], [casadi.vertcat(4 - x**2, 0)])
    nothing = (flow, lambda t: np.empty((0, t.size)), FRICTION)
    span, start = (0.0, 20.0, 20.0), np.array([2 - 5e-13, 0.0])
    for first in np.linspace(0.05, 6.0, 60):
        mine = Steps(nothing, span, start, first, rtol=RTOL, atol=RTOL * np.array([2.0, 1.0]))
        while mine.status == "running":
            assert mine.step() == ""
            between = mine.between(np.linspace(mine.t_old, mine.t, 20))[0]
            assert np.abs(between - 2.0).max() < 1e-7

"""Steps in a row go to closed forms, and end where single ones have to go on."""

import math

import casadi
import numpy as np
import pytest

from socp.verdict.simulation.strides import Course, Strides, strides

X, U = casadi.SX.sym("x"), casadi.SX.sym("u", 0)
T, P = casadi.SX.sym("t"), casadi.SX.sym("p", 0)
MOST = np.full(2, 1e6)


def moved(rate: casadi.SX, edges: list[float], y: list[float]) -> Strides:
    """Return the steps of x' = rate, and of its integral, over pieces between edges."""
    flow = casadi.Function("flow", [X, U, T, P], [casadi.vertcat(rate, X)])
    laid = np.array([edges[:-1], edges[1:], range(len(edges) - 1)], dtype=float)
    latest = np.nextafter(np.array(edges[1:]), -math.inf)
    nothing = Course(
        flow, lambda _, on: np.empty((0, on.size)), np.empty(0), latest, 1e-10, 1e-10 * np.ones(2)
    )
    return strides(nothing, laid, np.array(y), MOST)


def test_a_motion_in_closed_form_is_met_wherever_it_is_looked_at() -> None:
    """X' = x with the integral of x from 0 to 6: e^t and e^t - 1, over steps that are too long."""
    found = moved(X, [0.0, 2.5, 6.0], [1.0, 0.0])
    assert found.ends[-1] == 6.0
    assert found.ends.size > 2
    assert np.array_equal(found.begins[1:], found.ends[:-1])
    assert found.after[-1] == pytest.approx([math.exp(6.0), math.expm1(6.0)], rel=1e-9)
    t, step = found.looks(np.array([4, 20]))
    assert (t[0], t[-1]) == (0.0, 6.0)
    assert np.count_nonzero(t == 2.5) == 2  # where a piece ends, and where the next one begins
    assert t.size == 2 + 4 * np.count_nonzero(found.on == 0) + 20 * np.count_nonzero(found.on == 1)
    x, integral = found.at(t, step)
    assert x == pytest.approx(np.exp(t), rel=1e-7)
    assert integral == pytest.approx(np.expm1(t), rel=1e-7, abs=1e-9)


def test_more_steps_than_a_row_has_are_taken() -> None:
    """X' = cos t over a hundred pieces: sin t."""
    found = moved(casadi.cos(T), np.linspace(0.0, 10.0, 101).tolist(), [0.0, 0.0])
    assert found.ends.size == 100
    assert found.after[:, 0] == pytest.approx(np.sin(found.ends), abs=1e-10)


def test_a_kink_is_stepped_over_in_small_steps() -> None:
    """X' = |t - 1| from 0 to 3: 5 / 2 in the end."""
    found = moved(casadi.fabs(T - 1.0), [0.0, 3.0], [0.0, 0.0])
    assert found.ends[-1] == 3.0
    assert found.after[-1, 0] == pytest.approx(2.5, abs=1e-9)


def test_rates_see_no_time_after_the_latest() -> None:
    """A rate that jumps where a piece ends is that before the jump, and after it in the next."""
    found = moved(casadi.if_else(T < 1, 1, 9), [0.0, 1.0, 2.0], [0.0, 0.0])
    assert found.after[:, 0] == pytest.approx([1.0, 10.0], abs=1e-12)


def test_what_escapes_is_left_before_it_does() -> None:
    """X' = x^2 from 1 is infinite at 1, and is 1 / (1 - t) as far as it is followed."""
    found = moved(X**2, [0.0, 2.0], [1.0, 0.0])
    assert 0.9 < found.ends[-1] < 1.0
    assert found.after[:, 0] == pytest.approx(1.0 / (1.0 - found.ends), rel=1e-5)
    assert (np.abs(found.after) <= MOST).all()


def test_a_motion_that_ends_is_left_where_it_does() -> None:
    """X' = -sqrt(x) - 1 from 1 has no rates where x is below 0."""
    found = moved(-casadi.sqrt(X) - 1.0, [0.0, 2.0], [1.0, 0.0])
    assert found.ends[-1] == pytest.approx(2.0 - 2.0 * math.log(2.0), abs=1e-3)
    assert np.isfinite(found.after).all()

"""Numbers as they are meant, and motions that are enclosed: known functions lie inside."""

from fractions import Fraction
from math import pi

import casadi
import numpy as np
import pytest

from socp.errors import SolveError
from socp.proof.balls import ball, coefficients, compiled, flint, precision
from socp.proof.exact import Exact, Numbers
from socp.proof.flow import Motion, State, passage, shares


@pytest.mark.parametrize(
    ("value", "fraction", "turns"),
    [
        (0.8, Fraction(4, 5), False),
        (1 / 3, Fraction(1, 3), False),
        (pi, Fraction(1), True),
        (2 * pi / 3, Fraction(2, 3), True),
        (-pi / 4, Fraction(-1, 4), True),
        (310.0, Fraction(310), False),
        (1e-9, Fraction(1, 10**9), False),
        (0.1234567890123456, Fraction(0.1234567890123456), False),
    ],
)
def test_a_float_stands_for(value: float, fraction: Fraction, turns: bool) -> None:
    assert Exact.of(value) == Exact(fraction, pi=turns)


def test_derivatives_keep_exact_numbers() -> None:
    """Casadi folds 0.14 * 3 to 0.42000000000000004; d(0.14 x^3)/dx at 1 is 21/50."""
    x = casadi.SX.sym("x")
    numbers = Numbers()
    slope = casadi.jacobian(numbers.expression(0.14 * x**3, {}), x)
    with precision(256):
        values = {symbol: ball(each) for symbol, each in numbers.values.items()}
        (found,) = compiled(slope, x, values).call([flint().arb(1)])
        assert found.contains(flint().arb(21) / 50)
        assert float(found.rad()) < 1e-70


def test_a_rounded_number_is_refused() -> None:
    x = casadi.SX.sym("x")
    with pytest.raises(SolveError, match="is rounded"):
        compiled(0.1 * x, x, {})


def test_a_step_that_is_no_smooth_function_is_refused() -> None:
    x = casadi.SX.sym("x")
    with pytest.raises(SolveError, match="has no enclosure"):
        Numbers().expression(casadi.floor(x), {})


def test_an_oscillator_is_enclosed_with_its_derivatives() -> None:
    """X'' = -x: cos t and -sin t from (1, 0), the derivative is the rotation by t."""
    z = casadi.SX.sym("z", 2)
    with precision(128):
        arb = flint().arb
        motion = Motion.of(casadi.vertcat(z[1], -z[0]), z, {})
        begin, length = [arb(1), arb(0)], arb(7)
        steps, _ = shares(motion, begin, length, 1e-25)
        assert sum(steps) == 1
        one = flint().arb_mat(2, 2, [1, 0, 0, 1])
        end, stages = passage(motion, State.of(begin, one), length, steps)
        for value, exact in zip(end.box, (length.cos(), -length.sin()), strict=True):
            assert value.contains(exact)
            assert float(value.rad()) < 1e-20
        turned = [length.cos(), length.sin(), -length.sin(), length.cos()]
        for entry, exact in zip(end.derivative.entries(), turned, strict=True):
            assert entry.overlaps(exact)
            assert float(entry.rad()) < 1e-6
        assert all(stage.during[0].contains(stage.start[0]) for stage in stages)


def test_a_box_of_states_is_enclosed() -> None:
    """X' = x - x^3 (Bernoulli): x(t) = x0 e^t / sqrt(1 + x0^2 (e^2t - 1)) at both ends of a box."""
    z = casadi.SX.sym("z", 1)
    with precision(128):
        arb = flint().arb
        motion = Motion.of(z - z * z * z, z, {})
        box, length = [arb(0.5, 1e-6)], arb(2)
        steps, _ = shares(motion, [arb(0.5)], length, 1e-22)
        end, _ = passage(motion, State.of(box, flint().arb_mat(1, 1, [1])), length, steps)
        for x0 in np.linspace(0.5 - 1e-6, 0.5 + 1e-6, 5):
            start = arb(float(x0))
            grown = length.exp()
            exact = start * grown / (1 + start * start * (grown * grown - 1)).sqrt()
            assert end.box[0].overlaps(exact)
        assert float(end.box[0].rad()) < 1e-5


def test_a_motion_without_end_is_not_enclosed() -> None:
    """X' = x^2 from 1 is infinite at time 1."""
    z = casadi.SX.sym("z", 1)
    with precision(64):
        arb = flint().arb
        motion = Motion.of(z * z, z, {})
        with pytest.raises(SolveError, match="could not be enclosed"):
            shares(motion, [arb(1)], arb(2), 1e-12)


@pytest.mark.parametrize("order", [5, 12, 18, 24])
def test_taylor_coefficients_of_nonlinear_motions(order: int) -> None:
    """X' = x^2 from 1 is 1 / (1 - t): every coefficient is 1. And y' = x y from 1 is the same."""
    z = casadi.SX.sym("z", 2)
    with precision(128):
        motion = Motion.of(casadi.vertcat(z[0] ** 2, z[0] * z[1]), z, {})
        wide = motion.series([flint().arb(1, 1e-30), flint().arb(1)], order)
        for its in wide:
            found = coefficients(its, order + 1)
            assert all(each.contains(1) for each in found)
            assert max(float(each.rad()) for each in found) < 1e-25


def test_a_series_does_not_know_what_was_cut_off() -> None:
    flint().ctx.cap = 3
    short = flint().arb_series([1, 1])
    with pytest.raises(ValueError, match="3 coefficients of 4"):
        coefficients(short, 4)


def test_an_arc_of_too_many_steps_is_refused_soon() -> None:
    """Ten thousand turns of an oscillator take some steps each."""
    z = casadi.SX.sym("z", 2)
    with precision(128):
        motion = Motion.of(casadi.vertcat(z[1], -z[0]), z, {})
        with pytest.raises(SolveError, match="steps, at most 4000"):
            shares(motion, [flint().arb(1), flint().arb(0)], flint().arb(62832), 1e-22)

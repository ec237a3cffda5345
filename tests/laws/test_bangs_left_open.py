"""One derivation serves the values of bang controls, but where a value makes another arc of it."""

from typing import Any

import casadi
import numpy as np
import pytest

from socp import laws
from socp.laws import principle
from socp.laws import probes as sampled
from socp.model.problem import Problem
from socp.model.symbols import controls, states
from socp.model.word import Mode, Modes

x, y, z = states("x y z")
u, w = controls("u w")
LOWER, UPPER = (tuple(map(Mode.parse, ("s", each))) for each in "-+")
ON_TOP: Modes = (Mode("singular"), Mode("boundary", "z.upper"))


def problem(**given: Any) -> Problem:
    fields = {"name": "toy", "start": {x: 1, y: 1}, "final_time": 5, "bounds": {u: (-9, 9)}}
    return Problem(**{**fields, **given})


def weighed(least: float, most: float) -> Problem:
    """Return x' = u, y' = x with the cost w x^2 / 2 + y^2 / 2: sigma_u'' = w u - y, and where w is
    zero the fourth derivative is the first that holds u.
    """
    return problem(
        running=w * x**2 / 2 + y**2 / 2,
        dynamics={x: u, y: x},
        bounds={u: (-9, 9), w: (least, most)},
    )


def counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return a list that grows with every derivation."""
    calls: list[int] = []
    chain = principle.derivatives
    monkeypatch.setattr(principle, "derivatives", lambda *given: calls.append(1) or chain(*given))
    return calls


def control(own: Problem, modes: Modes, at: tuple[float, ...]) -> float:
    return float(casadi.Function("law", [own.x], [laws.arc_law(own, modes).control[0]])(at))


def test_one_derivation_serves_both_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    own, calls = weighed(1, 2), counted(monkeypatch)
    at = (0.3, 0.8)
    for modes, weight in ((LOWER, 1.0), (UPPER, 2.0)):
        found = laws.extremal_arc(own, modes)
        assert found.orders == {"u": 1}
        assert control(own, modes, at) == pytest.approx(0.8 / weight, rel=1e-12)
        assert float(found.legendre_clebsch) == pytest.approx(weight, rel=1e-12)
        assert np.allclose(sampled.evaluator(own, found.equations)(found.points)[0], 0, atol=1e-8)
        assert np.all(found.points[-1] == weight)
    assert len(calls) == 1


def test_a_bound_at_which_the_order_is_another_has_a_derivation_of_its_own() -> None:
    own = weighed(0, 2)
    assert laws.extremal_arc(own, UPPER).orders == {"u": 1}
    found = laws.extremal_arc(own, LOWER)
    assert found.orders == {"u": 2}
    assert float(found.legendre_clebsch) == pytest.approx(1.0, rel=1e-12)
    assert control(own, UPPER, (0.3, 0.8)) == pytest.approx(0.4, rel=1e-12)
    assert control(own, LOWER, (0.0, 0.0)) == 0.0


def test_a_bound_at_which_a_factor_vanishes_has_a_derivation_of_its_own() -> None:
    """sigma_u' = -w lambda_y: with w = 0 the costate is left open."""
    own = problem(
        running=x**2 + z**2,
        dynamics={x: w * y, y: u, z: u},
        start={x: 1, y: 1, z: 1},
        bounds={u: (-9, 9), w: (0, 2)},
    )
    general = laws.derive(own, ("u",))
    low, high = (laws.extremal_arc(own, modes) for modes in (LOWER, UPPER))
    assert general.orders == high.orders == {"u": 1}
    for found in (low, high):
        assert found.points.shape[1] >= 2
        assert np.allclose(sampled.evaluator(own, found.equations)(found.points)[0], 0, atol=1e-8)


def test_an_arc_without_free_controls_is_derived_once(monkeypatch: pytest.MonkeyPatch) -> None:
    own, calls = problem(running=x**2 + y**2, dynamics={x: u, y: x}), counted(monkeypatch)
    assert laws.derive(own, ("u",)) is laws.extremal_arc(own, (Mode("singular"),))
    assert len(calls) == 1


def test_the_law_is_worked_out_when_it_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    own = problem(running=x**2 + y**2, dynamics={x: u, y: x})
    monkeypatch.setattr(principle.eliminate, "feedback", lambda *_: pytest.fail("not asked for"))
    found = laws.derive(own, ("u",))
    assert found.orders == {"u": 1}
    assert float(found.legendre_clebsch) == pytest.approx(2.0)


def test_laws_of_the_same_operations_are_one_expression() -> None:
    """Where z is kept at its limit the law of u is derived anew, and comes out the same."""
    own = problem(
        running=x**2 / 2 + y**4 / 4,
        dynamics={x: u, y: x, z: w},
        bounds={u: (-9, 9), w: (-1, 1), z: (None, 2)},
    )
    one, other = (laws.arc_law(own, modes).control for modes in (LOWER, ON_TOP))
    assert float(other[1]) == 0.0
    assert one[0].element_hash() == other[0].element_hash()


def kept(lift: Any, **given: Any) -> Problem:
    """Return x' = u, y' = x, z' = `lift` with z <= 1, on which w is to be a number."""
    fields: dict[str, Any] = {"bounds": {u: (-9, 9), w: (-3, 3), z: (None, 1)}, **given}
    fields["start"] = {x: 1, y: 1, z: 0}
    return problem(dynamics={x: u, y: x, z: lift}, **fields)


def on_top(own: Problem, at: tuple[float, float]) -> float:
    """Return the singular control on z = 1, where what was derived holds at the points found."""
    found = laws.extremal_arc(own, ON_TOP)
    assert np.allclose(sampled.evaluator(own, found.equations)(found.points)[0], 0, atol=1e-8)
    assert found.feedback is not None
    return float(casadi.Function("law", [own.x], [found.feedback[0]])((*at, 1.0)))


def test_one_derivation_serves_a_constraint_on_which_a_control_is_a_number(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """sigma_u'' = u - y whatever w is: the multiplier is in lambda_z' alone."""
    own, calls = kept(w - 2, running=x**2 / 2 + y**2 / 2), counted(monkeypatch)
    assert on_top(own, (0.3, 0.8)) == pytest.approx(0.8, rel=1e-12)
    assert laws.extremal_arc(own, ON_TOP).orders == {"u": 1, "z.upper": 1}
    assert float(laws.arc_law(own, ON_TOP).control[1]) == 2.0
    assert laws.derive(own, ("u",)).orders == {"u": 1}
    assert len(calls) == 1


def test_a_law_that_holds_the_control_is_worked_out_with_its_number(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Sigma_u'' = w u - y, with w = 2 where z is held."""
    own, calls = kept(w - 2, running=w * x**2 / 2 + y**2 / 2), counted(monkeypatch)
    assert on_top(own, (0.3, 0.8)) == pytest.approx(0.4, rel=1e-12)
    assert len(calls) == 1


def test_a_constraint_whose_number_makes_the_order_another_has_a_derivation_of_its_own() -> None:
    """With w = 0 on z = 1 nothing is left of sigma_u'' = w u - y but y."""
    own = kept(w, running=w * x**2 / 2 + y**2 / 2)
    assert laws.derive(own, ("u",)).orders == {"u": 1}
    assert laws.extremal_arc(own, ON_TOP).orders == {"u": 2, "z.upper": 1}


def test_a_multiplier_that_enters_a_derivative_has_a_derivation_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """sigma_u' = -x - lambda_y - 2 x (z - 1) lambda_z holds the costate that the multiplier drives;
    on z = 1 the control is y all the same.
    """
    own = kept(w + (z - 1) * x**2, running=x**2 / 2 + y**2 / 2)
    calls = counted(monkeypatch)
    assert on_top(own, (0.3, 0.8)) == pytest.approx(0.8, rel=1e-12)
    assert len(calls) == 2

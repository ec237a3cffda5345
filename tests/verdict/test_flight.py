"""What a plan leads to where things are not as planned, against motions known in closed form."""

import numpy as np
import pytest
from carts import cart, u, v, x
from records import revised

from socp import MethodError, Solution, silent, solve, time
from socp.model.result.solution import Stop


@pytest.fixture(scope="module")
def plan() -> Solution:
    """Full speed up to t = 1, full stop until t = 2: x = 1, v = 0 at the end."""
    return solve(cart(), method="lgr-multiphase", word="+ -", watch=silent)


def end(flown: Solution) -> list[float]:
    return [float(flown[name][-1]) for name in ("x", "v")]


def test_without_a_disturbance_the_plan_is_flown(plan: Solution) -> None:
    flown = plan.simulate()
    assert end(flown) == pytest.approx([1, 0], abs=1e-9)
    assert flown.objective == pytest.approx(2, abs=1e-10)
    assert flown.verified[0].drift < 1e-9
    assert (flown.method, flown.stop, flown.extremal) == ("simulate", Stop.SIMULATED, None)


def test_a_disturbance_is_added_to_the_rates(plan: Solution) -> None:
    """V' = u + c t adds c t**2/2 to v and c t**3/6 to x."""
    flown = plan.simulate(cart(), disturbance={v: 0.3 * time})
    assert end(flown) == pytest.approx([1 + 0.3 * 8 / 6, 0.3 * 2], abs=1e-8)
    np.testing.assert_allclose(flown.at([0.5, 1.5])[1], [0.5375, 0.8375], atol=1e-4)
    assert flown.verified[0].miss == pytest.approx(0.6, rel=0.5)
    assert not flown.verified[0].feedback


def test_names_stand_for_states(plan: Solution) -> None:
    flown = plan.simulate(disturbance={"x": 0.1}, start={"v": 0.2})
    assert end(flown) == pytest.approx([1 + 2 * 0.1 + 2 * 0.2, 0.2], abs=1e-8)


def test_the_control_jumps_where_the_plan_does(plan: Solution) -> None:
    flown = plan.simulate(disturbance={"x": 0.1})
    assert [len(flown.arcs), *np.unique(flown["u"])] == [2, -1, 1]
    assert flown.junctions == pytest.approx([1.0])


def test_another_plant_is_driven_by_the_same_plan(plan: Solution) -> None:
    """Half the thrust: half the speed and half the way."""
    flown = plan.simulate(cart(dynamics={x: v, v: 0.5 * u}))
    assert end(flown) == pytest.approx([0.5, 0], abs=1e-9)


def test_a_function_of_the_state_takes_the_place_of_the_plan(plan: Solution) -> None:
    """V' = -v from v = 0.5: exp(-t) of it is left, and the way is 0.5 (1 - exp(-2))."""
    flown = plan.simulate(start={v: 0.5}, feedback=lambda _t, state: -state[1])
    assert end(flown) == pytest.approx([0.5 * (1 - np.exp(-2)), 0.5 * np.exp(-2)], abs=1e-8)
    assert flown.verified[0].feedback


def test_feedback_stays_within_the_bounds(plan: Solution) -> None:
    flown = plan.simulate(feedback=lambda _t, _state: 7.0)
    assert end(flown) == pytest.approx([2, 2], abs=1e-8)
    assert flown["u"].max() == 1


def test_the_law_of_a_singular_arc_answers_a_disturbance() -> None:
    """On the ramp x = 0.3 t the law is u = 0.3, which does not see x; a plan has no more."""
    from socp import Problem, controls, states

    (y,), w = (states("y"),), controls("w")
    ramp = Problem(
        name="ramp",
        running=(y - 0.3 * time) ** 2,
        dynamics={y: w},
        bounds={w: (-1, 1)},
        start={y: 1},
        final_time=2,
    )
    plan = solve(ramp, method="lgr-multiphase", word="- s", watch=silent)
    by_time, by_law = (
        plan.simulate(disturbance={"y": 0.05}, feedback=how) for how in (False, True)
    )
    assert by_law["y"][-1] == pytest.approx(0.6 + 0.1, abs=1e-8)
    assert by_time["y"][-1] == pytest.approx(by_law["y"][-1], abs=1e-8)


def test_what_cannot_be_flown_is_refused(plan: Solution) -> None:
    with pytest.raises(MethodError, match="no state 'w'; there are x, v"):
        plan.simulate(disturbance={"w": 1})

    with pytest.raises(MethodError, match="carries no problem"):
        revised(plan, statement=None).simulate()


def test_a_motion_that_diverges_says_so(plan: Solution) -> None:
    flown = plan.simulate(cart(), disturbance={x: x**3}, start={"x": 2})
    assert flown.stop is Stop.FAILED
    assert "integration broke down" in flown.message

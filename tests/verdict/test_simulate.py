"""The verifier: it finds a wrong end, a hidden violation, an inadmissible control and a divergence,
exactly.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from time import process_time
from typing import Any

import numpy as np
import pytest
from casadi import cos
from records import built

from socp.model.evaluation import scales
from socp.model.problem import Problem
from socp.model.result.arc import Arc
from socp.model.result.findings import Feasibility
from socp.model.result.solution import Solution, Stop
from socp.model.symbols import controls, final_time, initial, parameters, states, time
from socp.transcription.mesh import table
from socp.transcription.schemes import euler, lgr, trapezoid
from socp.verdict.reintegration import verify

x, y = states("x y")
u, w = controls("u w")
k = parameters("k")
Curve = Callable[[np.ndarray], Any]


def walk(**changes: Any) -> Problem:
    """Return x' = u, |u| <= 1, with changes."""
    parts = {
        "name": "walk",
        "minimise": final_time,
        "dynamics": {x: u},
        "bounds": {u: (-1, 1)},
        "start": {x: 0},
    }
    return Problem(**parts | changes)


def claimed(
    problem: Problem,
    X: Curve,
    U: Curve,
    *,
    span: tuple[float, float] = (0, 1),
    scheme: Any = None,
    modes: str = "*",
) -> Solution:
    """Return a solution of one arc that claims states X(t) for controls U(t) on four intervals."""
    joined = table([(1.0, scheme or trapezoid())] * 4)
    t = span[0] + (span[1] - span[0]) * joined.tau
    nx, nu = len(problem.state_names), len(problem.control_names)
    rows, values = (
        np.broadcast_to(f(t), (n, t.size)).astype(float).copy() for f, n in ((X, nx), (U, nu))
    )
    unknown = np.full_like(rows, np.nan)
    arc = Arc(
        t=t,
        x=rows,
        u=values,
        costate=unknown,
        mesh=joined.mesh,
        side=joined.side,
        modes=(modes,) * nu,
    )
    return built(problem=problem.name, method="claim", arcs=(arc,), objective=0.0, stop=Stop.SOLVED)


def verified(problem: Problem, solution: Solution) -> Feasibility:
    return verify(problem, solution)[0]


def test_a_true_solution_has_nothing_wrong() -> None:
    found = verified(walk(end={x: 1}), claimed(walk(), lambda t: t, lambda t: 0 * t + 1))
    assert found.worst < 1e-12
    assert found.drift < 1e-12
    assert not found.error
    assert not found.feedback


def test_a_wrong_end_point_by_its_amount() -> None:
    problem = walk(end={x: 1.25})
    found = verified(problem, claimed(problem, lambda t: 1.25 * t, lambda t: 0 * t + 1))
    assert found.miss == pytest.approx(
        0.25 / 1.25, rel=1e-9
    )  # relative to the state's magnitude, 1.25
    assert found.miss_at == "x"
    assert found.drift == pytest.approx(0.25 / 1.25, rel=1e-9)
    assert found.worst == found.miss


def test_an_end_interval_is_met_anywhere_inside() -> None:
    inside, outside = walk(end={x: (0.5, 2)}), walk(end={x: (1.5, 2)})
    assert verified(inside, claimed(inside, lambda t: t, lambda t: 0 * t + 1)).miss == 0.0
    assert verified(
        outside, claimed(outside, lambda t: t, lambda t: 0 * t + 1)
    ).miss == pytest.approx(0.25)


def test_a_path_constraint_violated_between_the_nodes() -> None:
    # x' = u cos t with u = 1: x = sin t is 0 at the nodes 0, pi, .. 4 pi and 1 between them
    problem = walk(dynamics={x: u * cos(time)}, path={"low": x <= 0.25})
    found = verified(
        problem, claimed(problem, lambda t: 0 * t, lambda t: 0 * t + 1, span=(0, 4 * math.pi))
    )
    assert found.path == pytest.approx(0.75, abs=1e-3)  # looked at in every step, not solved for
    assert found.path <= 0.75
    assert found.path_at == "low"
    assert found.miss == 0.0


def test_a_bound_of_a_state_is_a_constraint_too() -> None:
    problem = walk(bounds={u: (-1, 1), x: (-5, 0.5)})
    found = verified(problem, claimed(problem, lambda t: t, lambda t: 0 * t + 1))
    assert found.path == pytest.approx(0.5 / 5)
    assert found.path_at == "x.upper"


@pytest.mark.parametrize(("value", "excess"), [(1.3, 0.15), (-1.5, 0.25), (1.0, 0.0)])
def test_a_control_out_of_its_box_by_its_share_of_the_width(value: float, excess: float) -> None:
    found = verified(walk(), claimed(walk(), lambda t: value * t, lambda t: 0 * t + value))
    assert found.box == pytest.approx(excess, abs=1e-15)


def test_a_polynomial_control_that_leaves_its_box_between_the_nodes() -> None:
    # on every interval the control is the parabola through three LGR nodes; this one peaks at 1.2
    # in the middle of the last interval, where it has no node, and is at most 0.9 at all of them
    slope = 0.3 / np.abs(lgr(3).nodes[:3]).min() ** 2
    problem = walk(bounds={u: (-399, 1)})
    hump = claimed(
        problem, lambda t: t, lambda t: 1.2 - slope * ((t - 0.875) / 0.125) ** 2, scheme=lgr(3)
    )
    assert hump.arcs[0].u.max() == pytest.approx(0.9)
    assert verified(problem, hump).box == pytest.approx(0.2 / 400, rel=0.05)


def test_a_diverging_state_is_reported_with_its_time() -> None:
    # x' = x^2 from 1 leaves every bound at t = 1
    problem = walk(dynamics={x: u * x**2}, start={x: 1})
    found = verified(problem, claimed(problem, lambda t: 1 + t, lambda t: 0 * t + 1, span=(0, 2)))
    assert found.error.startswith(
        ("integration broke down at t = 1:", "integration broke down at t = 0.99999")
    )
    assert found.worst == math.inf


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_numbers_that_are_none_end_in_an_error_and_not_in_a_hang(bad: float) -> None:
    found = verified(walk(), claimed(walk(), lambda t: t, lambda t: np.where(t > 0.5, bad, 1.0)))
    assert found.error
    assert found.worst == math.inf


def test_states_that_are_none_are_no_feasible_solution() -> None:
    found = verified(walk(start={}), claimed(walk(), lambda t: t + math.nan, lambda t: 0 * t + 1))
    assert found.worst == math.inf


def test_end_conditions_relative_to_what_they_are_made_of() -> None:
    # from 2 to 5: x - 3 x(t0) + 1.5 = 0.5, and the terms are as large as 5 + 3 * 5
    target = {"wrong": x + 1.5 == 3 * initial(x), "fine": x <= 2 * final_time}
    problem = walk(target=target, start={x: 2}, dynamics={x: 3 * u})
    found = verified(
        problem, claimed(problem, lambda t: 2 + 3 * t, lambda t: 0 * t + 1, span=(0, 1))
    )
    assert found.miss_at == "fine"
    assert found.miss == pytest.approx((5 - 2) / (5 + 2 * 1))
    relaxed = replace(problem, target={"wrong": target["wrong"]})
    again = verified(relaxed, claimed(problem, lambda t: 2 + 3 * t, lambda t: 0 * t + 1))
    assert again.miss == pytest.approx(0.5 / (5 + 3 * 5))
    assert again.miss_at == "wrong"


def test_times_out_of_their_interval() -> None:
    problem = walk(final_time=(2, 3))
    found = verified(problem, claimed(problem, lambda t: t, lambda t: 0 * t + 1, span=(0, 1.5)))
    assert found.miss_at == "final time"
    assert found.miss == pytest.approx(0.5 / 1.5)


def test_parameters_and_time_reach_the_motion() -> None:
    # x' = k u + t from t = 1 to 3: 2 k + 4
    problem = walk(dynamics={x: k * u + time}, end={x: 2 * 0.7 + 4}, initial_time=1)
    solution = claimed(
        problem, lambda t: 0.7 * (t - 1) + (t**2 - 1) / 2, lambda t: 0 * t + 1, span=(1, 3)
    )
    found = verified(problem, replace(solution, parameters={"k": 0.7}))
    assert found.worst < 1e-12
    assert found.drift < 1e-12
    assert verified(problem, replace(solution, parameters={"k": 0.8})).miss == pytest.approx(
        0.2 / 5.6
    )


def test_steps_of_the_control_are_integrated_as_steps() -> None:
    # Euler's control is constant on an interval: 1, then -1, then 1 (twice), a quarter each
    problem = walk(end={x: 0.5})
    solution = claimed(
        problem,
        lambda t: 0.5 * t,
        lambda t: np.where(np.isclose(t, 0.5), -1.0, 1.0),
        scheme=euler(),
    )
    found = verified(problem, solution)
    assert found.miss < 1e-12
    assert found.box == 0.0


def test_laws_are_verified_as_feedback_too() -> None:
    # x' = y, y' = u - y with u at its upper bound 1: y = 1 - exp(-t)
    problem = walk(dynamics={x: y, y: u - y}, start={x: 0, y: 0}, end={y: 1 - math.exp(-1)})
    solution = claimed(
        problem, lambda t: [t - 1 + np.exp(-t), 1 - np.exp(-t)], lambda t: 0 * t + 1, modes="+"
    )
    as_time, as_feedback = verify(problem, solution)
    assert (as_time.feedback, as_feedback.feedback) == (False, True)
    assert max(as_time.worst, as_feedback.worst) < 1e-11


def test_feedback_uses_the_law_and_not_the_values() -> None:
    solution = claimed(walk(), lambda t: -t, lambda t: 0 * t - 1, modes="+")
    as_time, as_feedback = verify(walk(end={x: -1}), solution)
    assert as_time.miss < 1e-12
    assert as_feedback.miss == pytest.approx(2.0)


def test_a_solution_without_laws_is_verified_in_time_alone() -> None:
    assert len(verify(walk(), claimed(walk(), lambda t: t, lambda t: 0 * t + 1, modes="*"))) == 1


def test_magnitudes_are_those_of_bounds_ends_and_values() -> None:
    bounds = {u: (-1, 1), w: (0, 1), y: (-7, 3)}
    problem = walk(dynamics={x: u, y: w}, bounds=bounds, start={x: 0, y: 0}, end={x: (1, 4)})
    solution = claimed(problem, lambda t: [0 * t + 9, 0 * t], lambda t: [0 * t, 0 * t])
    np.testing.assert_array_equal(scales(problem, solution), [9, 7])
    still = claimed(walk(), lambda t: 0 * t, lambda t: 0 * t)
    np.testing.assert_array_equal(scales(walk(), still), [1])


def test_an_arc_of_no_length_is_passed() -> None:
    solution = claimed(walk(), lambda t: t, lambda t: 0 * t + 1)
    (arc,) = solution.arcs
    empty = replace(arc, t=np.full_like(arc.t, 1.0), x=np.full_like(arc.x, 1.0))
    found = verified(walk(end={x: 1}), replace(solution, arcs=(arc, empty)))
    assert found.worst < 1e-12


def test_a_parabola_does_not_hide_its_peak_in_one_step() -> None:
    # x' = y, y' = u = -1 from y = 1/2: x peaks at 1/8, half way through what is one step of an
    # integrator of order 8
    problem = walk(dynamics={x: y, y: u}, start={x: 0, y: 0.5}, path={"low": x <= 0})
    found = verified(
        problem, claimed(problem, lambda t: [t / 2 - t**2 / 2, 0.5 - t], lambda t: 0 * t - 1)
    )
    assert found.path == pytest.approx(1.0, rel=1e-2)  # 1/8, relative to the largest x of the claim


def test_a_stiff_motion_is_integrated_in_a_moment() -> None:
    """X follows cos t within 1e-6: (r^2 cos t + r sin t) / (r^2 + 1) with r = 1e6, for 2e6 steps of
    an explicit method.
    """
    r = 1e6
    problem = walk(
        minimise=y, dynamics={x: r * (cos(time) - x), y: u}, start={x: 1, y: 0}, final_time=10
    )

    def motion(t: np.ndarray) -> Any:
        return np.vstack([(r**2 * np.cos(t) + r * np.sin(t)) / (r**2 + 1), -t])

    solution = claimed(problem, motion, lambda t: -np.ones_like(t), span=(0, 10))
    began = process_time()
    seen = verify(problem, solution)[0]
    assert process_time() - began < 10.0
    assert seen.end == pytest.approx(motion(np.array([10.0]))[:, 0].tolist(), abs=1e-8)
    assert seen.drift < 1e-8

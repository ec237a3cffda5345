"""The default method, cold, over the public problems: word, digits and verdict, and what it says of
the rest.
"""

import importlib
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from casadi import cos, sin

from socp import Ipopt, Problem, Solution, controls, default_guess, run, states
from socp.errors import LateError
from socp.model.progress import Progress
from socp.model.result.solution import Stop
from socp.model.symbols import final_time, initial_time, time
from socp.model.word import Word
from socp.registry.plugins import Registry

NAMES = [
    "auv",
    "catalyst_mixing",
    "double_integrator_time",
    "dubins_csc",
    "jacobson_1",
    *(
        pytest.param(name, marks=pytest.mark.slow)
        for name in (
            "auv_reverse",
            "double_integrator_vlimit",
            "fishery_discounted",
            "goddard",
            "goddard_fixed_time",
            "goddard_vlimit",
            "lotka_fishing",
            "rayleigh_time",
            "robot_arm",
            "vdp_regulator",
        )
    ),
]

FULLER = "u: - + - + - s"  # the best of at most `max_switches` switches


def load(name: str) -> Problem:
    problem: Problem = importlib.import_module(f"socp_problems.{name}").problem
    return problem


def solved(registry: Registry, problem: Problem) -> Solution:
    return run(registry.methods["auto"](), problem, default_guess(problem))


def spelt(problem: Problem) -> str:
    """Return a reference's word as a structure spells it: every control by itself, without
    repetition.
    """
    rows = []
    for i, name in enumerate(problem.control_names):
        modes = [
            str(arc[i]) for arc in Word.parse(problem.reference.word, problem.control_names).arcs
        ]
        rows.append(
            f"{name}: {' '.join(m for k, m in enumerate(modes) if k == 0 or m != modes[k - 1])}"
        )
    return "; ".join(rows)


@pytest.mark.parametrize("name", NAMES)
def test_cold_start_ends_in_the_reference_certified(registry: Registry, name: str) -> None:
    problem = load(name)
    reference, solution = problem.reference, solved(registry, problem)
    assert solution.verdict is not None
    assert solution.extremal, solution.verdict.reasons
    assert re.sub(r"\[[^]]*\]", "", solution.word) == re.sub(r"\[[^]]*\]", "", spelt(problem))
    digits = max(reference.tolerance, 1e-9 * abs(reference.objective))
    assert solution.objective == pytest.approx(reference.objective, rel=0, abs=digits)
    assert solution.switches == pytest.approx(reference.switches, rel=0, abs=1e-7)


@pytest.mark.slow
def test_fuller_is_named_chattering_and_not_certified(registry: Registry) -> None:
    problem = load("fuller")
    solution = solved(registry, problem)
    assert not solution.extremal
    assert "u: chattering" in solution.message
    assert solution.verdict is not None
    assert solution.verdict.miss < 1e-6
    assert (
        solution.objective > problem.reference.objective - problem.reference.tolerance
    )  # no finite word reaches it
    assert solution.objective == pytest.approx(problem.reference.objective, rel=1e-10)
    assert solution.word == FULLER
    assert "best objective by number of switches 0: 20.8333333333, " in solution.message


@pytest.mark.slow
def test_a_limit_on_switches_is_kept_where_a_control_chatters(registry: Registry) -> None:
    problem = load("fuller")
    few = run(registry.method("auto")(max_switches=3), problem, default_guess(problem))
    assert few.word == "u: - + - s"
    assert few.objective == pytest.approx(0.13419707506, rel=1e-9)
    many = run(registry.method("auto")(max_switches=0), problem, default_guess(problem))
    assert "u: chattering" in many.message
    assert "best objective by" not in many.message


x, v = states("x v")
u, q, p, n = controls("u q p n")


def rest(horizon: float, **more: object) -> Problem:
    """Return a double integrator from rest at 0 to rest at 1, thrust p forwards and n backwards,
    least fuel.
    """
    return Problem(
        name="fuel",
        running=p + n,
        dynamics={x: v, v: p - n},
        bounds={p: (0, 1), n: (0, 1)},
        start={x: 0, v: 0},
        end={x: 1, v: 0},
        final_time=horizon,
        **more,
    )  # type: ignore[arg-type]


def test_least_fuel_with_two_sided_thrust(registry: Registry) -> None:
    """Burn for s, coast, brake for s: s (3 - s) = 1, fuel 2 s."""
    solution = solved(registry, rest(3.0))
    s = (3 - np.sqrt(5)) / 2
    assert solution.extremal
    assert solution.word == "p: + -; n: - +"
    assert solution.switches == pytest.approx([s, 3 - s], abs=1e-9)
    assert solution.objective == pytest.approx(2 * s, abs=1e-9)


def test_two_controls_that_switch_at_once(registry: Registry) -> None:
    """Two engines on one mass have one switching function: 3 s^2 = 1 for half of the time."""
    problem = Problem(
        name="engines",
        minimise=final_time,
        dynamics={x: v, v: u + 2 * q},
        bounds={u: (-1, 1), q: (-1, 1)},
        start={x: 0, v: 0},
        end={x: 1, v: 0},
    )
    solution = solved(registry, problem)
    assert solution.extremal
    assert solution.word == "u: + -; q: + -"
    assert solution.switches == pytest.approx([3**-0.5], abs=1e-9)
    assert solution.objective == pytest.approx(2 * 3**-0.5, abs=1e-9)


@pytest.mark.slow
def test_several_separated_singular_arcs(registry: Registry) -> None:
    """The path follows sin 3t where its slope is within the bounds, and leaves it where it is too
    steep.
    """
    problem = Problem(
        name="track",
        running=(x - sin(3 * time)) ** 2,
        dynamics={x: u},
        bounds={u: (-2, 2)},
        start={x: 0},
        final_time=3,
    )
    solution = solved(registry, problem)
    assert solution.extremal
    assert solution.word == "u: + s - s + s -"
    singular = [row for row in solution.structure["u"] if row[0] == "s"]
    for _, a, b in singular:
        t = np.linspace(a, b, 20)[1:-1]
        assert solution.at(t)[0] == pytest.approx(np.sin(3 * t), abs=1e-7)


@pytest.mark.slow
def test_an_arc_of_a_ten_thousandth_of_the_horizon(registry: Registry) -> None:
    """From 0.01 off the line 1 + t/5 with a speed of -10: met after 0.01 / 10.2; costates of
    1e-5.
    """
    problem = Problem(
        name="tiny",
        running=(x - 1 - 0.2 * time) ** 2,
        dynamics={x: u},
        bounds={u: (-10, 10)},
        start={x: 1.01},
        final_time=10,
    )
    solution = solved(registry, problem)
    assert solution.extremal
    assert solution.switches == pytest.approx([0.01 / 10.2], rel=1e-6)


def test_a_free_initial_time(registry: Registry) -> None:
    problem = Problem(
        name="late",
        minimise=final_time - initial_time,
        dynamics={x: v, v: u + 0.3 * cos(time)},
        bounds={u: (-1, 1)},
        start={x: 0, v: 0},
        end={x: 1, v: 0},
        initial_time=(0, 2),
        final_time=(0, 12),
    )
    assert solved(registry, problem).extremal


@pytest.mark.slow
def test_what_cannot_be_reached_is_said_to_be_infeasible(registry: Registry) -> None:
    """Rest to rest over 1 takes a time of 2 with these thrusts."""
    solution = solved(registry, rest(1.0))
    assert not solution.stop.ok
    assert not solution.extremal


def test_a_failed_first_solve_is_returned_with_its_stop(registry: Registry) -> None:
    method = replace(registry.methods["auto"](), starts=0, backend=Ipopt({"max_iter": 1}))
    solution = run(method, load("auv"), default_guess(load("auv")))
    assert solution.stop is Stop.LIMIT


def test_a_watch_stops_it(registry: Registry) -> None:
    calls: list[Progress] = []

    def stop(progress: Progress) -> bool:
        calls.append(progress)
        return len(calls) > 5

    problem = load("auv")
    assert (
        registry.methods["auto"]().solve(problem, default_guess(problem), stop).stop
        is Stop.INTERRUPTED
    )
    assert len(calls) < 50


def test_scattered_starts_find_the_better_extremal_of_two(registry: Registry) -> None:
    """Downhill either way, one way a little deeper: the guess leads the other way."""
    problem = Problem(
        name="ridge",
        minimise=-(x**2) + 0.1 * x,
        dynamics={x: u},
        bounds={u: (-1, 1)},
        start={x: 0},
        final_time=1,
        guess={x: (0, 0.9)},
    )
    solution = solved(registry, problem)
    assert solution.extremal
    assert solution.word == "u: -"
    assert solution.objective == pytest.approx(-1.1, abs=1e-9)


def test_a_fault_of_the_search_leaves_what_is_in_hand(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise ValueError("cannot be")

    monkeypatch.setattr("socp_plugins.auto.refine", broken)
    with pytest.warns(RuntimeWarning, match="internal error: ValueError: cannot be; this is the"):
        found = solved(registry, load("double_integrator_time"))
    assert found.verdict is not None
    assert found.verdict.feasible
    assert found.objective == pytest.approx(1 + np.sqrt(6), rel=1e-3)
    assert "internal error: ValueError: cannot be" in found.message


def test_time_that_ends_on_the_way_leaves_what_is_in_hand(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    def late(*_: object) -> None:
        raise LateError("re-integration: the time for it is over")

    monkeypatch.setattr("socp_plugins.auto.conclude", late)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = solved(registry, load("double_integrator_time"))
    assert found.extremal
    assert found.objective == pytest.approx(1 + np.sqrt(6), rel=1e-9)

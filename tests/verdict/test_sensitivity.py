"""Derivatives of extremals: closed forms, and differences of extremals solved anew."""

from collections.abc import Callable
from math import pi, sqrt

import numpy as np
import pytest
from casadi import cos, fabs, sin, tanh

from socp import (
    MethodError,
    Problem,
    Solution,
    SolveError,
    Word,
    constants,
    controls,
    default_guess,
    final_time,
    judge,
    parameters,
    states,
)
from socp.methods.guess import split
from socp.methods.polish import polished
from socp.methods.solving import Follower
from socp.model.ladder.sensitivity import Sensitivity
from socp.registry import Registry
from socp.verdict.sensitivity import data_values, derivatives


def solved(problem: Problem, text: str, lengths: list[float] | None = None) -> Solution:
    """Return a word's extremal to rounding, judged."""
    word = Word.parse(text, problem.control_names)
    guess = default_guess(problem)
    found = Follower()(problem, word, split(guess, lengths) if lengths else guess)
    return judge(problem, polished(problem, judge(problem, found)) or found)


def double_integrator(
    x0: float = 1.0, v0: float = -1.0, limit: float | None = None, force: float = 1.0
) -> Problem:
    x, v = states("x v")
    u = controls("u")
    return Problem(
        name="double_integrator",
        minimise=final_time,
        dynamics={x: v, v: u},
        bounds={u: (-force, force)} | ({} if limit is None else {v: (None, limit)}),
        start={x: x0, v: v0},
        end={x: 0 if limit is None else 10, v: 0},
    )


def test_derivatives_are_those_of_the_solution_however_far_the_values_are_from_it() -> None:
    """From rest at x: tf = 2 sqrt(x), so dtf/dx = 1 at x = 1 whatever neighbour the values are of:
    that of x = 1.0001 is off by 5e-5 in its times, near enough for one matrix to do.
    """
    neighbour = solved(double_integrator(x0=1.0001, v0=0.0), "- +")
    (found,) = derivatives(double_integrator(v0=0.0), neighbour, ["start.x"])
    assert found.final_time == pytest.approx(1.0, abs=1e-9)
    assert found.junctions == pytest.approx((0.5,), abs=1e-9)


def test_a_bang_bang_extremal_in_closed_form() -> None:
    """Tf = v + 2 r with r^2 = x + v^2/2 at x = 1, v = -1, half of 2 r after the switch; dx/dx(0) =
    1 and dx/dv(0) = t on the first arc.
    """
    problem, r = double_integrator(), sqrt(1.5)
    by_x, by_v = derivatives(
        problem, solved(problem, "u: - +", [0.3, 1.2]), ["start.x", "start.v"], at=[0.1]
    )
    assert by_x.objective == pytest.approx(1 / r, rel=1e-10)
    assert by_x.final_time == pytest.approx(1 / r, rel=1e-10)
    assert by_x.junctions == pytest.approx([0.5 / r], rel=1e-10)
    assert by_x.states[0.1] == pytest.approx([1, 0], abs=1e-12)
    assert by_v.objective == pytest.approx(1 - 1 / r, rel=1e-10)
    assert by_v.junctions == pytest.approx([1 - 0.5 / r], rel=1e-10)
    assert by_v.states[0.1] == pytest.approx([0.1, 1], abs=1e-12)


def test_a_named_constant_in_closed_form() -> None:
    """With |u| <= F the switch is at v / F + r, Tf = v / F + 2 r, r^2 = x / F + v^2 / 2 F^2: at x =
    1, v = -1, F = 1 they grow by 1 - 1 / r and 1 - 2 / r. A constant may stand in several places.
    """
    x, v = states("x v")
    u, force = controls("u"), constants(force=1.0)
    problem = Problem(
        name="pushed",
        minimise=final_time,
        dynamics={x: v, v: u},
        bounds={u: (-force, force)},
        start={x: 1, v: -1},
        end={x: 0, v: 0},
    )
    (found,), r = derivatives(problem, solved(problem, "u: - +", [0.3, 1.2]), ["force"]), sqrt(1.5)
    assert flat(found) == pytest.approx([1 - 2 / r, 1 - 1 / r, 1 - 2 / r], rel=1e-9)
    assert "force" in data_values(problem)


def test_derivatives_as_a_method_and_as_a_dataset() -> None:
    """The same extremal: 1 / r, 1 - 1 / r for objective and final time, half of it, and 1 less
    that, for the switch.
    """
    problem, r = double_integrator(), sqrt(1.5)
    solution = solved(problem, "u: - +", [0.3, 1.2])
    found = solution.sensitivity(problem, ["start.x", "start.v"], at=[0.1, 0.2])
    shown = found.to_xarray()
    assert shown.objective.sel(datum="start.x") == pytest.approx(1 / r, rel=1e-10)
    assert shown.final_time.sel(datum="start.v") == pytest.approx(1 - 1 / r, rel=1e-10)
    assert shown.junctions.sel(datum="start.v").values == pytest.approx([1 - 0.5 / r], rel=1e-10)
    assert shown.states.sel(datum="start.v", time=0.2, state="x") == pytest.approx(0.2, abs=1e-12)
    assert shown.junction.values == pytest.approx(solution.junctions)
    assert (shown.attrs["problem"], shown.attrs["word"]) == ("double_integrator", "u: - +")
    assert found.data["derivatives"][0]["objective"] == found[0].objective
    every = solution.sensitivity(problem)
    assert [each.to for each in every] == list(data_values(problem))
    assert every.to_xarray().states.shape == (len(every), 0, 2)


def test_what_does_not_move_is_zero() -> None:
    """Where x' = x u with u <= 2 leads from 1 as far as it can until 1, x(1) = x(0) e^2: the
    horizon moves with its own ends alone, and the lower bound moves nothing.
    """
    x, u = states("x"), controls("u")
    problem = Problem(
        name="grown",
        minimise=-x,
        dynamics={x: x * u},
        bounds={u: (-1, 2)},
        start={x: 1},
        final_time=1,
    )
    found = {each.to: each for each in solved(problem, "u: +").sensitivity(at=[0.5])}
    assert found["start.x"].objective == pytest.approx(-np.exp(2), rel=1e-9)
    assert found["start.x"].states[0.5] == pytest.approx([np.exp(1)], rel=1e-9)
    assert (found["start.x"].final_time, found["final_time"].initial_time) == (0.0, 0.0)
    assert (found["u.lower"].objective, found["u.lower"].states[0.5]) == (0.0, (0.0,))
    assert found["final_time"].final_time == pytest.approx(1)


def test_a_datum_that_cannot_move_is_told_beside_those_that_can() -> None:
    """The start is at the lower bound of v: moved up, there is no such problem."""
    x, v = states("x v")
    u = controls("u")
    problem = Problem(
        name="grounded",
        minimise=final_time,
        dynamics={x: v, v: u},
        bounds={u: (-1, 1), v: (0, 5)},
        start={x: 0, v: 0},
        end={x: 1},
    )
    solution = solved(problem, "u: +")
    found = solution.sensitivity()
    assert list(found.missing) == ["v.lower"]
    assert "no derivative by v.lower: moved by" in found.missing["v.lower"]
    assert {"end.x", "u.upper", "v.upper"} <= {each.to for each in found}
    with pytest.raises(SolveError, match=r"no derivative by v\.lower: moved by"):
        solution.sensitivity(to=["v.lower"])


@pytest.mark.slow
def test_a_boundary_arc_in_closed_form() -> None:
    """From rest over 10 with |u| <= 1 and v <= V = 2: switches at V and 10 / V, Tf = 10 / V + V;
    with force F they are V / F, 10 / V and Tf = 10 / V + V / F.
    """
    problem = double_integrator(0.0, 0.0, limit=2.0)
    solution = solved(problem, "u: + b -", [2.0, 3.0, 2.0])
    by_limit, by_end, by_force = derivatives(
        problem, solution, ["v.upper", "end.x", "u.upper"], at=[3.0]
    )
    assert by_limit.junctions == pytest.approx([1, -2.5], rel=1e-9)
    assert by_limit.objective == pytest.approx(1 - 2.5, rel=1e-9)
    assert by_limit.states[3.0] == pytest.approx([3.0 - 2.0, 1.0], rel=1e-9)
    assert by_end.junctions == pytest.approx([0, 0.5], abs=1e-10)
    assert by_end.final_time == pytest.approx(0.5, rel=1e-10)
    # a stronger start alone: V / F later at the limit, half of that gained in the end
    assert by_force.junctions == pytest.approx([-2.0, -1.0], rel=1e-9)
    assert by_force.objective == pytest.approx(-1.0, rel=1e-9)


def test_a_singular_arc_in_closed_form() -> None:
    """Integral of x^2 with x' = c u from a: |u| <= 1 until x = 0 at a / c, then singular; it is
    a^3 / 3 c, and with u >= b -a^3 / (3 b c).
    """
    x, u, c = states("x"), controls("u"), parameters("c")
    problem = Problem(
        name="regulator",
        running=x**2,
        dynamics={x: c * u},
        bounds={u: (-1, 1), c: (1, 1)},
        start={x: 1},
        final_time=2.0,
    )
    solution = solved(problem, "u: - s", [1.0, 1.0])
    by_a, by_c, by_b, by_top, by_end = derivatives(
        problem, solution, ["start.x", "c", "u.lower", "u.upper", "final_time"]
    )
    assert by_a.objective == pytest.approx(1.0, rel=1e-10)
    assert by_a.junctions == pytest.approx([1.0], rel=1e-10)
    assert by_c.objective == pytest.approx(-1 / 3, rel=1e-10)
    assert by_c.junctions == pytest.approx([-1.0], rel=1e-10)
    assert by_c.parameters == {"c": pytest.approx(1.0)}
    assert by_b.objective == pytest.approx(1 / 3, rel=1e-10)
    assert by_top.objective == pytest.approx(0.0, abs=1e-10)
    assert by_end.final_time == pytest.approx(1.0)
    assert by_end.objective == pytest.approx(0.0, abs=1e-10)


def differences(build: Callable[[float], Solution], at: float, step: float) -> np.ndarray:
    """Return differences of order 4 of objective, junctions and final time."""
    rows = []
    for side in (-2, -1, 1, 2):
        found = build(at + side * step)
        rows.append(np.array([found.objective, *found.junctions, found.final_time]))
    a, b, c, d = rows
    return np.array((a - 8 * b + 8 * c - d) / (12 * step))


def flat(found: Sensitivity) -> list[float]:
    return [found.objective, *found.junctions, found.final_time]


def rayleigh(start: float) -> Problem:
    x, v = states("x v")
    u = controls("u")
    return Problem(
        name="rayleigh",
        minimise=final_time,
        dynamics={x: v, v: -x + v * (1.4 - 0.14 * v**2) + 4 * u},
        bounds={u: (-1, 1)},
        start={x: start, v: -5},
        end={x: 0, v: 0},
    )


@pytest.mark.slow
def test_a_free_time_against_extremals_solved_anew() -> None:
    def build(start: float) -> Solution:
        return solved(rayleigh(start), "u: + - +")

    (found,) = derivatives(rayleigh(-5), build(-5), ["start.x"])
    assert flat(found) == pytest.approx(differences(build, -5, 1e-2), rel=1e-8, abs=1e-9)


@pytest.mark.slow
def test_the_vehicle_by_the_strength_of_its_current() -> None:
    x, y, phi, u = states("x y phi u")
    (r, f), c = controls("r f"), parameters("c")

    def build(strength: float) -> tuple[Problem, Solution]:
        problem = Problem(
            name="auv",
            minimise=final_time,
            dynamics={
                x: u * cos(phi) + c * tanh(y),
                y: u * sin(phi),
                phi: r,
                u: f - u * fabs(u),
            },
            bounds={r: (-pi, pi), f: (-5, 5), u: (0, 2), c: (strength, strength)},
            start={x: 40, y: -2, phi: pi, u: 0},
            end={phi: pi, u: 0},
            target={"disc": x**2 + y**2 <= 0.05},
        )
        word = "r: + s s s +; f: + + b[u.upper] - -"
        return problem, solved(problem, word, [0.05, 0.6, 14.0, 0.1, 0.2])

    (found,) = derivatives(*build(0.8), ["c"])
    known = [0.0352639, 0.0, -5.0218429, -5.1156360, -5.0218429]
    assert flat(found)[1:] == pytest.approx(known, abs=1e-7)
    wanted = differences(lambda strength: build(strength)[1], 0.8, 1e-2)
    assert flat(found) == pytest.approx(wanted, rel=1e-8, abs=1e-9)
    registered = Registry.load().problem("auv")  # where the same number is a named constant
    (named,) = derivatives(registered, judge(registered, build(0.8)[1]), ["current"])
    assert flat(named) == pytest.approx(flat(found), rel=1e-9, abs=1e-9)


@pytest.mark.slow
def test_where_there_are_no_derivatives_the_reason_is_said() -> None:
    problem = double_integrator()
    solution = solved(problem, "u: - +", [0.3, 1.2])
    with pytest.raises(MethodError, match=r"'start\.y' is no datum of the problem; there are st"):
        derivatives(problem, solution, ["start.y"])
    with pytest.raises(MethodError, match=r"time 9 is outside the horizon, 0 to 1\.449"):
        derivatives(problem, solution, ["start.x"], at=[9.0])
    wrong = judge(problem, solved(problem, "u: + -", [0.3, 1.2]))
    with pytest.raises(SolveError, match="not certified as an extremal"):
        derivatives(problem, wrong, ["start.x"])


def test_two_controls_that_switch_at_one_time_have_none() -> None:
    """Two double integrators side by side: a change of one start parts the switches."""
    x, v, y, w = states("x v y w")
    u, a = controls("u a")
    problem = Problem(
        name="twins",
        minimise=final_time,
        dynamics={x: v, v: u, y: w, w: a},
        bounds={u: (-1, 1), a: (-1, 1)},
        start={x: 1, v: 0, y: 1, w: 0},
        end={x: 0, v: 0, y: 0, w: 0},
    )
    solution = solved(problem, "u: - +; a: - +", [1.0, 1.0])
    with pytest.raises(SolveError, match="no derivatives"):
        derivatives(problem, solution, ["start.x"])


def test_the_data_of_a_problem_have_names() -> None:
    problem = double_integrator(0.0, 0.0, limit=2.0)
    ends = ["start.x", "start.v", "end.x", "end.v", "initial_time"]
    assert list(data_values(problem))[:5] == ends
    assert list(data_values(problem))[-3:] == ["u.lower", "u.upper", "v.upper"]

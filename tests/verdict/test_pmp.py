"""The judge: it certifies extremals, and nothing else, and says which condition fails, where and by
how much.
"""

from dataclasses import replace

import numpy as np
import pytest

from socp import (
    Ipopt,
    Problem,
    Solution,
    Word,
    controls,
    default_guess,
    final_time,
    judge,
    parameters,
    solve_collocated,
    states,
    uniform,
)
from socp.methods.guess import split
from socp.model.data.files import from_json, to_json
from socp.model.tolerances import EXTREMAL, FEASIBLE
from socp.registry import solve
from socp.transcription import follow
from socp.transcription.schemes import lgr

SHARP = Ipopt({"tol": 1e-11, "max_iter": 200})


def solved(
    problem: Problem,
    word: str,
    fixed: dict[int, float] | None = None,
    lengths: list[float] | None = None,
) -> Solution:
    """Solve a word, with some arcs held at a given length, on a mesh that resolves them; judge
    it.
    """
    phased = follow(problem, Word.parse(word, problem.control_names))
    held = fixed or {}
    phases = tuple(
        replace(f, length=(held[k],) * 2) if k in held else f for k, f in enumerate(phased.phases)
    )
    phased = replace(phased, phases=phases)
    guess = split(default_guess(problem), lengths) if lengths else default_guess(problem)
    first = solve_collocated(phased, [uniform(lgr(8), 1)] * len(phases), SHARP, guess)
    share = [(arc.t[-1] - arc.t[0]) / (first.final_time - first.initial_time) for arc in first.arcs]
    meshes = [uniform(lgr(10), 10 if part > 0.2 else 2) for part in share]
    return judge(problem, solve_collocated(phased, meshes, SHARP, first))


def bang_bang(scale: float = 1.0, pace: float = 1.0, cost: float = 1.0) -> Problem:
    """Return the double integrator from (1, 1) in minimum time, in other units of length, time and
    cost.
    """
    x, v = states("x v")
    u = controls("u")
    return Problem(
        name="double",
        minimise=cost * final_time / pace,
        dynamics={x: v / pace, v: u / pace},
        bounds={u: (-scale, scale)},
        start={x: scale, v: scale},
        end={x: 0, v: 0},
    )


def test_double_integrator_is_certified_with_its_closed_form_costates() -> None:
    """From H = -1 and v(t1) of the textbook: lambda(0) = (sqrt(2/3), 1 + sqrt(2/3)), switch at 1 +
    sqrt(3/2).
    """
    solution = solved(bang_bang(), "- +")
    verdict = solution.verdict
    assert verdict is not None
    assert verdict.extremal, verdict.reasons
    assert verdict.residual < 1e-9
    assert solution.switches == pytest.approx([1 + np.sqrt(1.5)], abs=1e-10)
    assert solution.arcs[0].costate[:, 0] == pytest.approx(
        [np.sqrt(2 / 3), 1 + np.sqrt(2 / 3)], abs=1e-8
    )
    assert verdict.digits >= 10


def test_boundary_arc_has_the_closed_form_multiplier() -> None:
    """Rest to rest over 10 with v <= 1.5: lambda_x = -2/3 constant, lambda_v = 0 on the boundary:
    mu = -lambda_x.
    """
    x, v = states("x v")
    u = controls("u")
    problem = Problem(
        name="limit",
        minimise=final_time,
        dynamics={x: v, v: u},
        bounds={u: (-1, 1), v: (-np.inf, 1.5)},
        start={x: 0, v: 0},
        end={x: 10, v: 0},
        boundary={u: {"v.upper": 0}},
    )
    solution = solved(problem, "+ b[v.upper] -")
    assert solution.extremal, solution.verdict.reasons if solution.verdict else None
    assert solution.objective == pytest.approx(49 / 6, abs=1e-9)
    middle = solution.arcs[1]
    assert middle.costate[0] == pytest.approx(np.full(middle.t.size, -2 / 3), abs=1e-8)
    assert middle.costate[1] == pytest.approx(np.zeros(middle.t.size), abs=1e-8)
    assert middle.multipliers["v.upper"] == pytest.approx(np.full(middle.t.size, 2 / 3), abs=1e-6)


@pytest.fixture(scope="module")
def auv() -> Problem:
    from socp_problems.auv import problem

    assert isinstance(problem, Problem)
    return problem


RIGHT = "r: + s s s +; f: + + b[u.upper] - -"


def test_auv_is_certified(auv: Problem) -> None:
    verdict = solved(auv, RIGHT).verdict
    assert verdict is not None
    assert verdict.extremal, verdict.reasons
    assert verdict.residual <= 1e-6
    assert verdict.distance is None


# word, arcs held at a length, what the judge must say first; all but those marked are converged,
# feasible solutions
WRONG = [
    (RIGHT, {2: 13.98}, "switch"),
    (RIGHT, {3: 0.1013455}, "switch"),
    ("r: + - s s s +; f: + + + b[u.upper] - -", {1: 1e-3}, "strict sign"),
    ("r: + s s s s +; f: + + b[u.upper] - + -", {4: 1e-3}, "f, stretch"),
    ("r: + s s s s s +; f: + + b[u.upper] - b[u.upper] - -", {}, "without length"),
    ("r: + - s s +; f: + + b[u.upper] - -", {}, "r, stretch 1"),
    ("r: + s s s + -; f: + + b[u.upper] - - -", {}, "without length"),
    # infeasible, which takes the solver long to find
    *(
        pytest.param(word, fixed, "re-integrated control is off", marks=pytest.mark.slow)
        for word, fixed in (
            (RIGHT, {0: 0.05005211}),  # the singular law is left at the wrong heading
            ("r: - s s -; f: + b[u.upper] - -", {}),
        )
    ),
]


@pytest.mark.parametrize(("word", "fixed", "reason"), WRONG)
def test_wrong_words_and_moved_switches_are_not_certified(
    auv: Problem, word: str, fixed: dict[int, float], reason: str
) -> None:
    verdict = solved(auv, word, fixed).verdict
    assert verdict is not None
    assert not verdict.extremal
    assert any(reason in line for line in verdict.reasons), verdict.reasons


def test_distance_is_a_lower_bound(auv: Problem) -> None:
    """No multipliers leave less than the programme's worst residual: those of any other judgement
    leave more.
    """
    verdict = solved(auv, RIGHT, {2: 13.98}).verdict
    assert verdict is not None
    assert verdict.distance is not None
    assert EXTREMAL < verdict.distance <= verdict.residual * (1 + 1e-9)


@pytest.mark.slow
def test_a_ringing_control_is_named(auv: Problem) -> None:
    from socp.transcription.mesh import uniform as mesh
    from socp.transcription.phases import single_phase
    from socp.transcription.schemes import trapezoid

    verdict = judge(
        auv,
        solve_collocated(single_phase(auv), [mesh(trapezoid(), 400)], Ipopt(), default_guess(auv)),
    ).verdict
    assert verdict is not None
    assert verdict.feasible
    assert verdict.miss <= FEASIBLE
    assert not verdict.extremal
    assert set(verdict.rings) == {"r", "f"}


@pytest.mark.parametrize(
    "units", [(1e3, 1.0, 1.0), (1.0, 1e-2, 1.0), (1.0, 1.0, 1e4), (50.0, 20.0, 0.1)]
)
def test_the_judge_does_not_depend_on_units(units: tuple[float, float, float]) -> None:
    """A moved switch costs the same residual whatever the units of length, time and cost."""
    first = 2.3
    plain, scaled = (
        solved(bang_bang(*u), "- + -", {0: first * u[1]}, [2.2 * u[1], u[1], 0.2 * u[1]])
        for u in ((1.0, 1.0, 1.0), units)
    )
    assert plain.verdict is not None
    assert scaled.verdict is not None
    assert not plain.extremal
    assert scaled.verdict.residual == pytest.approx(plain.verdict.residual, rel=1e-5)


def test_a_solution_that_is_not_finite_is_judged_so() -> None:
    solution = solved(bang_bang(), "- +")
    arc = replace(solution.arcs[0], x=np.full_like(solution.arcs[0].x, np.nan))
    verdict = judge(bang_bang(), replace(solution, arcs=(arc, *solution.arcs[1:]))).verdict
    assert verdict is not None
    assert not verdict.feasible
    assert not verdict.extremal
    assert "not finite" in verdict.notes[0]


def test_verdict_survives_the_result_file() -> None:
    solution = solved(bang_bang(), "- +")
    again = from_json(to_json(solution))
    assert again.verdict == solution.verdict
    assert to_json(again) == to_json(solution)


def test_a_parameter_that_is_held_has_no_condition() -> None:
    """X' = k - u from 1, |u| <= 1, integral of x: u = 1, and a smaller k would be better."""
    x, u, k = states("x"), controls("u"), parameters("k")
    problem = Problem(
        name="held",
        running=x,
        dynamics={x: k - u},
        bounds={u: (-1, 1), k: (0.5, 0.5)},
        start={x: 1},
        final_time=1,
    )
    found = solve(problem, method="lgr-multiphase", word="+")
    assert found.extremal
    assert found.objective == pytest.approx(0.75)
    free = replace(problem, bounds={u: (-1, 1), k: (0, 1)})
    assert not judge(free, found).extremal

"""The public problems: registered, short, and their references confirmed along the derived laws."""

import importlib
import tomllib
from functools import cache
from importlib.metadata import entry_points
from itertools import pairwise
from pathlib import Path

import casadi
import numpy as np
import pytest
from scipy.integrate import DOP853

from socp import laws
from socp.methods.guess import default_guess
from socp.model.problem import Problem
from socp.model.symbols import final_time, initial_time, time
from socp.model.word import Word

ROOT = Path(__file__).parents[2]
NAMES = sorted(path.stem for path in (ROOT / "problems").glob("*.py"))


@cache
def load(name: str) -> Problem:
    found: Problem = importlib.import_module(f"socp_problems.{name}").problem
    return found


WITH_WORD = [name for name in NAMES if load(name).reference.word]


def word(problem: Problem) -> Word:
    return laws.name_constraints(problem, Word.parse(problem.reference.word, problem.control_names))


def test_every_problem_file_is_registered_under_its_own_name() -> None:
    table = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["entry-points"][
        "socp.problems"
    ]
    assert table == {name: f"socp_problems.{name}:problem" for name in NAMES}
    installed = {entry.name for entry in entry_points(group="socp.problems")}
    assert set(NAMES) <= installed


@pytest.mark.parametrize("name", NAMES)
def test_file_is_short_and_names_its_problem_title_and_source(name: str) -> None:
    lines = (ROOT / "problems" / f"{name}.py").read_text().splitlines()
    problem = load(name)
    assert len(lines) <= 40
    assert problem.name == name
    assert problem.title
    assert problem.source
    assert problem.reference.source


@pytest.mark.parametrize("name", NAMES)
def test_no_law_is_given_where_it_can_be_derived(name: str) -> None:
    assert not load(name).singular
    assert not load(name).boundary


@pytest.mark.parametrize("name", NAMES)
def test_rates_and_cost_are_finite_on_the_default_guess(name: str) -> None:
    problem, guess = load(name), default_guess(load(name))
    function = casadi.Function(
        "f", [problem.x, problem.u, time], [casadi.vertcat(problem.rate, problem.lagrangian)]
    )
    t = guess.arcs[0].t
    assert np.isfinite(
        function.map(t.size)(guess.arcs[0].x, guess.arcs[0].u, t[None, :]).full()
    ).all()


@pytest.mark.parametrize("name", WITH_WORD)
def test_reference_has_one_switch_between_neighbouring_arcs(name: str) -> None:
    problem = load(name)
    reference, arcs = problem.reference, word(problem).arcs
    assert len(reference.switches) == len(arcs) - 1
    assert list(reference.switches) == sorted(set(reference.switches))
    assert all(a != b for a, b in pairwise(arcs)), "two neighbouring arcs are the same"
    first, last = problem.initial_time_box[0], problem.final_time_box[1]
    assert first < reference.switches[0]
    assert reference.switches[-1] < last


@pytest.mark.parametrize("name", WITH_WORD)
def test_reference_objective_follows_from_its_switches_along_the_derived_laws(name: str) -> None:
    """An independent route: DOP853 over the arcs, laws from `socp.laws.law`, and nothing of the
    solvers.
    """
    problem = load(name)
    reference = problem.reference
    end, x, cost = integrate(problem)
    mayer = casadi.Function("J", [problem.x, initial_time, final_time], [problem.mayer])
    objective = float(mayer(x, problem.initial_time_box[0], end)) + cost
    assert objective == pytest.approx(reference.objective, rel=1e-8, abs=1e-10)
    low, high = problem.end_box
    scale = 1.0 + np.abs(problem.start_box).max(
        axis=0, where=np.isfinite(problem.start_box), initial=0.0
    )
    assert (np.maximum(np.maximum(low - x, x - high), 0.0) / scale).max() < 1e-8
    low, high = problem.state_box
    assert ((low - x) / scale).max() < 1e-8
    for condition in problem.conditions:
        assert float(casadi.Function("c", [problem.x], [condition.expression])(x)) < 1e-8


def test_fuller_reference_is_the_cost_of_the_optimal_synthesis() -> None:
    """Fuller's switching curve x1 = -C x2 |x2| with C = sqrt((sqrt(33) - 1) / 24); every arc is a
    parabola.
    """
    reference = load("fuller").reference
    C = np.sqrt((np.sqrt(33.0) - 1.0) / 24.0)
    x, v, u, cost, times = 0.0, 1.0, -1.0, 0.0, []
    for _ in range(8):  # the cost of an arc falls by the fifth power of the ratio
        # x + v s + u s^2 / 2 = -C w |w| at w = v + u s, which has the sign of u by then
        roots = np.roots([u / 2 + C * u, v + 2 * C * v, x + C * u * v * v])
        s = next(r for r in roots if (v + u * r) * u > 0)
        cost += 0.5 * np.polyval(np.polyint(np.polymul([u / 2, v, x], [u / 2, v, x])), s)
        x, v, u = x + v * s + u * s * s / 2, v + u * s, -u
        times.append(s)
    assert cost == pytest.approx(reference.objective, abs=10 * reference.tolerance)
    assert f"{times[0]:.14f}" in reference.source
    assert f"{times[2] / times[1]:.8f}" in reference.source
    assert sum(times) < load("fuller").final_time


def integrate(problem: Problem) -> tuple[float, np.ndarray, float]:
    """Integrate the reference arcs; returns final time, final state (nx,) and the integral of the
    running cost.
    """
    controls = [laws.arc_law(problem, modes).control for modes in word(problem).arcs]
    times = [problem.initial_time_box[0], *problem.reference.switches, final(problem)]
    y = np.append(problem.start_box[0], 0.0)
    start = times[0]
    for control, end in zip(controls, times[1:], strict=True):
        rates = casadi.substitute(
            casadi.vertcat(problem.rate, problem.lagrangian), problem.u, control
        )
        flow = casadi.Function("f", [problem.x, time], [rates])
        # a free end time that is not the cost itself is where the cost stops falling, as nothing
        # else holds it
        falling = casadi.Function(
            "s", [problem.x, time], [casadi.jtimes(problem.mayer, problem.x, rates[:-1])]
        )
        start, y = advance(flow, falling if end is None else None, (start, end), y)
    return start, y[:-1], float(y[-1])


def final(problem: Problem) -> float | None:
    low, high = problem.final_time_box
    if low == high:
        return low
    return problem.reference.objective if casadi.is_equal(problem.mayer, final_time) else None


def advance(
    flow: casadi.Function,
    falling: casadi.Function | None,
    span: tuple[float, float | None],
    y: np.ndarray,
) -> tuple[float, np.ndarray]:
    a, b = span
    solver = DOP853(
        lambda t, y: flow(y[:-1], t).full().ravel(),
        a,
        y,
        b or a + 10.0,
        rtol=1e-13,
        atol=1e-14,
        max_step=0.1 if b else 0.01,
    )
    before = -1.0
    while solver.status == "running":
        solver.step()
        if falling is None:
            continue
        now = float(falling(solver.y[:-1], solver.t))
        if before < 0 <= now:
            return crossing(solver, falling)
        before = now
    assert solver.status == "finished"
    return solver.t, solver.y


def crossing(solver: DOP853, falling: casadi.Function) -> tuple[float, np.ndarray]:
    dense, low, high = solver.dense_output(), solver.t_old, solver.t
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (
            (middle, high) if float(falling(dense(middle)[:-1], middle)) < 0 else (low, middle)
        )
    return low, dense(low)

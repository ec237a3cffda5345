"""The grade of a grid: the error that it states covers the true one, what is far from an extremal
is not called near one, and duality holds where the mathematics says so.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from records import revised
from scipy.integrate import solve_ivp

from socp import (
    Ipopt,
    Problem,
    Solution,
    controls,
    default_guess,
    final_time,
    initial,
    judge,
    parameters,
    single_phase,
    solve_collocated,
    states,
    uniform,
)
from socp.model import (
    APPROXIMATE,
    Arc,
    Grade,
    cached,
    from_json,
    mayer_function,
    rate_function,
    running_function,
    to_json,
)
from socp.model.symbols import time
from socp.process import time_limit
from socp.registry.plugins import Registry
from socp.registry.standard import STANDARD, turning_back
from socp.transcription import Mesh, euler, hermite_simpson, lgr, trapezoid
from socp.verdict import certified, certify, grade, reintegration
from socp.verdict.grading import weighing
from socp.verdict.grading.pieces import Pieces
from socp.verdict.grading.unknowns import Unknowns
from socp.verdict.grading.weighing import Chained, Weights, weights

REGISTRY = Registry.load()
# problems of the registry that a grid solves in a fraction of a second, to the reference's extremal
REGISTERED = (
    "catalyst_mixing",
    "double_integrator_time",
    "fuller",
    "goddard_fixed_time",
    "jacobson_1",
    "lotka_fishing",
    "rayleigh_time",
    "vdp_regulator",
)
GRIDS: dict[str, Mesh] = {
    "euler 100": uniform(euler(), 100),
    "trapezoid 50": uniform(trapezoid(), 50),
    "trapezoid 120": uniform(trapezoid(), 120),
    "hermite-simpson 40": uniform(hermite_simpson(), 40),
    "lgr 20 x 3": uniform(lgr(3), 20),
}
SOON = ("euler 100", "lgr 20 x 3")


@cache
def truths() -> dict[str, tuple[Problem, float]]:
    """Return problems with their true objectives."""
    found = {
        each.problem.name: (each.problem, each.objective) for each in (*STANDARD, turning_back())
    }
    for name in REGISTERED:
        problem = REGISTRY.problem(name)
        assert problem.reference is not None
        found[name] = (problem, problem.reference.objective)
    return found


@cache
def solved(name: str, grid: str) -> Solution:
    problem = truths()[name][0]
    return judge(problem, on(problem, GRIDS[grid]))


def on(problem: Problem, mesh: Mesh) -> Solution:
    found = solve_collocated(single_phase(problem), [mesh], Ipopt(), default_guess(problem))
    assert found.stop.ok
    return found


def graded(problem: Problem, solution: Solution) -> Grade:
    found = grade(problem, solution)
    assert found is not None
    return found


def weighed(problem: Problem, solution: Solution) -> tuple[Pieces, Weights]:
    pieces = Pieces.of(problem, solution)
    found = weights(Unknowns(problem, solution, pieces), 1.0)
    assert found is not None
    return pieces, found


STANDARDS = [each.problem.name for each in STANDARD] + ["turning_back"]


@pytest.mark.parametrize(
    "grid",
    [each if each in SOON else pytest.param(each, marks=pytest.mark.slow) for each in GRIDS],
)
@pytest.mark.parametrize(
    "name", [*STANDARDS, *(pytest.param(each, marks=pytest.mark.slow) for each in REGISTERED)]
)
def test_the_stated_error_covers_the_true_one(name: str, grid: str) -> None:
    problem, truth = truths()[name]
    solution = solved(name, grid)
    error = graded(problem, solution).error
    rounding = 1e-8 * max(abs(truth), 1.0)  # the solver's tolerance
    assert error + rounding >= abs(solution.objective - truth)
    assert error + rounding >= abs(solution.reached - truth)


@pytest.mark.slow
def test_the_stated_error_is_of_the_order_of_the_true_one() -> None:
    quotients = []
    for name in REGISTERED:
        problem, truth = truths()[name]
        solution = solved(name, "trapezoid 120")
        true = max(abs(each - truth) for each in (solution.objective, solution.reached))
        quotients.append(graded(problem, solution).error / true)
    assert np.median(quotients) < 10.0
    assert max(quotients) < 50.0


def test_a_finer_grid_states_a_smaller_error() -> None:
    problem = truths()["jacobson_1"][0]
    errors = [graded(problem, solved("jacobson_1", f"trapezoid {n}")).error for n in (50, 120)]
    assert errors[1] < errors[0] / 3.0  # order 2, but for the step that holds the switch


def test_chattering_has_a_grade_where_no_word_is_certified() -> None:
    verdict = solved("fuller", "trapezoid 120").verdict
    assert verdict is not None
    assert verdict.approximate
    assert not verdict.extremal


# -- duality


def flown(problem: Problem, of: Solution, t: np.ndarray, u: np.ndarray) -> Solution:
    """Return controls u (nu, n), linear between times t (n,), with the motion that they have."""
    rate, cost, p = rate_function(problem), running_function(problem), np.empty(0)

    def flow(s: float, y: np.ndarray) -> np.ndarray:
        v = np.array([np.interp(s, t, row) for row in u])
        return np.append(rate(y[:-1], v, s, p).full(), float(cost(y[:-1], v, s, p)))

    y = [np.append(of.arcs[0].x[:, 0], 0.0)]
    for a, b in pairwise(t):
        y.append(solve_ivp(flow, (a, b), y[-1], rtol=1e-8, atol=1e-10).y[:, -1])
    x = np.array(y).T[:-1]
    mayer = float(mayer_function(problem)(x[:, -1], x[:, 0], p, t[0], t[-1]))
    nothing = np.full_like(x, np.nan)
    mesh, modes = np.arange(t.size), ("*",) * u.shape[0]
    arc = Arc(t=t, x=x, u=u, costate=nothing, mesh=mesh, side="both", modes=modes)
    return revised(of, arcs=(arc,), objective=float(y[-1][-1]) + mayer, verified=(), verdict=None)


def shapes(t: np.ndarray) -> dict[str, np.ndarray]:
    """Return controls between 0 and 1 that no extremal has."""
    tau = (t - t[0]) / np.ptp(t)
    return {
        "low": np.zeros_like(t),
        "middle": np.full_like(t, 0.5),
        "high": np.ones_like(t),
        "ramp": tau,
        "wave": 0.5 + 0.5 * np.sin(7.0 * tau),
        "noise": np.random.default_rng(1).random(t.size),
    }


@pytest.mark.parametrize("shape", shapes(np.linspace(0, 1, 3)))
@pytest.mark.parametrize("name", ["regulator", "tracking", "jacobson_1"])
def test_weak_duality_on_convex_problems(name: str, shape: str) -> None:
    """Linear dynamics with a convex cost: no control does better than the Lagrangian less what
    better controls would gain in it, whichever control they are taken at (a supporting plane).
    """
    problem, truth = truths()[name]
    of = solved(name, "trapezoid 50")
    t = np.linspace(of.initial_time, of.final_time, 31)
    low, high = problem.box[:, 0]
    found = judge(problem, flown(problem, of, t, low + (high - low) * shapes(t)[shape][None, :]))
    mine = graded(problem, found)
    assert mine.objective - mine.gain <= truth + 1e-6
    assert mine.error >= abs(found.objective - truth) - 1e-6


@pytest.mark.parametrize("shape", shapes(np.linspace(0, 1, 3)))
@pytest.mark.parametrize("name", ["vdp_regulator", "lotka_fishing", "jacobson_1", "control_cost"])
@pytest.mark.slow
def test_a_control_of_no_extremal_is_not_near_one(name: str, shape: str) -> None:
    """Held off its optimum, interior though not singular, or rough: feasible, but no more."""
    problem = truths()[name][0]
    of = solved(name, "trapezoid 50")
    t = np.linspace(of.initial_time, of.final_time, 31)
    low, high = problem.box[:, 0]
    u = low + (high - low) * shapes(t)[shape][None, :]
    verdict = judge(problem, flown(problem, of, t, u)).verdict
    assert verdict is not None
    assert not verdict.approximate
    assert verdict.grade is None or verdict.grade.error > APPROXIMATE * verdict.grade.size


# -- the multipliers


def test_the_multipliers_are_the_principles_own() -> None:
    """Cruising at the speed limit of `speed_limit`: lambda_x = -1, lambda_v = -1 at the start and 0
    along the limit, where 0 = lambda_v' = -lambda_x - mu gives mu = 1.
    """
    problem = truths()["speed_limit"][0]
    pieces, found = weighed(problem, solved("speed_limit", "trapezoid 120"))
    assert found.costate[0, 0] == pytest.approx([-1.0, -1.0], abs=2e-2)
    assert found.costate[:, :, 0] == pytest.approx(-1.0, abs=2e-2)
    middle = np.abs(pieces.t[:, 0] - 1.5) < 0.3
    names = [each.name for each in problem.constraints]
    mass = found.density[middle].sum(axis=0) * np.ptp(pieces.edges) / pieces.count
    mass += found.jump[1:][middle].sum(axis=0)  # densities and jumps may share the work
    limit = names.index("v.upper")
    assert mass[limit] == pytest.approx(0.6, abs=0.06)
    assert np.delete(mass, limit) == pytest.approx(0.0, abs=1e-9)


def test_forms_in_the_unknowns_of_stretches_are_those_in_all_that_follow_from_them() -> None:
    problem = truths()["turning_back"][0]
    solution = solved("turning_back", "euler 100")
    unknowns = Unknowns(problem, solution, Pieces.of(problem, solution))
    chained = Chained.over(unknowns, np.arange(0, 100, 7))
    few = chained.spread.shape[1]
    assert few < unknowns.first[-1] / 5
    y = np.random.default_rng(0).normal(size=few)
    z, nx, ends = chained.whole(y), unknowns.scale.size, (*range(6, 100, 7), 99)
    left = unknowns.adjoint().at(z).reshape(-1, nx)
    assert np.abs(np.delete(left, ends, axis=0)).max() < 1e-12 * np.abs(z).max()
    assert left[list(ends)].ravel() == pytest.approx(chained.equations().at(y), rel=1e-10)
    seen = unknowns.switching((1, 3), np.arange(0, 100, 9))
    assert seen.at(z) == pytest.approx(chained.form(seen).at(y), rel=1e-10)


@pytest.mark.parametrize("name", ["turning_back", "goddard_fixed_time", "rayleigh_time"])
def test_stretches_of_several_steps_state_nearly_the_same_error(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem, truth = truths()[name]
    found = on(problem, uniform(euler(), 200))
    whole = graded(problem, judge(problem, found))
    monkeypatch.setattr(weighing, "STRETCHES", 70)
    few = graded(replace(problem), judge(replace(problem), found))
    assert abs(found.objective - truth) <= few.error < 1.5 * whole.error


@pytest.mark.parametrize("name", STANDARDS)
def test_the_costate_at_the_start_is_known(name: str) -> None:
    exact = next(e for e in (*STANDARD, turning_back()) if e.problem.name == name)
    found = weighed(exact.problem, solved(name, "trapezoid 120"))[1]
    assert found.costate[0, 0] == pytest.approx(exact.costate, abs=0.05)


def test_free_numbers_have_slopes_of_their_own() -> None:
    """A start of free place and time, an end held to it, a parameter: all at their best, so nothing
    is left to gain; with the start moved there is.

    x' = p u from t0 in [0, 1] to 2 with x(2) - x(t0) >= 1 wants p = 1 / (2 - t0), which costs
    p^2 (2 - t0) / 2, least with t0 = 0; and (x(t0) - 3)^2 is least at 3.
    """
    x, y = states("x y")
    u = controls("u")
    p = parameters("p")
    problem = Problem(
        name="free_numbers",
        minimise=y + (initial(x) - 3) ** 2,
        dynamics={x: p * u, y: p**2 / 2},
        bounds={u: (0, 1), p: (0.1, 2)},
        start={x: (0, 5), y: 0},
        target={"gone": x - initial(x) >= 1},
        initial_time=(0, 1),
        final_time=2.0,
    )
    best = judge(problem, on(problem, uniform(trapezoid(), 20)))
    mine = graded(problem, best)
    assert best.objective == pytest.approx(0.25, abs=1e-6)
    assert mine.error < 1e-6
    arc = best.arcs[0]
    moved = arc.x + np.array([[0.1], [0.0]])
    away = judge(problem, replace(best, arcs=(replace(arc, x=moved),), objective=0.26))
    assert graded(problem, away).gain == pytest.approx(2 * 0.1 * 3.1, rel=1e-3)


def test_explicit_time_and_a_free_initial_time() -> None:
    """Cost t^2 + x over a path of length 1 that may begin when it likes: the integral of t^2 over
    [a, a + 1] is least at a = -1/2, where it is 1/12.
    """
    x = states("x")
    u = controls("u")
    problem = Problem(
        name="when",
        running=time**2,
        dynamics={x: u},
        bounds={u: (-1, 1)},
        start={x: 0},
        end={x: 1},
        initial_time=(-3, 1),
        final_time=(-2, 4),
    )
    found = judge(problem, on(problem, uniform(trapezoid(), 60)))
    assert found.objective == pytest.approx(1 / 12, rel=1e-3)
    assert graded(problem, found).error >= abs(found.objective - 1 / 12)
    assert graded(problem, found).error < 1e-3 / 12


def test_an_end_on_a_limit_has_no_multipliers_that_cancel() -> None:
    """Rest to rest over 1 with |u| <= 1, both ends on limits of the place: tf = 2, however the
    multipliers of an end and of its limit are shared.
    """
    x, v = states("x v")
    u = controls("u")
    problem = Problem(
        name="shuttle",
        minimise=final_time,
        dynamics={x: v, v: u},
        bounds={u: (-1, 1), x: (0, 1), v: (0, None)},
        start={x: 0, v: 0},
        end={x: 1, v: 0},
    )
    found = judge(problem, on(problem, uniform(euler(), 101)))
    mine = graded(problem, found)
    assert abs(found.objective - 2.0) <= mine.error < 0.1
    multipliers = weighed(problem, found)[1]
    assert np.abs(multipliers.tie).max() < 10.0
    assert np.abs(multipliers.jump).max() < 10.0


# -- what is spoilt


def spoilt() -> dict[str, Callable[[Solution], Solution]]:
    def with_arc(change: Callable[[Arc], Arc]) -> Callable[[Solution], Solution]:
        return lambda s: replace(s, arcs=(change(s.arcs[0]),))

    return {
        "states moved": with_arc(lambda a: replace(a, x=a.x + 0.05 * np.ptp(a.x, axis=1)[:, None])),
        "states stretched": with_arc(lambda a: replace(a, x=1.02 * a.x)),
        "control shifted": with_arc(lambda a: replace(a, u=np.roll(a.u, 6, axis=1))),
        "control weakened": with_arc(lambda a: replace(a, u=0.9 * a.u)),
        "control reversed": with_arc(lambda a: replace(a, u=-a.u)),
        "control held": with_arc(lambda a: replace(a, u=np.full_like(a.u, a.u.mean()))),
        "objective too good": lambda s: replace(s, objective=0.98 * s.objective),
        "time stretched": with_arc(lambda a: replace(a, t=1.02 * a.t)),
    }


@pytest.mark.slow
@pytest.mark.parametrize("how", spoilt())
@pytest.mark.parametrize("name", ["goddard_fixed_time", "vdp_regulator", "fuller"])
def test_what_is_spoilt_is_not_near(name: str, how: str) -> None:
    problem = truths()[name][0]
    right = solved(name, "trapezoid 120")
    assert right.verdict is not None
    assert right.verdict.approximate
    verdict = judge(problem, spoilt()[how](right)).verdict
    assert verdict is not None
    assert not verdict.approximate


def test_multipliers_that_a_file_brings_are_not_looked_at() -> None:
    problem = truths()["double_integrator_time"][0]
    right = solved("double_integrator_time", "trapezoid 50")
    arcs = tuple(replace(arc, costate=1e3 + 0.0 * arc.x) for arc in right.arcs)
    assert graded(problem, replace(right, arcs=arcs)) == graded(problem, right)


def test_units_of_cost_time_and_length_change_no_relative_error() -> None:
    def move(length: float, second: float, price: float) -> tuple[Problem, float]:
        x, v = states("x v")
        u = controls("u")
        accelerate = length / second**2
        problem = Problem(
            name="move",
            minimise=price * final_time,
            dynamics={x: v, v: u},
            bounds={u: (-accelerate, accelerate)},
            start={x: 0, v: 0},
            end={x: 3 * length, v: 0},
        )
        found = graded(problem, judge(problem, on(problem, uniform(trapezoid(), 25))))
        return problem, found.error / found.size

    plain, scaled = move(1.0, 1.0, 1.0)[1], move(1e3, 60.0, 0.2)[1]
    assert scaled == pytest.approx(plain, rel=1e-3)
    assert math.isfinite(plain)


def test_what_is_certified_or_infeasible_has_no_grade() -> None:
    problem = truths()["control_cost"][0]
    exact = judge(problem, on(problem, uniform(trapezoid(), 40)))  # the switch is a node
    rough = solved("double_integrator_time", "lgr 20 x 3").verdict
    assert rough is not None
    assert exact.verdict is not None
    assert rough.grade is None
    assert not rough.feasible
    assert exact.verdict.extremal == (exact.verdict.grade is None)


def test_a_grade_is_read_back_and_older_files_have_none() -> None:
    solution = solved("fuller", "trapezoid 120")
    again = from_json(to_json(solution))
    assert solution.verdict is not None
    assert again.verdict is not None
    assert again.verdict.grade == solution.verdict.grade
    assert again.verdict.approximate
    assert solution.verdict.grade is not None
    text = to_json(solution)
    begin = text.index('"grade":')
    older = text[:begin].rstrip().rstrip(",") + text[text.index("}", begin) + 1 :]
    read = from_json(older).verdict
    assert read is not None
    assert read.grade is None
    assert not read.approximate


def test_without_time_there_is_no_grade_and_the_verdict_stays() -> None:
    """The last motions that re-integration has kept may be others by then."""
    known = truths()["jacobson_1"][0]
    problem = replace(known)
    judged = certified(problem, on(problem, GRIDS["trapezoid 120"]))
    cached(problem, reintegration._in_time).clear()
    with time_limit(0.0):
        late = certify.graded(problem, judged)
    assert judged.verdict is not None
    assert late.verdict == judged.verdict
    found = certify.graded(problem, judged).verdict
    assert found is not None
    assert found.grade is not None

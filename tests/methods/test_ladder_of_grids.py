"""Large grids by way of coarser ones: the same solutions, of the same order, and none lost."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from socp import (
    Ipopt,
    Problem,
    Solution,
    controls,
    default_guess,
    final_time,
    single_phase,
    states,
    uniform,
)
from socp.methods import ladder, solve_collocated, solve_uniform
from socp.model import Stop
from socp.registry.plugins import Registry
from socp.solvers import NLP, NLPPoint
from socp.transcription import (
    Scheme,
    euler,
    hermite_simpson,
    laid_out,
    lgr,
    lift,
    prolonged,
    push,
    trapezoid,
)

REGISTRY = Registry.load()
SCHEMES = [euler(), trapezoid(), hermite_simpson(), lgr(3)]


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Begin with grids of 20 intervals."""
    monkeypatch.setattr(ladder, "_COARSEST", 20)


def limited() -> Problem:
    """Return a double integrator that stays below a parabola on its way, and ends in least time."""
    (x, v), u = states("x v"), controls("u")
    return Problem(
        name="limited",
        minimise=final_time,
        dynamics={x: v, v: u},
        bounds={u: (-1, 1)},
        start={x: 0, v: 0},
        end={x: 3, v: 0},
        path={"slow": v + x**2 / 20 <= 1},
    )


def of(name: str) -> Problem:
    return limited() if name == "limited" else REGISTRY.problem(name)


def told(backend: Any) -> Any:
    """Return a function as a backend that keeps to its own tolerance."""
    backend.within = lambda _: backend
    return backend


def climbed(
    problem: Problem, scheme: Scheme, count: int, backend: Callable[..., NLPPoint] | None = None
) -> Solution:
    guess = default_guess(problem)
    return solve_uniform(single_phase(problem), scheme, count, backend or Ipopt(), guess)


def directly(problem: Problem, scheme: Scheme, count: int) -> Solution:
    mesh = uniform(scheme, count)
    return solve_collocated(single_phase(problem), [mesh], Ipopt(), default_guess(problem))


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("scheme", SCHEMES, ids=[each.name for each in SCHEMES])
@pytest.mark.parametrize("name", ["vdp_regulator", "auv", "limited"])
def test_the_same_objective_with_and_without(name: str, scheme: Scheme) -> None:
    problem = of(name)
    one, other = climbed(problem, scheme, 200), directly(problem, scheme, 200)
    assert one.stop is other.stop is Stop.SOLVED
    assert one.message == "Ipopt: Solve Succeeded, by way of 20 intervals"
    assert len(one.arcs[0].mesh) == 201
    assert one.objective == pytest.approx(other.objective, rel=2e-8)


@pytest.mark.usefixtures("small")
def test_the_order_of_convergence_is_the_schemes() -> None:
    """Euler's error falls with the step, from 200 to 2000 by 10."""
    problem = of("vdp_regulator")
    assert problem.reference is not None
    errors = [
        climbed(problem, euler(), count).objective - problem.reference.objective
        for count in (200, 2000)
    ]
    assert errors[0] / errors[1] == pytest.approx(10.0, rel=0.1)


@pytest.mark.parametrize("scheme", SCHEMES, ids=[each.name for each in SCHEMES])
def test_multipliers_of_a_coarse_grid_are_nearly_those_of_a_fine_one(scheme: Scheme) -> None:
    problem = limited()
    guess = default_guess(problem)
    laid = [laid_out(single_phase(problem), [uniform(scheme, n)], guess) for n in (100, 400)]
    points = [Ipopt()(nlp, push(layout, guess)) for nlp, layout in laid]
    found = prolonged(laid[0][1], laid[1][1], points[0], lift(laid[0][1], points[0]))
    for mine, its in ((found.lam_g, points[1].lam_g), (found.lam_v, points[1].lam_v)):
        assert mine is not None
        assert its is not None
        assert np.abs(mine - its).sum() < 0.3 * np.abs(its).sum()
    states = laid[1][1].states  # controls ring, each grid's in its own way
    assert np.abs(found.v - points[1].v)[states].mean() < 0.02


def test_few_intervals_are_solved_as_they_are() -> None:
    found = climbed(of("vdp_regulator"), euler(), 100)
    assert found.message == "Ipopt: Solve Succeeded"


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("failing", [20, 200], ids=["coarse", "fine"])
def test_a_grid_that_fails_on_the_way_loses_nothing(failing: int) -> None:
    problem, counts = of("vdp_regulator"), []

    @told
    def backend(nlp: NLP, guess: NLPPoint, _: Any = None) -> NLPPoint:
        found = Ipopt()(nlp, guess)
        counts.append(nlp.rows)
        warm = guess.lam_g is not None
        lost = len(counts) == 1 if failing == 20 else warm
        return replace(found, stop=Stop.FAILED, message="lost") if lost else found

    found = climbed(problem, euler(), 200, backend)
    assert found.stop is Stop.SOLVED
    assert found.message == "Ipopt: Solve Succeeded"
    assert found.objective == pytest.approx(directly(problem, euler(), 200).objective, rel=1e-9)


@pytest.mark.usefixtures("small")
def test_an_interrupted_solution_says_on_which_grid() -> None:
    problem = of("vdp_regulator")

    @told
    def backend(nlp: NLP, guess: NLPPoint, _: Any = None) -> NLPPoint:
        return replace(Ipopt()(nlp, guess), stop=Stop.INTERRUPTED, message="interrupted")

    found = climbed(problem, euler(), 2000, backend)
    assert (found.stop, found.message) == (Stop.INTERRUPTED, "interrupted, on 20 intervals")
    assert len(found.arcs[0].mesh) == 21


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("ending", [Stop.INTERRUPTED, Stop.FAILED])
@pytest.mark.parametrize("lost", [20, 200], ids=["coarse", "fine"])
def test_what_failed_on_the_way_is_counted_once(lost: int, ending: Stop) -> None:
    """Where the last solve is interrupted the solution says so, and every iteration is its own."""
    counts = list[int]()

    @told
    def backend(nlp: NLP, guess: NLPPoint, _: Any = None) -> NLPPoint:
        found = Ipopt()(nlp, guess)
        counts.append(found.iterations)
        on_way = guess.lam_g is not None or (lost == 20 and len(counts) == 1)
        stop = Stop.FAILED if on_way else found.stop if len(counts) == 1 else ending
        return replace(found, stop=stop, message="lost" if on_way else "ended")

    found = climbed(of("vdp_regulator"), euler(), 200, backend)
    assert found.stop is ending
    assert len(counts) == (2 if lost == 20 else 3)
    assert found.effort.iterations == sum(counts)
    assert len(found.arcs[0].mesh) == 201

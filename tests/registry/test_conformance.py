"""socp's own methods pass the suite that is shipped for strangers, and the suite catches what it
should.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, final

import numpy as np
import pytest
from records import revised
from scipy.integrate import quad
from socp_plugins.collocation import TABLE

from socp import Method, Problem, Solution, Watch, controls, final_time, silent, states
from socp.model.result.solution import Stop
from socp.registry.conformance import assert_conforms, check_problem, conforms
from socp.registry.plugins import Registry
from socp.registry.standard import STANDARD, Standard, regulator, turning_back
from socp.transcription.schemes import euler

OWN = [*(row.name for row in TABLE), "lgr-multiphase", "mboc"]
QUICK = {  # method -> options that keep the suite quick
    "euler-ipopt": {"steps": 200},
    "trapezoidal": {"steps": 100},
    "hermite-simpson": {"steps": 60},
}


@pytest.mark.parametrize("name", OWN)
@pytest.mark.slow
def test_our_own_methods_conform(name: str, registry: Registry) -> None:
    assert_conforms(registry.methods[name](**QUICK.get(name, {})))


@pytest.mark.parametrize("name", OWN)
@pytest.mark.slow
def test_a_stationary_point_of_the_infeasibility_is_never_called_solved(
    name: str, registry: Registry
) -> None:
    found = conforms(registry.methods[name](**QUICK.get(name, {})), [turning_back()])
    assert not found or any(Stop.INFEASIBLE.value in finding.text for finding in found)


def test_the_word_of_a_standard_problem_gives_its_objective_to_the_last_digits(
    registry: Registry,
) -> None:
    method = registry.methods["lgr-multiphase"](word="u: - s")
    assert_conforms(method, [regulator()], tolerance=1e-9)


def test_the_closed_forms_of_the_standard_problems() -> None:
    """The integrals behind two of them by quadrature; the others are polynomials done in the
    head.
    """
    meet = np.sqrt(2) - 1
    cost = quad(lambda t: (0.5 - t - t**2 / 2) ** 2, 0, meet)[0]
    slope = quad(lambda t: 2 * (0.5 - t - t**2 / 2), 0, meet)[0]
    tracking = next(each for each in STANDARD if each.problem.name == "tracking")
    assert tracking.objective == pytest.approx(cost, rel=1e-14)
    assert tracking.costate[0] == pytest.approx(slope, rel=1e-14)


Spoil = Callable[[Solution, Solution], Any]


@final
@dataclass(frozen=True)
class Spoilt(Method):
    """A right method whose solution is spoilt afterwards."""

    name: ClassVar[str] = "spoilt"
    source: ClassVar[str] = "none"
    spoil: Spoil = field(default=lambda solution, _guess: solution)

    def solve(self, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
        from socp import Ipopt, single_phase, solve_collocated, uniform

        solution = solve_collocated(
            single_phase(problem), [uniform(euler(), 200)], Ipopt(), guess, watch
        )
        return self.spoil(solution, guess)


def _arc(**changes: Callable[[np.ndarray], np.ndarray]) -> Any:
    def spoil(solution: Solution, _guess: Solution) -> Solution:
        arc = solution.arcs[0]
        new = {name: change(getattr(arc, name)) for name, change in changes.items()}
        return replace(solution, arcs=(replace(arc, **new), *solution.arcs[1:]))

    return spoil


def _scribble(solution: Solution, guess: Solution) -> Solution:
    guess.arcs[0].x[0, 0] += 1.0
    return solution


def _random(solution: Solution, guess: Solution) -> Solution:
    noise = np.random.default_rng().random()
    return _arc(x=lambda x: x + 1e-12 * noise)(solution, guess)


def _not_a_solution(_solution: Solution, _guess: Solution) -> float:
    return 1.0


def _raise(_solution: Solution, _guess: Solution) -> Solution:
    raise KeyError("x")


def _nan_at_the_end(values: np.ndarray) -> np.ndarray:
    return np.hstack([values[:, :-1], np.full((values.shape[0], 1), np.nan)])


SPOILERS = {
    "guess: was modified": _scribble,
    "shape: state names": lambda s, _: replace(s, state_names=("z",)),
    "shape: the solution is of problem 'other'": lambda s, _: replace(s, problem="other"),
    "shape: arc 0: x (1, 200), not (1, 201)": _arc(x=lambda x: x[:, 1:]),
    "shape: arc 0: mesh": _arc(mesh=lambda mesh: mesh[:-1]),
    "shape: parameters ['q'], not []": lambda s, _: replace(s, parameters={"q": 1.0}),
    "shape: the solution has no arcs": lambda s, _: replace(s, arcs=()),
    "values: arc 0: times decrease": _arc(t=lambda t: np.concatenate([t[:1], t[2:0:-1], t[3:]])),
    "values: arc 0: u is not finite": _arc(u=_nan_at_the_end),
    "values: arc 0: a control leaves its box": _arc(u=lambda u: 1.1 * u),
    "values: arc 0: costates are given at some nodes": _arc(costate=_nan_at_the_end),
    "values: stopped because": lambda s, _: replace(s, stop=Stop.LIMIT),
    "objective: ": lambda s, _: replace(s, objective=1.1 * s.objective),
    "costate: ": _arc(costate=np.negative),
    "file: ": lambda s, _: revised(s, options={1: object()}, trace={"a": object()}),
    "determinism: ": _random,
    "solution: is float": _not_a_solution,
    "solve: raised KeyError": _raise,
}


@pytest.mark.parametrize("expected", SPOILERS)
def test_the_suite_catches(expected: str) -> None:
    found = [f"{f.check}: {f.text}" for f in conforms(Spoilt(SPOILERS[expected]), [regulator()])]
    assert any(text.startswith(expected) for text in found), found


def test_the_suite_passes_what_is_not_spoilt() -> None:
    assert conforms(Spoilt(), [regulator()]) == []


def test_a_wrong_end_is_a_breach_of_feasibility() -> None:
    standard = STANDARD[0]
    found = conforms(Spoilt(_arc(u=lambda u: 0.9 * u)), [standard])
    assert any(
        finding.check == "feasibility" and "the end missed by" in finding.text for finding in found
    )


def test_the_suite_catches_a_method_that_will_not_stop() -> None:
    deaf = Spoilt(lambda s, _: replace(s, stop=Stop.SOLVED))
    assert [str(f) for f in conforms(deaf, [regulator()])] == [
        "regulator: watch: the watch asked it to stop, but it says: the solver met its tolerances"
    ]


def test_assert_conforms_lists_every_breach() -> None:
    with pytest.raises(
        AssertionError, match=r"method 'spoilt' does not conform:\n  regulator: objective: "
    ):
        assert_conforms(Spoilt(SPOILERS["objective: "]), [regulator()])
    with pytest.raises(AssertionError, match=r"int is no socp\.Method"):
        assert_conforms(3, [])  # type: ignore[arg-type]


def test_check_problem_finds_what_is_not_finite_on_the_guess() -> None:
    x = states("x")
    u = controls("u")
    problem = Problem(
        name="root",
        minimise=final_time,
        dynamics={x: u + x**0.5},
        bounds={u: (-1, 1)},
        start={x: 0},
        end={x: 1},
    )
    (finding,) = check_problem(problem)
    assert finding.check == "rate of 'x'"
    assert finding.text.startswith("it or its slope is not finite at t = 0, x = ")


@pytest.mark.parametrize("standard", STANDARD, ids=lambda s: s.problem.name)
def test_every_standard_problem_is_well_posed(standard: Standard) -> None:
    assert check_problem(standard.problem) == []


def test_every_registered_problem_is_well_posed(registry: Registry) -> None:
    found = [
        finding for name in registry.problems for finding in check_problem(registry.problem(name))
    ]
    assert found == []
    assert registry.problems

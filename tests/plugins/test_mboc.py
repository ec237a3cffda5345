"""Words from a bound on their switches: the vehicle cold, too few switches, the parts of the search
by themselves.
"""

import itertools
import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from test_auto import NAMES, load, spelt

from socp import MethodError, Problem, Solution, controls, default_guess, run, states
from socp.laws.modes import arc_modes
from socp.methods.direct import scouts
from socp.methods.solving import Follower
from socp.model.result.solution import Stop
from socp.model.word import Mode, Word
from socp.registry.plugins import Registry
from socp.registry.standard import minimum_time
from socp.search.candidate import Candidate, without_short_arcs
from socp.search.ledger import Ledger, all_words, canonical, insert_into, word_count
from socp.search.tree.insertion import insertions, magnitude
from socp.search.tree.softening import end_miss, softened_problem

LOWER, UPPER, SINGULAR = (Mode("lower"),), (Mode("upper"),), (Mode("singular"),)
MODES = (LOWER, UPPER, SINGULAR)


def solved(registry: Registry, problem: Problem, **options: object) -> Solution:
    return run(registry.methods["mboc"](**options), problem, default_guess(problem))


def right(problem: Problem, solution: Solution) -> None:
    reference = problem.reference
    assert solution.extremal, solution.message
    assert re.sub(r"\[[^]]*\]", "", solution.word) == re.sub(r"\[[^]]*\]", "", spelt(problem))
    digits = max(reference.tolerance, 1e-9 * abs(reference.objective))
    assert solution.objective == pytest.approx(reference.objective, rel=0, abs=digits)
    assert solution.switches == pytest.approx(reference.switches, rel=0, abs=1e-7)


@pytest.mark.parametrize(
    "options",
    [
        {"switches": "4", "points": 14},
        pytest.param({"switches": "5", "points": 20}, marks=pytest.mark.slow),
    ],
)
@pytest.mark.slow
def test_the_vehicle_cold(registry: Registry, options: dict[str, object]) -> None:
    problem = load("auv")
    solution = solved(registry, problem, **options)
    right(problem, solution)
    assert solution.objective == pytest.approx(14.95016178215355, rel=0, abs=1e-9)
    total = word_count(len(arc_modes(problem)), int(str(options["switches"])))
    assert f"of {total} words of at most {options['switches']} switches" in solution.message
    assert (
        "not looked at (none is better if this extremal is the best one of all" in solution.message
    )
    assert "excluded by" not in solution.message  # local solves of relaxations bound nothing
    assert solution.nodes[-1].word == "r: + s s s +; f: + + b[u.upper] - -"


@pytest.mark.slow
def test_three_switches_are_too_few_for_the_vehicle_and_the_arc_is_named(
    registry: Registry,
) -> None:
    solution = solved(registry, load("auv"), switches="3")
    assert not solution.extremal
    assert "switches = 3 seems too small: an arc is missing" in solution.message
    assert "its shortest arc is r: + from t = 0 to 0.0490" in solution.message


@pytest.mark.slow
def test_too_few_switches_are_said_to_be_too_few(registry: Registry) -> None:
    solution = solved(registry, load("catalyst_mixing"), switches="1")
    assert not solution.extremal
    assert "switches = 1 seems too small: an arc is missing" in solution.message
    assert all(
        len(node.word.removeprefix("u: ").split()) <= 4 for node in solution.nodes
    )  # two more on the way


@pytest.mark.parametrize(
    "name", ["catalyst_mixing", "double_integrator_vlimit", "jacobson_1", "vdp_regulator"]
)
def test_small_problems_cold(registry: Registry, name: str) -> None:
    problem = load(name)
    right(problem, solved(registry, problem))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [name for name in NAMES if isinstance(name, str)] + ["auv_reverse"]
)
def test_the_public_problems_cold(registry: Registry, name: str) -> None:
    problem = load(name)
    right(problem, solved(registry, problem))


def test_what_a_mixed_integer_solver_returns_is_cleaned_and_judged(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A solver that keeps an arc of no length and calls it solved: the arc goes, the rest is solved
    anew.
    """
    problem = load("catalyst_mixing")
    asked = []

    def fake(problem: Problem, *given: Any) -> Solution:
        solver, switches, points, time, guess, _, backend = given
        asked.append((solver, switches, points, time))
        assert backend.name == "ipopt"
        found = Follower(points=points, intervals=1)(
            problem, Word.parse("u: + s - +", ("u",)), guess
        )
        return replace(found, message="said so")

    monkeypatch.setattr("socp.search.integer.minlp.minlp", fake)
    solution = solved(registry, problem, solver="bonmin", switches="3", points=9, time=5.0)
    right(problem, solution)
    assert asked == [("bonmin", 3, 9, 5.0)]
    assert "said so" in solution.message
    assert "words" not in solution.message  # what the solver looked at by itself was not counted


def test_a_mixed_integer_solver_that_fails_is_reported_as_it_says(
    registry: Registry, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = load("catalyst_mixing")
    failed = replace(
        scouts(problem, default_guess(problem), 1)[0], stop=Stop.FAILED, message="it died"
    )
    monkeypatch.setattr("socp.search.integer.minlp.minlp", lambda *_: failed)
    solution = solved(registry, problem, solver="scip")
    assert solution.stop is Stop.FAILED
    assert solution.message == "it died"


@pytest.mark.parametrize("given", ["few", "-1", "2.5", "100000000"])
def test_a_wrong_number_of_switches_is_refused(registry: Registry, given: str) -> None:
    with pytest.raises(
        MethodError,
        match=f"switches='{given}', but it should be auto or a whole number from 0 to 99",
    ):
        solved(registry, load("jacobson_1"), switches=given)


def test_no_time_gives_the_direct_solution_and_says_why(registry: Registry) -> None:
    solution = solved(registry, load("jacobson_1"), time=0.0)
    assert "the time allowed is over" in solution.message
    assert not solution.nodes


def test_a_horizon_that_shrinks_to_a_point_keeps_one_arc() -> None:
    given = Candidate((UPPER, LOWER), (0.0, 0.0, 0.0), default_guess(load("jacobson_1")))
    assert without_short_arcs(given, 0.0).arcs == (UPPER,)


@pytest.mark.parametrize("solver", ["foo", "", "SCIP"])
def test_an_unknown_solver_is_refused_before_anything_is_solved(
    registry: Registry, solver: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("socp.methods.direct.laid_out", None)
    with pytest.raises(
        MethodError, match=f"no mixed-integer solver '{solver}'; available here: bonmin"
    ):
        solved(registry, load("jacobson_1"), solver=solver)


def test_no_number_is_no_time(registry: Registry) -> None:
    with pytest.raises(MethodError, match="time=nan, but it should be a number, finite"):
        solved(registry, load("jacobson_1"), time=float("nan"))


def test_words_that_nobody_counts_are_told_in_short() -> None:
    assert Ledger(9).text(99).startswith("of about ")


@pytest.mark.parametrize("asked", [5, 20, 40])
def test_a_watch_stops_it_between_and_inside_programmes(registry: Registry, asked: int) -> None:
    calls = itertools.count(1)
    problem = load("jacobson_1")
    found = registry.methods["mboc"]().solve(
        problem, default_guess(problem), lambda _: next(calls) > asked
    )
    assert found.stop is Stop.INTERRUPTED
    assert next(calls) < asked + 10


# -- the parts


def test_words_are_counted_as_they_are_listed() -> None:
    words = list(all_words(MODES, 3))
    assert len(words) == len(set(words)) == word_count(3, 3)
    assert all(canonical(word) == word for word in words)


def test_an_inserted_arc_meets_its_neighbours() -> None:
    assert insert_into((UPPER, LOWER), 0, SINGULAR) == (UPPER, SINGULAR, UPPER, LOWER)
    assert insert_into((UPPER, LOWER), 0, SINGULAR, 1) == (UPPER, SINGULAR, LOWER)
    assert insert_into((UPPER, LOWER), 1, UPPER, -1) == (UPPER, LOWER)
    assert insert_into((UPPER, LOWER), 1, SINGULAR, 1) == (UPPER, LOWER, SINGULAR)


def test_the_ledger_adds_up() -> None:
    ledger = Ledger(3, solved={(UPPER,)}, failed={(LOWER,)})
    ledger.exclude((UPPER,), {(0, LOWER): 1.0, (0, SINGULAR): -1.0}, -1e-6)
    assert ledger.idle == {(UPPER, LOWER, UPPER), (UPPER, LOWER), (LOWER, UPPER)}
    assert ledger.counts(1) == (9, 1, 1, 2, 5)
    assert ledger.text(1) == (
        "of 9 words of at most 1 switches 1 solved, 1 without a solution, 2 excluded, the arc "
        "they add does not pay, 5 not looked at"
    )


x, v = states("x v")
u = controls("u")


def descent(word: str, problem: Problem) -> Solution:
    """Return the solution along a word, with the costates of its programme."""
    solution = Follower(points=8, intervals=1)(
        problem, Word.parse(word, ("u",)), default_guess(problem)
    )
    assert solution.stop.ok
    return solution


def test_the_gradient_is_the_change_of_the_objective_with_the_length_of_an_inserted_arc() -> None:
    """Integral of x^2, x' = u from 1 along u = 0.5 only: put -1 in at the start for h and look at
    the objective.
    """
    problem = Problem(
        name="held",
        running=x**2,
        dynamics={x: u},
        bounds={u: (-1, 1)},
        start={x: 1},
        final_time=1.0,
        singular={u: 0.5},
    )
    first = next(
        each
        for each in insertions(problem, descent("s", problem), arc_modes(problem))
        if each.modes == LOWER
    )
    assert first.t == pytest.approx(0.0)

    def cost(h: float) -> float:
        t = np.polynomial.legendre.leggauss(9)
        early, late = ((t[0] + 1) / 2 * length for length in (h, 1 - h))
        return float(
            (1 - early) ** 2 @ t[1] * h / 2 + (1 - h + 0.5 * late) ** 2 @ t[1] * (1 - h) / 2
        )

    h = 1e-6
    assert first.slope == pytest.approx((cost(h) - cost(0.0)) / h, rel=1e-4)


def test_nothing_pays_along_an_extremal() -> None:
    problem = minimum_time().problem
    along = descent("- +", problem)
    level = 1e-8 * magnitude(problem, along)
    assert min(each.slope for each in insertions(problem, along, arc_modes(problem))) >= -level


def test_softened_ends_give_every_word_a_solution_and_a_right_one_its_own() -> None:
    problem = minimum_time().problem
    soft = softened_problem(problem, scouts(problem, default_guess(problem), 3)[0])
    misses = {}
    for word in ("+", "- +"):
        solution = Follower(points=6, intervals=1)(
            soft, Word.parse(word, ("u",)), default_guess(soft)
        )
        assert solution.stop.ok
        misses[word] = end_miss(solution)
    assert misses["+"] > 1e-2
    assert misses["- +"] < 1e-7

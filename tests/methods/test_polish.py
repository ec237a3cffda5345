"""Kinks, hidden arcs, and the digits that Newton and a second mesh add to a certified solution."""

from typing import Any

import casadi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ponds import POND

from socp import (
    Ipopt,
    Problem,
    Word,
    controls,
    default_guess,
    final_time,
    run,
    solve_collocated,
    states,
    uniform,
)
from socp.methods.guess import split
from socp.methods.polish import plausible, polished
from socp.methods.solving import Follower
from socp.model.data.files import from_json, to_json
from socp.model.result.arc import Arc, join
from socp.model.result.solution import Solution
from socp.model.symbols import time
from socp.registry.plugins import Registry
from socp.registry.standard import STANDARD, minimum_time, speed_limit
from socp.search.digits import agrees, apart, with_agreement
from socp.search.reading import read, with_hidden_bangs
from socp.transcription.kinks import kinks
from socp.transcription.linearised import Linearised, interval_ends
from socp.transcription.phases import follow, single_phase
from socp.transcription.schemes import radau_iia
from socp.transcription.shooting import Shooting
from socp.verdict.certify import judge

REGISTRY = Registry.load()
a, b = casadi.SX.sym("a"), casadi.SX.sym("b")


def along(problem: Problem, text: str, lengths: list[float]) -> Solution:
    word = Word.parse(text, problem.control_names)
    return judge(problem, Follower()(problem, word, split(default_guess(problem), lengths)))


# -- kinks


@pytest.mark.parametrize(
    ("expression", "expected"),
    [
        (casadi.fabs(a - 1) * b, [a - 1]),
        (casadi.fmin(a, b) + casadi.fmax(a, b), [a - b]),
        (casadi.if_else(a > 2, b, 0), [2 - a]),
        (casadi.sign(b) * casadi.sin(a), [b]),
        (casadi.sin(a) * b, []),
        (casadi.fabs(3.0) * a, []),
    ],
)
def test_kinks_are_where_the_cases_of_an_expression_meet(
    expression: casadi.SX, expected: list[casadi.SX]
) -> None:
    found = kinks(expression, casadi.vertcat(a, b))
    at = np.random.default_rng(0).normal(size=(2, 5))
    values = casadi.Function("k", [casadi.vertcat(a, b)], [casadi.densify(found)]).map(5)(at).full()
    wanted = [
        casadi.Function("e", [casadi.vertcat(a, b)], [each]).map(5)(at).full()[0]
        for each in expected
    ]
    assert len(values) == len(wanted)
    for row, other in zip(values, wanted, strict=True):
        assert np.allclose(row, other) or np.allclose(row, -other)


def braked() -> Problem:
    """Minimum time to rest with a drag v |v|: the velocity turns, and the drag has a kink there."""
    x, v = states("x v")
    u = controls("u")
    return Problem(
        name="braked",
        minimise=final_time,
        dynamics={x: v, v: u - v * casadi.fabs(v)},
        bounds={u: (-1, 1)},
        start={x: 1, v: 1},
        end={x: 0, v: 0},
    )


def braked_time() -> tuple[float, float]:
    """Return switching and final time of `braked` in closed form.

    v' = -1 - v|v| from v = 1 stops after arctan 1 = pi/4 at 1 + log(2)/2. Then backwards v = -tanh,
    x falls by log cosh; then v' = 1 + v^2 from -w stops after arctan w on log(1 + w^2)/2. With w =
    tanh s the distance is log cosh s + log(1 + tanh^2 s)/2 = 1 + log(2)/2.
    """
    from scipy.optimize import brentq

    s = brentq(
        lambda s: np.log(np.cosh(s)) + np.log1p(np.tanh(s) ** 2) / 2 - 1 - np.log(2) / 2,
        0.1,
        5,
        xtol=1e-15,
    )
    return np.pi / 4 + s, np.pi / 4 + s + np.arctan(np.tanh(s))


def test_an_arc_over_a_kink_keeps_its_digits() -> None:
    problem = braked()
    solution = along(problem, "u: - +", [2.0, 1.0])
    switch, last = braked_time()
    assert solution.word == "u: - +"
    assert len(solution.arcs) == 2
    assert solution.objective == pytest.approx(last, abs=1e-11)
    assert solution.switches == pytest.approx([switch], abs=1e-9)
    assert solution.extremal
    kink = min(abs(t - np.pi / 4) for t in solution.corners)
    assert kink < 1e-10  # an interval ends where the velocity turns


@given(st.integers(1, 4), st.integers(2, 5))
def test_joined_pieces_are_the_arc(pieces: int, nodes: int) -> None:
    t = np.linspace(0.0, 1.0, pieces * nodes + 1)
    whole = Arc(
        t=t,
        x=np.array([t**2, t]),
        u=np.array([t]),
        costate=np.array([t, t]),
        side="left",
        modes=("s",),
        mesh=np.arange(0, t.size, nodes),
    )
    cut = [
        Arc(
            t=whole.t[k : k + nodes + 1],
            x=whole.x[:, k : k + nodes + 1],
            u=whole.u[:, k : k + nodes + 1],
            costate=whole.costate[:, k : k + nodes + 1],
            side="left",
            modes=("s",),
            mesh=np.array([0, nodes]),
        )
        for k in range(0, pieces * nodes, nodes)
    ]
    again = join(cut)
    for name in ("t", "x", "u", "costate", "mesh"):
        assert np.array_equal(getattr(again, name), getattr(whole, name))


# -- hidden arcs


def test_a_bang_shorter_than_a_step_is_found_by_the_deviation_from_the_singular_law() -> None:
    x = states("x")
    u = controls("u")
    problem = Problem(  # x reaches its singular surface x = 0 after 0.01, a quarter of a step
        name="short",
        running=x**2 / 2,
        dynamics={x: u},
        bounds={u: (-1, 1)},
        start={x: 0.01},
        final_time=1.0,
    )
    direct = solve_collocated(
        single_phase(problem), [uniform(radau_iia(2), 25)], Ipopt(), default_guess(problem)
    )
    first = read(problem, direct)
    assert [str(arc[0]) for arc in first.arcs] == ["s"]  # what labels alone show
    found = with_hidden_bangs(problem, first)
    assert [str(arc[0]) for arc in found.arcs] == ["-", "s"]
    assert found.edges[1] == pytest.approx(0.01, rel=1e-3)  # what the control goes through, over 1


def test_nothing_is_revealed_on_an_arc_that_keeps_its_law() -> None:
    x = states("x")
    u = controls("u")
    problem = Problem(
        name="kept",
        running=x**2 / 2,
        dynamics={x: u},
        bounds={u: (-1, 1)},
        start={x: 0.0},
        final_time=1.0,
    )
    direct = solve_collocated(
        single_phase(problem), [uniform(radau_iia(2), 25)], Ipopt(), default_guess(problem)
    )
    first = read(problem, direct)
    assert with_hidden_bangs(problem, first).arcs == first.arcs


# -- shooting


def test_a_step_is_of_order_eight() -> None:
    x = states("x")
    u = controls("u")
    problem = Problem(
        name="growth",
        running=x,
        dynamics={x: x * (1 + time) + u},
        bounds={u: (0, 1)},
        start={x: 1},
        final_time=2.0,
    )
    word = Word.parse("u: -", problem.control_names)
    start = Follower(intervals=1)(problem, word, default_guess(problem))
    exact = np.exp(4.0)  # x' = (1 + t) x
    ends = interval_ends(follow(problem, word), start)
    errors = [abs(ends([0], n)[0][0, -1] - exact) for n in (4, 8)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(8.0, abs=0.7)


@pytest.mark.parametrize("standard", STANDARD, ids=lambda each: each.problem.name)
def test_newton_settles_on_the_closed_form(standard: object) -> None:
    problem = standard.problem  # type: ignore[attr-defined]
    solution = run(REGISTRY.method("auto")(starts=0), problem, default_guess(problem))
    found = polished(problem, solution)
    assert found is not None
    assert found.objective == pytest.approx(standard.objective, abs=2e-14)  # type: ignore[attr-defined]
    assert found.judgement.agreement is not None
    assert found.judgement.agreement.objective < 1e-13
    assert judge(problem, found).extremal


def test_newton_mends_a_rough_solution() -> None:
    standard = minimum_time()
    problem = standard.problem
    word = Word.parse("u: - +", problem.control_names)
    rough = Follower(backend=Ipopt({"tol": 1e-3}))(
        problem, word, split(default_guess(problem), [1.0, 1.0])
    )
    found = polished(problem, rough)
    assert found is not None
    assert abs(found.objective - standard.objective) < 1e-14
    assert found.junctions == pytest.approx([np.sqrt(1.5) - 1], abs=1e-13)


@pytest.mark.parametrize(("word", "right"), [("- s +", True), ("- +", False)])
def test_a_word_is_plausible_where_the_signs_of_its_programme_are(word: str, right: bool) -> None:
    """In T = 4 the pond stays at its level: down and up at once the multipliers have a wrong sign,
    and a word of three arcs goes through Newton in place of finer meshes.
    """
    spelt = Word.parse(f"u: {word}", POND.control_names)
    start = split(default_guess(POND), [1.0] * len(spelt.arcs))
    found = Follower(exact=True, longer=False)(POND, spelt, start)
    assert plausible(POND, found) is right
    assert (found.judgement.agreement is not None) is right
    if right:
        assert found.objective == pytest.approx(2 / 3 * 0.75**3, abs=1e-14)
        assert found.junctions == pytest.approx([0.75, 3.25], abs=1e-12)


def test_newton_takes_the_place_of_programmes_on_finer_meshes() -> None:
    calls = list[int]()
    backend = Ipopt({"tol": 1e-9})

    def counted(*given: Any) -> Any:
        calls.append(1)
        return backend(*given)

    problem = REGISTRY.problem("rayleigh_time")
    word = Word.parse("u: + - +", problem.control_names)
    start = Follower()(problem, word, split(default_guess(problem), [1.12, 2.19, 0.36]))
    plain = Follower(backend=counted)(problem, word, start)
    several = len(calls)
    calls.clear()
    exact = Follower(backend=counted, exact=True)(problem, word, start)
    assert (len(calls), several > 1) == (1, True)
    assert exact.objective == pytest.approx(plain.objective, rel=1e-9)
    assert exact.junctions == pytest.approx(plain.junctions, rel=1e-8)
    assert [len(a.t) for a in exact.arcs] == [len(a.t) for a in plain.arcs]


@pytest.mark.slow
def test_newton_leaves_what_it_cannot_do() -> None:
    problem = minimum_time().problem
    direct = run(REGISTRY.method("trapezoidal")(steps=20), problem, default_guess(problem))
    assert (
        polished(problem, direct) is None
    )  # its controls are collocated: there is no word to solve along
    vast = Follower(backend=Ipopt({"max_iter": 0}))(
        problem,
        Word.parse("u: - +", problem.control_names),
        split(default_guess(problem), [1.0, 5.0]),
    )
    assert polished(problem, vast) is None  # a guess is no solution to be polished


def test_shooting_reproduces_the_collocated_motion() -> None:
    problem = speed_limit().problem
    solution = along(problem, "u: + b -", [1.0, 1.0, 1.0])
    word = Word.parse("u: + b -", problem.control_names)
    shooting = Shooting(follow(problem, word), solution, (2, 2, 2))
    left = Linearised.of(shooting, shooting.start).equations
    assert np.abs(left).max() < 1e-12
    again = shooting.lifted(shooting.start, solution.objective)
    assert np.abs(again.rows("x") - solution.rows("x")).max() < 1e-12


# -- digits


def test_digits_come_from_two_computations() -> None:
    problem = REGISTRY.problem("jacobson_1")
    solution = run(REGISTRY.method("auto")(digits=12), problem, default_guess(problem))
    assert solution.judgement.agreement is not None
    assert agrees(solution, 12)
    assert solution.judgement.agreement.digits >= 12
    assert abs(solution.objective / problem.reference.objective - 1) < 1e-12
    assert from_json(to_json(solution)).judgement.agreement == solution.judgement.agreement


def test_meshes_are_compared_where_newton_does_not_settle(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("socp.search.digits.polished", lambda *_: None)
    problem = minimum_time().problem
    solution = along(problem, "u: - +", [1.0, 1.0])
    found = with_agreement(problem, solution, 9, Ipopt({"tol": 1e-11}))
    assert found.judgement.agreement is not None
    assert found.extremal
    assert agrees(found, 9)
    assert len(found.effort.meshes) > len(solution.effort.meshes)


def test_solutions_that_differ_are_said_to() -> None:
    problem = minimum_time().problem
    one, other = along(problem, "u: - +", [1.0, 1.0]), along(problem, "u: + -", [1.0, 1.0])
    assert apart(one, one).digits == 15
    assert not agrees(one, 1)  # nobody has compared anything yet
    assert apart(one, other).switches > 1e-3

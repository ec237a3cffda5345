"""The mixed-binary reduction: with its binaries fixed it is the problem on the word they spell."""

import casadi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from socp_problems.auv import problem as auv
from socp_problems.robot_arm import problem as arm

from socp import laws
from socp.errors import MethodError
from socp.laws.modes import arc_modes
from socp.methods.guess import default_guess, split
from socp.model import Mode, Modes
from socp.model.problem import Problem
from socp.model.result.solution import Solution
from socp.model.symbols import controls, final_time, states
from socp.model.word import Word
from socp.search.integer.bounds import enclosures, reachable
from socp.search.integer.reduction import binary_modes
from socp.solvers.backends.ipopt import Ipopt
from socp.solvers.contract import NLP
from socp.transcription.collocation import collocate
from socp.transcription.mesh import table, uniform
from socp.transcription.phases import follow
from socp.transcription.schemes import lgr

WORD = "r: + s s s +; f: + + b[u.upper] - -"
LENGTHS = [0.05, 0.6, 14.0, 0.1, 0.2]
MESHES = [uniform(lgr(6), 1)] * 5
MODES = arc_modes(auv)


def car() -> Problem:
    x, v = states("x v")
    (a,) = [controls("a")]
    return Problem(
        name="car",
        minimise=final_time,
        dynamics={x: v, v: a},
        bounds={a: (-1, 1)},
        start={x: 1, v: 0},
        end={x: 0, v: 0},
        guess={final_time: 2.0},
    )


def rows(nlp: NLP, v: np.ndarray) -> np.ndarray:
    return casadi.Function("g", [nlp.v], [nlp.g])(v).full().ravel()


def worst(nlp: NLP, v: np.ndarray) -> float:
    g = rows(nlp, v)
    pairs = ((g, nlp.g_box), (v, nlp.v_box))
    return float(max(np.maximum(box[0] - at, at - box[1]).max() for at, box in pairs))


@pytest.fixture(scope="module")
def followed() -> Solution:
    """Solve along the right word; the solution is a guess for the reduction."""
    word = Word.parse(WORD, ("r", "f"))
    reduced = collocate(follow(auv, word), MESHES)
    guess = split(default_guess(auv), LENGTHS)
    point = Ipopt({"tol": 1e-10})(reduced.problem, reduced.push(guess))
    assert point.stop.ok
    return reduced.lift(point)


@pytest.mark.parametrize("collocated", [False, True])
def test_the_solution_along_a_word_is_a_point_of_the_reduction(
    followed: Solution, collocated: bool
) -> None:
    reduced = collocate(binary_modes(auv, 4, collocated=collocated), MESHES)
    point = reduced.push(followed)
    z = point.v[reduced.problem.binary]
    assert set(z.tolist()) == {0.0, 1.0}
    assert worst(reduced.problem, point.v) < 1e-7
    lifted = reduced.lift(point)
    assert [arc.modes for arc in lifted.arcs] == [arc.modes for arc in followed.arcs]
    for ours, theirs in zip(lifted.arcs, followed.arcs, strict=True):
        assert ours.x == pytest.approx(theirs.x, abs=1e-12)
        assert ours.u[:, :-1] == pytest.approx(theirs.u[:, :-1], abs=1e-6)


def modes_of(text: str) -> Modes:
    return tuple(map(Mode.parse, text.split()))


def test_binaries_are_the_papers_two_for_lower_upper_and_singular() -> None:
    choice = binary_modes(auv, 4).phases[0].choice
    assert choice is not None
    assert [str(mode) for mode in choice.modes[0]] == ["-", "+", "s"]
    assert choice.values(modes_of("+ b[u.upper]")).tolist() == [0, 1, 0, 1, 0]
    assert choice.values(modes_of("s +")).tolist() == [0, 0, 0, 0, 0]
    assert choice.values(modes_of("* +"))[:2] == pytest.approx(1 / 3)


@given(st.integers(0, 10**6))
@settings(max_examples=30)
def test_binaries_read_back_as_the_modes_they_were_made_of(seed: int) -> None:
    modes = MODES[seed % len(MODES)]
    choice = binary_modes(auv, 0).phases[0].choice
    assert choice is not None
    assert choice.read(choice.values(modes)) == modes


def test_rules_allow_what_has_a_law_and_forbid_the_rest() -> None:
    phased = binary_modes(auv, 1)
    z = casadi.vertcat(*(phase.z for phase in phased.phases))
    rule = casadi.Function("rules", [z], [casadi.vertcat(*(row for row, _, _ in phased.rules))])
    low, high = (np.array([row[k] for row in phased.rules]) for k in (1, 2))
    choice = phased.phases[0].choice
    assert choice is not None
    words = [(a, b) for a in MODES for b in MODES]
    for word in words:
        value = rule(np.concatenate([choice.values(each) for each in word])).full().ravel()
        assert bool(((value >= low) & (value <= high)).all()) == (word[0] != word[1])
    missing = modes_of("s b[u.lower]")  # backwards along u = 0 has no singular law
    value = (
        rule(np.concatenate([choice.values(missing), choice.values(modes_of("+ +"))]))
        .full()
        .ravel()
    )
    assert not ((value >= low) & (value <= high)).all()


def test_a_boundary_arc_has_to_begin_on_its_constraint(followed: Solution) -> None:
    reduced = collocate(binary_modes(auv, 4), MESHES)
    point = reduced.push(followed)
    names = auv.state_names
    entry = 1 + 5 + 2 * 6 * 4 + names.index("u")  # the speed where the third arc begins
    assert point.v[entry] == pytest.approx(2.0)
    moved = point.v.copy()
    moved[entry] = 1.5
    before = rows(reduced.problem, moved) < reduced.problem.g_box[0] - 0.4
    on = point.v.copy()
    assert before.sum() > (rows(reduced.problem, on) < reduced.problem.g_box[0] - 0.4).sum()


def test_a_negative_number_of_switches_is_refused() -> None:
    with pytest.raises(MethodError, match="switches=-1: a problem has 0 switches or more"):
        binary_modes(auv, -1)


@pytest.mark.slow
def test_costates_are_carried_where_a_law_needs_them() -> None:
    needs = any(laws.arc_law(arm, each).costate for each in arc_modes(arm))
    phase = binary_modes(arm, 1).phases[0]
    assert bool(phase.carried.numel()) == needs


# -- intervals


@given(st.lists(st.floats(-3, 3), min_size=4, max_size=4), st.integers(0, 10**6))
@settings(max_examples=60)
def test_intervals_hold_every_value(ends: list[float], seed: int) -> None:
    x = casadi.SX.sym("x", 2)
    a, b = x[0], x[1]
    expressions = casadi.vertcat(
        a * b,
        a / (2 + b**2),
        casadi.sin(a) * casadi.cos(b),
        casadi.tanh(a) - casadi.fabs(b),
        casadi.exp(a) + b**3,
        casadi.sqrt(a**2 + 1),
        casadi.cosh(b) - casadi.atan(a),
        casadi.fmin(a, b),
        casadi.sign(a) * b,
        a**4 - 2 * a,
    )
    box = np.sort(np.array(ends).reshape(2, 2), axis=0)
    low, high = enclosures(expressions, x, box)
    random = np.random.default_rng(seed)
    function = casadi.Function("f", [x], [expressions])
    for _ in range(20):
        value = function(box[0] + (box[1] - box[0]) * random.random(2)).full().ravel()
        assert (value >= low - 1e-9).all()
        assert (value <= high + 1e-9).all()


def test_intervals_know_poles_and_what_they_do_not_know() -> None:
    x = casadi.SX.sym("x")
    found = enclosures(casadi.vertcat(1 / x, casadi.erf(x), x * 0), x, np.array([[-1.0], [1.0]]))
    assert np.isinf(found[:, :2]).all()
    assert found[:, 2].tolist() == [0.0, 0.0]


def test_reachable_states_hold_the_solution_and_no_more_than_the_rates_allow(
    followed: Solution,
) -> None:
    box = reachable(auv, 15.0, table(MESHES[0]))
    x = followed.rows("x")
    rounding = 1e-9  # of the solver
    assert (x >= box[0][:, None] - rounding).all()
    assert (x <= box[1][:, None] + rounding).all()
    assert box[:, 3].tolist() == [0.0, 2.0]
    assert np.isfinite(box).all()
    car_box = reachable(car(), 2.0, table(uniform(lgr(1), 1)))
    assert car_box[1, 1] == pytest.approx(1.0)  # up for half the time, down for the other half
    assert np.isfinite(
        reachable(car(), 2.0, table(MESHES[0]))
    ).all()  # the position's rate is bounded by then only

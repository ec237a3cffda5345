"""Problems as data: written, read back equal by a whitelist, told apart by a fingerprint, sent to
other processes.
"""

import copy
import json
import math
import pickle
import sys
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from typing import Any

import casadi
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from socp.errors import ProblemError
from socp.methods.guess import default_guess
from socp.model.data import grammar, portable, stated
from socp.model.data.comparing import differences
from socp.model.data.files import from_json, to_json
from socp.model.parts import Reference, Scene
from socp.model.problem import Problem
from socp.model.symbols import controls, final_time, initial, initial_time, parameters, states, time
from socp.registry.plugins import Registry
from socp.study.store import fingerprint
from socp.verdict.certify import with_statement

NAMES = Registry.load(only=()).problems
a, b, c = (casadi.SX.sym(name) for name in "abc")
SYMBOLS = {"a": a, "b": b, "c": c}


def same(one: Problem, other: Problem) -> None:
    """Hold two problems against each other in numbers: every expression at random points, every
    table.
    """
    random = np.random.default_rng(0)
    size = [len(one.state_names)] * 2 + [len(one.control_names), len(one.parameter_names), 3]
    for _ in range(20):
        given = [random.normal(size=n) * 3 for n in size]
        seen = []
        for each in (one, other):
            parts = dict(portable.expressions(vars(each)))
            arguments = [
                each.x,
                each.x0,
                each.u,
                each.p,
                casadi.vertcat(time, initial_time, final_time),
            ]
            function = casadi.Function(
                "all", arguments, [casadi.densify(casadi.vertcat(*parts.values()))]
            )
            seen.append((list(parts), function(*given).full().tobytes()))
        assert seen[0] == seen[1]
    for box in ("box", "state_box", "parameter_box", "start_box", "end_box"):
        assert getattr(one, box).tobytes() == getattr(other, box).tobytes()
    for each in (
        "initial_time_box",
        "final_time_box",
        "name",
        "title",
        "source",
        "reference",
        "state_names",
    ):
        assert getattr(one, each) == getattr(other, each)
    assert [c.name for c in one.constraints] == [c.name for c in other.constraints]
    assert [(c.name, c.equation) for c in one.conditions] == [
        (c.name, c.equation) for c in other.conditions
    ]
    assert {k.name(): v for k, v in one.units.items()} == {
        k.name(): v for k, v in other.units.items()
    }


# -- all registered problems


@pytest.mark.parametrize("name", NAMES)
def test_registered_problems_go_there_and_back(name: str, registry: Registry) -> None:
    problem = registry.problem(name)
    text = json.dumps(problem.statement, allow_nan=False)
    again = Problem.from_statement(json.loads(text))
    assert again.statement == problem.statement
    assert again.fingerprint == problem.fingerprint
    assert differences(problem, again) == ()
    same(problem, again)
    one, other = default_guess(problem), default_guess(again)
    assert (
        one.rows("x").tobytes() + one.rows("u").tobytes()
        == other.rows("x").tobytes() + other.rows("u").tobytes()
    )


@pytest.mark.parametrize("name", NAMES)
def test_registered_problems_are_pickled_and_copied(name: str, registry: Registry) -> None:
    problem = registry.problem(name)
    for again in (pickle.loads(pickle.dumps(problem)), copy.deepcopy(problem)):  # noqa: S301 - written just before
        assert again.statement == problem.statement
        same(problem, again)


def test_no_two_registered_problems_have_one_fingerprint(registry: Registry) -> None:
    assert len({registry.problem(name).fingerprint for name in NAMES}) == len(NAMES)


def _seen(problem: Problem) -> tuple[str, str]:
    return problem.fingerprint, str(problem.hamiltonian)


def test_a_problem_travels_to_a_worker_process() -> None:
    problem = everything()
    with ProcessPoolExecutor(1, get_context("spawn")) as pool:
        assert pool.submit(_seen, problem).result() == _seen(problem)


# -- everything that a problem can hold

x, v, w = states("x v w")
u, f = controls("u f")
k, m = parameters("k m")


def everything(**changes: Any) -> Problem:
    parts: dict[str, Any] = {
        "name": "everything",
        "minimise": final_time + m**2 + initial(w) * 2,
        "running": casadi.if_else(x < 1, x**2, casadi.fabs(x)) + k * time,
        "dynamics": {
            x: v,
            v: u * casadi.fmax(1, x) - casadi.sign(v),
            w: f + casadi.pw_lin(x, [0, 1, 2], [0, 3, 1]),
        },
        "bounds": {u: (-1, 1), f: (0, 2), x: (None, 4.5), k: (1, 2), v: (-3, math.inf)},
        "start": {x: 0, v: (0.1, 0.2)},
        "end": {x: (1, None)},
        "target": {"ring": x**2 + v**2 <= 1, "gate": w == 2},
        "path": {"wall": x + v <= 9, "roof": w <= 3 + time},
        "boundary": {u: {"x.upper": 0}, f: 1},
        "singular": {u: casadi.pw_const(x, [1.0, 2.0], [0.0, 0.5, 0.25])},
        "initial_time": 0.25,
        "final_time": (1, 7),
        "guess": {x: (0, 1), v: time**2, k: 1.5, final_time: 2, u: 0.5},
        "units": {x: "m", time: "s"},
        "title": "all of it",
        "source": "nobody",
        "reference": Reference(
            objective=1.0, switches=(0.5, 0.75), word="u: + -", tolerance=1e-6, source="none"
        ),
        "scene": Scene(plane=(x, w), heading=v, flow=(x * w, 0.5), target=(0.0, 1.0, 0.25)),
    }
    return Problem(**parts | changes)


def test_everything_goes_there_and_back() -> None:
    problem = everything()
    again = Problem.from_statement(json.loads(json.dumps(problem.statement)))
    assert again.statement == problem.statement
    same(problem, again)
    assert again.scene is not None
    assert (str(again.scene.flow), again.scene.target) == ("(SX((x*w)), SX(0.5))", (0.0, 1.0, 0.25))
    guess = {symbol.name(): str(value) for symbol, value in again.guess.items()}
    assert guess == {"x": "(0.0, 1.0)", "v": "sq(t)", "k": "1.5", "tf": "2.0", "u": "0.5"}
    assert {symbol.name(): str(law) for symbol, law in again.boundary.items()} == {
        "u": "{'x.upper': SX(0)}",
        "f": "1",
    }


def test_the_same_statement_is_read_once() -> None:
    statement = everything().statement
    assert Problem.from_statement(statement) is Problem.from_statement(copy.deepcopy(statement))


OUTSIDE: dict[str, Any] = {
    "name": "renamed",
    "title": "t",
    "source": "s",
    "reference": None,
    "units": {},
    "scene": None,
    "guess": {},
}


@pytest.mark.parametrize("field", OUTSIDE)
def test_what_defines_nothing_is_not_in_the_fingerprint(field: str) -> None:
    assert everything(**{field: OUTSIDE[field]}).fingerprint == everything().fingerprint


def test_spellings_of_one_problem_have_one_fingerprint() -> None:
    base = everything()
    bounds = {
        f: (0.0, 2.0),
        u: (-1.0, 1.0),
        x: (-math.inf, 4.5),
        v: (-3, None),
        k: (1, 2),
        w: (None, None),
    }
    assert everything(
        bounds=bounds, start={v: (0.1, 0.2), x: (0, 0.0)}, end={x: (1, math.inf)}
    ).fingerprint == (base.fingerprint)
    shared = casadi.sin(x * v + 1)
    alone = [casadi.sin(x * v + 1) for _ in range(2)]
    one, other = (everything(running=p * p * k + q) for p, q in ((shared, shared), alone))
    assert one.fingerprint == other.fingerprint


UP = np.nextafter(1.0, 2.0)
CHANGED: dict[str, Callable[[], dict[str, Any]]] = {
    "minimise": lambda: {"minimise": final_time + m**2 + initial(w) * (2 * UP)},
    "running": lambda: {"running": k * time},
    "dynamics.x": lambda: {"dynamics": {**everything().dynamics, x: v * UP}},
    "dynamics.w": lambda: {"dynamics": {**everything().dynamics, w: f}},
    "bounds.u": lambda: {"bounds": {**everything().bounds, u: (-1, UP)}},
    "bounds.x": lambda: {"bounds": {**everything().bounds, x: (None, 4)}},
    "bounds.k": lambda: {"bounds": {**everything().bounds, k: (1, 3)}},
    "start.x": lambda: {"start": {x: 5e-324, v: (0.1, 0.2)}},
    "start.w": lambda: {"start": {**everything().start, w: 0}},
    "end.x": lambda: {"end": {x: 1}},
    "target.ring": lambda: {"target": {**everything().target, "ring": x**2 + v**2 == 1}},
    "target.gate": lambda: {"target": {"ring": x**2 + v**2 <= 1}},
    "path.wall": lambda: {"path": {**everything().path, "wall": x + v <= 9 * UP}},
    "path.floor": lambda: {"path": {**everything().path, "floor": w >= 0}},
    "singular.u": lambda: {"singular": {}},
    "boundary.u.x.upper": lambda: {"boundary": {u: {"x.upper": 1}, f: 1}},
    "boundary.f": lambda: {"boundary": {u: {"x.upper": 0}}},
    "initial_time": lambda: {"initial_time": 0.25 * UP},
    "final_time": lambda: {"final_time": (1, 7 * UP)},
}


@pytest.mark.parametrize("place", CHANGED)
def test_every_change_shows_in_the_fingerprint_and_is_named(place: str) -> None:
    base, changed = everything(), everything(**CHANGED[place]())
    assert changed.fingerprint != base.fingerprint
    assert differences(base, changed) == (place,)


@pytest.mark.parametrize("name", NAMES)
def test_every_number_in_a_statement_counts(name: str, registry: Registry) -> None:
    """Every finite number of a registered problem, moved by one bit, changes the fingerprint."""
    statement = json.loads(json.dumps(registry.problem(name).statement))
    seen, count = {statement["fingerprint"]}, 0
    for table, key in places(
        {key: value for key, value in statement.items() if key not in stated.OUTSIDE}
    ):
        before = table[key]
        table[key] = float(np.nextafter(before, math.inf))
        seen.add(stated.fingerprint(statement))
        table[key], count = before, count + 1
    assert len(seen) == count + 1 > 3


def places(value: Any) -> Any:
    """Yield (container, key) of every float in a document."""
    for key, each in value.items() if isinstance(value, dict) else enumerate(value):
        if isinstance(each, float):
            yield value, key
        elif isinstance(each, (dict, list)):
            yield from places(each)


def test_the_census_knows_a_problem_by_the_same_fingerprint() -> None:
    assert fingerprint(everything(), "r") == fingerprint(everything(title="t"), "r")
    assert fingerprint(everything(), "r") != fingerprint(everything(guess={x: (0, 0.5)}), "r")
    assert fingerprint(everything(), "r") != fingerprint(everything(start={x: 0.5}), "r")


# -- expressions

number = st.one_of(st.floats(allow_nan=False, allow_infinity=False), st.integers(-3, 3).map(float))


@st.composite
def expressions(draw: st.DrawFn) -> list[Any]:
    """Draw a few expressions that share parts, by any of the operations."""
    pool = [a, b, c, *(casadi.SX(draw(number)) for _ in range(draw(st.integers(0, 4))))]
    operations = st.sampled_from(sorted(grammar.ARITY))
    for _ in range(draw(st.integers(1, 25))):
        name = draw(operations)
        given = [pool[draw(st.integers(0, len(pool) - 1))] for _ in range(grammar.ARITY[name])]
        apply = casadi.SX.unary if len(given) == 1 else casadi.SX.binary
        made = apply(getattr(casadi, f"OP_{name.upper()}"), *given)
        if not made.is_constant() or math.isfinite(float(made)):
            pool.append(made)
    return pool[-draw(st.integers(1, 4)) :]


@given(expressions(), st.integers(0, 2**32 - 1))
def test_expressions_go_there_and_back(drawn: list[Any], seed: int) -> None:
    try:
        nodes, places = grammar.written(drawn, SYMBOLS)
    except ProblemError as error:  # folding met a number that is none, as 0/0
        assert "the number" in str(error)  # noqa: PT017 - the text is the point
        return
    text = json.dumps([nodes, places], allow_nan=False)
    again = grammar.read(json.loads(text)[0], SYMBOLS)
    assert grammar.written([again[place] for place in places], SYMBOLS) == (nodes, places)
    random = np.random.default_rng(seed)
    one, other = (
        casadi.Function("f", [a, b, c], [casadi.vertcat(*each)])
        for each in (drawn, [again[place] for place in places])
    )
    for scale in (0.5, 1.0, 3.0, 100.0):
        point = random.normal(size=3) * scale
        left, right = (each(*point).full().ravel() for each in (one, other))
        sound = np.isfinite(left) & np.isfinite(
            right
        )  # x - x is 0 where folded, nan at infinity where not
        np.testing.assert_allclose(left[sound], right[sound], rtol=1e-12)


def test_shared_parts_are_written_once() -> None:
    tower = a
    for _ in range(300):  # as a tree 2**300 entries
        tower = casadi.sin(tower) * casadi.cos(tower)
    nodes, _ = grammar.written([tower], SYMBOLS)
    assert len(nodes) == 1 + 3 * 300


def test_numbers_keep_their_bits() -> None:
    values = [0.1, 1 / 3, 5e-324, 1.7976931348623157e308, -0.0, math.pi, 2**53 + 1.0]
    nodes, places = grammar.written([a + value for value in values], SYMBOLS)
    again = grammar.read(json.loads(json.dumps(nodes)), SYMBOLS)
    for value, place in zip(values, places, strict=True):
        assert str(again[place]) == str(a + value)
    assert {value.hex() for value in nodes if isinstance(value, float)} >= {
        value.hex() for value in values if value
    }


def test_a_table_of_a_thousand_points_goes_there_and_back() -> None:
    grid = np.linspace(0, 1, 1000)
    table = casadi.pw_lin(a, grid.tolist(), np.sin(9 * grid).tolist())
    nodes, (place,) = grammar.written([table], SYMBOLS)
    again = casadi.Function("f", [a], [grammar.read(json.loads(json.dumps(nodes)), SYMBOLS)[place]])
    once = casadi.Function("f", [a], [table])
    for at in np.linspace(-0.5, 1.5, 97):
        assert float(once(at)) == float(again(at))


@pytest.mark.parametrize(
    ("nodes", "text"),
    [
        (["d"], "nodes[0]: no symbol 'd'; there are a, b, c"),
        (["__import__"], "no symbol '__import__'"),
        ([["system", 0]], "nodes[0]: ['system', 0] is no number, no symbol and no operation"),
        (["a", ["call", 0]], "nodes[1]: ['call', 0] is no"),
        (["a", ["sin"]], "nodes[1]: ['sin'] is no"),
        (["a", ["sin", 0, 0]], "nodes[1]"),
        (["a", ["sin", 1]], "nodes[1]: argument 1 of sin is no place"),
        (["a", ["sin", -1]], "argument -1 of sin is no place"),
        (["a", ["sin", True]], "argument True of sin is no place"),
        (["a", ["sin", 0.0]], "argument 0.0 of sin is no place"),
        (["a", ["sin", "a"]], "argument 'a' of sin is no place"),
        (["a", ["sin", [0]]], "argument [0] of sin is no place"),
        (["a", [["sin"], 0]], "nodes[1]: [['sin'], 0] is no"),
        ([[]], "nodes[0]: [] is no"),
        ([None], "nodes[0]: None is no"),
        ([True], "nodes[0]: True is no"),
        ([{"a": 1}], "nodes[0]"),
        ([math.nan], "nodes[0]: nan where a finite number is needed"),
        ([math.inf], "nodes[0]: inf where a finite number is needed"),
        ([10**400], "nodes[0]"),
        (
            ["a"] * (grammar.MOST + 1),
            f"nodes: {grammar.MOST + 1} entries where at most {grammar.MOST} are allowed",
        ),
        (
            ["a", *(["sin", n] for n in range(grammar.DEEPEST + 1))],
            "operations nested more than 10000 deep",
        ),
    ],
)
def test_what_is_no_expression_is_refused_with_its_place(nodes: list[Any], text: str) -> None:
    with pytest.raises(ProblemError) as caught:
        grammar.read(nodes, SYMBOLS)
    assert text in str(caught.value)


def test_the_deepest_expression_allowed_can_be_read_and_written() -> None:
    nodes = ["a", *(["sin", n] for n in range(grammar.DEEPEST))]
    deepest = grammar.read(nodes, SYMBOLS)[-1]
    assert grammar.written([deepest], SYMBOLS) == (nodes, [grammar.DEEPEST])


# -- statements


def broken(change: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
    """Return the statement of `everything`, changed, with the fingerprint of what it has become."""
    statement: dict[str, Any] = json.loads(json.dumps(everything().statement))
    change(statement)
    return {**statement, "fingerprint": stated.fingerprint(statement)}


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda s: s.pop("dynamics"), "object missing required field 'dynamics'"),
        (lambda s: s.update(code="evil.py"), "object contains unknown field 'code'"),
        (lambda s: s.update(states=["x", "x", "w"]), "the name 'x' is there twice"),
        (lambda s: s.update(states=["x", ["v"], "w"]), "states[1]: expected 'str', got 'array'"),
        (lambda s: s.update(states="x"), "states: expected 'array', got 'str'"),
        (lambda s: s.update(states=["t", "v", "w"]), "goes here; there are t, v, w"),
        (lambda s: s["dynamics"].update(x=10**6), "dynamics[...]: expected 'int' <= 199999"),
        (lambda s: s["dynamics"].update(x=len(s["nodes"])), "a place among"),
        (lambda s: s["dynamics"].update(x=-1), "dynamics[...]: expected 'int' >= 0"),
        (lambda s: s["dynamics"].update(z=0), "dynamics: no symbol 'z' goes here"),
        (lambda s: s["dynamics"].pop("x"), "dynamics: not one rate for each of the states"),
        (lambda s: s["bounds"].update(u=[1]), "bounds[...]: expected 'array' of length 2, got 1"),
        (
            lambda s: s["bounds"].update(u=[None, 1]),
            "bounds[...][0]: expected 'float | str', got 'null'",
        ),
        (lambda s: s["bounds"].update(u=["infinity", 1]), "invalid enum value 'infinity'"),
        (lambda s: s["bounds"].update(u=[1, -1]), "bounds of 'u': lower 1.0 > upper -1.0"),
        (lambda s: s["bounds"].pop("u"), "no bounds"),
        (lambda s: s.update(minimise=None, running=None), "no objective"),
        (lambda s: s.update(final_time=[0.0, 0.0]), "final_time"),
        (lambda s: s["target"].update(ring=0), "target 'ring'"),
        (lambda s: s["boundary"].update(u={"nosuch": 0}), "no state constraint 'nosuch'"),
        (lambda s: s["nodes"].append(["system", 0]), "nodes["),
        (lambda s: s["about"]["nodes"].append(["system", 0]), "about.nodes["),
        (lambda s: s["about"]["scene"].update(plane=[0]), "about.scene.plane: 1 expressions"),
        (lambda s: s["about"]["scene"].update(stars=[0]), "about.scene.stars: 1 expressions"),
        (lambda s: s["about"]["guess"].update(x=[0, 1, 2]), "about.guess.x: 3 values"),
        (lambda s: s["about"]["guess"].update(q=[0]), "about.guess: no symbol 'q' goes here"),
        (lambda s: s["about"]["units"].update(x=3), "about.units[...]: expected 'str', got 'int'"),
        (
            lambda s: s["about"].update(reference={}),
            "about.reference: object missing required field 'objective'",
        ),
    ],
)
def test_what_is_no_statement_is_refused_with_its_field(change: Any, text: str) -> None:
    with pytest.raises(ProblemError) as caught:
        Problem.from_statement(broken(change))
    assert text in str(caught.value)


def test_a_statement_changed_after_it_was_written_is_refused() -> None:
    statement = json.loads(json.dumps(everything().statement))
    statement["start"]["x"] = [1.0, 1.0]
    with pytest.raises(ProblemError, match="fingerprint: it is not that of the statement"):
        Problem.from_statement(statement)


def test_names_that_are_code_stay_names() -> None:
    for name in ("__import__('os')", "x;y", "a b", "evil.py"):
        with pytest.raises(ProblemError):
            Problem.from_statement(broken(lambda s, name=name: s.update(states=[name, "v", "w"])))


@pytest.mark.parametrize(
    "changes",
    [
        {"title": "\x1b[31m"},
        {"path": {"\x07": x <= 9}},
        {"units": {x: "\x00"}},
        {"target": {"n" * 201: x <= 9}},
    ],
)
def test_what_could_not_be_read_is_not_written(changes: dict[str, Any]) -> None:
    with pytest.raises(ProblemError, match="cannot be written as data"):
        _ = everything(boundary={}, **changes).statement


def external() -> Problem:
    """Return a problem that calls a function which casadi cannot write out."""
    hidden = casadi.Function("hidden", [a], [casadi.sin(a)], {"never_inline": True})
    return everything(running=hidden(x) + k * time)


def test_what_cannot_be_written_is_said_and_not_carried() -> None:
    problem = external()
    with pytest.raises(
        ProblemError, match="problem 'everything' cannot be written as data: the operation 'call'"
    ):
        _ = problem.statement
    with pytest.raises(ProblemError, match="call"):
        pickle.dumps(problem)
    solution = with_statement(problem, default_guess(problem))
    assert solution.statement is None
    assert "the operation 'call' cannot be written as data" in solution.origin.unstated
    assert from_json(to_json(solution)).origin.unstated == solution.origin.unstated
    carried = with_statement(everything(), replace(solution))
    assert (carried.origin.unstated, carried.statement) == ("", everything().statement)
    assert fingerprint(problem, "r") != fingerprint(problem, "r")


def test_nothing_changed_is_the_problem_with_its_reference() -> None:
    base = everything(reference=Reference(objective=1.0))
    assert base.with_().reference == base.with_({}).reference == base.reference
    assert base.with_().fingerprint == base.fingerprint


def test_numbers_changed_again_and_again_are_those_of_the_last_change() -> None:
    now = everything()
    for k in range(sys.getrecursionlimit()):
        now = now.with_(start={x: 1.0 + k / 1e4})
    assert now.fingerprint == everything().with_(start={x: now.start[x]}).fingerprint

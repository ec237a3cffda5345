"""Named constants: what stands for a number in a problem, and problems changed by name."""

import copy
import json
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from casadi import cos, sqrt, tanh

from socp.errors import ProblemError
from socp.model.data.constants import Constant, constants
from socp.model.parts import Reference, Scene
from socp.model.problem import Problem
from socp.model.symbols import controls, final_time, free, initial, parameters, states, time

x, v = states("x v")
a = controls("a")
mass = parameters("mass")
unheard = constants(unheard=3)
drag, limit = constants(drag=(0.25, "1/s", "of the water"), limit=2)


def cart(drag: Any, limit: Any) -> Problem:
    """Return a problem with two numbers everywhere where numbers may stand."""
    return Problem(
        name="cart",
        minimise=final_time + limit * mass,
        running=drag * a + time * limit,
        dynamics={x: v + tanh(limit * x), v: (a - drag * v) * (1 + mass)},
        bounds={a: (-limit, limit), v: (None, 3 * limit), mass: (drag, 1)},
        start={x: -drag, v: (0, limit)},
        end={x: (drag, None)},
        target={"near": x - initial(x) <= limit},
        path={"wall": x * drag <= 10 * limit},
        boundary={a: {"v.upper": drag * v}},
        initial_time=drag,
        final_time=(1, 10 * limit),
        guess={final_time: 2 * limit, x: (0, limit), v: limit * time},
        scene=Scene(plane=(x, v), heading=limit * x, flow=(drag * x, cos(v)), target=(0, 0, limit)),
        reference=Reference(objective=1.0),
    )


POSED, PLAIN = cart(drag, limit), cart(0.25, 2)


def test_a_problem_of_constants_is_that_of_their_values() -> None:
    assert POSED.fingerprint == PLAIN.fingerprint
    assert POSED.statement["about"] == PLAIN.statement["about"]
    assert (POSED.bounds[a], POSED.start[x], POSED.initial_time) == ((-2.0, 2.0), -0.25, 0.25)
    assert POSED.constants == {"drag": Constant(0.25, "1/s", "of the water"), "limit": Constant(2)}
    assert PLAIN.constants == {}
    assert "formula" not in PLAIN.statement


def test_other_values_give_the_problem_of_those_values() -> None:
    changed = POSED.with_(drag=0.5, limit=1)
    assert changed.fingerprint == cart(0.5, 1).fingerprint
    assert changed.statement["about"]["guess"] == cart(0.5, 1).statement["about"]["guess"]
    assert changed.with_(drag=0.25, limit=2).fingerprint == PLAIN.fingerprint
    assert POSED.constants["drag"].value == 0.25
    assert changed.reference is None
    assert POSED.with_(title="another").reference == POSED.reference


@pytest.mark.parametrize(
    "way",
    [copy.copy, copy.deepcopy, lambda p: pickle.loads(pickle.dumps(p)), replace],  # noqa: S301
    ids=["copy", "deepcopy", "pickle", "replace"],
)
def test_copies_keep_their_constants(way: Any) -> None:
    there = way(POSED.with_(drag=0.125))
    assert there.fingerprint == cart(0.125, 2).fingerprint
    assert there.constants == POSED.with_(drag=0.125).constants
    assert there.with_(limit=3).fingerprint == cart(0.125, 3).fingerprint


def test_what_is_replaced_stays_while_constants_change() -> None:
    other = replace(POSED, final_time=7.0)
    assert (other.final_time, other.with_(limit=3).final_time) == (7.0, 7.0)
    assert other.with_(limit=3).bounds[a] == (-3.0, 3.0)


def test_numbers_are_set_by_name() -> None:
    named = POSED.with_(
        {
            "start.x": 1,
            "bounds.a.upper": 1.5,
            "end.v": (0, 1),
            "final_time.lower": 2,
            "start.v": free,
        }
    )
    assert (named.start[x], named.start[v], named.end[v]) == (1, free, (0, 1))
    assert (named.bounds[a], named.final_time) == ((-2.0, 1.5), (2, 20.0))
    again = named.with_(limit=4)
    assert (again.bounds[a], again.final_time, again.start[x]) == ((-4.0, 1.5), (2, 40.0), 1)
    assert POSED.with_(start={"x": 1}, bounds={a: (-1, 1)}).start == {x: 1, v: (0, 2.0)}
    assert POSED.with_({"bounds.x.upper": 5}).bounds[x] == (-float("inf"), 5)
    assert POSED.with_({"initial_time.upper": 1.0}).initial_time == (0.25, 1.0)


def test_a_side_that_is_free_has_no_bound() -> None:
    bounded = POSED.with_({"bounds.x": (-1, 5), "start.v": 0.5})
    assert bounded.with_({"bounds.x.upper": free}).state_box[:, 0].tolist() == [-1, np.inf]
    assert bounded.with_({"bounds.x.lower": free}).state_box[:, 0].tolist() == [-np.inf, 5]
    assert bounded.with_({"final_time.upper": free}).final_time_box == (1, np.inf)
    assert bounded.with_({"start.v.lower": free}).start_box[:, 1].tolist() == [-np.inf, 0.5]


def test_symbols_stand_for_their_names_and_arrays_for_intervals() -> None:
    assert POSED.with_({drag: 0.5}).constants["drag"].value == 0.5
    other = POSED.with_(bounds={a: np.array([-1.0, 2.0])})
    assert other.with_({"bounds.a.upper": 3}).bounds[a] == (-1.0, 3)


def test_constants_that_cancel_leave_numbers() -> None:
    posed = small(bounds={a: (limit - limit - 1, limit / limit)}, start={x: 0 * drag})
    assert (posed.bounds[a], posed.start[x], posed.constants) == ((-1.0, 1.0), 0.0, {})


@pytest.mark.parametrize("beside", [{"guess.x": 1}, {"title": "other"}, {"units": {x: "m"}}])
def test_what_defines_no_problem_leaves_the_reference(beside: dict[str, Any]) -> None:
    assert POSED.with_(beside).reference == POSED.reference


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"unheard": 1}, "there is no 'unheard' to change: it is a constant that the problem does"),
        ({"final_time.": 1}, "there is no 'final_time.' to change; did you mean 'final_time'?"),
        ({3: 1}, "with_: 3 where the name of a number is needed"),
        ("drag", "with_('drag'): give a table, such as {'start.x': 30}"),
        ({"drgg": 1}, "there is no 'drgg' to change; did you mean 'drag'?"),
        ({"start.w": 1}, "there is no 'start.w' to change; did you mean 'start.x'?"),
        ({"a.upper": 1}, "there is no 'a.upper' to change; did you mean 'bounds.a.upper'?"),
        ({"x": 1}, "there is no 'x' to change; did you mean 'start.x'?"),
        ({"start.a": 1}, "start: 'a' is a control; a state goes here"),
        ({"title.x": 1}, "there is no 'title.x' to change; did you mean"),
        ({"formula": 1}, "there is no 'formula' to change"),
        ({"bounds.q": 1}, "there is no 'bounds.q' to change; did you mean 'bounds."),
        ({"bounds.x.upper": (1, 2)}, "bounds.x.upper: (1, 2) where a number, or free, is needed"),
        ({"bounds.a.upper": free}, "bounds of 'a': (-2.0, inf); a control needs finite bounds"),
        ({"start": 3}, "start: 3 where a table {...: ...} is needed"),
        ({"start": {"w": 3}}, "start: there is no 'w'; there are"),
        ({"drag": "much"}, "constant 'drag': 'much' where a finite number is needed"),
        ({"limit": float("inf")}, "constant 'limit': inf where a finite number is needed"),
        ({"start.v": 7}, "start of 'v': 7 lies outside its bounds"),
        ({"limit": -1}, "scene target: (0, 0, -1.0) where (cx, cy, radius)"),
    ],
)
def test_what_cannot_be_changed_is_named(change: Any, said: str) -> None:
    with pytest.raises(ProblemError) as refused:
        POSED.with_(change)
    assert str(refused.value).startswith(f"problem 'cart': {said}")


def small(**more: Any) -> Problem:
    given = {"minimise": final_time, "dynamics": {x: a}, "bounds": {a: (-1, 1)}, "end": {x: 1}}
    return Problem(name="small", **{**given, "start": {x: 0}, **more})


def test_names_of_constants_mean_nothing_else() -> None:
    for name, what in (("a", "a control"), ("start", "a part of every problem")):
        with pytest.raises(ProblemError, match=f"constant '{name}': this is the name of {what}"):
            small(dynamics={x: a * constants(**{name: 1})})
    twins = constants(twin=1) + constants(twin=2)
    with pytest.raises(ProblemError, match="the name 'twin' is used for two constants"):
        small(dynamics={x: a * twins})


def test_a_constant_is_no_key() -> None:
    with pytest.raises(ProblemError, match="start: 'drag' is a constant; a state goes here"):
        small(start={drag: 1})


def test_a_bound_with_a_state_in_it_is_refused_as_ever() -> None:
    with pytest.raises(ProblemError, match="a bound c\\(x, t\\)"):
        small(bounds={a: (-1, drag * x)})


def test_a_relation_that_values_decide_is_refused() -> None:
    with pytest.raises(ProblemError, match="the relation is True whatever the states are"):
        small(path={"always": drag <= 1})


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda f: f["constants"]["drag"].update(value=0.5), "it is another problem"),
        (lambda f: f["places"].append([["start", "w"], 0]), "the problem has no place 'start.w'"),
        (lambda f: f["places"][0].__setitem__(1, 9999), "a place among"),
        (lambda f: f["places"].append([[], 0]), "formula.places"),
        (lambda f: f["nodes"].append("w"), "no symbol 'w'"),
        (lambda f: f["constants"].update(x=f["constants"]["drag"]), "'x' names something else"),
        (lambda f: f["constants"]["drag"].update(text="\x1b[2J"), "control characters"),
        (lambda f: f["constants"].clear(), "formula.constants"),
    ],
)
def test_a_formula_that_was_changed_by_hand_is_refused(spoil: Any, said: str) -> None:
    data = json.loads(json.dumps(POSED.statement))
    spoil(data["formula"])
    with pytest.raises(ProblemError) as refused:
        Problem.from_statement(data)
    assert said in str(refused.value)


def test_the_order_of_a_constant_s_fields_says_nothing() -> None:
    data = json.loads(json.dumps(POSED.statement))
    own = data["formula"]["constants"]
    own["drag"] = dict(reversed(own["drag"].items()))
    assert Problem.from_statement(data).constants["drag"] == Constant(0.25, "1/s", "of the water")


def test_a_formula_that_reads_back_otherwise_leaves_the_numbers() -> None:
    """A square of a root is simplified where its parts are one, and differs in the last bit."""
    k, m = constants(k=1.2, m=1.7)
    spring = Problem(
        name="spring",
        running=x**2,
        dynamics={x: v, v: a - sqrt(k / m) * sqrt(k / m) * x},
        bounds={a: (-1, 1)},
        start={x: 1, v: 0},
        final_time=3,
    )
    assert "formula" not in spring.statement
    again = Problem.from_statement(spring.statement)
    assert again.fingerprint == spring.fingerprint
    assert copy.deepcopy(spring).fingerprint == spring.fingerprint

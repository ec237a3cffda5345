"""The problem language: what it means, by formula and by automatic differentiation, and every
refusal with its text.
"""

import math
from contextlib import suppress
from dataclasses import replace
from typing import Any

import casadi
import numpy as np
import pytest
from casadi import cos, exp, fabs, if_else, sin, tanh
from hypothesis import given
from hypothesis import strategies as st

from socp.errors import ProblemError
from socp.model.parts import Reference
from socp.model.problem import Problem
from socp.model.symbols import (
    controls,
    final_time,
    free,
    initial,
    initial_time,
    parameters,
    states,
    time,
)

x, y, unmoved = states("x y unmoved")
v, w, loose = controls("v w loose")
k, idle = parameters("k idle")


def sound(**changes: Any) -> dict[str, Any]:
    """Return the parts of a small problem that is well posed, with changes."""
    parts = {
        "name": "toy",
        "minimise": final_time,
        "dynamics": {x: y, y: v},
        "bounds": {v: (-1, 1)},
        "start": {x: 0, y: 0},
        "end": {x: 1},
    }
    return parts | changes


def test_the_sound_problem_is_accepted() -> None:
    problem = Problem(**sound())
    assert (problem.state_names, problem.control_names, problem.parameter_names) == (
        ("x", "y"),
        ("v",),
        (),
    )


# -- refusals: what is wrong -> what the message says, beside the problem's name

REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    # the control-affine form
    "square": ({"dynamics": {x: y, y: v**2}}, "dynamics of 'y' is not affine in control 'v'"),
    "product": (
        {"dynamics": {x: v * w, y: v}, "bounds": {v: (-1, 1), w: (0, 1)}},
        "dynamics of 'x' is not affine in control 'v'",
    ),
    "second of two": (
        {"dynamics": {x: v, y: sin(w)}, "bounds": {v: (-1, 1), w: (0, 1)}},
        "dynamics of 'y' is not affine in control 'w'",
    ),
    "modulus": ({"dynamics": {x: y, y: fabs(v)}}, "dynamics of 'y' is not affine in control 'v'"),
    "step": (
        {"dynamics": {x: y, y: if_else(v > 0, 1, 2)}},
        "dynamics of 'y' is not affine in control 'v'",
    ),
    "rounding": (
        {"dynamics": {x: y, y: v + casadi.floor(v)}},
        "dynamics of 'y' is not affine in control 'v'",
    ),
    "quotient": (
        {"dynamics": {x: y, y: x / (2 + v)}},
        "dynamics of 'y' is not affine in control 'v'",
    ),
    "running": ({"running": v**2}, "running cost is not affine in control 'v'"),
    # symbols
    "state without dynamics": (
        {"dynamics": {x: unmoved, y: v}},
        "dynamics of 'x': state 'unmoved' has no dynamics",
    ),
    "start without dynamics": ({"start": {unmoved: 1}}, "start: state 'unmoved' has no dynamics"),
    "unknown": (
        {"dynamics": {x: y, y: v + casadi.SX.sym("q")}},
        "dynamics of 'y': unknown symbol 'q'",
    ),
    "time at the ends": (
        {"minimise": time},
        "minimise: unknown symbol 't'; at the ends write final_time",
    ),
    "end along the way": (
        {"dynamics": {x: final_time, y: v}},
        "dynamics of 'x': unknown symbol 'tf'; along the way",
    ),
    "initial along the way": (
        {"dynamics": {x: initial(x), y: v}},
        "dynamics of 'x': unknown symbol 'x(t0)'; initial values are known in minimise and target",
    ),
    "initial of another": (
        {"minimise": initial(unmoved)},
        "minimise: unknown symbol 'unmoved(t0)'",
    ),
    "no bounds": (
        {"dynamics": {x: loose, y: v}},
        "control 'loose' has no bounds; give bounds={loose: (lower, upper)}",
    ),
    "idle control": ({"bounds": {v: (-1, 1), w: (0, 1)}}, "bounds: control 'w' acts on nothing"),
    "idle parameter": (
        {"bounds": {v: (-1, 1), idle: (0, 1)}},
        "bounds: parameter 'idle' has no place",
    ),
    "idle parameter guessed": ({"guess": {idle: 1}}, "guess: parameter 'idle' has no place"),
    "control in the Mayer term": ({"minimise": v}, "minimise: uses the control 'v'"),
    "control in the target": ({"target": {"a": v <= 0}}, "target 'a': uses the control 'v'"),
    "control in the path": ({"path": {"a": v <= x}}, "path 'a': uses the control 'v'"),
    "control in a law": ({"singular": {v: v + x}}, "singular law of 'v': uses the control 'v'"),
    "control in a boundary law": (
        {"boundary": {v: v}, "bounds": {v: (-1, 1), y: (0, 1)}},
        "boundary law of 'v': uses the control 'v'",
    ),
    "one name for two": (
        {"dynamics": {x: y, y: v, states("x"): 1}},
        "the name 'x' is used for two symbols",
    ),
    "state named as control": (
        {"dynamics": {x: y, y: v, states("v"): 1}},
        "the name 'v' is used for two symbols",
    ),
    # tables and their keys
    "swapped roles": ({"dynamics": {x: y, v: 1}}, "dynamics: 'v' is a control; a state goes here"),
    "start of a control": ({"start": {v: 0}}, "start: 'v' is a control; a state goes here"),
    "law of a state": ({"singular": {x: 0}}, "singular: 'x' is a state; a control goes here"),
    "expression as key": ({"end": {x + y: 0}}, "end: '(x+y)' is no symbol (it is an SX)"),
    "string as key": ({"start": {"x": 0}}, "start: 'x' is no symbol (it is a str)"),
    "undeclared key": (
        {"bounds": {v: (-1, 1), casadi.SX.sym("q"): (0, 1)}},
        "bounds: 'q' is not declared",
    ),
    "time bounded": (
        {"bounds": {v: (-1, 1), final_time: (1, 2)}},
        "bounds: 'tf' has its own entry; write final_time=",
    ),
    "list as table": (
        {"dynamics": [y, v]},
        "dynamics: [SX(y), SX(v)] where a table {...: ...} is needed",
    ),
    "none as table": ({"start": None}, "start: None where a table"),
    "relation as target": ({"target": x <= 0}, "target: SX((x<=0)) where a table"),
    "unnamed condition": (
        {"target": {x: x <= 0}},
        "target: SX(x) where the condition's name, a string, is needed",
    ),
    "unit": ({"units": {x: 3}}, "units of 'x': 3 where a string is needed"),
    "no dynamics": ({"dynamics": {}}, "dynamics: give the rate of at least one state"),
    "empty name": ({"name": " "}, "name: a problem needs a name"),
    "name not a string": ({"name": 7}, "name: a problem needs a name"),
    "title": ({"title": None}, "title: None where a string is needed"),
    "reference": (
        {"reference": 14.95},
        "reference: 14.95 where a Reference(objective=...) is needed",
    ),
    # numbers
    "crossed bounds": ({"bounds": {v: (1, -1)}}, "bounds of 'v': lower 1.0 > upper -1.0"),
    "crossed end": ({"end": {x: (2, 1)}}, "end of 'x': lower 2.0 > upper 1.0"),
    "single bound": ({"bounds": {v: 1}}, "bounds of 'v': 1 where a pair (lower, upper) is needed"),
    "three bounds": (
        {"bounds": {v: (0, 1, 2)}},
        "bounds of 'v': (0, 1, 2) where a pair (lower, upper) is needed",
    ),
    "string bounds": (
        {"bounds": {v: "ab"}},
        "bounds of 'v': 'ab' where a pair (lower, upper) is needed",
    ),
    "strings as bounds": ({"bounds": {v: ("-1", "1")}}, "bounds of 'v': ('-1', '1') where a pair"),
    "truth as bounds": (
        {"bounds": {v: (False, True)}},
        "bounds of 'v': (False, True) where a pair",
    ),
    "expression as bounds": ({"bounds": {v: (-x, x)}}, "bounds of 'v'"),
    "symbol as bounds": ({"bounds": {v: x}}, "bounds of 'v'"),
    "nan bounds": (
        {"bounds": {v: (math.nan, 1)}},
        "bounds of 'v': (nan, 1) where finite numbers are needed",
    ),
    "open control": (
        {"bounds": {v: (0, math.inf)}},
        "bounds of 'v': (0.0, inf); a control needs finite bounds",
    ),
    "none as control bound": (
        {"bounds": {v: (None, 1)}},
        "bounds of 'v': (-inf, 1.0); a control needs finite bounds",
    ),
    "closed control": ({"bounds": {v: (1, 1)}}, "bounds of 'v': lower = upper = 1.0"),
    "inverted infinity": (
        {"bounds": {v: (-1, 1), x: (math.inf, math.inf)}},
        "bounds of 'x': (inf, inf)",
    ),
    "end outside": (
        {"bounds": {v: (-1, 1), x: (-2, 0.5)}},
        "end of 'x': 1 lies outside its bounds (-2.0, 0.5)",
    ),
    "start outside": (
        {"bounds": {v: (-1, 1), y: (1, 2)}},
        "start of 'y': 0 lies outside its bounds (1.0, 2.0)",
    ),
    "nan start": ({"start": {x: math.nan}}, "start of 'x': nan where finite numbers are needed"),
    "infinite end": ({"end": {x: math.inf}}, "end of 'x': inf where finite numbers are needed"),
    "symbolic start": (
        {"start": {x: y}},
        "start of 'x': SX(y) where a number or a pair (lower, upper) is needed",
    ),
    "string start": ({"start": {x: "0"}}, "start of 'x': '0' where a number or a pair"),
    "no time": ({"final_time": 0}, "final_time: 0 is not after initial_time 0.0"),
    "time before": (
        {"initial_time": 3, "final_time": (1, 2)},
        "final_time: (1, 2) is not after initial_time 3",
    ),
    "nan time": ({"final_time": math.nan}, "final_time: nan where finite numbers are needed"),
    "symbol as time": ({"final_time": final_time}, "final_time: SX(tf) where a number or a pair"),
    "none as time": ({"initial_time": None}, "initial_time: None where a number or a pair"),
    # expressions
    "nan rate": (
        {"dynamics": {x: math.nan, y: v}},
        "dynamics of 'x': nan where a finite value is needed",
    ),
    "nan inside": (
        {"dynamics": {x: y * math.nan, y: v}},
        "dynamics of 'x': (nan*y) where a finite value is needed",
    ),
    "infinite cost": ({"minimise": final_time + math.inf}, "minimise: "),
    "infinite cost says so": ({"running": math.inf}, "running: inf where a finite value is needed"),
    "string rate": (
        {"dynamics": {x: "y", y: v}},
        "dynamics of 'x': 'y' is not an expression (it is a str)",
    ),
    "none rate": ({"dynamics": {x: None, y: v}}, "dynamics of 'x': None is not an expression"),
    "truth as cost": ({"minimise": True}, "minimise: True is not an expression (it is a bool)"),
    "list rate": (
        {"dynamics": {x: [y], y: v}},
        "dynamics of 'x': [SX(y)] is not an expression (it is a list)",
    ),
    "MX rate": (
        {"dynamics": {x: casadi.MX.sym("m"), y: v}},
        "dynamics of 'x': MX(m) is not an expression",
    ),
    "DM rate": (
        {"dynamics": {x: casadi.DM(1), y: v}},
        "dynamics of 'x': DM(1) is not an expression",
    ),
    "vector rate": (
        {"dynamics": {x: casadi.vertcat(y, v), y: v}},
        "dynamics of 'x': shape (2, 1) where one number",
    ),
    "vector cost": (
        {"minimise": casadi.SX(0, 0)},
        "minimise: shape (0, 0) where one number is needed",
    ),
    "vector law": ({"singular": {v: casadi.vertcat(x, y)}}, "singular law of 'v': shape (2, 1)"),
    "relation as rate": (
        {"dynamics": {x: y <= 0, y: v}},
        "dynamics of 'x': (y<=0) is a relation, true or false",
    ),
    "relation as cost": ({"running": x == 0}, "running: (x==0) is a relation, true or false"),
    "no objective": ({"minimise": None}, "no objective: give minimise (a Mayer term) or running"),
    # conditions and constraints
    "expression as condition": (
        {"target": {"a": x}},
        "target 'a': x is no relation; write left <= right",
    ),
    "inequality sign": ({"target": {"a": x != 0}}, "target 'a': (x!=0) is no relation"),
    "number as condition": ({"target": {"a": 3}}, "target 'a': 3 is no relation"),
    "folded": (
        {"path": {"a": x <= 1 * x}},
        "path 'a': the relation is True whatever the states are",
    ),
    "false": (
        {"path": {"a": x.is_constant()}},
        "path 'a': the relation is False whatever the states are",
    ),
    "numpy truth": (
        {"path": {"a": np.float64(1) <= 0}},
        "path 'a': the relation is False whatever",
    ),
    "vector condition": (
        {"target": {"a": casadi.vertcat(x, y) <= 0}},
        "is no relation; write left <= right",
    ),
    "path equation": (
        {"path": {"a": x == y}},
        "path 'a': an equation; a path constraint is c(x, t) <= 0",
    ),
    "infinite condition": (
        {"path": {"a": x <= math.inf}},
        "path 'a': (x-inf) where a finite value is needed",
    ),
    "name of a bound": (
        {"path": {"x.upper": x <= 1}},
        "path 'x.upper': this is the name of a state's bound",
    ),
    "name of an end": ({"target": {"x": x <= 1}}, "target 'x': this names an end value already"),
    "law without constraint": (
        {"boundary": {v: 0}},
        "boundary law of 'v': the problem has no state constraint",
    ),
    "law on no constraint": (
        {"bounds": {v: (-1, 1), y: (0, 1)}, "boundary": {v: {"y.lowr": 0}}},
        "boundary law of 'v': no state constraint 'y.lowr'; there are y.lower, y.upper",
    ),
    # guesses
    "state-dependent guess": ({"guess": {x: y}}, "guess of 'x': y may only depend on time"),
    "guess of three": (
        {"guess": {x: (1, 2, 3)}},
        "guess of 'x': (1, 2, 3) where a number, a pair (start, end)",
    ),
    "guess of one": (
        {"guess": {x: (1,)}},
        "guess of 'x': (1,) where a number, a pair (start, end)",
    ),
    "nan guess": ({"guess": {x: math.nan}}, "guess of 'x': nan where a finite number is needed"),
    "string guess": ({"guess": {x: "1"}}, "guess of 'x': '1' where a number is needed"),
    "relation as guess": (
        {"guess": {x: time <= 1}},
        "guess of 'x': SX((t<=1)) where a number is needed",
    ),
    "moving ends of a guess": (
        {"guess": {x: (0, time)}},
        "guess of 'x': t where a number is needed, not a function",
    ),
    "pair for a time": (
        {"guess": {final_time: (1, 2)}},
        "guess of 'tf': (1, 2) where a number is needed",
    ),
    "moving time": (
        {"guess": {final_time: time}},
        "guess of 'tf': t where a number is needed, not a function of time",
    ),
    "moving parameter": (
        {"dynamics": {x: y * k, y: v}, "guess": {k: (1, 2)}},
        "guess of 'k': (1, 2) where a number is needed",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals_name_the_problem_and_the_offender(case: str) -> None:
    changes, message = REFUSED[case]
    with pytest.raises(ProblemError) as caught:
        Problem(**sound(**changes))
    name = changes.get("name", "toy")
    assert str(caught.value).startswith(f"problem {name!r}: ")
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ("", "name at least one state"),
        ("a a", "'a' is declared twice"),
        ("a b;c", "'b;c' is no name"),
        ("2a", "'2a' is no name"),
        ("t", "'t' is the name of time"),
        ("a tf", "'tf' is the name of final_time"),
        (["a"], "give the names in one string"),
        (None, "give the names in one string"),
    ],
)
def test_declarations_refuse_what_is_no_name(names: Any, message: str) -> None:
    with pytest.raises(ProblemError, match=r"^states"):
        states(names)
    with pytest.raises(ProblemError) as caught:
        states(names)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    "wrong", [v, k, time, x + 1, 3, "x", [x], casadi.vertcat(x, y), casadi.MX.sym("x"), None]
)
def test_only_a_state_has_an_initial_value(wrong: Any) -> None:
    with pytest.raises(ProblemError, match="only a declared state has an initial value"):
        initial(wrong)


def test_the_initial_value_of_a_state_is_one_symbol() -> None:
    assert initial(x) is initial(x)
    assert initial(x).name() == "x(t0)"


THINGS = (
    x,
    y,
    v,
    k,
    time,
    final_time,
    x + v,
    v * v,
    x <= 1,
    casadi.MX.sym("m"),
    casadi.DM([1, 2]),
    casadi.SX(2, 2),
    np.array([0.0, 1.0]),
    np.eye(2),
    {x: 1},
    {"a": x <= 1},
    {v: (0, 1)},
    object(),
    print,
)
JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.text(max_size=3),
    st.lists(st.integers(), max_size=3),
    st.integers(0, len(THINGS) - 1).map(
        THINGS.__getitem__
    ),  # some of them cannot be hashed, as sampling would
)
FIELDS = [
    "name",
    "minimise",
    "running",
    "dynamics",
    "bounds",
    "start",
    "end",
    "target",
    "path",
    "singular",
    "boundary",
    "initial_time",
    "final_time",
    "guess",
    "units",
    "title",
    "source",
    "reference",
]


@given(st.sampled_from(FIELDS), JUNK)
def test_nothing_but_a_problem_error_escapes(field: str, junk: Any) -> None:
    with suppress(ProblemError):
        Problem(**sound(**{field: junk}))


@given(
    st.sampled_from(
        ["dynamics", "bounds", "start", "end", "singular", "boundary", "guess", "units"]
    ),
    JUNK,
)
def test_no_entry_of_a_table_escapes_either(table: str, junk: Any) -> None:
    entries = {"dynamics": {x: y, y: v}, "bounds": {v: (-1, 1)}}.get(table, {})
    symbol = v if table in {"bounds", "singular", "boundary"} else x
    with suppress(ProblemError):
        Problem(**sound(**{table: entries | {symbol: junk}}))


@given(st.sampled_from(["target", "path"]), JUNK)
def test_no_condition_escapes_either(table: str, junk: Any) -> None:
    with suppress(ProblemError):
        Problem(**sound(**{table: {"named": junk}}))


# -- what is accepted


def test_a_control_affine_under_a_switch_of_the_states_is_affine() -> None:
    problem = Problem(
        **sound(dynamics={x: if_else(x > 0, v, 2 * v) - (v - 3) / exp(y), y: 1 - (2 - v)})
    )
    assert problem.control_names == ("v",)


def test_numpy_numbers_and_arrays_stand_for_their_values() -> None:
    problem = Problem(
        **sound(bounds={v: np.array([-1.0, 2.0])}, start={x: np.float64(0.5), y: np.int64(1)})
    )
    np.testing.assert_array_equal(problem.box, [[-1.0], [2.0]])
    np.testing.assert_array_equal(problem.start_box, [[0.5, 1.0], [0.5, 1.0]])


def test_intervals_fixed_values_and_what_is_free() -> None:
    problem = Problem(
        **sound(
            bounds={v: (-1, 1), y: (None, 3)},
            start={x: (0, 2)},
            end={y: 1},
            initial_time=(-1, 1),
            final_time=(2, None),
        )
    )
    inf = math.inf
    np.testing.assert_array_equal(problem.state_box, [[-inf, -inf], [inf, 3]])
    np.testing.assert_array_equal(problem.start_box, [[0, -inf], [2, inf]])
    np.testing.assert_array_equal(problem.end_box, [[-inf, 1], [inf, 1]])
    assert problem.initial_time_box == (-1.0, 1.0)
    assert problem.final_time_box == (2.0, inf)
    assert Problem(**sound()).final_time_box == free
    assert Problem(**sound(final_time=4)).final_time_box == (4.0, 4.0)


def test_state_bounds_and_path_constraints_are_named_constraints() -> None:
    problem = Problem(**sound(bounds={v: (-1, 1), y: (-2, 3)}, path={"wall": x + time <= y + 7}))
    assert [c.name for c in problem.constraints] == ["y.lower", "y.upper", "wall"]
    function = casadi.Function(
        "c", [problem.x, time], [casadi.vertcat(*(c.expression for c in problem.constraints))]
    )
    np.testing.assert_allclose(
        function([5, 0.5], 2.0).full().ravel(), [-2 - 0.5, 0.5 - 3, 5 + 2 - 7 - 0.5]
    )


def test_conditions_are_equations_or_inequalities_of_both_ends_and_times() -> None:
    target = {"loop": x == initial(x), "late": initial_time + 2 <= final_time, "up": y >= k}
    problem = Problem(**sound(target=target, start={}, end={}))
    assert [(c.name, c.equation) for c in problem.conditions] == [
        ("loop", True),
        ("late", False),
        ("up", False),
    ]
    symbols = [problem.x, problem.x0, problem.p, initial_time, final_time]
    function = casadi.Function(
        "psi", symbols, [casadi.vertcat(*(c.expression for c in problem.conditions))]
    )
    np.testing.assert_allclose(
        function([3, 4], [1, 2], 6, 0.5, 1.5).full().ravel(), [3 - 1, 0.5 + 2 - 1.5, 6 - 4]
    )


def test_parameters_are_found_wherever_they_stand() -> None:
    a, b, c = parameters("a b c")
    problem = Problem(
        **sound(
            dynamics={x: y * c, y: v},
            path={"p": x <= a},
            minimise=b,
            bounds={v: (-1, 1), b: (0, 2)},
            guess={a: 3},
        )
    )
    assert problem.parameter_names == ("a", "b", "c")
    np.testing.assert_array_equal(
        problem.parameter_box, [[-math.inf, 0, -math.inf], [math.inf, 2, math.inf]]
    )


def test_units_may_name_the_unit_of_time() -> None:
    assert Problem(**sound(units={x: "m", v: "m/s^2", time: "s"})).units[time] == "s"


def test_the_symbolstables_are_copied() -> None:
    dynamics = {x: y, y: v}
    problem = Problem(**sound(dynamics=dynamics))
    dynamics[x] = casadi.SX(0)
    assert str(problem.rate[0]) == "y"
    with pytest.raises(TypeError):
        problem.dynamics[x] = 0  # type: ignore[index]


def test_a_problem_is_changed_by_replacing_its_parts() -> None:
    problem = replace(Problem(**sound()), name="slower", bounds={v: (-0.5, 0.5)})
    np.testing.assert_array_equal(problem.box, [[-0.5], [0.5]])
    assert repr(problem) == "Problem('slower': states x, y; controls v)"


def test_a_reference_is_kept() -> None:
    known = Reference(objective=2.0)
    assert Problem(**sound(reference=known)).reference is known


# -- the control-affine form, by formula and by automatic differentiation

vehicle = Problem(
    name="vehicle with drag in a current",
    running=x**2 + k * v * sin(y) + time * w,
    dynamics={x: cos(y) * w + tanh(y) + time * v, y: k * v - x * fabs(x) + 3},
    bounds={v: (-2, 3), w: (0, 1)},
    final_time=1,
)
number = st.floats(-3, 3)


@given(number, number, number, number, number, number)
def test_drift_and_fields_are_those_of_the_formula(
    x_: float, y_: float, v_: float, w_: float, t: float, k_: float
) -> None:
    f0, G = casadi.Function("form", [vehicle.x, time, vehicle.p], [vehicle.drift, vehicle.fields])(
        [x_, y_], t, k_
    )
    np.testing.assert_allclose(f0.full().ravel(), [math.tanh(y_), 3 - x_ * abs(x_)])
    np.testing.assert_allclose(G.full(), [[t, math.cos(y_)], [k_, 0.0]])
    rate = casadi.Function("rate", [vehicle.x, vehicle.u, time, vehicle.p], [vehicle.rate])(
        [x_, y_], [v_, w_], t, k_
    )
    np.testing.assert_allclose(rate.full(), (f0 + G @ casadi.DM([v_, w_])).full(), atol=1e-12)


@given(st.tuples(*[number] * 8))
def test_hamiltonian_and_switching_functions_agree_with_automatic_differentiation(
    values: tuple[float, ...],
) -> None:
    x_, y_, v_, w_, t, k_, p, q = values
    symbols = [vehicle.x, vehicle.u, time, vehicle.p, vehicle.costate]
    at = ([x_, y_], [v_, w_], t, k_, [p, q])
    value = float(casadi.Function("H", symbols, [vehicle.hamiltonian])(*at))
    rate_x, rate_y = math.cos(y_) * w_ + math.tanh(y_) + t * v_, k_ * v_ - x_ * abs(x_) + 3
    cost = x_**2 + k_ * v_ * math.sin(y_) + t * w_
    assert value == pytest.approx(cost + p * rate_x + q * rate_y, abs=1e-11)
    slope = (
        casadi.Function("dH", symbols, [casadi.gradient(vehicle.hamiltonian, vehicle.u)])(*at)
        .full()
        .ravel()
    )
    sigma = casadi.Function(
        "sigma", [vehicle.x, time, vehicle.p, vehicle.costate], [vehicle.switching]
    )
    by_formula = [k_ * math.sin(y_) + p * t + q * k_, t + p * math.cos(y_)]
    np.testing.assert_allclose(sigma([x_, y_], t, k_, [p, q]).full().ravel(), slope, atol=1e-12)
    np.testing.assert_allclose(slope, by_formula, atol=1e-12)


def test_a_problem_may_have_no_control_at_all() -> None:
    problem = Problem(
        name="decay", minimise=x, dynamics={x: -k * x}, bounds={}, start={x: 1}, final_time=1
    )
    assert problem.fields.shape == (1, 0)
    assert problem.switching.shape == (0, 1)
    assert problem.box.shape == (2, 0)


def test_a_chained_relation_is_never_read_as_one_half_of_it() -> None:
    # Python evaluates 0 <= x <= 1 as (0 <= x) and (x <= 1), and asks the first for its truth before
    # any problem exists
    with pytest.raises(RuntimeError, match="truth value"):
        _ = 0 <= x <= 1


def test_functions_of_numpy_make_expressions_without_a_notice() -> None:
    assert casadi.is_equal(np.sin(x), casadi.sin(x), 1)
    assert casadi.is_equal(np.fmax(x, 0), casadi.fmax(x, 0), 1)

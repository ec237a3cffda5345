"""Bad inputs: each is answered by its exit code and one message that says what, where, and what to
write instead.
"""

import dataclasses
import json
import math
import os
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pytest
from carts import FILE
from casadi import DM, MX, SX, fabs, floor, fmax, fmin, if_else, sin, sqrt
from records import older

from socp import (
    Problem,
    Reference,
    controls,
    final_time,
    initial,
    initial_time,
    parameters,
    states,
    time,
)
from socp.cli import main
from socp.errors import MethodError, ProblemError
from socp.methods.chain import run
from socp.methods.contract import check_options
from socp.methods.guess import default_guess
from socp.model.checks import check_solvable
from socp.model.word import Word
from socp.registry.plugins import Registry
from socp.solvers.backends.ipopt import Ipopt
from socp.view.statement import formula

x, y, other = states("x y other")
v, w = controls("v w")
k = parameters("k")
MISSING = object()
MET = (
    "the start meets the end already, and no motion costs less than none, final_time = "
    "initial_time = 0; change start"
)


class Evil:
    """A value that cannot be printed."""

    def __str__(self) -> str:
        raise RuntimeError("no text")

    __repr__ = __str__


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
    return {key: value for key, value in {**parts, **changes}.items() if value is not MISSING}


# -- values: every kind of thing in every place

VALUES: dict[str, Any] = {
    "truth": True,
    "numpy's truth": np.bool_(True),
    "DM": DM(1),
    "DM of two": DM([1, 2]),
    "array of none": np.array(1.0),
    "array of one": np.array([1.0]),
    "array": np.array([0.0, 1.0]),
    "matrix": np.eye(2),
    "text": "x",
    "complex": 1j,
    "nan": math.nan,
    "inf": math.inf,
    "too large": 10**400,
    "MX": MX.sym("m"),
    "unprintable": Evil(),
    "list": [1],
    "vector": casadi.vertcat(x, y),
    "fraction": Fraction(1, 2),
    "function": math.sin,
    "relation": x <= 1,
    "no entries": SX(),
    "type": int,
    "bytes": b"1",
    "set": {1},
}
PLACES: dict[str, Callable[[Any], dict[str, Any]]] = {
    "dynamics of 'x'": lambda a: {"dynamics": {x: a, y: v}},
    "running": lambda a: {"running": a},
    "minimise": lambda a: {"minimise": a},
    "bounds of 'v'": lambda a: {"bounds": {v: (a, 2)}},
    "start of 'x'": lambda a: {"start": {x: a}},
    "end of 'x'": lambda a: {"end": {x: (a, 3)}},
    "initial_time": lambda a: {"initial_time": a, "final_time": 5},
    "final_time": lambda a: {"final_time": a},
    "singular law of 'v'": lambda a: {"singular": {v: a}},
    "reference": lambda a: {"reference": a},
}


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("kind", VALUES)
def test_a_value_out_of_place_is_one_line_that_names_the_place(kind: str, place: str) -> None:
    with pytest.raises(ProblemError) as caught:
        Problem(**sound(**PLACES[place](VALUES[kind])))
    text = str(caught.value)
    assert text.startswith(f"problem 'toy': {place}")
    assert len(text) < 700
    assert "\n" not in text


@pytest.mark.parametrize("kind", [np.float32(1), np.float64(1), np.int64(1), 1, 1.0])
def test_numbers_of_every_library_are_numbers(kind: Any) -> None:
    problem = Problem(
        **sound(
            running=kind,
            bounds={v: (-kind, kind + kind)},
            start={x: kind, y: kind},
            end={x: 2 * kind},
        )
    )
    assert problem.start_box[0].tolist() == [1.0, 1.0]


# -- expressions and tables: what is wrong -> what the message says

STATED: dict[str, tuple[dict[str, Any], str]] = {
    "modulus of a control": (
        {"running": fabs(v)},
        'v = v_p - v_n:\n  v_p, v_n = controls("v_p v_n")\n  bounds={v_p: (0, 1), ',
    ),
    "modulus in a rate": ({"dynamics": {x: y, y: v - fabs(v)}}, "v_p + v_n for fabs(v)"),
    "positive part": ({"running": fmax(v, 0)}, "v_p for fmax(v, 0)"),
    "negative part": ({"running": -fmin(v, 0)}, "v = v_p - v_n"),
    "modulus of one sign": ({"running": fabs(v), "bounds": {v: (0, 1)}}, "write v"),
    "modulus of the other": ({"running": fabs(v), "bounds": {v: (-2, 0)}}, "write -v"),
    "quadratic cost": (
        {"running": v**2},
        "which are what socp is for; write it as f0 + v*f1; to keep it, let v be a state",
    ),
    "cubic": (
        {"dynamics": {x: y, y: v**3}},
        "dynamics of 'y' is not affine in control 'v'; a control in a power",
    ),
    "product of controls": (
        {"dynamics": {x: w, y: v * w}, "bounds": {v: (0, 1), w: (0, 1)}},
        "a product of controls",
    ),
    "root": (
        {"running": sqrt(v + 2)},
        "write it as f0 + v*f1; to keep it, let v be a state, its rate the control",
    ),
    "case": ({"dynamics": {x: y, y: if_else(v > 0, 1, 2)}}, "on_v with bounds (0, 1)"),
    "step": ({"running": floor(v)}, "a step"),
    "control in a denominator": ({"running": x / (2 + v)}, "write it as f0 + v*f1"),
    "control in a path": (
        {"path": {"a": v <= x}},
        "path 'a': uses the control 'v'; allowed are states, parameters and times; for",
    ),
    "its scaling": (
        {"path": {"a": v <= x}},
        "a new control s with bounds (0, 1), and c(x, t)*s in the place of v",
    ),
    "sum of controls": (
        {"path": {"a": v + w <= 1}, "dynamics": {x: w, y: v}, "bounds": {v: (0, 1), w: (0, 1)}},
        "a row of several controls (v, w) cannot be expressed",
    ),
    "control in the Mayer term": ({"minimise": v}, "all along the way goes into running"),
    "bound that moves": (
        {"bounds": {v: (0, 1 + sin(time))}},
        "scale the control: write c(x, t)*s for v, with bounds={s: (0, 1)}",
    ),
    "bound by a state": ({"bounds": {v: (0, x)}}, "scale the control"),
    "bound of a state that moves": (
        {"bounds": {v: (-1, 1), x: (0, 1 + time)}},
        "path={'name': x <= ...}",
    ),
    "end by a state": ({"end": {x: y}}, "an end that moves into target"),
    "time by a state": ({"final_time": 2 * k}, "go into target={'name': left == right}"),
    "infinite bound": (
        {"bounds": {v: (-1, math.inf)}},
        "a control needs finite bounds; choose them wider",
    ),
    "unbounded": ({"bounds": {v: (None, 1)}}, "a control needs finite bounds"),
    "missing bounds": (
        {"bounds": {}},
        "control 'v' has no bounds; give bounds={v: (lower, upper)}",
    ),
    "huge bounds": (
        {"bounds": {v: (-1e308, 1e308)}},
        "larger than 1e+100: products of it overflow; choose other units",
    ),
    "huge start": ({"start": {x: 1e200, y: 0}}, "start of 'x': 1e+200, larger than"),
    "crossed": ({"bounds": {v: (1, -1)}}, "bounds of 'v': lower 1.0 > upper -1.0"),
    "no width": ({"bounds": {v: (1, 1)}}, "write the constant in its place"),
    "no horizon": (
        {"final_time": 1e-300},
        "final_time: 1e-300 cannot be told from initial_time 0.0",
    ),
    "drowned horizon": (
        {"initial_time": 1e9, "final_time": 1e9 + 1e-5},
        "cannot be told from initial_time",
    ),
    "before": ({"initial_time": 5, "final_time": 3}, "final_time: 3 is not after initial_time 5"),
    "sine of math": (
        {"dynamics": {x: y, y: v + math.sin(time)}},
        "math.sin(x) and the like give nan for an expression: take sin",
    ),
    "cosine of math": (
        {"running": math.cos(x)},
        "running: nan where a finite value is needed; math.sin(x) and",
    ),
    "division by zero": ({"running": x / 0}, "a division by zero gives inf"),
    "limit at infinity": ({"path": {"a": x <= math.inf}}, "leave a limit out where there is none"),
    "equation along the way": (
        {"path": {"a": x**2 == 3}},
        "where an equation holds all the way, eliminate a state",
    ),
    "relation as a rate": (
        {"dynamics": {x: x**2 == 3, y: v}},
        "relations go into path and target; of two cases, write casadi's if_else",
    ),
    "not equal": ({"path": {"a": x != 3}}, "is no relation; write left <= right or left == right"),
    "both": ({"path": {"a": casadi.logic_and(x <= 1, y <= 1)}}, "is no relation"),
    "rows": ({"path": {"a": casadi.vertcat(x, y) <= 1}}, "is no relation"),
    "true relation": ({"path": {"a": SX(1) <= 2}}, "the relation is True whatever the states are"),
    "cancelling control": (
        {"dynamics": {x: y, y: (v + x) * 2 - 2 * v}},
        "control 'v' does nothing: its terms cancel in all rates",
    ),
    "control times zero": ({"dynamics": {x: y, y: 0 * v}}, "control 'v' acts on nothing"),
    "array as a start": (
        {"start": {x: np.array([0.0, 1.0])}},
        "an array is no interval: write (float(a), float(b))",
    ),
    "DM as an end": ({"end": {x: DM(1)}}, "it holds a DM: float(...) makes a number of it"),
    "MX": (
        {"dynamics": {x: MX.sym("m"), y: v}},
        "socp's symbols are casadi.SX, made by states, controls and parameters",
    ),
    "function": ({"running": lambda: 0}, "call it with symbols: what it returns goes here"),
    "symbol of nobody": (
        {"dynamics": {x: y + SX.sym("y"), y: v}},
        "unknown symbol 'y'; declare it with states",
    ),
    "state of another problem": ({"dynamics": {x: other, y: v}}, "state 'other' has no dynamics"),
    "the same name twice": (
        {"dynamics": {x: y, y: v, states("x"): 1}},
        "the name 'x' is used for two symbols",
    ),
    "slash in the name": ({"name": "a/b"}, "name: 'a/b' holds '/'; results are named after it"),
    "null in the name": ({"name": "a\0b"}, r"name: 'a\x00b' holds '\x00'"),
    "line end in the name": ({"name": "a\nb"}, r"holds '\n'"),
    "half a character": ({"name": "\udce9"}, r"holds '\udce9'"),
    "dots": ({"name": ".."}, "name: '..' starts with a dot"),
    "long name": ({"name": "a" * 300}, "name: has 300 characters; at most 100"),
    "blank in a path's name": ({"path": {"a b": x <= 2}}, "path: 'a b': a word names it as b[a b]"),
    "bracket in a path's name": ({"path": {"a]": x <= 2}}, "may hold no blank, [ ] or ;"),
    "path as a list": ({"path": [x <= 1]}, "path: [SX((x<=1))] where a table {...: ...} is needed"),
    "unprintable key": ({"start": {Evil(): 0}}, "a Evil that cannot be printed"),
    "reference of texts": (
        {"reference": Reference(objective="a")},
        "reference objective: 'a' where a number",
    ),
    "switches of a reference": (
        {"reference": Reference(objective=1, switches=3)},
        "reference switches: 3 where times",
    ),
    "list of guesses": (
        {"guess": {x: np.linspace(0, 1, 101)}},
        "a number, a pair (start, end) or an expression of time",
    ),
    "maximise": (
        {"maximise": x},
        "a problem has no 'maximise'; write minimise=-(...), with a minus sign",
    ),
    "maximize": ({"maximize": x}, "write minimise=-(...)"),
    "minimize": ({"minimize": x}, "write minimise="),
    "misspelt part": ({"dynamic": {}}, "a problem has no 'dynamic'; did you mean 'dynamics'?"),
    "controls as a part": ({"controls": [v]}, "controls are named by bounds="),
    "unheard-of part": ({"zzz": 1}, "a problem has no 'zzz'; there are name, dynamics, bounds"),
}


@pytest.mark.parametrize("case", STATED)
def test_a_problem_out_of_bounds_says_what_to_write(case: str) -> None:
    changes, message = STATED[case]
    with pytest.raises(ProblemError) as caught:
        Problem(**sound(**changes))
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: states("a" * 10_000), "a name of 10000 characters; at most 100"),
        (lambda: states(""), "name at least one state"),
        (lambda: states("t"), "'t' is the name of time; choose another"),
        (lambda: controls("u.x"), "'u.x' is no name"),
        (lambda: controls("u u"), "'u' is declared twice"),
        (lambda: states(["x"]), "give the names in one string, such as states('a b')"),
        (lambda: states(Evil()), "a Evil that cannot be printed"),
        (lambda: initial(v), "initial(v): only a declared state has an initial value"),
        (lambda: initial(Evil()), "only a declared state"),
        (lambda: initial([]), "initial([]): only"),
    ],
)
def test_a_bad_symbol_is_refused(call: Callable[[], Any], message: str) -> None:
    with pytest.raises(ProblemError) as caught:
        call()
    assert message in str(caught.value)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize(
    "name", ["casadi", "__class__", "θ", "lambda_x", "problem", "self", "print"]
)
def test_a_state_may_have_any_name(name: str) -> None:
    problem = Problem(**sound(dynamics={states(name): y, y: v}, start={}, end={y: 1}))
    assert problem.state_names == (name, "y")
    assert default_guess(problem).state_names == (name, "y")


def test_an_expression_of_many_thousand_operations_is_read() -> None:
    deep = x
    for _ in range(5000):  # deeper than Python's own stack goes
        deep = sin(deep) + 1
    problem = Problem(**sound(dynamics={x: y, y: v + deep}))
    assert formula(problem.dynamics[y]).count("sin") == 5000


# -- methods

METHODS: dict[str, tuple[str, dict[str, Any], str]] = {
    "huge steps": (
        "euler-ipopt",
        {"steps": 10**21},
        "steps=1000000000000000000000, but it must be at most 100000",
    ),
    "no steps": ("trapezoidal", {"steps": -1}, "steps=-1, but it must be at least 1"),
    "nan steps": ("trapezoidal", {"steps": math.nan}, "steps=nan, but it should be a whole number"),
    "half a step": ("trapezoidal", {"steps": 1.5}, "steps=1.5, but it should be a whole number"),
    "true steps": ("trapezoidal", {"steps": True}, "steps=True, but it should be a whole number"),
    "text": ("hermite-simpson", {"steps": "many"}, "steps='many', but it should be a whole number"),
    "nothing": ("lgr", {"points": None}, "points=None, but it should be a whole number"),
    "many points": (
        "lgr-multiphase",
        {"points": 10**6},
        "points=1000000, but it must be at most 100",
    ),
    "many phases": (
        "lgr-multiphase",
        {"phases": 10**6},
        "phases=1000000, but it must be at most 1000",
    ),
    "nan tolerance": (
        "lgr-multiphase",
        {"tolerance": math.nan},
        "tolerance=nan, but it should be a number, finite",
    ),
    "word of a number": ("lgr-multiphase", {"word": 3}, "word=3, but it should be a text"),
    "digits": ("auto", {"digits": 99}, "digits=99, but it must be at most 15"),
    "seconds": ("mboc", {"time": math.inf}, "time=inf, but it should be a number, finite"),
    "unprintable": (
        "euler-ipopt",
        {"steps": Evil()},
        "a Evil that cannot be printed, but it should be a whole number",
    ),
}


@pytest.mark.parametrize("case", METHODS)
def test_an_option_of_a_wrong_kind_or_size_is_refused(case: str, registry: Registry) -> None:
    name, options, message = METHODS[case]
    with pytest.raises(MethodError) as caught:
        check_options(registry.method(name)(**options))
    assert str(caught.value).startswith(name)
    assert message in str(caught.value)


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("", "no arcs for control 'v'"),
        (";;", "no arcs for control 'v'"),
        ("+ ?", "'?' is no kind of arc"),
        ("w: +", "'w: +' should start with a control and a colon; controls: v"),
        ("+ " * 3000, "3000 arcs; at most 1000"),
        ("s[a]", "names a constraint, which only a boundary arc has"),
        ("x" * 5000, "(5000 characters)"),
        ("v: +; v: -", "control 'v' is given twice"),
    ],
)
def test_a_word_that_is_nonsense_is_refused(word: str, message: str) -> None:
    with pytest.raises(MethodError) as caught:
        Word.parse(word, ["v"])
    assert message in str(caught.value)
    assert len(str(caught.value)) < 400


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"dynamics": {x: y, y: 1}, "bounds": {}, "end": {}},
            "no control; a problem to solve has one at least",
        ),
        (
            {"dynamics": {x: y, y: v, other: w}, "bounds": {v: (-1, 1), w: (-1, 1)}},
            "control 'w' does nothing: it moves",
        ),
        ({"start": {x: 1}}, MET),
        ({"start": {x: (0, 3)}, "end": {x: (2, 4)}}, MET),
        ({"minimise": MISSING, "running": 2, "start": {x: 1}}, MET),
        ({"minimise": MISSING, "running": 1 - v, "start": {x: 1}}, MET),
        ({"end": {}, "target": {"round": x == initial(x), "slow": y <= 0}}, MET),
        ({"start": {x: 1, y: 0}, "path": {"left": x + y <= 1}}, MET),
        ({"start": {x: 0.1, y: 0.2}, "end": {}, "target": {"sum": x + y == 0.3}}, MET),  # rounded
        ({"start": {x: 1}, "minimise": 3 * final_time - 2}, MET),
    ],
)
def test_a_problem_with_nothing_to_decide_is_not_solved(
    changes: Any, message: str, registry: Registry
) -> None:
    problem = Problem(**sound(**changes))
    with pytest.raises(ProblemError) as caught:
        run(registry.method("euler-ipopt")(steps=5), problem, default_guess(problem))
    assert str(caught.value).startswith(f"problem 'toy': {message}")


@pytest.mark.parametrize(
    "changes",
    [
        {"start": {x: 1}, "final_time": (2, None)},
        {"start": {x: 1}, "minimise": final_time - x},
        {"start": {x: 1}, "minimise": MISSING, "running": 0.9 + v},
        {"start": {x: 1}, "minimise": MISSING, "running": x**2},
        {"start": {x: (0, 1)}, "end": {x: (2, 4)}},
        {"end": {}, "target": {"other": x == 1 + initial(x)}},
        {"start": {x: 1, y: 0}, "path": {"left": x + y <= 0.5}},
        {"start": {x: (0, 3), y: 0}, "end": {}, "target": {"right": x >= 1}},
        {"start": {x: 1, y: 0}, "target": {"at": x >= k}, "bounds": {v: (-1, 1), k: (0, 3)}},
        # the ways are small, not none
        {"start": {x: 5e-4, y: 0}, "end": {}, "target": {"near": x**2 <= 1e-8}},
        {"start": {x: 0, y: 0}, "end": {}, "target": {"away": x - 5e-7 == 0}},
        {"start": {x: 1, y: 0}, "target": {"late": final_time - initial_time >= 1e-7}},
        {"start": {x: 1, y: 0}, "target": {"slow": x / final_time <= 1}},  # no value at all
        # the objective at the initial time, which is not zero, is one of the states
        {
            "start": {x: 1},
            "minimise": -initial_time * x,
            "initial_time": 2,
            "final_time": (2, 4),
        },
        # steps have no slope: less than nothing after a time
        {"start": {x: 1}, "minimise": if_else(final_time > 1, -1, 0)},
        {"start": {x: 1}, "minimise": if_else(final_time > 1, -x, 0)},
        {"start": {x: 1}, "minimise": casadi.sign(1 - final_time)},
        {"start": {x: 1}, "minimise": -final_time, "final_time": (0, 9)},
    ],
)
def test_what_may_need_a_motion_is_not_taken_for_met_at_once(changes: Any) -> None:
    check_solvable(Problem(**sound(**changes)))


@pytest.mark.slow
def test_a_linear_solver_that_ends_the_process_is_refused_by_name() -> None:
    """Which ones are there depends on the installation; MUMPS is part of it, and this one nobody
    has.
    """
    assert Ipopt({"linear_solver": "mumps"}).options == {"linear_solver": "mumps"}
    with pytest.raises(
        MethodError, match=r"pardiso.*: it .*; linear solvers that work here: .*mumps"
    ):
        Ipopt({"linear_solver": "pardiso", "pardisolib": "no-such-library.so"})


# -- the command line

CLASS = "class E(Exception):\n    def __str__(self): {}\nraise E()\n"
FILES: dict[str, tuple[str | bytes, int, str]] = {
    "GeneratorExit": ("raise GeneratorExit", 3, "line 1: GeneratorExit"),
    "KeyboardInterrupt": ("raise KeyboardInterrupt", 130, "interrupted; nothing was written"),
    "own BaseException": ("class E(BaseException): pass\nraise E('x')", 3, "line 2: E: x"),
    "exit": ("raise SystemExit(3)", 3, "line 1: the file calls exit(3)"),
    "exit by text": ("import sys\nsys.exit('bye')", 3, "line 2: the file calls exit(bye)"),
    "exit by a thing": (
        "class E:\n    def __str__(self): 1/0\n    __repr__ = __str__\nraise SystemExit(E())",
        3,
        "its text cannot be printed",
    ),
    "unprintable": (CLASS.format("1/0"), 3, "line 3: E: its text cannot be printed"),
    "fatally unprintable": (
        CLASS.format("raise SystemExit"),
        3,
        "line 3: E: its text cannot be printed",
    ),
    "long text": ("raise ValueError('a' * 10**6)", 3, "(1000000 characters)"),
    "group": (
        "raise ExceptionGroup('a', [ValueError(1)])",
        3,
        "line 1: ExceptionGroup: a (1 sub-exception)",
    ),
    "recursion": ("def f(): f()\nf()", 3, "RecursionError: maximum recursion depth exceeded"),
    "import": (
        "import no_such_module",
        3,
        "line 1: ModuleNotFoundError: No module named 'no_such_module'",
    ),
    "import from socp": (
        "from socp import stats",
        3,
        "line 1: ImportError: cannot import name 'stats' from 'socp'",
    ),
    "syntax": ("x = (((", 3, "line 1: SyntaxError: '(' was never closed"),
    "indentation": ("  x = 1\n y = 2", 3, "line 1: IndentationError: unexpected indent"),
    "null byte": (b"x = 1\0", 3, "source code string cannot contain null bytes"),
    "utf-16": ("x = 1".encode("utf-16"), 3, "not a Python file: "),
    "latin": (b"# caf\xe9\nx = 1", 3, "not a Python file: "),
    "coding": ("# coding: nonsense\n", 3, "unknown encoding: nonsense"),
    "empty": ("", 3, "defines no 'problem'; assign one: problem = Problem(...)"),
    "blank": ("\n\n# nothing\n", 3, "defines no 'problem'"),
    "list": (
        "problem = [1]",
        3,
        "'problem' is a list, not a Problem; assign one: problem = Problem(...)",
    ),
    "list of problems": (
        FILE + "problem = [problem]",
        3,
        "give each a name of its own, such as first = ...",
    ),
    "dict of problems": (FILE + "problem = {1: problem}", 3, "give each a name of its own"),
    "function": (
        "def problem(): pass",
        3,
        "'problem' is a function, not a Problem; if it makes one, call it",
    ),
    "class": ("from socp import Problem as problem", 3, "'problem' is a type, not a Problem"),
    "none": ("problem = None", 3, "'problem' is a NoneType, not a Problem"),
    "another name": (FILE.replace("problem =", "mine ="), 3, "(it has mine); write"),
    "beside another": (
        FILE.replace("problem =", "mine =") + "problem = 3",
        3,
        "'problem' is an int, not a Problem; write",
    ),
    "deleted": (FILE + "del problem", 3, "defines no 'problem'"),
    "truth": (
        FILE.replace("v: u}", "v: u if x > 0 else -u}"),
        3,
        "write casadi's if_else(x > 0, a, b)",
    ),
    "max": (FILE.replace("v: u}", "v: u + max(x, 0)}"), 3, "fmax(a, b)"),
    "chain": (FILE.replace("end=", "path={'a': 0 <= x <= 2}, end="), 3, "or two relations"),
    "delay": (
        FILE.replace("v: u}", "v: u + x(-1)}"),
        3,
        "a delay, x(time - 1), cannot be expressed",
    ),
    "MX": (
        FILE.replace("v: u}", "v: u + __import__('casadi').MX.sym('m')}"),
        3,
        "which are casadi.SX, not MX",
    ),
    "two texts": (
        "from socp import states\nstates('x', 'y')",
        3,
        "give the names in one string, such as states('a b')",
    ),
    "no keywords": (
        "from socp import Problem\nProblem('a')",
        3,
        "every part has a name: Problem(name=...,",
    ),
    "no bounds": (
        FILE.replace(", bounds={u: (-1, 1)}", ""),
        3,
        "bounds={u: (lower, upper)} names the controls",
    ),
    "square": (
        FILE.replace("v: u}", "v: u**2}"),
        3,
        "dynamics of 'v' is not affine in control 'u'; a control in a power",
    ),
}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Stand in an empty directory with the file cart.py."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "cart.py").write_text(FILE)
    yield tmp_path
    assert Path.cwd() == tmp_path


@pytest.mark.parametrize("case", FILES)
def test_a_bad_problem_file_is_one_message(
    case: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, code, message = FILES[case]
    (here / "bad.py").write_bytes(source if isinstance(source, bytes) else source.encode())
    assert main(["solve", "bad.py", "-m", "euler-ipopt"]) == code
    out, err = capsys.readouterr()
    assert message in err
    assert "Traceback" not in err
    assert len(err) < 1200
    assert out == ""
    assert sorted(each.name for each in here.iterdir() if each.suffix == ".json") == []


LONG = "a" * 300
ASKED: dict[str, tuple[str, int, str]] = {
    "nothing": ("solve ''", 3, "an empty name where a problem is needed"),
    "directory": ("solve .", 3, ". is a directory; give a problem file inside it"),
    "device": ("solve /dev/zero", 3, "/dev/zero is no file but a device or a pipe"),
    "long name": (f"solve {LONG}", 3, "unknown problem 'aaa"),
    "long file": (f"solve {LONG}.py", 3, "File name too long"),
    "long output": (f"solve cart.py --out {LONG}", 2, "File name too long; give another name"),
    "output in nothing": ("solve cart.py --out no/x.json", 2, "there is no directory no"),
    "output in brackets": (
        "solve cart.py --out '[red]/x.json'",
        2,
        "--out [red]/x.json: there is no directory [red]",
    ),
    "builtin": ("solve cart.py:print", 3, "defines no 'print'"),
    "dunder": ("solve cart.py:__class__", 3, "defines no '__class__'"),
    "long attribute": (f"solve cart.py:{LONG}", 3, "(300 characters)"),
    "many steps": (
        "solve cart.py -m euler-ipopt -o steps=1000000000000000000000",
        2,
        "at most 100000",
    ),
    "many steps, short": ("solve cart.py -m euler-ipopt -o steps=1e21", 2, "at most 100000"),
    "infinite steps": (
        "solve cart.py -m euler-ipopt -o steps=1e999",
        2,
        "steps='1e999', but it should be a whole number",
    ),
    "nan steps": (
        "solve cart.py -m euler-ipopt -o steps=nan",
        2,
        "steps='nan', but it should be a whole number",
    ),
    "negative": ("solve cart.py -m euler-ipopt -o steps=-1", 2, "it must be at least 1"),
    "no value": ("solve cart.py -o =3", 2, "write KEY=VALUE"),
    "points": (
        "solve cart.py -m lgr-multiphase -o points=1e6",
        2,
        "points=1000000, but it must be at most 100",
    ),
    "lengths": (
        "solve cart.py -m lgr-multiphase -o 'word=+ -' -o 'lengths=nan nan'",
        2,
        "should be 2 positive numbers",
    ),
    "infinite lengths": (
        "solve cart.py -m lgr-multiphase -o 'word=+ -' -o 'lengths=inf 1'",
        2,
        "2 positive numbers",
    ),
    "boundary of nothing": (
        "solve cart.py -m lgr-multiphase -o word=b",
        2,
        "no state constraint depends on it: none does",
    ),
    "digits": ("solve cart.py --digits 99", 2, "digits=99, but it must be at most 15"),
    "option of Ipopt": (
        "solve cart.py -m lgr -o ipopt.toll=1",
        2,
        "ipopt has no option 'toll'; did you mean 'tol'?",
    ),
    "tolerance": (
        "solve cart.py -m lgr -o ipopt.tol=inf",
        2,
        "ipopt.tol: inf is not allowed; allowed: real, 0 < tol",
    ),
    "linear solver": (
        "solve cart.py -m lgr -o ipopt.linear_solver=lapack",
        2,
        "'lapack' is not allowed; allowed: ma27",
    ),
    "guess": ("solve cart.py --guess cart.py", 2, "--guess cart.py: not a socp result"),
    "guess directory": ("solve cart.py --guess .", 2, "--guess ."),
    "jobs": ("census cart.py -j 1000000000", 2, "1000000000 is not in the range 1<=x<=1024"),
    "starts": ("census cart.py --starts 1000000000000", 2, "is not in the range 1<=x<=10000"),
    "switches": (
        "frontier cart.py --max-switches 100000",
        2,
        "100000 is not in the range 0<=x<=100",
    ),
    "width": ("plot cart.json --width nan", 2, "--width nan: it must be a number of inches"),
    "plot in nothing": ("plot cart.json -o no/x.png", 2, "-o no/x.png: there is no directory no"),
    "plot's ending": ("plot cart.json -o x.gif", 2, "figures end with .png, .svg, .pdf"),
    "long plot": (f"plot cart.json -o {LONG}.png", 2, "File name too long"),
    "binaries": ("export cart.py --format nl --switches 100000", 2, "100000 is not in the range"),
    "export's points": (
        "export cart.py --format nl --points 100000",
        2,
        "100000 is not in the range",
    ),
    "export's ending": ("export cart.json -o x.foo", 2, "which format? give --format csv|netcdf"),
    "export in nothing": ("export cart.py -o no/x.nl", 2, "-o no/x.nl: there is no directory no"),
    "command": ("slove cart.py", 2, "No such command 'slove'; did you mean 'solve'?"),
    "no command": ("cart.py", 2, "to solve a problem: socp solve cart.py"),
    "a problem for a result": ("plot cart.py -o x.svg", 1, "socp solve cart.py writes one"),
    "a name for a result": ("check fuller", 1, "this is a problem, and the command takes"),
    "no such result": ("check no.json", 1, "no.json: No such file"),
    "describe nothing": ("describe ''", 2, "no method or problem ''"),
    "describe a long name": (f"describe {LONG}", 2, "(300 characters)"),
    "method": ("solve cart.py -m ''", 2, "unknown method ''"),
}


@pytest.mark.parametrize("case", ASKED)
def test_a_bad_command_is_one_message(
    case: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command, code, message = ASKED[case]
    assert main(shlex.split(command)) == code
    out, err = capsys.readouterr()
    assert message in err
    assert "Traceback" not in err
    assert out == ""
    assert [each.name for each in here.iterdir()] == ["cart.py"]


def test_a_file_cannot_change_the_command_that_runs_it(
    here: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """It prints, closes the streams, moves away and spoils what is Python's; the answer comes out
    all the same.
    """
    (here / "away").mkdir()
    spoilt = """
import os, sys, warnings
import numpy
print("printed by the file")
os.chdir("away")
numpy.seterr(all="raise")
warnings.simplefilter("error")
sys.setrecursionlimit(200)
sys.stdout.close()
os.close(1)
sys.stdout = sys.stderr = None
sys.path.clear()
sys.modules.pop(__name__)
"""
    (here / "spoilt.py").write_text(FILE + spoilt)
    assert (
        main(["solve", "spoilt.py", "-m", "euler-ipopt", "-o", "steps=10", "--json", "--quiet"])
        == 0
    )
    out, err = capfd.readouterr()
    assert json.loads(out)["outcome"] == "FEASIBLE"
    assert err == "printed by the file\n"
    assert (here / "cart.socp.json").exists()
    assert list((here / "away").iterdir()) == []


@pytest.mark.usefixtures("here")
def test_a_check_of_an_unknown_problem_says_how_to_name_its_file(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["solve", "cart.py", "-m", "euler-ipopt", "-o", "steps=10", "--quiet"]) == 0
    old = json.loads(Path("cart.socp.json").read_text())  # as results were before they carried it
    Path("cart.socp.json").write_text(json.dumps(older(old)))
    assert main(["check", "cart.socp.json"]) == 3
    said = capsys.readouterr().err
    assert "carries no statement of its problem 'cart', and no such problem is registered" in said
    assert "--problem FILE" in said


def test_a_failed_run_shows_the_horizon_that_is_fixed(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "far.py").write_text(FILE.replace("x: 1, v: 0}", "x: 100, v: 0}, final_time=7"))
    assert main(["solve", "far.py", "-m", "euler-ipopt", "-o", "steps=20", "--quiet"]) == 1
    out = capsys.readouterr().out
    for text in (
        "no answer: ",
        "objective    none: the point is infeasible",
        "final time   7",
        "word         none: ",
    ):
        assert text in out


def test_signs_of_formulas_do_not_double() -> None:
    assert formula(-(-0.02 * x)) == "0.02*x"
    assert formula(y - (-0.02 * x)) == "y + 0.02*x"
    assert formula(y + (-0.02 * x) * y) == "y - 0.02*x*y"


@pytest.mark.slow
def test_a_long_formula_is_cut_unless_all_is_asked_for(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    long = "+".join(f"0.{n}*x**{n}" for n in range(11, 200))
    (here / "long.py").write_text(FILE.replace("v: u}", f"v: u, **{{states('z'): {long}}}}}"))
    assert main(["describe", "long.py"]) == 0
    out = capsys.readouterr().out
    assert "characters; --full shows all)" in out
    assert "x**199" not in out
    assert main(["describe", "long.py", "--full"]) == 0
    assert "x**199" in capsys.readouterr().out


def test_replacing_a_part_of_a_problem_still_works() -> None:
    assert dataclasses.replace(Problem(**sound()), final_time=3).final_time_box == (3.0, 3.0)


@pytest.mark.slow
def test_threads_of_a_file_do_not_keep_the_command(here: Path) -> None:
    endless = (
        "import threading, time\ndef f():\n    while True: "
        "time.sleep(0.05)\nthreading.Thread(target=f).start()\n"
    )
    (here / "endless.py").write_text(endless + "1/0\n")
    command = [sys.executable, "-m", "socp.cli", "solve", "endless.py"]
    said = subprocess.run(
        command, capture_output=True, text=True, timeout=60, check=False, env={**os.environ}
    )
    assert said.returncode == 3
    assert "line 5: ZeroDivisionError" in said.stderr

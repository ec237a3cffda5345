"""Corrupted results: each is refused with the field named, or judged and not certified, or
unharmed: never believed.

Genuine results of three problems are changed in one place each, as a slip of an editor, a lost
block of a disk or a forger would. `socp check` answers with exit code 1 and `error: FILE: not a
socp result: FIELD: ...` where the file is none, with exit code 1 and its reasons where it is no
extremal, and with 0 where what was changed says nothing.
"""

import copy
import errno
import json
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest
from carts import Said

from socp import run
from socp.cli import main
from socp.cli.session import Session
from socp.errors import SolveError
from socp.methods.guess import default_guess
from socp.model.data.files import to_json
from socp.model.problem import Problem
from socp.process.files import LARGEST, read_text
from socp.registry.plugins import Registry
from socp.registry.standard import parameter

Document = dict[str, Any]
Path_ = tuple[Any, ...]
WORDS = {"double_integrator_vlimit": "u: + b -", "jacobson_1": "u: - s", "parameter": "u: +"}
LEAST = 300  # corrupted results that are tried at least


@pytest.fixture(scope="module")
def genuine(registry: Registry) -> dict[str, str]:
    """Return certified results of three problems by name: a boundary arc, a singular arc, a
    parameter.
    """
    found = {}
    for name, word in WORDS.items():
        problem = parameter().problem if name == "parameter" else registry.problem(name)
        solution = run(
            registry.method("lgr-multiphase")(word=word), problem, default_guess(problem)
        )
        assert solution.extremal
        found[name] = to_json(solution)
    return found


@pytest.fixture
def check(
    tmp_path: Path,
    registry: Registry,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Callable[[Document | str | bytes], Said]:
    """Return a function that puts a result into a file and has it checked."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(Session, "registry", lambda _self, **_: registry)

    def checked(content: Document | str | bytes) -> Said:
        text = json.dumps(content) if isinstance(content, dict) else content
        Path("result.json").write_bytes(text if isinstance(text, bytes) else text.encode())
        code = main(["check", "result.json"])
        seen = capsys.readouterr()
        assert "Traceback" not in seen.out + seen.err
        assert "internal error" not in seen.err
        return Said(code, seen.out, seen.err)

    return checked


def refused(said: Said, names: str) -> None:
    assert (said.code, said.out) == (1, "")
    assert said.err.startswith("error: result.json: not a socp result: ")
    assert names in said.err
    assert len(said.err.splitlines()) == 1
    assert len(said.err) < 700


def uncertified(said: Said) -> None:
    assert said.code == 1
    assert "not extremal" in said.out or "not feasible" in said.out
    assert "error" not in said.err


def unharmed(said: Said) -> None:
    assert (said.code, said.err) == (0, "")


def at(document: Document, place: Path_) -> tuple[Any, Any]:
    """Return the container of a place and its key there."""
    value: Any = document
    for key in place[:-1]:
        value = value[key]
    return value, place[-1]


def changed(text: str, place: Path_, value: Any) -> Document:
    document: Document = json.loads(text)
    container, key = at(document, place)
    container[key] = value
    return document


@pytest.mark.slow
def test_the_genuine_ones_are_certified(genuine: dict[str, str], check: Any) -> None:
    for text in genuine.values():
        unharmed(check(text))


# -- every field gone

RECORDS: tuple[Path_, ...] = (
    (),
    ("arcs", 0),
    ("arcs", 1),
    (
        "judgement",
        "verdict",
    ),
    ("judgement", "verdict", "findings", 0),
    ("judgement", "verified", 0),
    (
        "origin",
        "statement",
    ),
    ("origin", "statement", "about"),
)


def fields(record: Path_) -> tuple[str, ...]:
    """Return the fields that a record of a result has to have, from the layout itself: those of
    later layouts have a value for files without them.
    """
    from socp.model.data import schema, stated

    last = next((key for key in reversed(record) if isinstance(key, str)), "")
    kinds: dict[str, Any] = {
        "": schema.Result,
        "effort": schema.Effort,
        "judgement": schema.Judgement,
        "origin": schema.Origin,
        "arcs": schema.Arc,
        "verdict": schema.Verdict,
        "findings": schema.Finding,
        "verified": schema.Feasibility,
        "statement": stated.Statement,
        "about": stated.About,
    }
    return tuple(each.name for each in msgspec.structs.fields(kinds[last]) if each.required)


GONE = [(record, field) for record in RECORDS for field in fields(record)]


@pytest.mark.parametrize(
    ("record", "field"), GONE, ids=lambda each: ".".join(map(str, each)) or "result"
)
def test_without_a_field_it_is_no_result(
    record: Path_, field: str, genuine: dict[str, str], check: Any
) -> None:
    document: Document = json.loads(genuine["double_integrator_vlimit"])
    container, key = at(document, (*record, field))
    del container[key]
    refused(check(document), field)


@pytest.mark.parametrize("record", RECORDS, ids=str)
def test_with_a_field_more_it_is_no_result(
    record: Path_, genuine: dict[str, str], check: Any
) -> None:
    place = (*record, "surprise")
    refused(check(changed(genuine["jacobson_1"], place, 1)), "surprise")


# -- every field of another type

WRONG: dict[str, Any] = {
    "null": None,
    "text": "text",
    "list": [],
    "table": {},
    "true": True,
    "-1": -1,
    "1e308": 1e308,
    "10**400": 10**400,
    "nested": [[[[]]]],
    "2.5": 2.5,
}
NUMBERS, LIMITS = {"-1", "1e308", "2.5"}, {"-1", "2.5"}
# place -> what may stand there as well; anything else is refused
TYPES: dict[Path_, set[str]] = {
    ("schema",): set(),
    ("problem",): set(),
    (
        "origin",
        "method",
    ): {"text"},
    ("arcs",): set(),
    ("arcs", 0): set(),
    ("arcs", 0, "t"): set(),
    ("arcs", 0, "t", 3): set(),
    ("arcs", 0, "x"): set(),
    ("arcs", 0, "x", 0): set(),
    ("arcs", 0, "x", 0, 3): {"null", *LIMITS},
    ("arcs", 0, "u"): set(),
    ("arcs", 0, "u", 0, 3): {"null", *LIMITS},
    ("arcs", 0, "costate", 0, 3): {"null", *LIMITS},
    ("arcs", 0, "mesh"): set(),
    ("arcs", 0, "mesh", 1): set(),
    ("arcs", 0, "side"): set(),
    ("arcs", 0, "modes"): set(),
    ("arcs", 0, "modes", 0): set(),
    ("arcs", 0, "multipliers"): {"table"},
    ("arcs", 1, "multipliers", "v.upper"): set(),
    ("arcs", 1, "multipliers", "v.upper", 2): {"null", *LIMITS},
    ("objective",): {"null", *NUMBERS},
    ("stop",): set(),
    ("message",): {"text"},
    ("state_names",): set(),
    ("state_names", 0): set(),
    ("control_names",): set(),
    ("control_names", 0): set(),
    ("parameters",): {"table"},
    (
        "origin",
        "options",
    ): {"table"},
    (
        "origin",
        "versions",
    ): {"table"},
    ("origin", "versions", "socp"): {"text"},
    (
        "effort",
        "iterations",
    ): set(),
    (
        "effort",
        "seconds",
    ): {"table"},
    ("effort", "seconds", "solve"): {"null", *NUMBERS},
    (
        "effort",
        "trace",
    ): {"table"},
    ("effort", "trace", "objective"): {"list"},
    (
        "judgement",
        "structure",
    ): {"table"},
    ("judgement", "structure", "u"): set(),
    ("judgement", "structure", "u", 0): set(),
    ("judgement", "structure", "u", 0, 0): set(),
    ("judgement", "structure", "u", 0, 1): {"-1"},
    (
        "judgement",
        "verified",
    ): {"list"},
    ("judgement", "verified", 0): set(),
    ("judgement", "verified", 0, "miss"): {"null", *NUMBERS},
    ("judgement", "verified", 0, "miss_at"): {"text"},
    ("judgement", "verified", 0, "feedback"): {"true"},
    ("judgement", "verified", 0, "end"): {"list"},
    (
        "judgement",
        "verdict",
    ): {"null"},
    ("judgement", "verdict", "findings"): {"list"},
    ("judgement", "verdict", "digits"): set(),
    ("judgement", "verdict", "margins"): {"table"},
    ("judgement", "verdict", "switch_errors"): {"list"},
    (
        "effort",
        "nodes",
    ): {"list"},
    (
        "effort",
        "meshes",
    ): {"list"},
    (
        "judgement",
        "agreement",
    ): {"null"},
    ("extremal",): {"null", "true"},
    ("word",): {"text"},
    ("switches",): {"list"},
    (
        "origin",
        "unstated",
    ): {"text"},
    ("origin", "statement", "name"): set(),
    ("origin", "statement", "states"): set(),
    ("origin", "statement", "nodes"): set(),
    ("origin", "statement", "nodes", 0): set(),
    ("origin", "statement", "bounds"): set(),
    ("origin", "statement", "bounds", "u"): set(),
    ("origin", "statement", "start", "x", 0): set(),
    ("origin", "statement", "dynamics"): set(),
    ("origin", "statement", "dynamics", "x"): set(),
    ("origin", "statement", "final_time"): set(),
    ("origin", "statement", "fingerprint"): set(),
    ("origin", "statement", "about"): set(),
    ("origin", "statement", "about", "title"): {"text"},
    ("origin", "statement", "about", "units"): {"table"},
    ("origin", "statement", "about", "reference"): {"null"},
    ("origin", "statement", "about", "guess"): {"table"},
}
# of these, what stands there is looked at: the rest is what a file says of itself
JUDGED = {("arcs", 0, "x", 0, 3), ("arcs", 0, "u", 0, 3), ("objective",)}
RETYPED = [(place, wrong) for place in TYPES for wrong in WRONG]


@pytest.mark.parametrize("place", TYPES, ids=lambda each: ".".join(map(str, each)))
def test_another_type_is_refused_or_says_nothing(
    place: Path_, genuine: dict[str, str], check: Any
) -> None:
    text = genuine["double_integrator_vlimit"]
    names = next(key for key in reversed(place) if isinstance(key, str))
    for wrong, value in WRONG.items():
        said = check(changed(text, place, value))
        if wrong not in TYPES[place]:
            assert names in said.err or "[...]" in said.err or "statement" in said.err, (
                wrong,
                said,
            )
            refused(said, "")
        elif place in JUDGED:
            uncertified(said)
        else:
            unharmed(said)


# -- what fits the layout and is wrong all the same

MODES = (
    "x",
    "?",
    "B",
    "",
    " ",
    "+-",
    "++",
    "upper",
    "S",
    "b[nosuch]",
    "b[]",
    "b[v.upper",
    "s[v.upper]",
    "*[x]",
    "−",
    "b[v.lower2]",
    "b[__import__('os')]",
    "+ ",
    "\x1b[31m+",
)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", WORDS)
def test_modes_that_are_none_are_refused(
    name: str, mode: str, genuine: dict[str, str], check: Any
) -> None:
    count = len(json.loads(genuine[name])["arcs"])
    for k in range(count):
        said = check(changed(genuine[name], ("arcs", k, "modes", 0), mode))
        refused(said, f"arcs[{k}].modes")
        assert "\x1b" not in said.err


def scaled(values: Any, by: float, plus: float = 0.0) -> Any:
    return (
        [scaled(each, by, plus) for each in values]
        if isinstance(values, list)
        else values * by + plus
    )


def each_arc(document: Document, change: Callable[[Document], None]) -> None:
    for arc in document["arcs"]:
        change(arc)


def moved(document: Document, by: float) -> None:
    """Move the last time at which arcs meet, or the final time where there is one arc."""
    arcs = document["arcs"]
    first = arcs[-2 if len(arcs) > 1 else -1]["t"]
    start, end = first[0], first[-1]
    first[:] = [start + (t - start) * (end + by - start) / (end - start) for t in first]
    if len(arcs) > 1:
        last = arcs[-1]["t"]
        final = last[-1]
        last[:] = [end + by + (t - last[0]) * (final - end - by) / (final - last[0]) for t in last]


def switched(document: Document, mode: str) -> None:
    arc = document["arcs"][0]
    arc["modes"] = [mode]


def bumped(values: list[float], by: float) -> None:
    values[len(values) // 2] += by


def wrong_objective(document: Document, by: float) -> None:
    document["objective"] = document["objective"] * (1 + by) + by


# changes of a genuine result that is judged and not certified afterwards
FORGED: dict[str, Callable[[Document], None]] = {
    **{
        f"switch moved by {by}": lambda d, by=by: moved(d, by)
        for by in (1e-2, -1e-2, 1e-3, -1e-3, 1e-4)
    },
    **{
        f"objective off by {by}": lambda d, by=by: wrong_objective(d, by)
        for by in (1.0, -1e-2, 1e-4, -1e-5)
    },
    **{
        f"controls times {by}": lambda d, by=by: each_arc(
            d, lambda arc: arc.update(u=scaled(arc["u"], by))
        )
        for by in (0.0, 0.5, 0.999, 1.001, -1.0)
    },
    **{
        f"controls plus {by}": lambda d, by=by: each_arc(
            d, lambda arc: arc.update(u=scaled(arc["u"], 1, by))
        )
        for by in (1e-3, -1e-4)
    },
    **{
        f"states plus {by}": lambda d, by=by: each_arc(
            d, lambda arc: arc.update(x=scaled(arc["x"], 1, by))
        )
        for by in (1.0, 1e-2, -1e-4)
    },
    **{
        f"one state off by {by}": lambda d, by=by: bumped(d["arcs"][0]["x"][0], by)
        for by in (1.0, 1e-2, 1e-3)
    },
    **{
        f"one control off by {by}": lambda d, by=by: bumped(d["arcs"][0]["u"][0], by)
        for by in (1.0, 1e-2, 1e-3)
    },
    "states all zero": lambda d: each_arc(d, lambda arc: arc.update(x=scaled(arc["x"], 0.0))),
    "states of the last arc reversed": lambda d: (
        [row.reverse() for row in d["arcs"][-1]["x"]] and None
    ),
    "times longer": lambda d: each_arc(d, lambda arc: arc.update(t=scaled(arc["t"], 1.01))),
    "times later": lambda d: each_arc(d, lambda arc: arc.update(t=scaled(arc["t"], 1.0, 0.5))),
    "the other bound": lambda d: switched(d, {"+": "-", "-": "+"}[d["arcs"][0]["modes"][0]]),
    "a bang called boundary": lambda d: switched(d, "b"),
    "a state unknown": lambda d: d["arcs"][0]["x"][0].__setitem__(2, None),
    "a control infinite": lambda d: d["arcs"][0]["u"][0].__setitem__(2, "inf"),
    "a state of 1e149": lambda d: d["arcs"][0]["x"][0].__setitem__(2, 1e149),
    "a control of -1e149": lambda d: d["arcs"][0]["u"][0].__setitem__(2, -1e149),
    "the first arc alone": lambda d: (
        d["arcs"].__setitem__(slice(1, None), []) if len(d["arcs"]) > 1 else moved(d, 0.1)
    ),
}


@pytest.mark.parametrize("forgery", FORGED)
@pytest.mark.slow
def test_forgeries_are_not_certified(forgery: str, genuine: dict[str, str], check: Any) -> None:
    for text in genuine.values():
        document = json.loads(text)
        FORGED[forgery](document)
        said = check(document)
        uncertified(said)


def numbered(document: Document, key: str, value: Any) -> None:
    document["arcs"][0][key] = value


def longer(document: Document, key: str) -> None:
    document["arcs"][0][key][0].append(0.0)


# changes after which the fields do not fit each other, and the field that is named
UNFIT: dict[str, tuple[str, Callable[[Document], Any]]] = {
    "arcs swapped": (
        "t",
        lambda d: d["arcs"].reverse() if len(d["arcs"]) > 1 else d["arcs"][0]["t"].reverse(),
    ),
    "an arc twice": ("t", lambda d: d["arcs"].append(copy.deepcopy(d["arcs"][-1]))),
    "times reversed": ("t[1]", lambda d: d["arcs"][0]["t"].reverse()),
    "two times swapped": ("t[3]", lambda d: d["arcs"][0]["t"].insert(2, d["arcs"][0]["t"].pop(3))),
    "all times equal": (
        "horizon",
        lambda d: each_arc(d, lambda arc: arc.update(t=[1.0] * len(arc["t"]))),
    ),
    "negative lengths": (
        "t[1]",
        lambda d: each_arc(d, lambda arc: arc.update(t=scaled(arc["t"], -1.0))),
    ),
    "a gap in time": (
        "t",
        lambda d: d["arcs"].append(
            {**copy.deepcopy(d["arcs"][-1]), "t": [t + 10 for t in d["arcs"][-1]["t"]]}
        ),
    ),
    "a node more in t": (".mesh", lambda d: d["arcs"][0]["t"].append(99.0)),
    "a node less in t": (".mesh", lambda d: d["arcs"][0]["t"].pop()),
    "a node more in x": (".x[0]", lambda d: longer(d, "x")),
    "a node more in u": (".u[0]", lambda d: longer(d, "u")),
    "a node more in costate": (".costate[0]", lambda d: longer(d, "costate")),
    "a row less of x": (".x: ", lambda d: d["arcs"][0]["x"].pop()),
    "a row more of x": (".x: ", lambda d: d["arcs"][0]["x"].append(d["arcs"][0]["x"][0])),
    "a row more of u": (".u: ", lambda d: d["arcs"][0]["u"].append(d["arcs"][0]["u"][0])),
    "no row of u": (".u: ", lambda d: d["arcs"][0]["u"].clear()),
    "a row more of costate": (
        ".costate: ",
        lambda d: d["arcs"][0]["costate"].append(d["arcs"][0]["x"][0]),
    ),
    "mesh backwards": (".mesh", lambda d: d["arcs"][0]["mesh"].reverse()),
    "mesh of one": (".mesh", lambda d: numbered(d, "mesh", [0])),
    "mesh too long": (".mesh", lambda d: d["arcs"][0]["mesh"].append(10**6)),
    "mesh not from 0": (".mesh", lambda d: d["arcs"][0]["mesh"].__setitem__(0, 1)),
    "a mode more": (".modes", lambda d: d["arcs"][0]["modes"].append("+")),
    "no mode": (".modes", lambda d: d["arcs"][0]["modes"].clear()),
    "a multiplier of no constraint": (
        ".multipliers",
        lambda d: d["arcs"][0]["multipliers"].update(nosuch=[0.0] * len(d["arcs"][0]["t"])),
    ),
    "a multiplier too short": (
        ".multipliers",
        lambda d: d["arcs"][0]["multipliers"].update({"v.upper": [0.0]}),
    ),
    "a state's name twice": (
        "twice",
        lambda d: d["state_names"].__setitem__(0, d["control_names"][0]),
    ),
    "another state's name": ("state_names", lambda d: d["state_names"].__setitem__(0, "z")),
    "a name with an escape": ("state_names", lambda d: d["state_names"].__setitem__(0, "\x1b[2J")),
    "a very long name": ("state_names[0]", lambda d: d["state_names"].__setitem__(0, "x" * 10**6)),
    "a very long side": ("side", lambda d: d["arcs"][0].update(side="x" * 10**6)),
    "very many names": (
        "state_names",
        lambda d: d["state_names"].extend(f"x{k}" for k in range(10**4)),
    ),
    "a title with an escape": (
        "statement.about",
        lambda d: d["origin"]["statement"]["about"].update(title="\x1b[2J"),
    ),
    "a unit with an escape": (
        "statement.about",
        lambda d: d["origin"]["statement"]["about"].update(units={d["state_names"][0]: "\x1b[2J"}),
    ),
    "an empty name": ("state_names[0]", lambda d: d["state_names"].__setitem__(0, "")),
    "another control's name": ("control_names", lambda d: d["control_names"].__setitem__(0, "z")),
    "another parameter": ("parameters", lambda d: d["parameters"].update(q=1.0)),
    "a parameter named as a state": (
        "twice",
        lambda d: d["parameters"].update({d["state_names"][0]: 1.0}),
    ),
    "another problem's name": ("problem", lambda d: d.update(problem="auv")),
    "a file for a problem": ("problem", lambda d: d.update(problem="evil.py")),
    "an empty problem": ("problem", lambda d: d.update(problem="")),
    "schema 4": ("schema: 4", lambda d: d.update(schema=4)),
    "structure of another control": (
        "structure",
        lambda d: d["judgement"].update(structure={"z": [["+", 0.0, 1.0]]}),
    ),
    "structure of an empty row": (
        "structure.u",
        lambda d: d["judgement"]["structure"].update(u=[]),
    ),
    "structure backwards": (
        "structure.u[0]",
        lambda d: d["judgement"]["structure"].update(u=[["+", 1.0, 0.0]]),
    ),
    "structure of no mode": (
        "structure.u[0]",
        lambda d: d["judgement"]["structure"].update(u=[["?", 0.0, 1.0]]),
    ),
    "another start": (
        "statement.fingerprint",
        lambda d: d["origin"]["statement"]["start"].update({d["state_names"][0]: [0.5, 0.5]}),
    ),
    "wider bounds": (
        "statement.fingerprint",
        lambda d: d["origin"]["statement"]["bounds"].update(u=[-9.0, 9.0]),
    ),
    "another rate": (
        "statement.fingerprint",
        lambda d: d["origin"]["statement"]["nodes"].append(7.0),
    ),
    "an operation that is none": (
        "statement.nodes",
        lambda d: d["origin"]["statement"]["nodes"].append(["system", 0]),
    ),
    "another statement": ("statement", lambda d: d["origin"].update(statement={"evil": "evil.py"})),
}


@pytest.mark.parametrize("change", UNFIT)
def test_fields_that_do_not_fit_are_named(change: str, genuine: dict[str, str], check: Any) -> None:
    names, change_it = UNFIT[change]
    for text in genuine.values():
        document = json.loads(text)
        change_it(document)
        refused(check(document), names)


# what a file says of itself: with another value of its type the verdict is the same
CLAIMS: dict[str, Callable[[Document], Any]] = {
    "extremal": lambda d: d.update(extremal=False),
    "word": lambda d: d.update(word="u: -"),
    "switches": lambda d: d.update(switches=[9.0]),
    "method": lambda d: d["origin"].update(method="evil.py"),
    "message": lambda d: d.update(message="../../etc/passwd"),
    "options": lambda d: d["origin"].update(options={"word": "evil"}),
    "versions": lambda d: d["origin"].update(versions={"socp": "evil.py"}),
    "seconds": lambda d: d["effort"].update(seconds={"a": -1.0}),
    "iterations": lambda d: d["effort"].update(iterations=2**62),
    "stop": lambda d: d.update(stop="FAILED"),
    "trace": lambda d: d["effort"].update(trace={"x": [None, "inf"]}),
    "meshes": lambda d: d["effort"].update(meshes=[[3.0, 1.0]]),
    "verdict": lambda d: d["judgement"]["verdict"].update(miss="inf", digits=0, notes=["evil.py"]),
    "findings": lambda d: d["judgement"]["verdict"]["findings"][0].update(residual="inf"),
    "no verdict": lambda d: d["judgement"].update(verdict=None),
    "verified": lambda d: d["judgement"].update(verified=[]),
    "feasibility": lambda d: d["judgement"]["verified"][0].update(miss="inf", error="evil"),
    "structure": lambda d: d["judgement"].update(structure={"u": [["s", 0.0, 1.0]]}),
    "no structure": lambda d: d["judgement"].update(structure={}),
    "costates": lambda d: each_arc(
        d, lambda arc: arc.update(costate=scaled(arc["costate"], 0.0, 7.0))
    ),
    "multipliers": lambda d: each_arc(d, lambda arc: arc.update(multipliers={})),
    "title": lambda d: d["origin"]["statement"]["about"].update(
        title="evil.py", source="/etc/passwd"
    ),
    "reference": lambda d: d["origin"]["statement"]["about"].update(reference=None),
    "agreement": lambda d: d["judgement"].update(agreement={"objective": 0.0, "switches": 0.0}),
}


@pytest.mark.parametrize("claim", CLAIMS)
def test_claims_change_nothing(claim: str, genuine: dict[str, str], check: Any) -> None:
    for text in genuine.values():
        document = json.loads(text)
        CLAIMS[claim](document)
        unharmed(check(document))


UNKNOWN: dict[str, Callable[[Document], Any]] = {
    "a control infinite": FORGED["a control infinite"],
    "a state of 1e149": FORGED["a state of 1e149"],
    "no state known": lambda d: each_arc(
        d, lambda arc: arc["x"].__setitem__(0, [None] * len(arc["t"]))
    ),
    "no control finite": lambda d: each_arc(
        d, lambda arc: arc["u"].__setitem__(0, ["inf"] * len(arc["t"]))
    ),
    "no structure": CLAIMS["no structure"],
}


@pytest.mark.parametrize("change", UNKNOWN)
def test_what_is_not_known_is_left_out_of_figures_and_tables(
    change: str, genuine: dict[str, str], check: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    document = json.loads(genuine["double_integrator_vlimit"])
    UNKNOWN[change](document)
    Path("torn.json").write_text(json.dumps(document))
    assert main(["plot", "torn.json"]) == 0
    assert main(["export", "torn.json", "--format", "csv"]) == 0
    assert "error" not in capsys.readouterr().err
    assert Path("torn.svg").stat().st_size > 1000
    assert len(Path("torn.csv").read_text().splitlines()) > sum(
        len(arc["t"]) for arc in document["arcs"]
    )
    assert check(document).code in {0, 1}


@pytest.mark.parametrize("value", [None, "inf", 0.0, -1e149, 1.001])
def test_another_parameter_is_not_certified(
    value: Any, genuine: dict[str, str], check: Any
) -> None:
    uncertified(check(changed(genuine["parameter"], ("parameters", "p"), value)))


@pytest.mark.parametrize("value", ["text", 1e308, [1.0], {}, True])
def test_what_is_no_parameter_is_refused(value: Any, genuine: dict[str, str], check: Any) -> None:
    refused(check(changed(genuine["parameter"], ("parameters", "p"), value)), "parameters")


# -- files


def spoilt(text: str) -> Iterator[tuple[str, str | bytes]]:
    """Yield (what is named, content) of files that are no JSON, or not all of it."""
    whole = text.encode()
    yield "not JSON", b""
    yield "not JSON", b"\n\n"
    yield from (("not JSON", whole[: len(whole) * k // 23]) for k in range(1, 23))
    yield "not JSON", whole + whole
    yield "not JSON", b"# " + whole
    yield "UTF-8", b"\xff\xfe" + whole
    yield "UTF-8", whole[:500] + b"\x80" + whole[500:]
    yield "UTF-8", text.encode("utf-16")
    yield "not JSON", b"\xef\xbb\xbf" + whole
    yield "not JSON", whole.replace(b"\n", b"\0", 1)
    yield "NaN is no JSON", text.replace('"objective": ', '"objective": NaN, "x": ')
    yield "Infinity is no JSON", text.replace('"iterations": ', '"iterations": Infinity, "x": ')
    yield (
        "'objective' is there twice",
        text.replace('"objective": ', '"objective": 1.0, "objective": '),
    )
    yield "'t' is there twice", text.replace('"t": [', '"t": [], "t": [', 1)
    yield "deep", '{"schema": ' + "[" * 200_000
    yield "deep", '{"schema": ' + '{"a":' * 200_000
    yield "schema", "[" + text + "]"
    yield "surrogate", text.replace('"message": "', '"message": "\\ud800')
    yield "JSON", text.replace('"iterations": ', '"iterations": ' + "9" * 5000)
    yield "iterations", text.replace('"iterations": ', '"iterations": ' + "9" * 50)
    yield "schema", "3"
    yield "schema", "null"
    yield "schema", '"text"'
    yield "schema", "{}"


def test_files_that_are_no_results_are_refused(genuine: dict[str, str], check: Any) -> None:
    seen = 0
    for names, content in spoilt(genuine["jacobson_1"]):
        said = check(content)
        assert (said.code, said.out) == (1, ""), names
        assert said.err.startswith("error: result.json: not a socp result: "), names
        assert names in said.err or names == "schema", said.err[:300]
        assert len(said.err) < 500
        seen += 1
    assert seen > 40


def refusing(act: Any, name: str) -> Any:
    """Return `os.open` as it is for those who may not read a file."""

    def opened(path: Any, *given: Any, **named: Any) -> int:
        if Path(os.fsdecode(path)).name == name:
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), name)
        return act(path, *given, **named)

    return opened


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("none.json", "No such file"),
        ("folder", "Is a directory"),
        ("/dev/zero", "is no regular file"),
        ("/dev/null", "is no regular file"),
        ("pipe", "is no regular file"),
        ("sparse", "bytes; a result has at most"),
        ("no\0name", "null"),
        ("locked", "Permission denied"),
    ],
)
def test_what_is_no_file_is_refused_at_once(
    name: str,
    reason: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    if name == "folder":
        Path("folder").mkdir()
    elif name == "pipe":
        os.mkfifo("pipe")
    elif name == "sparse":
        with Path("sparse").open("wb") as file:
            file.truncate(LARGEST + 1)
    elif name == "locked":
        Path("locked").touch(mode=0)
        if os.access("locked", os.R_OK):  # root reads every file: have the system refuse it
            monkeypatch.setattr(os, "open", refusing(os.open, "locked"))
    for command in (
        ["check", name],
        ["plot", name],
        ["export", name, "--format", "csv"],
        ["record", name],
    ):
        assert main(command) in {1, 2}
        said = capsys.readouterr()
        assert reason.lower() in said.err.lower(), (command, said)
        assert "internal" not in said.err
        assert said.out == ""
    assert list(tmp_path.glob("*.svg")) == []


def test_a_file_that_grows_while_it_is_read_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "growing"
    path.write_text("0123456789")
    monkeypatch.setattr("socp.process.files._check", lambda *_: None)
    with pytest.raises(SolveError, match="is longer than 9 bytes"):
        read_text(path, largest=9)
    assert read_text(path, largest=10) == "0123456789"


def test_a_statement_that_is_no_problem_is_refused(genuine: dict[str, str], check: Any) -> None:
    """Its fingerprint is right and its layout is kept; that bounds are the wrong way round only the
    language knows.
    """
    from socp.model.data import stated

    document = json.loads(genuine["jacobson_1"])
    document["origin"]["statement"]["bounds"]["u"] = [1.0, -1.0]
    document["origin"]["statement"]["fingerprint"] = stated.fingerprint(
        document["origin"]["statement"]
    )
    said = check(document)
    assert (said.code, said.out) == (1, "")
    assert (
        "result.json: its statement is no problem: problem 'jacobson_1': bounds of 'u': lower 1.0"
        in said.err
    )


def test_expressions_nested_deeper_than_the_algebra_goes_are_not_certified(
    genuine: dict[str, str], check: Any
) -> None:
    """Laws of them cannot be derived, as that recurs; what says so is a verdict, not an internal
    error.
    """
    from socp.model.data import stated

    document = json.loads(genuine["jacobson_1"])
    statement = document["origin"]["statement"]
    nodes, rate = statement["nodes"], statement["dynamics"]["x2"]
    nodes.append(["sin", nodes.index("x1")])
    for _ in range(1200):
        nodes.append(["sin", len(nodes) - 1])
    nodes.append(["add", rate, len(nodes) - 1])
    statement["dynamics"]["x2"] = len(nodes) - 1
    statement["fingerprint"] = stated.fingerprint(statement)
    said = check(document)
    assert said.code == 1
    assert "not feasible" in said.out


def test_a_forged_problem_is_judged_as_what_it_is(genuine: dict[str, str], check: Any) -> None:
    """A statement of another problem is a problem of its own: its result stands or falls by it, and
    that is said.
    """
    from socp.model.data import stated

    document = json.loads(genuine["double_integrator_vlimit"])
    document["origin"]["statement"]["bounds"]["u"] = [-2.0, 2.0]
    document["origin"]["statement"]["fingerprint"] = stated.fingerprint(
        document["origin"]["statement"]
    )
    assert Problem.from_statement(document["origin"]["statement"]).box.tolist() == [[-2.0], [2.0]]
    said = check(document)
    assert said.code == 1
    assert "not extremal" in said.out
    told = (
        "the result's own problem is used; the registered 'double_integrator_vlimit' differs in: "
        "bounds.u"
    )
    assert said.err == f"warning: {told}\n"


def test_there_are_enough_of_them() -> None:
    arcs = {"double_integrator_vlimit": 3, "jacobson_1": 2, "parameter": 1}
    tried = len(GONE) + len(RECORDS) + len(RETYPED) + len(MODES) * sum(arcs.values())
    tried += len(WORDS) * (len(FORGED) + len(UNFIT) + len(CLAIMS))
    assert tried > LEAST

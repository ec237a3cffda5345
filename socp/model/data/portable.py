"""Problems as data: the statement that a result file carries, its fingerprint, and the way back to
a problem.

A statement holds names, numbers and lists of operations, and nothing that could be run.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

import numpy as np

from socp.errors import ProblemError
from socp.model.data import grammar, stated
from socp.model.data.constants import Constant, Formula, constants, planted, valued
from socp.model.parts import Reference, Scene
from socp.model.ranges import interval
from socp.model.symbols import (
    Expr,
    controls,
    final_time,
    initial,
    initial_time,
    parameters,
    states,
    time,
)

Data = dict[str, Any]
Place = tuple[str, ...]
Symbols = Mapping[str, Sequence[Expr]]  # "states", "controls" and "parameters" of a problem

NUMBERS = ("bounds", "start", "end")
TIMES = ("initial_time", "final_time")
_LAWS = ("singular", "boundary")


def written(problem: Mapping[str, Any], symbols: Symbols) -> Data:
    """Return the arguments of `Problem` as data, `symbols` its states, controls and parameters in
    their order.

    Raises ProblemError, with the name and the place, where part of it has no spelling.
    """
    try:
        data = _data(problem, symbols)
        stated.check(data)  # what is written can be read
    except ProblemError as error:
        name = problem["name"]
        raise ProblemError(f"problem '{name}' cannot be written as data: {error}") from error
    return data


def _data(problem: Mapping[str, Any], symbols: Symbols) -> Data:
    names = by_name(symbols)
    data = _defining(problem, symbols, names)
    head = {"fingerprint": stated.fingerprint(data), "name": problem["name"]}
    formula = {} if problem["formula"] is None else _formula(problem["formula"], names)
    return {**head, **data, "about": _about(problem, names), **formula}


def _defining(
    problem: Mapping[str, Any],
    symbols: Symbols,
    names: Mapping[str, Expr],
    settled: Sequence[grammar.Node] = (),
) -> Data:
    """Return what of a statement its fingerprint is of; a list of nodes that is `settled` reads
    back as it is written.
    """
    parts = dict(expressions(problem))
    nodes, places = grammar.written(list(parts.values()), names, settled)
    at = dict(zip(parts, places, strict=True))
    data: Data = {
        **{kind: [symbol.name() for symbol in its] for kind, its in symbols.items()},
        "nodes": nodes,
        "minimise": at.get(("minimise",)),
        "running": at.get(("running",)),
        **{table: {} for table in ("dynamics", "path", "target", *_LAWS)},
    }
    for (table, *keys), place in at.items():
        if len(keys) == 1:
            data[table][keys[0]] = place
        elif keys:
            data[table].setdefault(keys[0], {})[keys[1]] = place
    return data | _numbers(problem)


def faithful(data: Mapping[str, Any], symbols: Symbols, formula: Formula) -> bool:
    """Tell whether a statement of a problem in these symbols, read back with its formula and the
    values of the constants put in, is written as the same again.
    """
    names = by_name(symbols)
    own = {symbol.name(): symbol for symbol in formula.values}
    leaves = _leaves(data["formula"], {**names, **own})
    values = {path: valued(leaf, formula.values) for path, leaf in leaves.items()}
    again = _defining(planted(_plain(data, names), values), symbols, names, data["nodes"])
    return bool(stated.fingerprint(again) == data["fingerprint"])


def revalued(known: Mapping[str, Any], problem: Mapping[str, Any]) -> Data:
    """Return the statement of a problem that differs from a known one, of which nothing was written
    with constants, in numbers alone.
    """
    data = {**known, **_numbers(problem), "about": {**known["about"], "reference": None}}
    of = {k: v for k, v in data.items() if k not in {"fingerprint", "name", "about"}}
    return data | {"fingerprint": stated.fingerprint(of)}


def _numbers(problem: Mapping[str, Any]) -> Data:
    times = {t: list(map(stated.json_number, interval(problem[t]))) for t in TIMES}
    return {**{table: _intervals(problem[table]) for table in NUMBERS}, **times}


def arguments(data: Mapping[str, Any]) -> Data:
    """Return the arguments of `Problem` that a statement stands for, in new symbols.

    Raises ProblemError, starting with the place in the statement, for what is no statement.
    """
    stated.check(data)
    declared = {
        **{name: states(name) for name in data["states"]},
        **{name: controls(name) for name in data["controls"]},
        **{name: parameters(name) for name in data["parameters"]},
    }
    symbols = {**declared, **_fixed([declared[name] for name in data["states"]])}
    found, formula = _plain(data, symbols), data.get("formula")
    if formula is None:
        return found
    parts = [each.name for each in fields(Constant)]
    given = {name: [each[p] for p in parts] for name, each in formula["constants"].items()}
    own = {name: constants(**{name: each}) for name, each in given.items()}
    return planted(found, _leaves(formula, {**symbols, **own}))


def _plain(data: Mapping[str, Any], symbols: Mapping[str, Expr]) -> Data:
    """Return the arguments of `Problem` that a statement stands for in given symbols, the values of
    constants in their places.
    """
    nodes = grammar.read(data["nodes"], symbols)
    found: Data = {
        each: None if data[each] is None else nodes[data[each]] for each in ("minimise", "running")
    }
    for table in NUMBERS:
        found[table] = {
            symbols[name]: tuple(map(stated.number, value)) for name, value in data[table].items()
        }
    for each in TIMES:
        found[each] = tuple(map(stated.number, data[each]))
    for table in ("dynamics", *_LAWS):
        found[table] = {symbols[name]: _placed(value, nodes) for name, value in data[table].items()}
    for table in ("path", "target"):
        found[table] = {name: nodes[place] for name, place in data[table].items()}
    return {"name": data["name"], **found, **_described(data["about"], symbols)}


def expressions(problem: Mapping[str, Any]) -> Iterator[tuple[Place, Expr]]:
    """Yield (place, expression) of all that defines a problem and is no plain number."""
    yield from ((("dynamics", state.name()), rate) for state, rate in problem["dynamics"].items())
    costs = ((place, problem[place]) for place in ("minimise", "running"))
    yield from (((place,), expression) for place, expression in costs if expression is not None)
    for table in ("path", "target"):
        yield from (((table, name), relation) for name, relation in problem[table].items())
    yield from ((("singular", control.name()), law) for control, law in problem["singular"].items())
    for control, law in problem["boundary"].items():
        if isinstance(law, Mapping):
            yield from ((("boundary", control.name(), name), each) for name, each in law.items())
        else:
            yield ("boundary", control.name()), law


def by_name(symbols: Symbols) -> dict[str, Expr]:
    """Return the symbols of a problem by name, with those that every problem has: its times, and
    the initial values of its states.
    """
    its = {symbol.name(): symbol for each in symbols.values() for symbol in each}
    return its | _fixed(symbols["states"])


def _fixed(its_states: Sequence[Expr]) -> dict[str, Expr]:
    """Return the symbols that every problem has, by name: times, and the initial values of its
    states.
    """
    starts = {stated.at_start(state.name()): initial(state) for state in its_states}
    return {"t": time, "t0": initial_time, "tf": final_time, **starts}


def _formula(formula: Formula, symbols: Mapping[str, Expr]) -> Data:
    """Return what was written with constants, and their values."""
    own = {symbol.name(): symbol for symbol in formula.values}
    nodes, places = grammar.written(list(formula.leaves.values()), {**symbols, **own})
    found = {
        "constants": {name: asdict(each) for name, each in formula.named.items()},
        "nodes": nodes,
        "places": [[list(path), k] for path, k in zip(formula.leaves, places, strict=True)],
    }
    return {"formula": found}


def _leaves(formula: Mapping[str, Any], symbols: Mapping[str, Expr]) -> dict[Place, Expr]:
    """Return what was written with constants, by its place in the problem, in given symbols."""
    nodes = grammar.read(formula["nodes"], symbols)
    return {tuple(path): nodes[place] for path, place in formula["places"]}


def _intervals(table: Mapping[Expr, Any]) -> Data:
    """Return the intervals of symbols by name, without those that are free."""
    found = {
        symbol.name(): list(map(stated.json_number, interval(value)))
        for symbol, value in table.items()
    }
    return {name: value for name, value in found.items() if value != ["-inf", "inf"]}


def _about(problem: Mapping[str, Any], symbols: Mapping[str, Expr]) -> Data:
    """Return what is known beside the problem: texts, units, reference values, the scene and the
    guess.
    """
    scene, parts = problem["scene"], dict[Place, Expr]()
    if scene is not None:
        pairs = {"plane": scene.plane, "flow": scene.flow or (), "heading": (scene.heading,)}
        parts = {
            ("scene", k, str(i)): e
            for k, es in pairs.items()
            for i, e in enumerate(es)
            if e is not None
        }
    for symbol, value in problem["guess"].items():
        both = value if isinstance(value, (tuple, list, np.ndarray)) else [value]
        parts |= {("guess", symbol.name(), str(i)): each for i, each in enumerate(both)}
    nodes, places = grammar.written(list(parts.values()), symbols)
    tables: dict[str, dict[str, list[int]]] = {"scene": {}, "guess": {}}
    for (table, name, _), place in zip(parts, places, strict=True):
        tables[table].setdefault(name, []).append(place)
    reference = None if problem["reference"] is None else asdict(problem["reference"])
    if reference is not None:
        figures = {each: stated.json_number(reference[each]) for each in ("objective", "tolerance")}
        reference |= {**figures, "switches": list(map(stated.json_number, reference["switches"]))}
    disc = None if scene is None or scene.target is None else list(map(float, scene.target))
    return {
        **{each: problem[each] for each in stated.TEXTS},
        "reference": reference,
        "nodes": nodes,
        "units": {symbol.name(): unit for symbol, unit in problem["units"].items()},
        "guess": tables["guess"],
        "scene": None if scene is None else tables["scene"],
        "target": disc,
    }


def _described(about: Mapping[str, Any], symbols: Mapping[str, Expr]) -> Data:
    """Return the arguments of `Problem` for what is known beside the problem."""
    nodes = grammar.read(about["nodes"], symbols)
    reference, scene = about["reference"], None
    if reference is not None:
        figures = {each: stated.number(reference[each]) for each in ("objective", "tolerance")}
        reference = Reference(
            **{**reference, **figures, "switches": tuple(map(stated.number, reference["switches"]))}
        )
    if about["scene"] is not None:
        parts = {
            name: tuple(nodes[place] for place in places) for name, places in about["scene"].items()
        }
        heading = parts.pop("heading", (None,))[0]
        scene = Scene(
            **parts,
            heading=heading,
            target=None if about["target"] is None else tuple(about["target"]),
        )
    guess = {
        symbols[name]: _guessed([nodes[place] for place in places])
        for name, places in about["guess"].items()
    }
    units = {symbols[name]: unit for name, unit in about["units"].items()}
    texts = {each: about.get(each, "") for each in stated.TEXTS}
    return {**texts, "reference": reference, "scene": scene, "guess": guess, "units": units}


def _guessed(parts: list[Expr]) -> Any:
    plain = [float(part) if part.is_constant() else part for part in parts]
    return plain[0] if len(plain) == 1 else tuple(plain)


def _placed(value: Any, nodes: list[Expr]) -> Any:
    return (
        {name: nodes[place] for name, place in value.items()}
        if isinstance(value, Mapping)
        else nodes[value]
    )

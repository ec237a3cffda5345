"""The result file: strict JSON that reads back bit for bit, written whole or not at all."""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from socp.errors import ProblemError, SolveError
from socp.model.arc import Arc
from socp.model.data import consistency
from socp.model.data.stated import number, quotation
from socp.model.findings import (
    Agreement,
    Condition,
    Feasibility,
    Finding,
    Grade,
    Node,
    Place,
    Verdict,
)
from socp.model.ladder.second_order import Curvature, Descent, Minimum, SecondOrder
from socp.model.solution import Solution, Stop
from socp.model.word import Mode
from socp.process import read_text, write_atomic

SCHEMA = 2  # version of the result file that is written
_DERIVED = (
    "word",
    "switches",
    "extremal",
)  # in the file for its readers; a solution works them out


def save(solution: Solution, path: str | Path) -> None:
    """Write a result file atomically: a reader sees the old file or the new one, never a part.

    Raises SolveError, with the path, where it cannot be written.
    """
    write_atomic(Path(path), to_json(solution) + "\n")


def load(path: str | Path) -> Solution:
    """Read a result file; SolveError names the file and what is wrong with it."""
    text = read_text(path)
    try:
        return from_json(text)
    except SolveError as error:
        raise SolveError(f"{path}: {error}") from error


def to_json(solution: Solution) -> str:
    """Return a solution as text: null for nan, "inf" and "-inf" for infinities, which JSON lacks,
    and floats that read back bit for bit.
    """
    document = {"schema": SCHEMA, **{name: getattr(solution, name) for name in _DERIVED}}
    document |= {f.name: getattr(solution, f.name) for f in fields(solution)}
    return json.dumps(_plain(document), allow_nan=False, indent=1)


def from_json(text: str) -> Solution:
    """Return the solution that `to_json` wrote; SolveError says what is wrong with anything
    else.
    """
    try:
        document = consistency.document(text)
        stop = _stop(document["stop"])
    except ProblemError as error:
        raise SolveError(f"not a socp result: {quotation(error)}") from error
    as_they_are = {k: v for k, v in document.items() if k not in {"schema", *_DERIVED}}
    return Solution(**{**as_they_are, **_fields(document), "stop": stop})


def _stop(name: str) -> Stop:
    if name not in Stop.__members__:
        raise ProblemError(f"stop: '{name}'; there are {', '.join(Stop.__members__)}")
    return Stop[name]


def _fields(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the fields that JSON does not hold as they are."""
    return {
        "arcs": tuple(_arc(arc) for arc in document["arcs"]),
        "objective": number(document["objective"]),
        "parameters": {name: number(value) for name, value in document["parameters"].items()},
        "seconds": {name: number(value) for name, value in document["seconds"].items()},
        "trace": {name: tuple(map(number, values)) for name, values in document["trace"].items()},
        "meshes": tuple(tuple(map(number, mesh)) for mesh in document["meshes"]),
        "structure": {
            name: tuple((m, float(a), float(b)) for m, a, b in row)
            for name, row in document["structure"].items()
        },
        "nodes": tuple(Node(**_numbers(each)) for each in document["nodes"]),
        "agreement": None
        if document["agreement"] is None
        else Agreement(**_numbers(document["agreement"])),
        "verified": tuple(Feasibility(**_feasibility(each)) for each in document["verified"]),
        "verdict": None
        if document["verdict"] is None
        else _verdict(document["verdict"], _stretches(document["structure"])),
        **{name: tuple(document[name]) for name in ("state_names", "control_names")},
    }


def _plain(value: Any) -> Any:
    """Return a value in JSON's types: arrays as lists, enums by name, records by their fields."""
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, Enum):
        value = value.name
    elif isinstance(value, Mode):
        value = str(value)
    elif isinstance(value, Finding):
        value = _plain(value.data)
    elif is_dataclass(value):
        value = {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
    elif isinstance(value, Mapping):
        value = {str(k): _plain(v) for k, v in value.items()}
    elif isinstance(value, (list, tuple)):
        value = [_plain(v) for v in value]
    elif isinstance(value, float) and not np.isfinite(value):
        value = None if np.isnan(value) else str(value)
    return value


def _numbers(data: Mapping[str, Any]) -> dict[str, Any]:
    return {
        k: v if isinstance(v, str) and k in {"word", "stop"} else number(v) for k, v in data.items()
    }


def _feasibility(data: Mapping[str, Any]) -> dict[str, Any]:
    figures = {
        k: number(data[k])
        for k in ("miss", "path", "box", "drift", "objective", "gap")
        if k in data
    }
    return {**data, **figures, "end": tuple(number(v) for v in data["end"])}


def _stretches(structure: Mapping[str, Any]) -> dict[str, Place]:
    """Return the stretches of every control by what they are called in words."""
    places = [
        Place(control=name, stretch=k, mode=Mode.parse(mode))
        for name, row in structure.items()
        for k, (mode, _, _) in enumerate(row, start=1)
    ]
    return {str(place): place for place in places}


def _finding(data: Mapping[str, Any], stretches: Mapping[str, Place]) -> Finding:
    """Return a finding, one of an older file by the words for it: its condition's, its place's."""
    words, where, mode = data["condition"], data["where"], data.get("mode")
    kind = next((each for each in Condition if each.value == words), Condition.OTHER)
    place = Place(
        control=data.get("control"),
        of=data.get("of", ""),
        stretch=data.get("stretch"),
        arc=data.get("arc"),
        mode=Mode.parse(mode) if mode else None,
    )
    return Finding(
        kind=kind,
        residual=number(data["residual"]),
        place=place if "kind" in data else stretches.get(where, Place(of=where)),
        t=data["t"],
        wants=Mode.parse(data["wants"]) if data["wants"] else None,
        text=words if kind is Condition.OTHER else "",
    )


def _verdict(data: Mapping[str, Any], stretches: Mapping[str, Place]) -> Verdict:
    figures = {name: number(data[name]) for name in ("miss", "normality", "objective_error")}
    # older files have none of these, nor `flat`
    figures["remaining_error"] = number(data.get("remaining_error"))
    figures["drift"] = number(data.get("drift", 0.0))
    named = ("legendre_clebsch", "ringing")
    tables = {name: {k: number(v) for k, v in data[name].items()} for name in named}
    findings = tuple(_finding(each, stretches) for each in data["findings"])
    margins = {
        stretches.get(name, Place(of=name)): number(v) for name, v in data["margins"].items()
    }
    errors = tuple((float(t), number(error)) for t, error in data["switch_errors"])
    flat = tuple((float(t), number(reach)) for t, reach in data.get("flat", ()))
    pairs = {"switch_errors": errors, "flat": flat}
    given = {
        **data,
        **figures,
        **tables,
        **pairs,
        "findings": findings,
        "margins": margins,
        "notes": tuple(data["notes"]),
    }
    given["chattering"] = tuple(data["chattering"])
    grade = data.get("grade")
    given["grade"] = None if grade is None else Grade(**_numbers(grade))
    given["second_order"] = _second_order(data.get("second_order"))
    return Verdict(**given)


def _second_order(data: Mapping[str, Any] | None) -> SecondOrder | None:
    if data is None:
        return None
    kind, descent = data["kind"], data["descent"]
    if kind not in Minimum.__members__:
        raise ProblemError(f"second_order: '{kind}'; there are {', '.join(Minimum.__members__)}")

    def curvature(found: Mapping[str, Any] | None) -> Curvature | None:
        if found is None:
            return None
        least, error = (number(found[name]) for name in ("least", "error"))
        return Curvature(least=least, error=error, free=found["free"])

    return SecondOrder(
        kind=Minimum[kind],
        theorem=data["theorem"],
        word=curvature(data["word"]),
        singular=curvature(data["singular"]),
        limits=tuple(data["limits"]),
        descent=None
        if descent is None
        else Descent(
            times=tuple(map(number, descent["times"])),
            parameters=tuple(map(number, descent["parameters"])),
            predicted=number(descent["predicted"]),
            found=number(descent["found"]),
        ),
    )


def _row(values: Any) -> np.ndarray:
    return np.array([number(value) for value in values])


def _arc(data: Mapping[str, Any]) -> Arc:
    t = _row(data["t"])
    matrices = {
        k: np.array([_row(r) for r in data[k]]).reshape(-1, t.size) for k in ("x", "u", "costate")
    }
    multipliers = {name: _row(values) for name, values in data["multipliers"].items()}
    mesh, modes = np.array(data["mesh"], dtype=int), tuple(map(Mode.parse, data["modes"]))
    return Arc(t=t, mesh=mesh, side=data["side"], modes=modes, multipliers=multipliers, **matrices)

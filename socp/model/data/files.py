"""The result file: strict JSON that reads back bit for bit, written whole or not at all."""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, TypeVar, get_args, get_origin

import msgspec
import numpy as np

from socp.errors import ProblemError, SolveError
from socp.model.data import consistency
from socp.model.data.schema import Result
from socp.model.data.stated import Number, number, quotation
from socp.model.ladder.grade import Grade
from socp.model.ladder.rungs import Proof, Rung
from socp.model.ladder.second_order import Curvature, Descent, Minimum, SecondOrder
from socp.model.ladder.starts import Met, Starts
from socp.model.result.arc import Arc
from socp.model.result.findings import (
    Agreement,
    Condition,
    Feasibility,
    Finding,
    Node,
    Place,
    Verdict,
)
from socp.model.result.records import Effort, Judgement, Origin
from socp.model.result.solution import Solution, Stop
from socp.model.word import Mode
from socp.process import read_text, write_atomic

_Names = TypeVar("_Names", bound=Enum)

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
    """Read a result file, judged as it was saved; values are in the units of its problem.

    Raises SolveError, with the path and what is wrong with it.
    """
    text = read_text(path)
    try:
        return from_json(text)
    except SolveError as error:
        raise SolveError(f"{path}: {error}") from error


def to_json(solution: Solution) -> str:
    """Return a solution as text: null for nan, "inf" and "-inf" for infinities, which JSON lacks,
    and floats that read back bit for bit.
    """
    document = {
        "schema": consistency.SCHEMAS[-1],
        **{name: getattr(solution, name) for name in _DERIVED},
    }
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
    values = _read(document, Result)
    records = {
        "arcs": tuple(map(_arc, values["arcs"])),
        "stop": stop,
        "effort": _effort(values["effort"]),
        "judgement": _judgement(values["judgement"]),
        "origin": Origin(**values["origin"]),
    }
    known = {f.name: values[f.name] for f in fields(Solution)}
    return Solution(**{**known, **records})


def _effort(values: Mapping[str, Any]) -> Effort:
    records = {
        "nodes": tuple(Node(**each) for each in values["nodes"]),
        "starts": values["starts"] and _starts(values["starts"]),
    }
    return Effort(**{**values, **records})


def _judgement(values: Mapping[str, Any]) -> Judgement:
    places = _stretches(values["structure"])
    records = {
        "agreement": values["agreement"] and Agreement(**values["agreement"]),
        "proofs": tuple(map(_proof, values["proofs"])),
        "verified": tuple(Feasibility(**each) for each in values["verified"]),
        "verdict": values["verdict"] and _verdict(values["verdict"], places),
    }
    return Judgement(**{**values, **records})


def _starts(values: Mapping[str, Any]) -> Starts:
    coarse, extremals = (
        tuple(Met(**each) for each in values[name]) for name in ("coarse", "extremals")
    )
    return Starts(**{**values, "coarse": coarse, "extremals": extremals})


def _proof(values: Mapping[str, Any]) -> Proof:
    return Proof(**{**values, "rung": _member(Rung, values["rung"], "proofs")})


def _member(kind: type[_Names], name: str, where: str) -> _Names:
    """Return a member of an enumeration by its name."""
    if name not in kind.__members__:
        known = ", ".join(kind.__members__)
        raise SolveError(f"not a socp result: {where}: '{name}'; there are {known}")
    return kind[name]


def _stop(name: str) -> Stop:
    if name not in Stop.__members__:
        raise ProblemError(f"stop: '{name}'; there are {', '.join(Stop.__members__)}")
    return Stop[name]


def _read(data: Any, kind: Any) -> Any:
    """Return what a field of a file holds, of a kind of the schema: numbers as floats, lists as
    tuples, records as tables.
    """
    origin, args, value = get_origin(kind), get_args(kind), data
    if kind == Number:
        value = number(data)
    elif data is None or kind is Any:
        pass
    elif origin in {Annotated, UnionType}:  # a kind with its limits; a record, or none
        value = _read(data, args[0])
    elif origin is dict:
        value = {name: _read(each, args[1]) for name, each in data.items()}
    elif origin in {list, tuple}:
        kinds = args if origin is tuple and args[-1] is not ... else [args[0]] * len(data)
        value = tuple(map(_read, data, kinds))
    elif isinstance(data, Mapping):
        value = {f.name: _read(data[f.name], f.type) for f in msgspec.structs.fields(kind)}
    return value


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
    words = data["condition"]
    kind = next((each for each in Condition if each.value == words), Condition.OTHER)
    place = Place(
        **{name: data[name] for name in ("control", "of", "stretch", "arc")},
        mode=Mode.parse(data["mode"]) if data["mode"] else None,
    )
    return Finding(
        kind=kind,
        residual=data["residual"],
        place=place if data["kind"] else stretches.get(data["where"], Place(of=data["where"])),
        t=data["t"],
        wants=Mode.parse(data["wants"]) if data["wants"] else None,
        text=words if kind is Condition.OTHER else "",
    )


def _verdict(data: Mapping[str, Any], stretches: Mapping[str, Place]) -> Verdict:
    findings = tuple(_finding(each, stretches) for each in data["findings"])
    margins = {stretches.get(k, Place(of=k)): margin for k, margin in data["margins"].items()}
    graded = data["grade"] and Grade(**data["grade"])
    records = {
        "findings": findings,
        "margins": margins,
        "grade": graded,
        "second_order": _second_order(data["second_order"]),
    }
    return Verdict(**{**data, **records})


def _second_order(data: Mapping[str, Any] | None) -> SecondOrder | None:
    if data is None:
        return None
    records = {
        "kind": _member(Minimum, data["kind"], "second_order"),
        "word": data["word"] and Curvature(**data["word"]),
        "singular": data["singular"] and Curvature(**data["singular"]),
        "descent": data["descent"] and Descent(**data["descent"]),
    }
    return SecondOrder(**{**data, **records})


def _arc(data: Mapping[str, Any]) -> Arc:
    t, multipliers = np.array(data["t"]), data["multipliers"]
    rows = {name: np.array(data[name]).reshape(-1, t.size) for name in ("x", "u", "costate")}
    return Arc(
        t=t,
        **rows,
        mesh=np.array(data["mesh"], dtype=int),
        side=data["side"],
        modes=tuple(map(Mode.parse, data["modes"])),
        multipliers={name: np.array(values) for name, values in multipliers.items()},
    )

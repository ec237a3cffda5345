"""The result file: strict JSON that reads back bit for bit, written whole or not at all."""

import json
import os
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from socp.arc import Arc
from socp.errors import SolveError
from socp.records import Agreement, Feasibility, Node
from socp.verdict import Finding, Verdict

SCHEMA = 1  # version of the result file; a reader refuses any other
T = TypeVar("T")
_DERIVED = ("word", "switches", "extremal")  # in the file for its readers; a solution works them out


def to_json(solution: Any) -> str:
    """Return a solution as text: null for nan, "inf" and "-inf" for infinities, which JSON lacks."""
    document = {"schema": SCHEMA, **{name: getattr(solution, name) for name in _DERIVED}}
    document |= {f.name: getattr(solution, f.name) for f in fields(solution)}
    return json.dumps(_plain(document), allow_nan=False, indent=1)


def read(text: str, solution: Callable[..., T], stops: Any) -> T:
    """Return the solution that `to_json` wrote; SolveError says what is wrong with anything else."""
    try:
        document = json.loads(text)
        schema = document.pop("schema")
        if schema != SCHEMA:
            raise SolveError(f"result has schema {schema}; this socp reads schema {SCHEMA}")
        for derived in _DERIVED:
            document.pop(derived)
        return solution(**{**document, **_fields(document, stops)})
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise SolveError(f"not a socp result: {type(error).__name__}: {error}") from error


def _fields(document: Mapping[str, Any], stops: Any) -> dict[str, Any]:
    """Return the fields that JSON does not hold as they are."""
    if not document["arcs"]:
        raise ValueError("it has no arcs")
    for name in ("problem", "method", "message"):
        if not isinstance(document[name], str):
            raise ValueError(f"its {name} is {document[name]!r} where a text is needed")  # noqa: TRY004 - read as one
    return {
        "arcs": tuple(_arc(arc) for arc in document["arcs"]),
        "stop": stops[document["stop"]],
        "objective": _float(document["objective"]),
        "parameters": {name: _float(value) for name, value in document["parameters"].items()},
        "seconds": {name: _float(value) for name, value in document["seconds"].items()},
        "trace": {name: tuple(map(_float, values)) for name, values in document["trace"].items()},
        "meshes": tuple(tuple(map(_float, mesh)) for mesh in document["meshes"]),
        "structure": {name: tuple((m, a, b) for m, a, b in row) for name, row in document["structure"].items()},
        "nodes": tuple(Node(**_numbers(each)) for each in document["nodes"]),
        "agreement": None if document["agreement"] is None else Agreement(**_numbers(document["agreement"])),
        "verified": tuple(Feasibility(**_feasibility(each)) for each in document["verified"]),
        "verdict": None if document["verdict"] is None else _verdict(document["verdict"]),
        **{name: tuple(document[name]) for name in ("state_names", "control_names")},
    }


def write_atomic(path: Path, content: str | bytes) -> None:
    """Write text or bytes to a file beside `path`, then rename it; SolveError names the path where that fails."""
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
    except OSError as error:
        raise SolveError(f"{path}: cannot be written: {error.strerror or error}") from error
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())  # a rename may reach the disk before the content does
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except OSError as error:
        raise SolveError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        Path(temporary).unlink(missing_ok=True)


def _plain(value: Any) -> Any:
    """Return a value in JSON's types: arrays as lists, enums by name, records by their fields."""
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, Enum):
        value = value.name
    elif is_dataclass(value):
        value = {f.name: _plain(getattr(value, f.name)) for f in fields(value)}
    elif isinstance(value, Mapping):
        value = {str(k): _plain(v) for k, v in value.items()}
    elif isinstance(value, (list, tuple)):
        value = [_plain(v) for v in value]
    elif isinstance(value, float) and not np.isfinite(value):
        value = None if np.isnan(value) else str(value)
    return value


def _float(value: Any) -> float:
    return float("nan") if value is None else float(value)


def _numbers(data: Mapping[str, Any]) -> dict[str, Any]:
    return {k: v if isinstance(v, str) and k in {"word", "stop"} else _float(v) for k, v in data.items()}


def _feasibility(data: Mapping[str, Any]) -> dict[str, Any]:
    figures = {k: _float(data[k]) for k in ("miss", "path", "box", "drift", "objective", "gap") if k in data}
    return {**data, **figures, "end": tuple(_float(v) for v in data["end"])}


def _verdict(data: Mapping[str, Any]) -> Verdict:
    figures = {name: _float(data[name]) for name in ("miss", "normality", "objective_error")}
    named = ("legendre_clebsch", "margins", "ringing")
    tables = {name: {k: _float(v) for k, v in data[name].items()} for name in named}
    findings = tuple(Finding(**{**each, "residual": _float(each["residual"])}) for each in data["findings"])
    errors = tuple((float(t), _float(error)) for t, error in data["switch_errors"])
    given = {**data, **figures, **tables, "findings": findings, "switch_errors": errors, "notes": tuple(data["notes"])}
    given["chattering"] = tuple(data["chattering"])
    return Verdict(**given)


def _row(values: Any, count: int) -> np.ndarray:
    row = np.array([_float(value) for value in values])
    if row.shape != (count,):
        raise ValueError(f"an arc of {count} nodes has {row.size} values of a quantity")
    return row


def _arc(data: Mapping[str, Any]) -> Arc:
    count, mesh = len(data["t"]), np.array(data["mesh"], dtype=int)
    if mesh.size < 2 or mesh[0] != 0 or mesh[-1] != count - 1 or (np.diff(mesh) < 1).any():
        raise ValueError(f"an arc of {count} nodes has the mesh {data['mesh']}")
    if data["side"] not in {"left", "right", "both"}:
        raise ValueError(f"an arc has side {data['side']!r}")
    matrices = {k: np.array([_row(r, count) for r in data[k]]).reshape(-1, count) for k in ("x", "u", "costate")}
    multipliers = {name: _row(values, count) for name, values in data["multipliers"].items()}
    modes = tuple(data["modes"])
    return Arc(t=_row(data["t"], count), mesh=mesh, side=data["side"], modes=modes, multipliers=multipliers, **matrices)

"""Solutions with fields of any of their records set."""

from dataclasses import fields, replace
from typing import Any

from socp.model import Effort, Judgement, Origin, Solution

_RECORDS = {"effort": Effort, "judgement": Judgement, "origin": Origin}


def parted(changes: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """Return fields by the record that has them; "" has those of the solution itself."""
    found: dict[str, dict[str, Any]] = {"": dict(changes)}
    for part, record in _RECORDS.items():
        names = [f.name for f in fields(record) if f.name in changes]
        found[part] = {name: found[""].pop(name) for name in names}
    return found


def revised(solution: Solution, **changes: Any) -> Solution:
    """Return a solution with fields of it and of its records changed."""
    own, *_ = (parts := parted(changes)).values()
    records = {part: replace(getattr(solution, part), **parts[part]) for part in _RECORDS}
    return replace(solution, **{**records, **own})


def built(**values: Any) -> Solution:
    """Return a solution of fields of it and of its records."""
    parts = parted(values)
    records = {part: record(**parts[part]) for part, record in _RECORDS.items()}
    return Solution(**{**records, **parts[""]})


def older(document: dict[str, Any], schema: int = 1) -> dict[str, Any]:
    """Return the document of a result as files of an earlier schema held it: all fields in one
    table, and, in the first, no statement.
    """
    found = {name: value for name, value in document.items() if name not in _RECORDS}
    for part in _RECORDS:
        found |= document[part]
    gone = {"statement", "unstated"} if schema == 1 else set()
    return {**{k: v for k, v in found.items() if k not in gone}, "schema": schema}

"""Result files read strictly: the layout of the whole held, and its fields against each other,
before any is used.
"""

import itertools
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from socp.errors import MethodError, ProblemError
from socp.model.data import stated
from socp.model.data.schema import Arc, Finding, Result, in_parts
from socp.model.result.findings import Condition
from socp.model.tolerances import SAME_TIME
from socp.model.word import Mode

# versions of the layout that are read, the last of them written; in the first, results carried no
# statement, and findings only words; in the second, all fields were one table
SCHEMAS = (1, 2, 3)
# of a time, state, control or costate: the square of a larger one, which every norm takes,
# overflows
LARGEST = 1e150


def document(text: str) -> dict[str, Any]:
    """Return the document of a result file's text, all of it checked, with the fields that older
    files lack; ProblemError names the field that is wrong.
    """
    found = _strict(text)
    if not isinstance(found, dict):
        raise ProblemError(f"{type(found).__name__} where a table of fields is needed")
    if found.get("schema") not in SCHEMAS:
        known = f"{', '.join(map(str, SCHEMAS[:-1]))} and {SCHEMAS[-1]}"
        raise ProblemError(
            f"schema: {_shown(found.get('schema', 'none'))}; this socp reads schemas {known}"
        )
    result = stated.record_of(found if found["schema"] == SCHEMAS[-1] else in_parts(found), Result)
    statement, verdict = result.origin.statement, result.judgement.verdict
    _texts(result)
    if statement is not None:
        _statement(result, statement)
    for k, arc in enumerate(result.arcs):
        _arc(f"arcs[{k}]", arc, result)
    for k, finding in enumerate(verdict.findings if verdict else ()):
        _finding(f"judgement.verdict.findings[{k}]", finding)
    _in_order(result.arcs)
    _structure(result.judgement.structure, result.control_names)
    if statement is not None:
        check_constraints(result, stated.constraint_names(statement))
    filled: dict[str, Any] = msgspec.to_builtins(result)
    return filled


def check_names(result: Any, names: Mapping[str, Sequence[str]]) -> None:
    """Raise ProblemError where the fields of a result, or of a solution, hold other names than
    those of its problem.

    `names` are by field: state_names, control_names and parameters.
    """
    for field, wanted in names.items():
        its = list(getattr(result, field))
        if its != list(wanted) and (field != "parameters" or sorted(its) != sorted(wanted)):
            has, needs = (", ".join(each) or "none" for each in (its, wanted))
            raise ProblemError(f"{field}: {has}; those of its problem are {needs}")


def check_constraints(result: Any, constraints: Sequence[str]) -> None:
    """Raise ProblemError where arcs of a result, or of a solution, name other constraints than
    those of its problem.
    """
    known = set(constraints)
    for k, arc in enumerate(result.arcs):
        modes = [Mode.parse(str(mode)).constraint for mode in arc.modes]
        for field, its in (
            ("modes", [each for each in modes if each]),
            ("multipliers", arc.multipliers),
        ):
            for name in its:
                if name not in known:
                    there = ", ".join(constraints) or "none"
                    raise ProblemError(
                        f"arcs[{k}].{field}: no state constraint '{name}'; there are {there}"
                    )


def _statement(result: Result, statement: Mapping[str, Any]) -> None:
    """Check the statement that a result carries, and that it is the one of the result's own
    problem.
    """
    try:
        stated.check(statement)
    except ProblemError as error:
        raise ProblemError(f"origin.statement.{error}") from error
    if result.problem != statement["name"]:
        named = f"'{statement['name']}', but the problem is called '{result.problem}'"
        raise ProblemError(f"origin.statement.name: {named}")
    fields = (
        ("state_names", "states"),
        ("control_names", "controls"),
        ("parameters", "parameters"),
    )
    check_names(result, {field: statement[each] for field, each in fields})


def _strict(text: str) -> Any:
    """Return JSON as values: no NaN, no name twice in a table, no text that cannot be written
    again.
    """
    try:
        found = json.loads(text, object_pairs_hook=_table, parse_constant=_refused)
        if "\\ud" in text.lower():  # half a surrogate pair is a JSON escape, but no text
            json.dumps(found, ensure_ascii=False).encode()
    except RecursionError:
        raise ProblemError("tables nested too deep") from None
    except UnicodeEncodeError:
        raise ProblemError("half a surrogate pair in a text") from None
    except ValueError as error:
        raise ProblemError(f"not JSON: {error}") from error
    return found


def _table(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ProblemError(
            f"'{stated.duplicate([name for name, _ in pairs])}' is there twice in one table"
        )
    return found


def _refused(constant: str) -> Any:
    raise ProblemError(
        f'{constant} is no JSON; unknown numbers are null, infinities "inf" and "-inf"'
    )


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _texts(result: Result) -> None:
    """Check the names: they tell things apart, and hold nothing that a terminal would obey."""
    names = {
        "problem": [result.problem],
        "origin.method": [result.origin.method],
        "parameters": result.parameters,
    }
    for field, texts in {
        **names,
        "state_names": result.state_names,
        "control_names": result.control_names,
    }.items():
        for text in texts:
            if not text.isprintable():
                raise ProblemError(f"{field}: {text!r} where a name is needed")
    twice = stated.duplicate([*result.state_names, *result.control_names, *result.parameters])
    if twice is not None:
        raise ProblemError(
            f"state_names, control_names, parameters: the name '{twice}' is there twice"
        )
    if not result.state_names:
        raise ProblemError("state_names: none")
    for name, value in result.parameters.items():
        if LARGEST < abs(stated.number(value)) < math.inf:
            raise ProblemError(f"parameters.{name}: {value} where at most {LARGEST:g} is allowed")


def _arc(where: str, arc: Arc, result: Result) -> None:
    count, mesh = len(arc.t), np.array(arc.mesh)
    if mesh.size < 2 or mesh[0] != 0 or mesh[-1] != count - 1 or (np.diff(mesh) < 1).any():
        ends = f"0, ..., {count - 1}, increasing, is needed"
        raise ProblemError(f"{where}.mesh: {_shown(arc.mesh)} where, for {count} nodes, {ends}")
    rows = {
        "x": len(result.state_names),
        "u": len(result.control_names),
        "costate": len(result.state_names),
    }
    for field, wanted in rows.items():
        matrix = getattr(arc, field)
        if len(matrix) != wanted:
            raise ProblemError(
                f"{where}.{field}: {len(matrix)} rows where {wanted} are needed, one for each name"
            )
        for k, row in enumerate(matrix):
            _row(f"{where}.{field}[{k}]", row, count)
    for name, row in arc.multipliers.items():
        _row(f"{where}.multipliers.{name}", row, count)
    _row(f"{where}.t", arc.t, count)
    if len(arc.modes) != rows["u"]:
        raise ProblemError(
            f"{where}.modes: {len(arc.modes)} where {rows['u']} are needed, one for each control"
        )
    for k, mode in enumerate(arc.modes):
        _mode(f"{where}.modes[{k}]", mode)


def _row(where: str, row: Any, count: int) -> None:
    if len(row) != count:
        raise ProblemError(
            f"{where}: {len(row)} values where {count} are needed, one for each node"
        )
    values = np.array([stated.number(value) for value in row])
    large = np.flatnonzero(np.isfinite(values) & (np.abs(values) > LARGEST))
    if large.size:
        raise ProblemError(
            f"{where}[{large[0]}]: {values[large[0]]} where at most {LARGEST:g} is allowed"
        )


def _finding(where: str, finding: Finding) -> None:
    """Check the modes of a finding, and that its kind is the one that its words are for."""
    for field, mode in (("wants", finding.wants), ("mode", finding.mode)):
        if mode:
            _mode(f"{where}.{field}", mode)
    kind, there = finding.kind, Condition.__members__
    if kind and kind not in there:
        raise ProblemError(f"{where}.kind: '{kind}'; there are {', '.join(there)}")
    if kind and kind != "OTHER" and there[kind].value != finding.condition:
        words = f"the words for {kind} are '{there[kind].value}'"
        raise ProblemError(f"{where}.condition: {_shown(finding.condition)}, but {words}")


def _mode(where: str, text: str) -> None:
    try:
        known = str(Mode.parse(text)) == text
    except MethodError:
        known = False
    if not known:
        raise ProblemError(
            f"{where}: '{text}' is no mode; modes are +, -, s, b, b[constraint] and *"
        )


def _in_order(arcs: list[Arc]) -> None:
    """Check that time goes on within arcs and from one to the next, and that some of it passes."""
    for k, arc in enumerate(arcs):
        back = np.flatnonzero(np.diff(arc.t) < 0)
        if back.size:
            raise ProblemError(
                f"arcs[{k}].t[{back[0] + 1}]: {arc.t[back[0] + 1]} comes after {arc.t[back[0]]}"
            )
    horizon = arcs[-1].t[-1] - arcs[0].t[0]
    if not horizon > 0:
        raise ProblemError(
            f"arcs: the horizon from {arcs[0].t[0]} to {arcs[-1].t[-1]} has no length"
        )
    for k, (one, two) in enumerate(itertools.pairwise(arcs)):
        if abs(two.t[0] - one.t[-1]) > SAME_TIME * horizon:
            raise ProblemError(
                f"arcs[{k + 1}].t[0]: {two.t[0]}, but the arc before it ends at {one.t[-1]}"
            )


def _structure(
    structure: Mapping[str, Sequence[tuple[str, float, float]]], controls: Sequence[str]
) -> None:
    where = "judgement.structure"
    if structure and set(structure) != set(controls):
        has, needs = (", ".join(each) or "none" for each in (structure, controls))
        raise ProblemError(f"{where}: of the controls {has}, but there are {needs}")
    for name, stretches in structure.items():
        if not stretches:
            raise ProblemError(f"{where}.{name}: no stretch")
        for k, (mode, start, end) in enumerate(stretches):
            _mode(f"{where}.{name}[{k}]", mode)
            if not start <= end:
                raise ProblemError(f"{where}.{name}[{k}]: it begins at {start} and ends at {end}")

"""The tables of a problem: its name, what kind of symbol may stand as a key in which, and names of
conditions.
"""

from collections.abc import Mapping
from typing import Any

from socp.errors import ProblemError
from socp.model.data.stated import TEXTS
from socp.model.parts import check_reference, check_text
from socp.model.symbols import final_time, initial_time, is_symbol, role, time
from socp.process import a, plainly, short, shown

Arguments = Mapping[str, Any]  # of a problem, by name

TABLES = (
    "dynamics",
    "bounds",
    "start",
    "end",
    "target",
    "path",
    "singular",
    "boundary",
    "guess",
    "units",
)
KINDS = {  # what may stand as a key, by table; other tables take names
    "dynamics": ("state",),
    "start": ("state",),
    "end": ("state",),
    "singular": ("control",),
    "boundary": ("control",),
    "bounds": ("state", "control", "parameter"),
    "guess": ("state", "control", "parameter"),
    "units": ("state", "control", "parameter"),
}
_LONGEST = (
    100  # characters of a problem's name: with .socp.json behind it, every file system takes it
)
_TIMES = (initial_time, final_time)


def check(problem: Arguments) -> None:
    """Raise ProblemError for a name, a table or a key of a wrong kind among a problem's
    arguments.
    """
    _name(problem["name"])
    for text in TEXTS:
        check_text(text, problem[text])
    check_reference(problem["reference"])
    for table in TABLES:
        if not isinstance(problem[table], Mapping):
            raise ProblemError(
                f"{table}: {shown(problem[table])} where a table {{...: ...}} is needed"
            )
    if not problem["dynamics"]:
        raise ProblemError("dynamics: give the rate of at least one state, dynamics={x: ...}")
    _keys(problem)


def label(name: Any) -> str:
    """Return a problem's name for the start of a message, whatever it is."""
    return (
        f"'{name}'"
        if isinstance(name, str) and len(name) <= _LONGEST and name.isprintable()
        else shown(name)
    )


def _name(name: Any) -> None:
    if not isinstance(name, str) or not name.strip():
        raise ProblemError("name: a problem needs a name, a string that is not empty")
    if len(name) > _LONGEST:
        raise ProblemError(
            f"name: has {len(name)} characters; at most {_LONGEST}, as results are named after it"
        )
    bad = next((sign for sign in name if sign in "/\\" or not sign.isprintable()), None)
    if bad is not None or name.startswith("."):
        what = "starts with a dot" if bad is None else f"holds {bad!a}"
        raise ProblemError(
            f"name: {name!a} {what}; results are named after it, so that no file could be"
        )


def _keys(problem: Arguments) -> None:
    for table, kinds in KINDS.items():
        for key in problem[table]:
            _key(table, key, kinds)
    for table in ("target", "path"):
        for name in problem[table]:
            if not isinstance(name, str) or not name.strip():
                raise ProblemError(
                    f"{table}: {shown(name)} where the condition's name, a string, is needed"
                )
            if table == "path" and any(sign in "[];" or sign.isspace() for sign in name):
                raise ProblemError(
                    f"path: {shown(name)}: a word names it as b[{short(name)}], so that it may "
                    "hold no blank, [ ] or ;"
                )
    for symbol, unit in problem["units"].items():
        check_text(f"units of '{symbol}'", unit)


def _key(table: str, key: Any, kinds: tuple[str, ...]) -> None:
    if is_symbol(key) and (
        (table == "guess" and key in set(_TIMES)) or (table == "units" and key in {time, *_TIMES})
    ):
        return
    kind, last = role(key), " or a ".join(kinds)
    if is_symbol(key) and key in set(_TIMES) and table == "bounds":
        entry = "final_time" if key.name() == "tf" else "initial_time"
        raise ProblemError(f"bounds: '{key}' has its own entry; write {entry}=(lower, upper)")
    if kind is None:
        what = "is not declared" if is_symbol(key) else f"is no symbol (it is {a(key)})"
        raise ProblemError(
            f"{table}: '{plainly(key)}' {what}; a {last} made by {kinds[0]}s(...) goes here"
        )
    if kind not in kinds:
        raise ProblemError(f"{table}: '{key}' is a {kind}; a {last} goes here")

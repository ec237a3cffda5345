"""Statements: problems as data, in the layout that result files carry, and what is wrong with one
that is none.
"""

import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from typing import Annotated, Any, Literal, TypeVar

import msgspec

from socp.errors import ProblemError
from socp.model.data import grammar

T = TypeVar("T")
Number = float | Literal["inf", "-inf"] | None  # null for nan
Name = Annotated[str, msgspec.Meta(min_length=1, max_length=200)]
Place = Annotated[int, msgspec.Meta(ge=0, lt=grammar.MOST)]
Limit = float | Literal["inf", "-inf"]
Interval = tuple[Limit, Limit]
Nodes = list[grammar.Node]

_SCENE = {
    "plane": (2,),
    "flow": (0, 2),
    "heading": (0, 1),
}  # how many expressions there are to each
# Symbols: a state of each point of a fine grid in a plane; the judge's algebra ends long before
_MOST = 10_000
# Characters of a message: what is wrong is said in fewer, the rest is what a file put there
_LONGEST = 500
OUTSIDE = (
    "fingerprint",
    "name",
    "about",
    "formula",
)  # of a statement: what its fingerprint is not of


class Record(msgspec.Struct, forbid_unknown_fields=True):
    """A record whose fields are all there are."""


class Reference(Record):
    """Known values to compare with."""

    objective: Number
    switches: list[Number]
    word: str
    tolerance: Number
    source: str


class About(Record):
    """What is known beside a problem; `nodes` are those of its scene and its guess."""

    title: str
    source: str
    reference: Reference | None
    units: dict[Name, str]
    nodes: Nodes
    guess: dict[Name, list[Place]]
    scene: dict[Name, list[Place]] | None
    target: tuple[float, float, float] | None


# fields of a problem that are texts for people, empty where they are not given
TEXTS = tuple(name for name, kind in About.__annotations__.items() if kind is str)


class Constant(Record):
    """A named constant."""

    value: float
    unit: str
    text: str


class Formula(Record):
    """What was written with constants: their values, and expressions, of the list `nodes`, for
    places of the problem.
    """

    constants: Annotated[dict[Name, Constant], msgspec.Meta(min_length=1)]
    nodes: Nodes
    places: list[tuple[Annotated[list[Name], msgspec.Meta(min_length=1)], Place]]


class Statement(Record):
    """A problem: names, intervals, and places of expressions in the list `nodes`."""

    fingerprint: str
    name: Name
    states: list[Name]
    controls: list[Name]
    parameters: list[Name]
    nodes: Nodes
    minimise: Place | None
    running: Place | None
    dynamics: dict[Name, Place]
    path: dict[Name, Place]
    target: dict[Name, Place]
    singular: dict[Name, Place]
    boundary: dict[Name, Place | dict[Name, Place]]
    bounds: dict[Name, Interval]
    start: dict[Name, Interval]
    end: dict[Name, Interval]
    initial_time: Interval
    final_time: Interval
    about: About
    formula: Formula | None = None  # where nothing holds constants it is not there


def record_of(data: Any, kind: type[T]) -> T:
    """Return data as a record; ProblemError names the field and what it holds in place of what."""
    try:
        return msgspec.convert(data, kind)
    except msgspec.ValidationError as error:
        what, _, where = str(error).partition(" - at `$")
        where = where.strip("`").removeprefix(".")
        text = what[:1].lower() + what[1:].replace("`", "'")
        raise ProblemError(f"{where}: {text}" if where else text) from error


def check(data: Any) -> None:
    """Raise ProblemError, naming the field, for data that is no statement; whether its problem is
    one is not asked.
    """
    statement = record_of(data, Statement)
    _names(statement)
    _texts(statement)
    known = dict.fromkeys(names(statement))
    grammar.check(statement.nodes, known)
    try:
        grammar.check(statement.about.nodes, known)
    except ProblemError as error:
        raise ProblemError(f"about.{error}") from error
    _formula(statement.formula, known)
    for where, place, nodes in _places(statement):
        if place >= len(nodes):
            raise ProblemError(f"{where}: {place} where a place among {len(nodes)} nodes is needed")
    if statement.fingerprint != fingerprint(data):
        raise ProblemError(
            "fingerprint: it is not that of the statement, which was changed after it was written"
        )


def _formula(formula: Formula | None, known: Mapping[str, Any]) -> None:
    """Check that a formula holds known symbols and constants alone."""
    if formula is None:
        return
    both = formula.constants.keys() & known.keys()
    if both:
        raise ProblemError(f"formula.constants: '{min(both)}' names something else")
    try:
        grammar.check(formula.nodes, {**known, **formula.constants})
    except ProblemError as error:
        raise ProblemError(f"formula.{error}") from error


def duplicate(names: list[str]) -> str | None:
    """Return the first name that is there twice, if any."""
    seen: set[str] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None


def quotation(error: object) -> str:
    """Return what a message quotes of a file: short, and nothing in it that a terminal would
    obey.
    """
    text = str(error)
    text = text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."
    return "".join(each if each.isprintable() else repr(each)[1:-1] for each in text)


def fingerprint(data: Mapping[str, Any]) -> str:
    """Return the sha256 of a statement's canonical JSON: keys in order, no blanks, without what
    defines nothing.
    """
    defining = {key: value for key, value in data.items() if key not in OUTSIDE}
    text = json.dumps(defining, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def names(statement: Statement) -> list[str]:
    """Return the names of all symbols that a statement's expressions may hold."""
    declared = [*statement.states, *statement.controls, *statement.parameters]
    return [*declared, "t", "t0", "tf", *map(at_start, statement.states)]


def at_start(state: str) -> str:
    """Return the name of a state's value at the initial time."""
    return f"{state}(t0)"


def constraint_names(data: Mapping[str, Any]) -> list[str]:
    """Return the names of all state constraints of a statement: bounds of states, and those of
    `path`.
    """
    bounds = [
        (name, k, side) for name in data["states"] for k, side in enumerate(("lower", "upper"))
    ]
    free = ("-inf", "inf")
    found = [
        f"{name}.{side}" for name, k, side in bounds if data["bounds"].get(name, free)[k] != free[k]
    ]
    return [*found, *data["path"]]


def json_number(value: Any) -> float | str | None:
    """Return a number as JSON has it: infinities as texts, nan as null."""
    number = float(value)
    return number if math.isfinite(number) else None if math.isnan(number) else str(number)


def number(value: Any) -> float:
    """Return the number that `json_number` wrote."""
    return math.nan if value is None else float(value)


def _names(statement: Statement) -> None:
    """Check that names tell symbols apart, and that tables hold names of the right kind."""
    symbols = [*statement.states, *statement.controls, *statement.parameters]
    twice = duplicate(symbols)
    if twice is not None:
        raise ProblemError(f"states, controls, parameters: the name '{twice}' is there twice")
    if len(symbols) > _MOST:
        raise ProblemError(
            f"states, controls, parameters: {len(symbols)} where at most {_MOST} are allowed"
        )
    kinds = (
        ("dynamics", statement.states),
        ("start", statement.states),
        ("end", statement.states),
        ("bounds", symbols),
        ("singular", statement.controls),
        ("boundary", statement.controls),
        ("about.guess", [*symbols, "t0", "tf"]),
        ("about.units", [*symbols, "t", "t0", "tf"]),
    )
    for table, allowed in kinds:
        its = (
            getattr(statement.about, table[6:])
            if table.startswith("about.")
            else getattr(statement, table)
        )
        strange = its.keys() - set(allowed)
        if strange:
            its_names = ", ".join(allowed) or "none"
            raise ProblemError(
                f"{table}: no symbol '{min(strange)}' goes here; there are {its_names}"
            )
    if list(statement.dynamics) != statement.states:
        raise ProblemError("dynamics: not one rate for each of the states, in their order")
    _counts(statement.about)


def _texts(statement: Statement) -> None:
    """Check that names can be printed, and that other texts hold nothing that a terminal would
    obey.
    """
    about = statement.about
    laws = [each for each in statement.boundary.values() if isinstance(each, dict)]
    constants = {} if statement.formula is None else statement.formula.constants
    tables: list[Mapping[str, Any]] = [statement.path, statement.target, *laws, constants]
    for name in [statement.name, *names(statement), *(name for table in tables for name in table)]:
        if not name.isprintable():
            raise ProblemError(f"{name!r} where a name is needed")
    reference = [] if about.reference is None else [about.reference.word, about.reference.source]
    told = [text for each in constants.values() for text in (each.unit, each.text)]
    texts = [getattr(about, each) for each in TEXTS]
    for text in [*texts, *about.units.values(), *reference, *told]:
        if not all(line.isprintable() for line in text.replace("\t", " ").split("\n")):
            raise ProblemError(f"about: {text!r} has control characters")


def _counts(about: About) -> None:
    """Check how many expressions there are to the parts of a scene and to a guess."""
    if about.scene is not None:
        for each in dict.fromkeys([*_SCENE, *about.scene]):
            if len(about.scene.get(each, [])) not in _SCENE.get(each, ()):
                raise ProblemError(
                    f"about.scene.{each}: {len(about.scene.get(each, []))} expressions"
                )
    for name, parts in about.guess.items():
        if len(parts) not in {1, 2}:
            raise ProblemError(
                f"about.guess.{name}: {len(parts)} values where one or two are needed"
            )


def _places(statement: Statement) -> Iterator[tuple[str, int, Nodes]]:
    """Yield (field, place, list that it is a place in) of every expression."""
    for each in ("minimise", "running"):
        if getattr(statement, each) is not None:
            yield each, getattr(statement, each), statement.nodes
    for table in ("dynamics", "path", "target", "singular", "boundary"):
        for name, value in getattr(statement, table).items():
            for place in value.values() if isinstance(value, dict) else [value]:
                yield f"{table}.{name}", place, statement.nodes
    about = statement.about
    drawn = [(f"scene.{name}", places) for name, places in (about.scene or {}).items()]
    for name, places in [
        *drawn,
        *((f"guess.{name}", places) for name, places in about.guess.items()),
    ]:
        yield from ((f"about.{name}", place, about.nodes) for place in places)
    if statement.formula is not None:
        for path, place in statement.formula.places:
            yield f"formula.{'.'.join(path)}", place, statement.formula.nodes

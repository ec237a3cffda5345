"""What a problem must satisfy, each breach refused with the offending name."""

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import casadi

from socp import ranges, scene
from socp.affinity import not_affine
from socp.errors import ProblemError
from socp.symbols import Expr, final_time, initial, initial_time, is_logical, is_symbol, relation, role, time

if TYPE_CHECKING:
    from socp.problem import Problem

TABLES = ("dynamics", "bounds", "start", "end", "target", "path", "singular", "boundary", "guess", "units")
_TIMES = (initial_time, final_time)
_KINDS = {  # what may stand as a key, by table; other tables take names
    "dynamics": ("state",), "start": ("state",), "end": ("state",), "singular": ("control",), "boundary": ("control",),
    "bounds": ("state", "control", "parameter"), "guess": ("state", "control", "parameter"),
    "units": ("state", "control", "parameter"),
}  # fmt: skip


def expressions(problem: "Problem") -> list[Expr]:
    """Return every expression of the problem, relations included."""
    laws = [law for _, law in boundary_laws(problem.boundary)]
    parts = [problem.minimise, problem.running, *problem.dynamics.values(), *problem.target.values()]
    parts += [*problem.path.values(), *problem.singular.values(), *laws]
    return [casadi.SX(part) for part in parts if part is not None]


def boundary_laws(boundary: Mapping[Expr, Any]) -> Iterator[tuple[str | None, Expr]]:
    """Yield (constraint name or None, law) of all user-given boundary laws."""
    for law in boundary.values():
        if isinstance(law, Mapping):
            yield from law.items()
        else:
            yield None, law


def validate(problem: "Problem") -> None:
    """Raise ProblemError, naming problem and offender, unless the problem is well posed as written."""
    try:
        _tables(problem)
        _expressions(problem)
        _symbols(problem)
        ranges.check(problem)
        _used(problem)
        _affine(problem)
        _named(problem)
    except ProblemError as error:
        raise ProblemError(f"problem {_label(problem.name)}: {error}") from None


def _label(name: Any) -> str:
    return f"'{name}'" if isinstance(name, str) else repr(name)


def _tables(problem: "Problem") -> None:
    """Check names, tables and their keys: what kind of thing stands where."""
    if not isinstance(problem.name, str) or not problem.name.strip():
        raise ProblemError("name: a problem needs a name, a string that is not empty")
    for text in ("title", "source"):
        _string(text, getattr(problem, text))
    if problem.reference is not None and type(problem.reference).__name__ != "Reference":
        raise ProblemError(f"reference: {problem.reference!r} where a Reference(objective=...) is needed")
    for table in TABLES:
        if not isinstance(getattr(problem, table), Mapping):
            raise ProblemError(f"{table}: {getattr(problem, table)!r} where a table {{...: ...}} is needed")
    if not problem.dynamics:
        raise ProblemError("dynamics: give the rate of at least one state")
    _keys(problem)
    scene.check(problem.scene)


def _keys(problem: "Problem") -> None:
    for table, kinds in _KINDS.items():
        for key in getattr(problem, table):
            _key(table, key, kinds)
    for table in ("target", "path"):
        for name in getattr(problem, table):
            if not isinstance(name, str) or not name.strip():
                raise ProblemError(f"{table}: {name!r} where the condition's name, a string, is needed")
    for symbol, unit in problem.units.items():
        _string(f"units of '{symbol}'", unit)


def _string(place: str, value: Any) -> None:
    if not isinstance(value, str):
        raise ProblemError(f"{place}: {value!r} where a string is needed")


def _key(table: str, key: Any, kinds: tuple[str, ...]) -> None:
    if is_symbol(key) and ((table == "guess" and key in set(_TIMES)) or (table == "units" and key in {time, *_TIMES})):
        return
    kind, last = role(key), " or a ".join(kinds)
    if is_symbol(key) and key in set(_TIMES) and table == "bounds":
        entry = "final_time" if key.name() == "tf" else "initial_time"
        raise ProblemError(f"bounds: '{key}' has its own entry; write {entry}=(lower, upper)")
    if kind is None:
        what = "is not declared" if is_symbol(key) else f"is no symbol (it is a {type(key).__name__})"
        raise ProblemError(f"{table}: '{key}' {what}; a {last} made by {kinds[0]}s(...) goes here")
    if kind not in kinds:
        raise ProblemError(f"{table}: '{key}' is a {kind}; a {last} goes here")


def placed(problem: "Problem") -> Iterator[tuple[str, Expr]]:
    """Yield (where it stands, expression) for everything but bounds, ends and guesses; relations as left - right."""
    yield from ((f"dynamics of '{state}'", rate) for state, rate in problem.dynamics.items())
    costs = (("minimise", problem.minimise), ("running", problem.running))
    yield from ((place, e) for place, e in costs if e is not None)
    yield from ((f"singular law of '{control}'", law) for control, law in problem.singular.items())
    for control, law in problem.boundary.items():
        laws = law.values() if isinstance(law, Mapping) else [law]
        yield from ((f"boundary law of '{control}'", each) for each in laws)
    yield from ((f"target '{name}'", relation(c, f"target '{name}'")[0]) for name, c in problem.target.items())
    for name, constraint in problem.path.items():
        left, equation = relation(constraint, f"path '{name}'")
        if equation:
            raise ProblemError(f"path '{name}': an equation; a path constraint is c(x, t) <= 0")
        yield f"path '{name}'", left
    yield from scene.placed(problem.scene)


def _expressions(problem: "Problem") -> None:
    if problem.minimise is None and problem.running is None:
        raise ProblemError("no objective: give minimise (a Mayer term) or running (an integrand), or both")
    for place, expression in placed(problem):
        if not isinstance(expression, casadi.SX) and not ranges.is_number(expression):
            raise ProblemError(f"{place}: {expression!r} is not an expression (it is a {type(expression).__name__})")
        scalar = casadi.SX(expression)
        if scalar.shape != (1, 1):
            raise ProblemError(f"{place}: shape {scalar.shape} where one number is needed")
        if is_logical(scalar):
            raise ProblemError(f"{place}: {expression} is a relation, true or false, where a quantity is needed")
        _finite(place, scalar)


def _finite(place: str, expression: Expr) -> None:
    """Refuse nan and infinity anywhere inside an expression: no solver recovers from either."""
    function = casadi.Function("part", casadi.symvar(expression), [expression])
    for k in range(function.n_instructions()):
        if function.instruction_id(k) == casadi.OP_CONST and not math.isfinite(function.instruction_constant(k)):
            raise ProblemError(f"{place}: {expression} where a finite value is needed")


def _symbols(problem: "Problem") -> None:
    used = {s for e in expressions(problem) for s in casadi.symvar(e)}
    at_ends = {*(initial(state) for state in problem.dynamics), *_TIMES}
    for place, expression in placed(problem):
        ends = place == "minimise" or place.startswith("target")
        with_controls = place == "running" or place.startswith("dynamics")
        for symbol in casadi.symvar(casadi.SX(expression)):
            kind = role(symbol)
            if kind == "state" and symbol not in problem.dynamics:
                raise ProblemError(f"{place}: state '{symbol}' has no dynamics")
            if kind == "control" and not with_controls:
                raise ProblemError(f"{place}: uses the control '{symbol}'; allowed are states, parameters and times")
            if kind == "control" and symbol not in problem.bounds:
                raise ProblemError(f"control '{symbol}' has no bounds; give bounds={{{symbol}: (lower, upper)}}")
            if kind == "parameter" and place.startswith("scene") and symbol not in used:
                raise ProblemError(f"{place}: parameter '{symbol}' is in no other expression of the problem")
            if kind is None and symbol not in (at_ends if ends else {time}):
                raise ProblemError(f"{place}: unknown symbol '{symbol}'{_hint(symbol, ends=ends)}")


def _hint(symbol: Expr, *, ends: bool) -> str:
    if symbol.name() == "t" and ends:
        return "; at the ends write final_time or initial_time"
    if symbol.name().endswith("(t0)") and not ends:
        return "; initial values are known in minimise and target only"
    if symbol.name() in {"t0", "tf"} and not ends:
        return "; along the way write time"
    return "; declare it with states, controls or parameters"


def _used(problem: "Problem") -> None:
    """Check that what is bounded, guessed or measured is part of the problem, and that names tell symbols apart."""
    used = {s for e in expressions(problem) for s in casadi.symvar(e)}
    states = list(problem.dynamics)
    controls = [symbol for symbol in problem.bounds if role(symbol) == "control"]
    parameters = [symbol for symbol in used if role(symbol) == "parameter"]
    for control in controls:
        if control not in used:
            raise ProblemError(f"bounds: control '{control}' acts on nothing; it is in no dynamics and not in running")
    lacking = {"state": "dynamics", "control": "bounds", "parameter": "place in any expression of the problem"}
    for table in _KINDS:
        for symbol in getattr(problem, table):
            kind = role(symbol)
            if kind is not None and symbol not in {*states, *controls, *parameters}:
                raise ProblemError(f"{table}: {kind} '{symbol}' has no {lacking[kind]}")
    _distinct(symbol.name() for symbol in [*states, *controls, *parameters])


def _distinct(names: Iterable[str]) -> None:
    found: set[str] = set()
    for name in names:
        if name in found:
            raise ProblemError(f"the name '{name}' is used for two symbols")
        found.add(name)


def _affine(problem: "Problem") -> None:
    rows = [(f"dynamics of '{state}'", casadi.SX(rate)) for state, rate in problem.dynamics.items()]
    rows.append(("running cost", problem.lagrangian))
    for place, expression in rows:
        for k in not_affine(expression, problem.u):
            name = problem.control_names[k]
            raise ProblemError(f"{place} is not affine in control '{name}'; write it as f0 + {name}*f1")


def _named(problem: "Problem") -> None:
    """Check the names of constraints and conditions, by which laws, words and results refer to them."""
    bounds = [f"{name}.{side}" for name in problem.state_names for side in ("lower", "upper")]
    for name in problem.path:
        if name in bounds:
            raise ProblemError(f"path '{name}': this is the name of a state's bound; choose another")
    for name in problem.target:
        if name in {*problem.state_names, "initial time", "final time"}:
            raise ProblemError(f"target '{name}': this names an end value already; choose another")
    names = [constraint.name for constraint in problem.constraints]
    for control, law in problem.boundary.items():
        if not names:
            raise ProblemError(f"boundary law of '{control}': the problem has no state constraint to follow")
        for name in law if isinstance(law, Mapping) else []:
            if name not in names:
                there = ", ".join(names)
                raise ProblemError(f"boundary law of '{control}': no state constraint '{name}'; there are {there}")

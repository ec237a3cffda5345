"""What a problem must satisfy, each breach refused with the offending name."""

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from socp.errors import ProblemError
from socp.symbols import Expr, final_time, initial, initial_time, relation, role, time

if TYPE_CHECKING:
    from socp.problem import Problem


def interval(value: Any) -> tuple[float, float]:
    """Return a number as the interval (value, value), a pair as it is; None in a pair means unbounded."""
    if isinstance(value, (tuple, list)):
        low, high = value
        return (-math.inf if low is None else float(low), math.inf if high is None else float(high))
    return (float(value), float(value))


def expressions(problem: "Problem") -> list[Expr]:
    """Return every expression of the problem, relations included."""
    laws = [law for _, law in boundary_laws(problem.boundary)]
    parts = [problem.minimise, problem.running, *problem.dynamics.values(), *problem.target.values(), *problem.path.values()]
    parts += [*problem.singular.values(), *laws]
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
        _shapes(problem)
        _symbols(problem)
        _numbers(problem)
        _affine(problem)
        _laws(problem)
    except ProblemError as error:
        raise ProblemError(f"problem '{problem.name}': {error}") from None


def _shapes(problem: "Problem") -> None:
    if not isinstance(problem.name, str) or not problem.name.strip():
        raise ProblemError("name: a problem needs a name")
    if not problem.dynamics:
        raise ProblemError("dynamics: give the rate of at least one state")
    for state in problem.dynamics:
        if role(state) != "state":
            raise ProblemError(f"dynamics: {state} is not a state; declare it with states(...)")
    for place, expression in _placed(problem):
        if not isinstance(expression, (casadi.SX, int, float, np.number)):
            raise ProblemError(f"{place}: {expression!r} is not an expression (it is a {type(expression).__name__})")
        if casadi.SX(expression).shape != (1, 1):
            raise ProblemError(f"{place}: shape {casadi.SX(expression).shape} where one number is needed")
        if casadi.SX(expression).is_constant() and not math.isfinite(float(casadi.SX(expression))):
            raise ProblemError(f"{place}: {expression} where a finite value is needed")
    if problem.minimise is None and problem.running is None:
        raise ProblemError("no objective: give minimise (a Mayer term) or running (an integrand), or both")


def _placed(problem: "Problem") -> Iterator[tuple[str, Expr]]:
    yield from ((f"dynamics of '{state}'", rate) for state, rate in problem.dynamics.items())
    yield from ((place, e) for place, e in (("minimise", problem.minimise), ("running", problem.running)) if e is not None)
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


def _symbols(problem: "Problem") -> None:
    states = list(problem.dynamics)
    controls = [symbol for symbol in problem.bounds if role(symbol) == "control"]
    known = {"state": states, "control": controls}
    at_ends = [*(initial(state) for state in states), initial_time, final_time]
    for place, expression in _placed(problem):
        ends = place == "minimise" or place.startswith("target")
        with_controls = place == "running" or place.startswith("dynamics")
        for symbol in casadi.symvar(casadi.SX(expression)):
            kind = role(symbol)
            if kind == "state" and symbol not in set(states):
                raise ProblemError(f"{place}: state '{symbol}' has no dynamics")
            if kind == "control" and not with_controls:
                raise ProblemError(f"{place}: uses the control '{symbol}'; allowed are states, parameters and times")
            if kind == "control" and symbol not in set(controls):
                raise ProblemError(f"control '{symbol}' has no bounds; give bounds={{{symbol}: (lower, upper)}}")
            allowed = kind is not None or symbol in (set(at_ends) if ends else {time})
            if not allowed:
                raise ProblemError(f"{place}: unknown symbol '{symbol}'{_hint(symbol, ends=ends)}")
    for table in ("bounds", "start", "end", "guess", "units", "singular", "boundary"):
        _keys(table, getattr(problem, table), known)
    names = [s.name() for s in [*states, *controls, *{s for e in expressions(problem) for s in casadi.symvar(e) if role(s) == "parameter"}]]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated:
        raise ProblemError(f"the name '{repeated[0]}' is used for two symbols")


def _hint(symbol: Expr, *, ends: bool) -> str:
    if symbol.name() == "t" and ends:
        return "; at the ends write final_time or initial_time"
    if symbol.name() in {"t0", "tf"}:
        return "; along the way write time"
    return "; declare it with states, controls or parameters"


def _keys(table: str, given: Mapping[Expr, Any], known: Mapping[str, list[Expr]]) -> None:
    controls_only = table in {"singular", "boundary"}
    states_only = table in {"start", "end"}
    for symbol in given:
        kind = role(symbol)
        if kind is None and not (table == "guess" and symbol in {final_time, initial_time}):
            raise ProblemError(f"{table}: '{symbol}' is not a declared symbol")
        if kind in known and symbol not in set(known[str(kind)]):
            raise ProblemError(f"{table}: {kind} '{symbol}' has no {'dynamics' if kind == 'state' else 'bounds'}")
        if (controls_only and kind != "control") or (states_only and kind != "state"):
            raise ProblemError(f"{table}: '{symbol}' is a {kind}; {'controls' if controls_only else 'states'} go here")


def _numbers(problem: "Problem") -> None:
    for table in ("bounds", "start", "end"):
        for symbol, value in getattr(problem, table).items():
            low, high = _pair(f"{table} of '{symbol}'", value, pair=table == "bounds")
            if role(symbol) == "control" and not (math.isfinite(low) and math.isfinite(high)):
                raise ProblemError(f"bounds of '{symbol}': ({low}, {high}); a control needs finite bounds")
            if role(symbol) == "control" and low == high:
                raise ProblemError(f"bounds of '{symbol}': lower = upper = {low}; write the constant into the dynamics instead")
    for table in ("start", "end"):
        for symbol, value in getattr(problem, table).items():
            low, high = interval(value)
            lower, upper = interval(problem.bounds.get(symbol, (-math.inf, math.inf)))
            if high < lower or low > upper:
                raise ProblemError(f"{table} of '{symbol}': {value} lies outside its bounds ({lower}, {upper})")
    first = _pair("initial_time", problem.initial_time, pair=False)
    last = _pair("final_time", problem.final_time, pair=False)
    if last[1] <= first[0]:
        raise ProblemError(f"final_time: {problem.final_time} is not after initial_time {problem.initial_time}")
    for symbol, value in problem.guess.items():
        _guess(symbol, value)


def _pair(place: str, value: Any, *, pair: bool) -> tuple[float, float]:
    try:
        if pair and not isinstance(value, (tuple, list)):
            raise TypeError
        low, high = interval(value)
    except (TypeError, ValueError, RuntimeError):
        wanted = "a pair (lower, upper)" if pair else "a number or a pair (lower, upper)"
        raise ProblemError(f"{place}: {value!r} where {wanted} is needed") from None
    if math.isnan(low) or math.isnan(high) or low == math.inf or high == -math.inf:
        raise ProblemError(f"{place}: {value!r} where finite numbers are needed")
    if low > high:
        raise ProblemError(f"{place}: lower {low} > upper {high}")
    return low, high


def _guess(symbol: Expr, value: Any) -> None:
    parts: Iterable[Any] = value if isinstance(value, (tuple, list)) else [value]
    for part in parts:
        expression = casadi.SX(part)
        if any(s not in {time} for s in casadi.symvar(expression)):
            raise ProblemError(f"guess of '{symbol}': {part} may only depend on time")
        if expression.is_constant() and not math.isfinite(float(expression)):
            raise ProblemError(f"guess of '{symbol}': {part} where a finite number is needed")


def _affine(problem: "Problem") -> None:
    rows = [(f"dynamics of '{state}'", casadi.SX(rate)) for state, rate in problem.dynamics.items()]
    rows.append(("running cost", casadi.SX(0 if problem.running is None else problem.running)))
    for place, expression in rows:
        slope = casadi.jacobian(expression, problem.u)
        curved = casadi.jacobian(slope.T, problem.u)
        for k, name in enumerate(problem.control_names):
            if any(not curved[k, j].is_zero() for j in range(problem.u.numel())):
                raise ProblemError(f"{place} is not affine in control '{name}'")


def _laws(problem: "Problem") -> None:
    names = [constraint.name for constraint in problem.constraints]
    for control, law in problem.boundary.items():
        if not names:
            raise ProblemError(f"boundary law of '{control}': the problem has no state constraint to follow")
        for name in law if isinstance(law, Mapping) else []:
            if name not in names:
                raise ProblemError(f"boundary law of '{control}': no state constraint '{name}'; there are {', '.join(names)}")

"""What a problem must satisfy, each breach refused with the offending name."""

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from socp.errors import ProblemError
from socp.model import advice, keys, ranges
from socp.model.data.constants import check_constants
from socp.model.graph import fold, not_affine
from socp.model.parts import check_scene, scene_expressions
from socp.model.symbols import (
    Expr,
    column,
    expression,
    final_time,
    initial,
    initial_time,
    is_logical,
    is_number,
    relation,
    role,
    time,
)
from socp.process import a, plainly, shown

if TYPE_CHECKING:
    from socp.model.problem import Problem

_TIMES = (initial_time, final_time)
_POINTS = 8  # random ones where a control's effect is looked for: nearly every one shows it
_ROUNDED = 4.0 * float(np.finfo(float).eps)  # of what the values given are worth in a row


def expressions(problem: "Problem") -> list[Expr]:
    """Return every expression of the problem, relations included."""
    laws = [law for _, law in boundary_laws(problem.boundary)]
    parts = [
        problem.minimise,
        problem.running,
        *problem.dynamics.values(),
        *problem.target.values(),
    ]
    parts += [*problem.path.values(), *problem.singular.values(), *laws]
    return [expression(part) for part in parts if part is not None]


def boundary_laws(boundary: Mapping[Expr, Any]) -> Iterator[tuple[str | None, Expr]]:
    """Yield (constraint name or None, law) of all user-given boundary laws."""
    for law in boundary.values():
        if isinstance(law, Mapping):
            yield from law.items()
        else:
            yield None, law


def validate(problem: "Problem") -> None:
    """Raise ProblemError, naming problem and offender, unless the problem is well posed as
    written.
    """
    try:
        keys.check(vars(problem))
        check_scene(problem.scene)
        _expressions(problem)
        _symbols(problem)
        ranges.check(vars(problem))
        _used(problem)
        _affine(problem)
        _acting(problem)
        _named(problem)
    except ProblemError as error:
        raise ProblemError(f"problem {keys.label(problem.name)}: {error}") from None


def placed_expressions(problem: "Problem") -> Iterator[tuple[str, Expr]]:
    """Yield (where it stands, expression) for everything but bounds, ends and guesses; relations as
    left - right.
    """
    yield from ((f"dynamics of '{state}'", rate) for state, rate in problem.dynamics.items())
    costs = (("minimise", problem.minimise), ("running", problem.running))
    yield from ((place, e) for place, e in costs if e is not None)
    yield from ((f"singular law of '{control}'", law) for control, law in problem.singular.items())
    for control, law in problem.boundary.items():
        laws = law.values() if isinstance(law, Mapping) else [law]
        yield from ((f"boundary law of '{control}'", each) for each in laws)
    yield from (
        (f"target '{name}'", relation(c, f"target '{name}'")[0])
        for name, c in problem.target.items()
    )
    for name, constraint in problem.path.items():
        left, equation = relation(constraint, f"path '{name}'")
        if equation:
            raise ProblemError(
                f"path '{name}': an equation; a path constraint is c(x, t) <= 0; where an "
                "equation holds all the way, eliminate a state by it; one at the end goes into "
                "target"
            )
        yield f"path '{name}'", left
    yield from scene_expressions(problem.scene)


def _expressions(problem: "Problem") -> None:
    if problem.minimise is None and problem.running is None:
        raise ProblemError(
            "no objective: give minimise (a Mayer term) or running (an integrand), or both"
        )
    scalars = []
    for place, given in placed_expressions(problem):
        if not isinstance(given, casadi.SX) and not is_number(given):
            what = f"is not an expression (it is {a(given)})"
            raise ProblemError(f"{place}: {shown(given)} {what}{advice.expression(given)}")
        scalar = expression(given)
        if scalar.shape != (1, 1):
            raise ProblemError(f"{place}: shape {scalar.shape} where one number is needed")
        if is_logical(scalar):
            raise ProblemError(
                f"{place}: {plainly(scalar)} is a relation, true or false, where a quantity is "
                "needed; relations go into path and target; of two cases, write casadi's "
                "if_else(x > 0, a, b)"
            )
        scalars.append((place, scalar))
    if not all(map(math.isfinite, _numbers(column(e for _, e in scalars)))):
        for place, scalar in scalars:
            _finite(place, scalar)


def _finite(place: str, scalar: Expr) -> None:
    """Refuse nan and infinity anywhere inside an expression: no solver recovers from either."""
    for number in _numbers(scalar):
        if not math.isfinite(number):
            why = advice.not_finite(number, ends=place.startswith(("target", "path")))
            what = f"{plainly(scalar)} where a finite value is needed"
            raise ProblemError(f"{place}: {what}; {why}")


def _numbers(expressions: Expr) -> list[float]:
    """Return the numbers that expressions (m, 1) hold."""
    found: list[float] = []
    symbols = column(casadi.symvar(expressions))
    fold(expressions, symbols, lambda _place: None, found.append, lambda *_given: None)
    return found


def _symbols(problem: "Problem") -> None:
    used = set(casadi.symvar(column(expressions(problem))))
    at_ends = {*(initial(state) for state in problem.dynamics), *_TIMES}
    for place, given in placed_expressions(problem):
        ends = place == "minimise" or place.startswith("target")
        with_controls = place == "running" or place.startswith("dynamics")
        for symbol in casadi.symvar(expression(given)):
            kind = role(symbol)
            if kind == "state" and symbol not in problem.dynamics:
                raise ProblemError(f"{place}: state '{symbol}' has no dynamics")
            if kind == "control" and not with_controls:
                raise ProblemError(
                    f"{place}: uses the control '{symbol}'; allowed are states, parameters and "
                    f"times{_cure(place, given)}"
                )
            if kind == "control" and symbol not in problem.bounds:
                raise ProblemError(
                    f"control '{symbol}' has no bounds; give bounds={{{symbol}: (lower, upper)}}"
                )
            if kind == "parameter" and place.startswith("scene") and symbol not in used:
                raise ProblemError(
                    f"{place}: parameter '{symbol}' is in no other expression of the problem"
                )
            if kind is None and symbol not in (at_ends if ends else {time}):
                raise ProblemError(f"{place}: unknown symbol '{symbol}'{_hint(symbol, ends=ends)}")


def _cure(place: str, expression: Expr) -> str:
    """Return what to write where a control stands in a path constraint or a condition of the
    end.
    """
    if place.startswith("path"):
        return "; " + advice.mixed(
            [s.name() for s in casadi.symvar(expression) if role(s) == "control"]
        )
    if place == "minimise":
        return "; what depends on controls all along the way goes into running"
    return ""


def _hint(symbol: Expr, *, ends: bool) -> str:
    if symbol.name() == "t" and ends:
        return "; at the ends write final_time or initial_time"
    if symbol.name().endswith("(t0)") and not ends:
        return "; initial values are known in minimise and target only"
    if symbol.name() in {"t0", "tf"} and not ends:
        return "; along the way write time"
    return "; declare it with states, controls or parameters"


def _used(problem: "Problem") -> None:
    """Check that what is bounded, guessed or measured is part of the problem, and that names tell
    symbols apart.
    """
    used = set(casadi.symvar(column(expressions(problem))))
    states = list(problem.dynamics)
    controls = [symbol for symbol in problem.bounds if role(symbol) == "control"]
    parameters = [symbol for symbol in used if role(symbol) == "parameter"]
    for control in controls:
        if control not in used:
            raise ProblemError(
                f"bounds: control '{control}' acts on nothing; it is in no dynamics and not in "
                "running"
            )
    lacking = {
        "state": "dynamics",
        "control": "bounds",
        "parameter": "place in any expression of the problem",
    }
    for table in keys.KINDS:
        for symbol in getattr(problem, table):
            kind = role(symbol)
            if kind is not None and symbol not in {*states, *controls, *parameters}:
                raise ProblemError(f"{table}: {kind} '{symbol}' has no {lacking[kind]}")
    _distinct(symbol.name() for symbol in [*states, *controls, *parameters])
    taken = {symbol.name(): f"a {role(symbol)}" for symbol in [*states, *controls, *parameters]}
    fields = dict.fromkeys(problem.__dataclass_fields__, "a part of every problem")
    check_constants(problem.formula, {**fields, **taken})


def _distinct(names: Iterable[str]) -> None:
    found: set[str] = set()
    for name in names:
        if name in found:
            raise ProblemError(f"the name '{name}' is used for two symbols")
        found.add(name)


def _affine(problem: "Problem") -> None:
    places = [*(f"dynamics of '{state}'" for state in problem.dynamics), "running cost"]
    rows = casadi.vertcat(problem.rate, problem.lagrangian)
    for place, bends in zip(places, not_affine(rows, problem.u), strict=True):
        for k, operation in bends.items():
            name = problem.control_names[k]
            cure = advice.bent(name, problem.box[:, k].tolist(), operation)
            raise ProblemError(f"{place} is not affine in control '{name}'; {cure}")


def _acting(problem: "Problem") -> None:
    """Refuse a control whose terms cancel wherever it stands."""
    fields = casadi.vertcat(problem.fields, casadi.jacobian(problem.lagrangian, problem.u))
    for name, acts in zip(problem.control_names, _acts(fields), strict=True):
        if not acts:
            what = "its terms cancel in all rates and in running"
            raise ProblemError(f"control '{name}' does nothing: {what}; leave it out")


def that_matter(problem: "Problem") -> set[int]:
    """Return the symbols that matter, by their hashes: casadi would compare them as expressions.

    What matters is the cost, a state with an end or a bound, and the conditions; what moves one of
    these matters too.
    """
    parts = [problem.lagrangian, problem.mayer]
    parts += [constraint.expression for constraint in problem.constraints]
    parts += [condition.expression for condition in problem.conditions]
    rates = {hash(state): expression(rate) for state, rate in problem.dynamics.items()}
    left = [*map(hash, casadi.symvar(casadi.vertcat(*parts))), *map(hash, problem.end)]
    seen = set(left)
    while left:
        rate = rates.get(left.pop())
        more = set() if rate is None else {*map(hash, casadi.symvar(rate))} - seen
        left += more
        seen |= more
    return seen


def check_solvable(problem: "Problem") -> None:
    """Raise ProblemError for a problem that leaves nothing to solve for: without a control, with
    one for nothing, or where the start meets the end already and no motion costs less than none.
    """
    _controlled(problem)
    if _met_at_once(problem) and _costing(problem):
        what = (
            "the start meets the end already, and no motion costs less than none, final_time = "
            f"initial_time = {problem.initial_time_box[0]:g}; change start or end, or for a way "
            "that comes back give final_time a lower bound, (lower, None)"
        )
        raise ProblemError(f"problem '{problem.name}': {what}")


def _controlled(problem: "Problem") -> None:
    """Refuse a problem without controls, or with one for nothing: of a control that moves nothing
    that matters any value is as good, and none could be told right.
    """
    place = f"problem '{problem.name}'"
    if not problem.control_names:
        what = (
            "no control; a problem to solve has one at least: bounds={u: (lower, upper)}, u in a "
            "rate or in running"
        )
        raise ProblemError(f"{place}: {what}")
    seen = that_matter(problem)
    for control in casadi.vertsplit(problem.u):
        if hash(control) not in seen:
            what = (
                "it moves neither the objective nor a state that has an end, a bound or a part "
                "in another's rate"
            )
            raise ProblemError(
                f"{place}: control '{control}' does nothing: {what}; any value is as good; leave "
                "it out"
            )


def _met_at_once(problem: "Problem") -> bool:
    """Tell whether the final time may be the initial one, which is given, and a point meets both
    ends' conditions: any of their boxes where there are no others, the one given where there are.
    """
    (t0, latest), (earliest, _) = problem.initial_time_box, problem.final_time_box
    boxes = problem.start_box, problem.end_box, problem.state_box
    low, high = np.max([b[0] for b in boxes], axis=0), np.min([b[1] for b in boxes], axis=0)
    if not (t0 == latest and earliest <= t0 and (low <= high).all()):
        return False
    rows = [(c.expression, c.equation) for c in problem.conditions]
    rows += [(c.expression, False) for c in problem.constraints if c.name in problem.path]
    if (low < high).any() or not rows:
        return not rows
    ends = [*(initial(state) for state in problem.dynamics), *casadi.vertsplit(problem.x)]
    given, values = column([*ends, *_TIMES, time]), casadi.DM([*low, *low, t0, t0, t0])
    left = column(row for row, _ in rows)
    known = casadi.substitute(casadi.horzcat(left, casadi.jacobian(left, given)), given, values)
    if not known.is_constant():  # it holds parameters
        return False
    off, slopes = np.split(casadi.DM(known).full(), [1], axis=1)
    slopes[~np.isfinite(slopes)] = 0.0
    rounded = _ROUNDED * np.abs(slopes) @ np.abs(values.full())
    equations = np.array([[equation] for _, equation in rows])
    return bool((np.where(equations, np.abs(off), off) <= rounded).all())


def _costing(problem: "Problem") -> bool:
    """Tell whether no moment takes anything from the objective, by its form alone, whatever the
    states are: an affine function of the final time and an integral that no control makes less.
    """
    t0, zero = problem.initial_time_box[0], casadi.DM.zeros(problem.u.shape)
    mayer = casadi.substitute(problem.mayer, initial_time, t0)
    if any(not_affine(mayer, final_time)):  # steps have no slope either
        return False
    still = casadi.substitute(problem.lagrangian, problem.u, zero)
    worth = casadi.jacobian(mayer, final_time) + still
    rates = casadi.vertcat(worth, casadi.jacobian(problem.lagrangian, problem.u).T)
    rates, rest = casadi.simplify(rates), casadi.substitute(mayer, final_time, t0)
    if not (rest.is_constant() and rates.is_constant()):
        return False
    worth, *parts = casadi.DM(rates).full().ravel()
    return bool(worth + (np.array(parts) * problem.box).min(axis=0).sum() >= 0.0)


def _acts(fields: Expr) -> np.ndarray:
    """Tell which columns (nu,) of expressions differ from zero somewhere, by values at random
    points; one that has no value at any may.
    """
    unknown = column(casadi.symvar(fields))
    function, random = (
        casadi.Function("fields", [unknown], [casadi.densify(fields)]),
        np.random.default_rng(0),
    )
    points = random.uniform(-2.0, 2.0, (unknown.numel(), _POINTS))
    values = np.array([function(point).full() for point in points.T])
    known = np.isfinite(values).all(axis=1)
    acts = (values.any(axis=1) & known).any(axis=0)
    acts |= ~known.any(axis=0)
    acts &= np.array([fields[:, k].nnz() > 0 for k in range(acts.size)], dtype=bool)
    return np.asarray(acts)


def _named(problem: "Problem") -> None:
    """Check the names of constraints and conditions, by which laws, words and results refer to
    them.
    """
    bounds = [f"{name}.{side}" for name in problem.state_names for side in ("lower", "upper")]
    for name in problem.path:
        if name in bounds:
            raise ProblemError(
                f"path '{name}': this is the name of a state's bound; choose another"
            )
    for name in problem.target:
        if name in {*problem.state_names, "initial time", "final time"}:
            raise ProblemError(f"target '{name}': this names an end value already; choose another")
    names = [constraint.name for constraint in problem.constraints]
    for control, law in problem.boundary.items():
        if not names:
            raise ProblemError(
                f"boundary law of '{control}': the problem has no state constraint to follow"
            )
        for name in law if isinstance(law, Mapping) else []:
            if name not in names:
                there = ", ".join(names)
                raise ProblemError(
                    f"boundary law of '{control}': no state constraint '{name}'; there are {there}"
                )

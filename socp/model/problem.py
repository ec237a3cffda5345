"""The abstract problem: symbols and the frozen `Problem`, checked when it is built."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import Any, Self, final

import casadi
import numpy as np

from socp.errors import ProblemError
from socp.model import advice, checks, keys, ranges
from socp.model.data import changes, constants, portable
from socp.model.data.constants import Constant, Formula
from socp.model.data.stated import TEXTS
from socp.model.data.views import view
from socp.model.parts import Constraint, EndCondition, Reference, Scene
from socp.model.ranges import interval, rows
from socp.model.symbols import (
    Expr,
    column,
    expression,
    free,
    initial,
    relation,
    symbols_of,
)

_TIMES = ("time", "t", "t0", "tf")  # names of the time and of its ends
_FIRST = "first"  # where the problem stands that one differs from in values alone
_NUMBERS = {*portable.NUMBERS, *portable.TIMES}  # what holds nothing else
_BESIDE = {*TEXTS, "name", "units", "guess", "scene", "reference"}  # what defines no problem


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Problem:
    """A singular optimal control problem, affine in bounded controls.

    minimise  Mayer(x(t0), x(tf), t0, tf, p) + integral of running(x, u, t, p)
    subject to  x' = dynamics(x, u, t, p),  bounds on controls and states,  path c(x, t, p) <= 0,
    start, end and target conditions.

    A number in `start`, `end`, `initial_time` or `final_time` fixes the value, a pair is an
    interval, and what is left out is free. In `minimise` and `target` a state stands for its value
    at the final time, `initial(x)` for that at the initial time. `singular` and `boundary` give
    feedback laws by control (`boundary` by state constraint too, where several act on one control:
    `{f: {"u.upper": 4}}`). `guess` gives a number, a (start, end) pair or an expression of `time`
    by symbol; of a parameter, `initial_time` or `final_time` it gives a number.

    All values are in the problem's own units, which `units` names; none is converted. Constants
    made by `constants` stand wherever numbers may. The fields hold their values;
    `formula` keeps what was written with them, and is not given: `with_` changes values.

    Raises ProblemError, with the offending name, for anything that is not such a problem. The
    tables are copied: what happens to the given ones later changes nothing.
    """

    name: str
    dynamics: Mapping[Expr, Expr]
    bounds: Mapping[Expr, tuple[float | None, float | None]]
    minimise: Expr = None
    running: Expr = None
    start: Mapping[Expr, float | tuple[float | None, float | None]] = field(default_factory=dict)
    end: Mapping[Expr, float | tuple[float | None, float | None]] = field(default_factory=dict)
    target: Mapping[str, Expr] = field(default_factory=dict)
    path: Mapping[str, Expr] = field(default_factory=dict)
    singular: Mapping[Expr, Expr] = field(default_factory=dict)
    boundary: Mapping[Expr, Any] = field(default_factory=dict)
    initial_time: float | tuple[float | None, float | None] = 0.0
    final_time: float | tuple[float | None, float | None] = free
    guess: Mapping[Expr, Any] = field(default_factory=dict)
    units: Mapping[Expr, str] = field(default_factory=dict)
    title: str = ""
    source: str = ""
    reference: Reference | None = None
    scene: Scene | None = None
    formula: Formula | None = None

    def __new__(cls, *_: Any, **given: Any) -> Self:
        """Refuse a keyword that there is none of, with what to write instead."""
        for name in given:
            if name not in cls.__dataclass_fields__:
                there = advice.keyword(name, cls.__dataclass_fields__)
                raise ProblemError(f"Problem({name}=...): a problem has no '{name}'{there}")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        for name in ("bounds", "start", "end", "initial_time", "final_time"):
            object.__setattr__(self, name, constants.numbers_in(getattr(self, name)))
        formula = constants.formula_of(self._arguments, self.formula)
        for name, value in {} if formula is None else formula.fields.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "formula", formula)
        checks.validate(self)
        for table in keys.TABLES:
            object.__setattr__(self, table, MappingProxyType(dict(getattr(self, table))))
        if formula is not None:  # whoever replaces fields hands on the others as they are
            held = {name: getattr(self, name) for name in formula.fields}
            object.__setattr__(self, "formula", replace(formula, fields=held))

    def __repr__(self) -> str:
        return (
            f"Problem({self.name!r}: states {', '.join(self.state_names)}; controls "
            f"{', '.join(self.control_names)})"
        )

    def _repr_html_(self) -> str:
        shown: str = view("html")(self)
        return shown

    # -- its numbers, by name

    @property
    def _arguments(self) -> dict[str, Any]:
        return {
            name: getattr(self, name) for name in self.__dataclass_fields__ if name != "formula"
        }

    @property
    def constants(self) -> Mapping[str, Constant]:
        """Its named constants, with the values that they have in it."""
        return {} if self.formula is None else self.formula.named

    def with_(self, named: Mapping[str, Any] | None = None, /, **given: Any) -> "Problem":
        """Return the problem with other values of constants, ends, bounds, times or other fields.

        `problem.with_(current=1.0, start={x: 30}, final_time=5)`; entries of tables stand beside
        those that there are. By name, as on the command line:
        `problem.with_({"start.x": 30, "bounds.u.upper": 1.5})`. Reference values go, unless new
        ones are given: they are those of another problem. Raises ProblemError, with the closest
        name, for what there is not, and for what is no problem any more.
        """
        known = self.formula
        try:
            told = {**changes.by_name({} if named is None else named), **given}
        except ProblemError as error:
            raise ProblemError(f"problem '{self.name}': {error}") from None
        own = {} if known is None else {symbol.name(): symbol for symbol in known.values}
        symbols = {symbol.name(): symbol for kind in self.symbols.values() for symbol in kind}
        written = self._arguments if known is None else known.written(self._arguments)
        try:
            found, values = changes.changed(written, own, symbols, told)
        except ProblemError as error:
            raise ProblemError(f"problem '{self.name}': {error}") from None
        heads = {name.partition(".")[0] for name in told}
        if heads - _BESIDE:
            found["reference"] = told.get("reference")
        if told and known is None and heads <= _NUMBERS:
            numbers = {name: constants.numbers_in(found[name]) for name in heads}
            if all(changes.alike(getattr(self, name), new) for name, new in numbers.items()):
                return self._valued(numbers)
        if known is not None:
            known = Formula({**known.values, **values}, {}, {})
        made = Problem(**found, formula=known)
        if told and heads <= {*_NUMBERS, *own}:
            vars(made)[_FIRST] = self.first
        return made

    @property
    def first(self) -> "Problem":
        """What `with_` has made it of, once or several times, by other values of constants, ends,
        bounds and times alone; else the problem itself.
        """
        found: Problem = vars(self).get(_FIRST, self)
        return found

    def _valued(self, numbers: Mapping[str, Any]) -> "Problem":
        """Return the problem with other numbers in the same places: what was checked of formulas
        and names holds for it as well.
        """
        found = object.__new__(Problem)
        tables = {k: MappingProxyType(v) if k in keys.TABLES else v for k, v in numbers.items()}
        vars(found).update(self._arguments, **tables, reference=None, formula=None)
        vars(found)[_FIRST] = self.first
        try:
            ranges.check(vars(found))
        except ProblemError as error:
            raise ProblemError(f"problem {keys.label(self.name)}: {error}") from None
        return found

    # -- as data

    @cached_property
    def statement(self) -> Mapping[str, Any]:
        """The problem as data, as result files carry it; ProblemError names an operation that has
        no spelling.

        What was written with constants is left out where it would be read back as another problem:
        casadi simplifies equal parts of an expression, which may change the last bit of a number.
        """
        plain = self.formula is None and self.first.formula is None
        if plain and self.first is not self:
            return portable.revalued(self.first.statement, vars(self))
        found = portable.written(vars(self), self.symbols)
        if self.formula is None or portable.faithful(found, self.symbols, self.formula):
            return found
        return {k: v for k, v in found.items() if k != "formula"}

    @property
    def fingerprint(self) -> str:
        """A hash of all that defines the problem: not of its name, title, source, reference, units,
        scene and guess.
        """
        return str(self.statement["fingerprint"])

    @classmethod
    def from_statement(cls, statement: Mapping[str, Any]) -> "Problem":
        """Return the problem that a statement describes, in symbols of its own; ProblemError says
        why it is none.
        """
        return _restored(json.dumps(statement))

    def __reduce__(self) -> tuple[Any, ...]:
        return _restored, (json.dumps(self.statement),)

    # -- symbols

    @property
    def symbols(self) -> dict[str, list[Expr]]:
        """Its states, controls and parameters under these words, each kind in its order."""
        columns = {"states": self.x, "controls": self.u, "parameters": self.p}
        return {k: casadi.vertsplit(c) if c.numel() else [] for k, c in columns.items()}

    def unit(self, name: str) -> str:
        """Return the unit of a quantity by its name, empty where it has none; `time` and the two
        ends of the horizon have one unit, whichever of them it was given for.
        """
        found = {symbol.name(): unit for symbol, unit in self.units.items()}
        names = _TIMES if name in _TIMES else (name,)
        return next((found[each] for each in names if each in found), "")

    def labelled(self, name: str) -> str:
        """Return a name with its unit in parentheses, where it has one."""
        unit = self.unit(name)
        return f"{name} ({unit})" if unit else name

    @cached_property
    def x(self) -> Expr:
        """States as a column (nx, 1), in the order of `dynamics`."""
        return column(self.dynamics)

    @cached_property
    def u(self) -> Expr:
        """Controls as a column (nu, 1), in the order of their declaration."""
        return column(symbol for symbol in symbols_of("control") if symbol in self.bounds)

    @cached_property
    def p(self) -> Expr:
        """Parameters as a column (np, 1), in the order of their declaration."""
        used = set(casadi.symvar(column(checks.expressions(self))))
        return column(symbol for symbol in symbols_of("parameter") if symbol in used)

    @cached_property
    def costate(self) -> Expr:
        """Costates lambda as a column of symbols (nx, 1)."""
        return column(casadi.SX.sym(f"lambda_{name}") for name in self.state_names)

    @cached_property
    def x0(self) -> Expr:
        """Symbols of the initial states (nx, 1), as `initial` makes them."""
        return column(initial(state) for state in self.dynamics)

    @cached_property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states."""
        return tuple(symbol.name() for symbol in self.dynamics)

    @cached_property
    def control_names(self) -> tuple[str, ...]:
        """Names of the controls."""
        return tuple(symbol.name() for symbol in self.symbols["controls"])

    @cached_property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters."""
        return tuple(symbol.name() for symbol in self.symbols["parameters"])

    # -- the control-affine form

    @cached_property
    def rate(self) -> Expr:
        """Right-hand side x' (nx, 1)."""
        return column(self.dynamics.values())

    @cached_property
    def fields(self) -> Expr:
        """Control fields G(x, t, p) (nx, nu) of x' = f0 + G u."""
        return casadi.substitute(casadi.jacobian(self.rate, self.u), self.u, 0)

    @cached_property
    def drift(self) -> Expr:
        """Drift f0(x, t, p) (nx, 1) of x' = f0 + G u."""
        return casadi.substitute(self.rate, self.u, 0)

    @cached_property
    def lagrangian(self) -> Expr:
        """Running cost as an expression (1, 1), zero where there is none."""
        return expression(0 if self.running is None else self.running)

    @cached_property
    def mayer(self) -> Expr:
        """Mayer term as an expression (1, 1), zero where there is none."""
        return expression(0 if self.minimise is None else self.minimise)

    @cached_property
    def hamiltonian(self) -> Expr:
        """H = running + costate . x', to be minimised over the controls; H = -1 for minimum
        time.
        """
        return self.lagrangian + casadi.dot(self.costate, self.rate)

    @cached_property
    def switching(self) -> Expr:
        """Switching functions sigma = dH/du (nu, 1): the control is at its lower bound where sigma
        > 0.
        """
        return casadi.substitute(casadi.jacobian(self.hamiltonian, self.u).T, self.u, 0)

    # -- bounds and conditions

    @cached_property
    def box(self) -> np.ndarray:
        """Bounds of the controls (2, nu): lower row, upper row."""
        return rows(self.u, self.bounds)

    @cached_property
    def state_box(self) -> np.ndarray:
        """Bounds of the states (2, nx), infinite where there are none."""
        return rows(self.x, self.bounds)

    @cached_property
    def parameter_box(self) -> np.ndarray:
        """Bounds of the parameters (2, np), infinite where there are none."""
        return rows(self.p, self.bounds)

    @cached_property
    def start_box(self) -> np.ndarray:
        """Interval of every initial state (2, nx)."""
        return rows(self.x, self.start)

    @cached_property
    def end_box(self) -> np.ndarray:
        """Interval of every final state (2, nx)."""
        return rows(self.x, self.end)

    @cached_property
    def initial_time_box(self) -> tuple[float, float]:
        """Interval of the initial time."""
        return interval(self.initial_time)

    @cached_property
    def final_time_box(self) -> tuple[float, float]:
        """Interval of the final time."""
        return interval(self.final_time)

    @cached_property
    def constraints(self) -> tuple[Constraint, ...]:
        """All state constraints: finite bounds of states first, then the path constraints."""
        found = []
        for k, name in enumerate(self.state_names):
            low, high = self.state_box[:, k]
            if np.isfinite(low):
                found.append(Constraint(f"{name}.lower", low - self.x[k]))
            if np.isfinite(high):
                found.append(Constraint(f"{name}.upper", self.x[k] - high))
        named = [
            Constraint(name, relation(c, f"path '{name}'")[0]) for name, c in self.path.items()
        ]
        return tuple(found + named)

    @cached_property
    def conditions(self) -> tuple[EndCondition, ...]:
        """The named end conditions of `target`."""
        return tuple(
            EndCondition(name, *relation(c, f"target '{name}'")) for name, c in self.target.items()
        )


@lru_cache(
    maxsize=64
)  # symbols are never forgotten: the same statement read again gives the same problem
def _restored(text: str) -> Problem:
    statement = json.loads(text)
    problem = Problem(**portable.arguments(statement))
    if problem.formula is not None:
        own = portable.written(vars(problem), problem.symbols)
        if own["fingerprint"] != statement["fingerprint"]:
            raise ProblemError("formula: with its constants' values it is another problem")
    return problem

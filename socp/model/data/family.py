"""Problems that differ in values only: constants as parameters that are held, so that laws and
compiled functions, which have parameters for arguments, serve all of them.
"""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, final

import casadi
import numpy as np

from socp.errors import ProblemError
from socp.model.data.carried import known_problem
from socp.model.data.constants import planted
from socp.model.data.portable import NUMBERS, TIMES
from socp.model.graph import fold
from socp.model.keeping import cached, hand_on, lately
from socp.model.problem import Problem
from socp.model.ranges import interval
from socp.model.result.findings import Condition, Finding
from socp.model.result.solution import Solution
from socp.model.symbols import Expr, column, declared
from socp.model.tolerances import EXTREMAL

# what a constant may stand in as a parameter does, and what has numbers of its own in every problem
_FORMULAE = ("dynamics", "minimise", "running", "target", "path", "singular", "boundary")
_NUMBERS = (*NUMBERS, *TIMES)
_FAMILIES = 4  # of a problem: sets of constants that are changed in turns
_MEMBERS = 4  # of a family: bounds that are changed in turns, and solutions that are gone on from


@final
@dataclass(frozen=True, eq=False)
class Family:
    """A problem and what becomes of it for other values of numbers, by the `names` that
    `Problem.with_` knows; `open` ones are those of them that are constants.
    """

    problem: Problem
    names: tuple[str, ...]

    @cached_property
    def open(self) -> dict[str, Expr]:
        """The constants among the numbers, as parameters by name; none where one is an exponent:
        the slope of a power in it is none where the base is zero.
        """
        found = self._constants
        if self._exponents & set(found.values()):
            return {}
        return {name: _parameter(symbol) for name, symbol in found.items()}

    @cached_property
    def _constants(self) -> dict[str, Expr]:
        """The constants among the numbers, by name."""
        formula = self.problem.formula
        own = () if formula is None else formula.values
        found = {symbol.name(): symbol for symbol in own}
        return {name: found[name] for name in self.names if name in found}

    @property
    def _exponents(self) -> set[Expr]:
        """The symbols in exponents of what was written with constants."""
        formula = self.problem.formula
        leaves = {} if formula is None else formula.leaves
        return set().union(
            *(_in_exponents(e) for path, e in leaves.items() if path[0] in _FORMULAE)
        )

    @cached_property
    def base(self) -> Problem:
        """The problem with parameters in place of these constants, held at their values."""
        problem, formula = self.problem, self.problem.formula
        own = {name: getattr(problem, name) for name in _FORMULAE}
        bounds = dict(problem.bounds)
        if formula is not None:
            pairs = {s: self.open.get(s.name(), value) for s, value in formula.values.items()}
            before, after = column(pairs), column(pairs.values())
            leaves = {
                path: casadi.substitute(leaf, before, after)
                for path, leaf in formula.leaves.items()
                if path[0] in _FORMULAE
            }
            own = planted(own, leaves)
            used = {each for leaf in leaves.values() for each in casadi.symvar(leaf)}
            held = {name: symbol for name, symbol in self.open.items() if symbol in used}
            bounds |= {s: (problem.constants[name].value,) * 2 for name, s in held.items()}
        found = replace(problem, **own, bounds=bounds, reference=None, formula=None)
        if len(bounds) == len(problem.bounds):  # no parameter is held, and nothing is another
            hand_on(problem, found)
        return found

    @cached_property
    def _placed(self) -> bool:
        """Whether a constant among the numbers stands in an end, a time or a bound as well."""
        formula, own = self.problem.formula, set(self.open)
        return formula is not None and any(
            path[0] in _NUMBERS and own & {s.name() for s in casadi.symvar(leaf)}
            for path, leaf in formula.leaves.items()
        )

    def at(self, values: Mapping[str, float]) -> Problem:
        """Return the problem of other values, with what was worked out for those that were asked
        for before, and for the base, where their bounds are the same. Errors as of `Problem.with_`.
        """
        if self.closed:
            return self.problem.with_(dict(values))
        if self._placed:
            return self.member(self.problem.with_(dict(values)))
        others = {name: value for name, value in values.items() if name not in self.open}
        return self._posed(others, values)

    def member(self, problem: Problem) -> Problem:
        """Return a problem that `with_` makes of that of the family, or one that reads like it, as
        one of the family, with what was worked out as `at` has it.
        """
        boxes = {f"bounds.{each.name()}": box for each, box in problem.bounds.items()}
        ends = {
            f"{table}.{each.name()}": value
            for table in ("start", "end")
            for each, value in getattr(problem, table).items()
        }
        times = {name: getattr(problem, name) for name in ("initial_time", "final_time")}
        values = {name: each.value for name, each in problem.constants.items()}
        return self._posed({**boxes, **ends, **times}, values)

    def _posed(self, numbers: Mapping[str, Any], values: Mapping[str, float]) -> Problem:
        """Return the base with other numbers, and with constants held at other values where these
        are told.
        """
        base = self.base
        own = {n: s for n, s in self.open.items() if s in base.bounds and n in values}
        held = {f"bounds.{name}": (values[name],) * 2 for name in own}
        found = base.with_({**numbers, **held})
        kind = self._kind(found)
        near = base
        if kind != self._kind(base):
            near = lately(self, Family.at, kind, lambda: found, _MEMBERS)
        if near is not found:
            hand_on(near, found)
        return found

    def _kind(self, problem: Problem) -> tuple[tuple[str, float, float], ...]:
        """Return what a problem's laws rest on beside its formulas, by name: its bounds, but for
        those of constants, which ends and times are free, and which times are so whatever the other
        one is. What is free has a known costate, or tells the Hamiltonian.
        """
        own = set(self.open.values())
        bounds = [(s.name(), *interval(b)) for s, b in problem.bounds.items() if s not in own]
        ends = problem.end_box.T, problem.initial_time_box, problem.final_time_box
        free = np.isinf(np.vstack(ends)).astype(float).tolist()
        (first, latest), (earliest, last) = ends[1:]
        later = float(last == np.inf and earliest <= first)
        sooner = float(first == -np.inf and latest >= last)
        names = (*problem.state_names, "t0", "tf")
        return (
            *bounds,
            *((f"end.{n}", low, high) for n, (low, high) in zip(names, free, strict=True)),
            ("horizon", sooner, later),
        )

    @property
    def closed(self) -> bool:
        """Whether a constant among the numbers cannot be a parameter."""
        return len(self.open) < len(self._constants)

    def origin(self, guess: Solution) -> Problem | None:
        """Return the problem that a guess is a solution of as one of the family, as far as the
        guess tells; None where it is one of other states or controls.
        """
        mark = (guess.statement or {}).get("fingerprint")
        known: dict[tuple[Any, ...], Any] = cached(self, Family.origin)
        if (mark,) in known:
            found: Problem = known[(mark,)]
            return found
        own, posed = known_problem(guess), self.problem
        if own is None or any(
            getattr(own, kind) != getattr(posed, kind)
            for kind in ("state_names", "control_names", "parameter_names")
        ):
            return None
        with suppress(ProblemError):  # one that reads otherwise may have what this has not
            return self.member(own)
        return None

    def note(self, problem: Problem, member: Problem) -> None:
        """Keep the member that a problem is, for solutions that tell it."""
        lately(self, Family.origin, (problem.fingerprint,), lambda: member, _MEMBERS)

    def inside(self, solution: Solution, member: Problem) -> Solution:
        """Return a solution of the problem that a member is as one of the family."""
        bounds = member.bounds
        own = {n: interval(bounds[s])[0] for n, s in self.open.items() if s in bounds}
        return replace(solution, parameters={**solution.parameters, **own})

    def outside(self, solution: Solution) -> Solution:
        """Return a solution in the family as one of the problem of its values, of which it carries
        no statement, and whose verdict does not say that parameters have values that they are held
        at, which this has not.
        """
        left = {name: v for name, v in solution.parameters.items() if name not in self.open}
        found = replace(solution, parameters=left).with_origin(statement=None, unstated="")
        if found.verdict is None:
            return found
        its = (f for f in found.verdict.findings if not self._is_of_held(f))
        return found.with_judgement(verdict=replace(found.verdict, findings=tuple(its)))

    def _is_of_held(self, finding: Finding) -> bool:
        mine = finding.kind is Condition.PARAMETER_RANGE and finding.place.of in self.open
        return mine and finding.residual <= EXTREMAL


def family_of(problem: Problem) -> Family | None:
    """Return the family of a problem that `with_` has made of another, opened for the constants in
    which they differ at least; None where there is no other, or one of these cannot be a parameter.

    It is kept with that other problem, `problem.first`, for as long as it is one of a few that were
    asked for last.
    """
    first, own = problem.first, problem.constants
    if first is problem:
        return None
    names = {n for n, each in first.constants.items() if n in own and own[n].value != each.value}
    known: dict[tuple[Any, ...], Any] = cached(first, family_of)
    key = next((key for key in known if names <= set(key)), tuple(sorted(names)))
    found = lately(first, family_of, key, lambda: Family(first, key), _FAMILIES)
    return None if found.closed else found


def _in_exponents(expression: Expr) -> set[Expr]:
    """Return the symbols in exponents of an expression."""
    symbols, found = casadi.symvar(expression), set[int]()

    def places(operation: int, *given: frozenset[int]) -> frozenset[int]:
        if operation == casadi.OP_POW:
            found.update(given[1])
        return frozenset().union(*given)

    given = casadi.vertcat(*symbols), lambda place: frozenset({place}), lambda _: frozenset[int]()
    fold(casadi.vec(expression), *given, places)
    return {symbols[place] for place in found}


@cache
def _parameter(symbol: Expr) -> Expr:
    """Return the parameter that stands for a constant, the same one every time."""
    return declared((symbol.name(),), "parameter", symbol.name())[0]

"""Problems that differ in values only: constants as parameters that are held, so that laws and
compiled functions, which have parameters for arguments, serve all of them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any, final

import casadi

from socp.model.data.constants import planted
from socp.model.data.portable import NUMBERS, TIMES
from socp.model.evaluation import cached, hand_on
from socp.model.graph import fold
from socp.model.problem import Problem
from socp.model.result.findings import Condition, Finding
from socp.model.result.solution import Solution
from socp.model.symbols import Expr, column, declared

# what a constant may stand in as a parameter does, and what has numbers of its own in every problem
_FORMULAE = ("dynamics", "minimise", "running", "target", "path", "singular", "boundary")
_NUMBERS = (*NUMBERS, *TIMES)


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
        return replace(problem, **own, bounds=bounds, reference=None, formula=None)

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
        if len(self.open) < len(self._constants):
            return self.problem.with_(dict(values))
        held = {s: (values[n],) * 2 for n, s in self.open.items() if s in self.base.bounds}
        others = {name: value for name, value in values.items() if name not in self.open}
        if self._placed:
            plain = self.problem.with_(dict(values))
            numbers = {name: getattr(plain, name) for name in _NUMBERS}
            found = replace(self.base, **numbers | {"bounds": {**plain.bounds, **held}})
        else:
            found = self.base.with_({**others, "bounds": held} if held else others)
        known: dict[tuple[Any, ...], Problem] = cached(self, Family.at)
        near = known.get((), self.base)
        if self._bounds(found) == self._bounds(near):
            hand_on(near, found)
        known[()] = found
        return found

    def _bounds(self, problem: Problem) -> dict[Expr, Any]:
        """Return the bounds of a problem but for those of constants."""
        own = set(self.open.values())
        return {symbol: box for symbol, box in problem.bounds.items() if symbol not in own}

    def inside(self, solution: Solution, values: Mapping[str, float]) -> Solution:
        """Return a solution of the problem of values as one of the family."""
        own = {name: float(values[name]) for name in self.open}
        return replace(solution, parameters={**solution.parameters, **own})

    def outside(self, solution: Solution) -> Solution:
        """Return a solution in the family as one of the problem of its values, of which it carries
        no statement, and whose verdict says nothing of parameters that this has not.
        """
        left = {name: v for name, v in solution.parameters.items() if name not in self.open}
        found = replace(solution, parameters=left).with_origin(statement=None, unstated="")
        if found.verdict is None:
            return found
        its = (f for f in found.verdict.findings if not self._is_of_held(f))
        return found.with_judgement(verdict=replace(found.verdict, findings=tuple(its)))

    def _is_of_held(self, finding: Finding) -> bool:
        return finding.kind is Condition.PARAMETER_RANGE and finding.place.of in self.open


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

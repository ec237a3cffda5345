"""The equations of a word: what its unknowns are, and which functions of the state at its joints
and ends have to vanish.

Nothing here is checked: a wrong set of equations has no solution, or one that fails the conditions
that are shown afterwards. What they leave out is shown there as well.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import final

import casadi
import numpy as np
from scipy.optimize import brentq

from socp.errors import SolveError
from socp.model import Arc, Expr, Modes, Solution, column
from socp.proof.hamilton import Hamiltonian, Loop, fixed, is_zero, loop

_SAMPLES = 20  # times at which it is looked which costate enters a condition most
_LOOKS = 400  # times of an arc at which the sign of a kink is looked at
# Of sizes: an inequality at an end as near as this to its limit is taken for an equation
_ACTIVE = 1e-7


@final
@dataclass(frozen=True, eq=False)
class Piece:
    """A part of an arc without kinks: the arc's place, the signs of the kinks on it, and the kink
    that is at zero where it begins, if one cuts it off the arc's part before it.
    """

    arc: int
    loop: Loop
    signs: Mapping[Expr, int]
    span: tuple[float, float]
    joint: Expr = None

    def sided(self, expression: Expr) -> Expr:
        """Return an expression with the signs of the kinks put in."""
        return casadi.substitute(
            casadi.SX(expression), column(self.signs), column(self.signs.values())
        )


@final
@dataclass(frozen=True, eq=False)
class Chain:
    """The pieces of a word along a solution of a system.

    Unknowns are, in this order, the costates at the initial time, the states there that are free,
    the lengths of the pieces, and the multipliers `nu` (k, 1) of the end conditions that hold as
    equations. `joints` are what vanishes where every piece begins, `ends` what does at the ends of
    the horizon, in z, `start` and nu.
    """

    system: Hamiltonian
    solution: Solution
    pieces: tuple[Piece, ...]

    @cached_property
    def nu(self) -> Expr:
        """Multipliers (k, 1) of the end conditions that hold as equations."""
        return column(casadi.SX.sym(f"nu_{name}") for name, _ in self.met)

    @cached_property
    def met(self) -> list[tuple[str, bool]]:
        """Names of the end conditions that hold as equations, and whether they are."""
        found = []
        for name, expression, equation in self.system.conditions:
            size = float(np.abs(self._floats(casadi.gradient(expression, self.system.z))).sum())
            if equation or self._floats(expression)[0] >= -_ACTIVE * max(size, 1.0):
                found.append((name, equation))
        return found

    @cached_property
    def free(self) -> list[int]:
        """Places of the initial states that are free."""
        box, x = self.system.problem.start_box, self.solution.arcs[0].x[:, 0]
        return [i for i in range(x.size) if not _held(box[:, i], x[i])]

    @cached_property
    def first(self) -> list[Expr]:
        """The initial states: numbers where they hold, symbols where they are free."""
        box, x = self.system.problem.start_box, self.solution.arcs[0].x[:, 0]
        return [
            self.system.start[i]
            if i in self.free
            else self.system.numbers.of(_limit(box[:, i], x[i]))
            for i in range(x.size)
        ]

    @cached_property
    def last(self) -> dict[int, Expr]:
        """The final states that hold, as numbers by place."""
        box, x = self.system.problem.end_box, self.solution.arcs[-1].x[:, -1]
        return {
            i: self.system.numbers.of(_limit(box[:, i], x[i]))
            for i in range(x.size)
            if _held(box[:, i], x[i])
        }

    @cached_property
    def duration(self) -> Expr | None:
        """The final time where it holds, as a number."""
        box, t = self.system.problem.final_time_box, self.solution.final_time
        return self.system.numbers.of(_limit(np.array(box), t)) if _held(np.array(box), t) else None

    @property
    def time0(self) -> Expr:
        """The initial time as a number; SolveError where it is free."""
        low, high = self.system.problem.initial_time_box
        if low != high:
            raise SolveError("its initial time is free")
        return self.system.numbers.of(low)

    @cached_property
    def lagrangian(self) -> Expr:
        """Mayer term + nu . conditions, in z and start."""
        by_name = {name: expression for name, expression, _ in self.system.conditions}
        return self.system.mayer + casadi.dot(self.nu, column(by_name[n] for n, _ in self.met))

    @cached_property
    def transversality(self) -> dict[int, Expr]:
        """The final costates of the states that do not hold there, by place."""
        slopes = casadi.gradient(self.lagrangian, self.system.x)
        return {i: slopes[i] for i in range(slopes.numel()) if i not in self.last}

    @cached_property
    def energy(self) -> Expr:
        """H at the final time, with the control that ends the word."""
        control = self.pieces[-1].loop.control
        return casadi.substitute(self.system.value, self.system.u, control)

    @cached_property
    def joints(self) -> list[list[Expr]]:
        """What vanishes where every piece begins."""
        found = [[each for each in self.pieces[0].loop.vanishing if not self.settled(each)]]
        for before, after in pairwise(self.pieces):
            known = [before.sided(each) for each in before.loop.vanishing]
            news = [e for e in after.loop.vanishing if not _among(after.sided(e), known)]
            if after.joint is not None:
                news.append(after.joint)
            for i, (one, other) in enumerate(zip(before.loop.modes, after.loop.modes, strict=True)):
                if {one.kind, other.kind} == {"lower", "upper"}:
                    news.append(self.system.switching[i])
            found.append(news)
        return found

    def settled(self, expression: Expr) -> bool:
        """Tell whether an expression vanishes at the initial time by what holds there."""
        known = [i for i in range(len(self.first)) if i not in self.free]
        put = [column(self.system.z[i] for i in known), column(self.first[i] for i in known)]
        at = casadi.substitute(
            expression,
            casadi.vertcat(put[0], self.system.z[-1]),
            casadi.vertcat(put[1], self.time0),
        )
        return is_zero(at)

    @cached_property
    def implied(self) -> list[tuple[Expr, int]]:
        """What vanishes on the last piece and is a combination of the final costates' conditions,
        with the place of the one that follows from it and from the others.

        Such a function is linear in the costates, and zero where they are what they have to be; so
        it is its slopes times what these conditions leave.
        """
        found: list[tuple[Expr, int]] = []
        places = list(self.transversality)
        put = column(self.system.costate[i] for i in places), column(self.transversality.values())
        for each in self.pieces[-1].loop.vanishing:
            gradient = casadi.gradient(each, self.system.costate)
            linear = not casadi.depends_on(gradient, self.system.costate)
            if not linear or not is_zero(casadi.substitute(each, *put)):
                continue
            slopes = np.abs(self._floats(gradient))
            left = [i for i in places if i not in [k for _, k in found]]
            if left and max(slopes[i] for i in left) > 0:
                found.append((each, max(left, key=lambda i: float(slopes[i]))))
        return found

    @cached_property
    def ends(self) -> list[Expr]:
        """What vanishes at the ends of the horizon."""
        system = self.system
        if casadi.depends_on(self.lagrangian, column(system.numbers.kinks)):
            raise SolveError("a kink in the objective or in an end condition")
        left = [k for _, k in self.implied]
        by_name = {name: expression for name, expression, _ in system.conditions}
        holds = [system.z[i] - value for i, value in self.last.items()]
        found = [e for e in holds if not _among(e, self.pieces[-1].loop.vanishing)]
        found += [
            system.costate[i] - value for i, value in self.transversality.items() if i not in left
        ]
        found += [by_name[name] for name, _ in self.met]
        slopes = casadi.gradient(self.lagrangian, system.start)
        count = system.x.numel()
        found += [system.start[count + i] + slopes[i] for i in self.free]
        if self.duration is not None:
            return [*found, system.z[-1] - self.duration]
        return [*found, self.energy + casadi.gradient(self.lagrangian, system.z[-1])]

    @cached_property
    def guess(self) -> np.ndarray:
        """The solution's values of the unknowns."""
        first, last = self.solution.arcs[0], self.solution.arcs[-1]
        lengths = [piece.span[1] - piece.span[0] for piece in self.pieces]
        nu = self._multipliers(last.costate[:, -1])
        return np.array([*first.costate[:, 0], *first.x[self.free, 0], *lengths, *nu])

    def _multipliers(self, costate: np.ndarray) -> np.ndarray:
        """Return the multipliers of the end conditions that fit the final costate best."""
        places = list(self.transversality)
        if not self.nu.numel() or not places:
            return np.zeros(self.nu.numel())
        rows = column(self.transversality.values())
        matrix = self._floats(casadi.jacobian(rows, self.nu)).reshape(len(places), -1, order="F")
        right = costate[places] - self._floats(casadi.substitute(rows, self.nu, 0))
        found: np.ndarray = np.linalg.lstsq(matrix, right, rcond=None)[0]
        return found

    def _floats(self, expression: Expr) -> np.ndarray:
        """Return the entries of an expression at the ends of the solution as floats."""
        return floats(self.system, self.solution, expression)


def _held(box: np.ndarray, value: float) -> bool:
    if fixed(box[:, None])[0]:
        return True
    near = _ACTIVE * max(abs(value), 1.0)
    return bool(value <= box[0] + near or value >= box[1] - near)


def _limit(box: np.ndarray, value: float) -> float:
    return float(min(box, key=lambda limit: abs(limit - value)))


def floats(system: Hamiltonian, solution: Solution, expression: Expr) -> np.ndarray:
    """Return the entries of an expression of z and start at the ends of a solution as floats, its
    multipliers and kinks zero.
    """
    first, last = solution.arcs[0], solution.arcs[-1]
    cost = [0.0] * system.costs
    begin = [*first.x[:, 0], *first.costate[:, 0], *cost, first.t[0]]
    end = [*last.x[:, -1], *last.costate[:, -1], *cost, last.t[-1]]
    return valued(system, expression, {**_pairs(system.z, end), **_pairs(system.start, begin)})


def _pairs(symbols: Expr, values: Sequence[float]) -> dict[Expr, float]:
    return dict(zip(casadi.vertsplit(symbols), values, strict=True))


def valued(system: Hamiltonian, expression: Expr, values: Mapping[Expr, float]) -> np.ndarray:
    """Return the entries of an expression with floats for its symbols, 0 for those that have no
    value.
    """
    known = {**{symbol: float(v) for symbol, v in system.numbers.values.items()}, **values}
    table = {symbol.element_hash(): value for symbol, value in known.items()}
    symbols = casadi.symvar(expression)
    given = [table.get(symbol.element_hash(), 0.0) for symbol in symbols]
    function = casadi.Function("v", [column(symbols)], [casadi.densify(expression)])
    found: np.ndarray = function(np.array(given)).full().ravel(order="F")
    return found


def chain(system: Hamiltonian, solution: Solution) -> Chain:
    """Return the equations of a solution's word; SolveError says why there are none."""
    loops: dict[Modes, Loop] = {}
    pieces: list[Piece] = []
    for k, arc in enumerate(solution.arcs):
        if arc.modes not in loops:
            loops[arc.modes] = loop(system, arc.modes, looks(system, arc))
        pieces += _pieces(system, k, arc, loops[arc.modes])
    found = Chain(system, solution, tuple(pieces))
    equations = sum(map(len, found.joints)) + len(found.ends)
    if equations != found.guess.size:
        raise SolveError(
            f"the word gives {equations} equations for {found.guess.size} unknowns: they are as "
            "many only where controls switch one at a time and every arc is needed"
        )
    return found


def _pieces(system: Hamiltonian, k: int, arc: Arc, its: Loop) -> Iterator[Piece]:
    """Yield the parts of an arc between the kinks that it crosses."""
    times = np.linspace(arc.t[0], arc.t[-1], _LOOKS + 1)
    middle = 0.5 * (times[1:] + times[:-1])
    cuts: list[tuple[float, Expr]] = []
    signs: dict[Expr, int] = {}
    for symbol, argument in system.numbers.kinks.items():
        if any(casadi.depends_on(argument, each) for each in system.numbers.kinks):
            raise SolveError("a kink within a kink")
        value = _along(system, arc, argument)
        row = value(middle)
        signs[symbol] = 1 if row[0] > 0 else -1
        changes = np.flatnonzero(np.sign(row[1:]) * np.sign(row[:-1]) < 0)
        cuts += [(_zero(value, middle[j], middle[j + 1]), symbol) for j in changes]
    cuts.sort(key=lambda cut: cut[0])
    corners = [float(arc.t[0]), *(t for t, _ in cuts), float(arc.t[-1])]
    joint = None
    for number, span in enumerate(pairwise(corners)):
        yield Piece(k, its, dict(signs), span, joint)
        if number < len(cuts):
            symbol = cuts[number][1]
            signs[symbol] = -signs[symbol]
            joint = system.numbers.kinks[symbol]


def looks(system: Hamiltonian, arc: Arc) -> Callable[[Expr], np.ndarray]:
    """Return what gives the values (n,) of an expression at some times of an arc."""
    times = np.linspace(arc.t[0], arc.t[-1], _SAMPLES)
    return lambda expression: _along(system, arc, expression)(times)


def _along(system: Hamiltonian, arc: Arc, argument: Expr) -> Callable[[np.ndarray], np.ndarray]:
    """Return an expression of states, costates and time on an arc as a function of times."""
    numbers = system.numbers.values
    known = column(numbers), casadi.DM([float(each) for each in numbers.values()])
    function = casadi.Function("a", [system.z], [casadi.substitute(argument, *known)])

    def values(t: np.ndarray) -> np.ndarray:
        cost = [0.0 * t] * system.costs
        rows = np.vstack([arc.at(t), arc.at(t, "costate"), *cost, t])
        return np.array(function.map(t.size)(rows).full()[0])

    return values


def _zero(value: Callable[[np.ndarray], np.ndarray], first: float, last: float) -> float:
    return float(brentq(lambda t: float(value(np.array([t]))[0]), first, last))


def _among(expression: Expr, known: Sequence[Expr]) -> bool:
    return any(same(expression, each) for each in known)


def same(one: Expr, other: Expr) -> bool:
    """Tell whether two expressions are the same as they are written, up to their sign."""
    return any(casadi.is_equal(one, each, 60) or is_zero(one - each) for each in (other, -other))

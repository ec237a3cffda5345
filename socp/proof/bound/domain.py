"""A region that no trajectory of interest leaves, or from which leaving costs enough."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from itertools import product
from math import inf
from typing import Any, final

from socp.errors import SolveError
from socp.model import Problem
from socp.proof.bound.ansatz import at_vertex
from socp.proof.bound.certificate import certificate
from socp.proof.bound.checking import Check
from socp.proof.bound.clipping import Pairs, clips
from socp.proof.bound.comparing import Staying, boxed, nonnegative
from socp.proof.bound.lifting import Lift, Limits, Polynomial, fraction, lifted, limits, span
from socp.proof.bound.sets import Region, with_ranges

Hull = Mapping[str, tuple[float, float]]
Spread = Hull  # where the states of a solution are, which need not be all

_NOWHERE: Limits = (None, None)
# How far out a side is looked for that nothing crosses, over the width of the region
_OUT = (0.25, 0.5, 1.0, 2.0, 4.0)
_NEAR = 1e-6  # of the width: a hull that ends so near to a given value ends there
_GRAIN = 64  # sides are multiples of the width over it
_MANY = 10  # with more variables not even squares of squares fit into a block
_SETTLED = 30  # rounds in which a reach box closes if it does, about the number of states


@final
@dataclass(frozen=True, eq=False)
class Setting:
    """A problem as a bound needs it: polynomials, vertices of the box of controls (m, nu), running
    and final cost with the weight of a free final time in the running cost, start and ends.
    """

    problem: Problem
    lift: Lift
    vertices: list[list[Fraction]]
    running: Polynomial
    final: Polynomial
    free: bool
    nothing_after: bool
    exact: bool  # nothing may be missing from an inequality: the time is free, and costs nothing

    @property
    def names(self) -> list[str]:
        """Names of the base variables: states and time."""
        return self.lift.names[: self.lift.base]

    @property
    def time(self) -> int:
        """Place of the time."""
        return self.lift.base - 1

    @property
    def length(self) -> Fraction:
        """The longest horizon, where it is not free."""
        last = limits(self.problem.statement["final_time"])[1]
        first = limits(self.problem.statement["initial_time"])[0]
        return (last or Fraction(0)) - (first or Fraction(0))

    @cached_property
    def check(self) -> Check:
        """What the checker makes of the problem: which sides are kept, or clipped, it says."""
        return Check(certificate(self.problem, self.lift, []))

    def kept(self, box: Sequence[Limits], which: tuple[int, int], *, ever: bool = False) -> bool:
        """Tell whether nothing crosses a side of a box of the base variables, of horizons of any
        length where `ever`.
        """
        check, length = self.check, None if ever or self.free else self.length
        start: Any = [check.initial(k) for k in range(self.lift.base)]
        ends: Any = boxed(check.model, [None if None in each else each for each in box])
        statement = self.problem.statement
        return Staying(check.model, check.vertices, statement, ends, start).within(*which, length)

    def given(self, table: str, place: int) -> Limits:
        """Return the interval of a state in a table of the statement."""
        its = self.problem.statement[table].get(self.names[place])
        return _NOWHERE if its is None else limits(its)

    def start(self) -> Region:
        """Return the point at which trajectories start."""
        box = [self.given("start", k) for k in range(self.lift.base)]
        box[self.time] = limits(self.problem.statement["initial_time"])
        return Region(self.lift, with_ranges(self.lift, box))

    def fastest(self, place: int, box: Sequence[Limits]) -> Limits:
        """Return the interval of a variable's rate on a box of the base variables."""
        ranges = with_ranges(self.lift, box)
        rates = [at_vertex(self.lift, self.lift.rates[place], v) for v in self.vertices]
        ends = [span(rate, ranges) for rate in rates]
        lows, highs = zip(*ends, strict=True)
        return (
            None if None in lows else min(lows),
            None if None in highs else max(highs),
        )

    def ageless(self, region: Region) -> bool:
        """Tell whether functions on a region may well do without the time, though it is given: data
        do not depend on it, and what would last is clipped.
        """
        timed = self.lift.appear() | self.lift.through()
        return bool(region.clipped) and not self.free and self.time not in timed

    def anywhere(self, place: int) -> Limits:
        """Return the interval of a variable's rate wherever the bounds of the problem let it be."""
        its = (self.given("bounds", k) for k in range(self.time))
        return self.fastest(place, [*its, _NOWHERE])

    def idle(self) -> set[int]:
        """Return the places of states that nothing depends on, not even through a function, and
        that the problem leaves without bounds: functions may be linear in them on all states.
        """
        free = {k for k in range(self.time) if None in self.given("bounds", k)}
        return free - self.lift.appear() - self.lift.through()

    def bounded(self) -> set[int]:
        """Return the places of states that nothing depends on and that the problem bounds."""
        bounded = {k for k in range(self.time) if None not in self.given("bounds", k)}
        return bounded - self.lift.through()


def setting(problem: Problem) -> Setting:
    """Return the setting of a problem; SolveError says what has no bound yet."""
    statement = problem.statement
    if statement["parameters"]:
        raise SolveError("free parameters have no bound yet")
    lift = lifted(problem)
    count = len(lift.appear()) + len(lift.functions)
    if count > _MANY:
        raise SolveError(f"{count} variables that are not linear are too many: at most {_MANY}")
    boxes = [limits(statement["bounds"][lift.names[k]]) for k in lift.controls]
    vertices = [[each or Fraction(0) for each in vertex] for vertex in product(*boxes)]
    free = float(statement["final_time"][1]) == inf
    running, cost, weight = lift.running, lift.final, Fraction(0)
    if free:
        slope = cost.derivative(lift.base - 1)
        if not slope.is_constant():
            raise SolveError("the horizon is free, and its cost is not linear in it")
        weight = fraction(slope.leading_coefficient()) if slope != 0 else weight
        running, cost = running + slope, cost - slope * lift.ring.gen(lift.base - 1)
    never = nonnegative(statement["nodes"], statement["running"]) and weight >= 0
    nothing = never and (cost == 0 or (cost.is_constant() and cost.leading_coefficient() > 0))
    exact = free and not (never and weight > 0 and cost == 0)
    found = Setting(problem, lift, vertices, running, cost, free, nothing, exact)
    for k, its in enumerate(found.start().box[: lift.base]):
        if None in its:
            raise SolveError(f"the start of '{lift.names[k]}' is not given")
    return found


@final
@dataclass(frozen=True, eq=False)
class Domain:
    """A region with its open sides: (place, 0 below or 1 above), to be closed by a function."""

    region: Region
    exits: list[tuple[int, int]]


def domain(
    setting: Setting,
    hull: Hull,
    widening: Mapping[tuple[int, int], float],
    first: float,
    also: set[int],
) -> Domain:
    """Return a region around a hull of the states, with sides moved out by widenings over its
    width, `first` where there is none; states that no rate depends on have sides where they are in
    `also`.

    Sides are those of the problem's bounds; else such as nothing crosses, for the motion there does
    not lead outward; else such as the horizon is too short for; else open. SolveError names what
    stays without bounds.
    """
    lift = setting.lift
    wanted = lift.appear() | lift.ranged() | also
    box: list[Limits] = [_NOWHERE] * lift.base
    if not setting.free:
        begin, end = (setting.problem.statement[f"{each}_time"] for each in ("initial", "final"))
        box[setting.time] = limits(begin)[0], limits(end)[1]
    elif setting.time in wanted:
        raise SolveError("data depend on the time, and the horizon is free")
    open_sides: list[tuple[int, int]] = []
    for k in sorted(wanted - {setting.time}):
        its = list(setting.given("bounds", k))
        open_sides += [(k, side) for side in (0, 1) if its[side] is None]
        box[k] = its[0], its[1]
    reach = _reach(setting, box) if open_sides and not setting.free else list(box)
    for k, side in open_sides:
        ends = list(box[k])
        ends[side] = _side(setting, hull, k, side, widening.get((k, side), first))
        box[k] = ends[0], ends[1]
    exits: list[tuple[int, int]] = []
    for k, side in open_sides:
        _settle(setting, box, reach, (k, side), hull)
    exits = [side for side in open_sides if not setting.kept(box, side)]
    clipped: Mapping[int, int] = {}
    pairs: Pairs = []
    if exits and not setting.nothing_after:
        edges = {(k, side): _edge(setting, hull, k, side) for k, side in exits}
        clipped, pairs = clips(setting.check, box, edges)
        for k, side in clipped.items():
            box[k] = _with(box[k], side, edges[k, side])
        exits = [
            (k, side)
            for k, side in exits
            if clipped.get(k) != side and not setting.kept(box, (k, side))
        ]
    for k in range(lift.base):
        if None not in box[k] and _width(box[k]) <= 0:
            raise SolveError(f"'{lift.names[k]}' has no room in the region")
    guards = [-each for each in lift.path if not lift.depends(each, clipped)]
    guards += lift.facts(lift.lasting())
    return Domain(Region(lift, with_ranges(lift, box), guards, clipped, pairs), exits)


def _side(setting: Setting, hull: Hull, place: int, side: int, widening: float) -> Fraction:
    low, high = hull[setting.names[place]]
    width = (high - low) or max(abs(high), 1.0)
    moved = low - widening * width if side == 0 else high + widening * width
    grain = Fraction(width).limit_denominator(_GRAIN) / _GRAIN or Fraction(1, _GRAIN)
    return round(Fraction(moved) / grain) * grain


def _edge(setting: Setting, hull: Hull, place: int, side: int) -> Fraction:
    """Return where the hull ends on a side: at a given start or end, as it is written, or near."""
    exact = _written(setting, hull, place, side)
    return exact[0] if exact else _side(setting, hull, place, side, 1.0 / _GRAIN)


def _written(setting: Setting, hull: Hull, place: int, side: int) -> list[Fraction]:
    """Return the given start or end at which the hull ends on a side, none if it does not."""
    low, high = ends = hull[setting.names[place]]
    near = _NEAR * ((high - low) or max(abs(high), 1.0))
    given = [setting.given(table, place)[side] for table in ("start", "end")]
    exact = [each for each in given if each is not None and abs(float(each) - ends[side]) <= near]
    return sorted(exact, reverse=bool(side))[:1]


def _settle(
    setting: Setting,
    box: list[Limits],
    reach: Sequence[Limits],
    which: tuple[int, int],
    hull: Hull,
) -> None:
    """Place a side where nothing crosses it if there is such a place near, else where the horizon
    ends if leaving is not free of costs, else leave it where it is.
    """
    k, side = which
    here, width = box[k][side], _width(box[k])
    low, high = setting.anywhere(k)
    one_way = (low is not None and low >= 0) or (high is not None and high <= 0)
    natural = _written(setting, hull, k, side) if one_way else []
    natural += [Fraction(0)] if side == 0 and hull[setting.names[k]][0] >= 0 else []
    for value in [*natural, here, *(_moved(here, side, Fraction(w) * width) for w in _OUT)]:
        trial = [*box[:k], _with(box[k], side, value), *box[k + 1 :]]
        if setting.kept(trial, which, ever=True):
            box[k] = trial[k]
            return
    if reach[k][side] is not None and not setting.nothing_after:
        box[k] = _with(box[k], side, reach[k][side])


def _with(its: Limits, side: int, value: Fraction | None) -> Limits:
    return (value, its[1]) if side == 0 else (its[0], value)


def _moved(value: Any, side: int, by: Fraction) -> Fraction:
    return Fraction(value + by if side else value - by)


def _width(its: Limits) -> Fraction:
    low, high = its
    return Fraction(0) if low is None or high is None else high - low


def _reach(setting: Setting, box: Sequence[Limits]) -> list[Limits]:
    """Return what the states can reach within the horizon, without bounds where that does not
    close.
    """
    start, found = setting.start().box, list(box)
    for _ in range(_SETTLED):
        before = list(found)
        for k in range(setting.time):
            low, high = setting.fastest(k, found)
            mine, its = start[k], setting.given("bounds", k)
            if its[0] is None and low is not None and mine[0] is not None:
                found[k] = mine[0] + setting.length * min(low, Fraction(0)), found[k][1]
            if its[1] is None and high is not None and mine[1] is not None:
                found[k] = found[k][0], mine[1] + setting.length * max(high, Fraction(0))
        if before == found:
            return found
    return list(box)

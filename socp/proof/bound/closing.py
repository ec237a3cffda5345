"""Regions and the functions on them: the subsolution of a degree, and what closes open sides."""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import chain
from math import inf, isqrt
from typing import final

import numpy as np

from socp.errors import LateError, SolveError
from socp.proof.bound.ansatz import Ansatz, below, decrease, falling, value
from socp.proof.bound.certificate import Data, function, proof
from socp.proof.bound.domain import Domain, Hull, Setting, Spread, domain
from socp.proof.bound.lifting import Limits, Polynomial, fraction, limits, span
from socp.proof.bound.rounding import rounded, shown
from socp.proof.bound.sets import Region, with_ranges
from socp.proof.bound.squares import Blocks, Demand, Solved, expense, monomials, solved

_EXIT_DEGREES = (4, 6)  # of the functions that close open sides: they need not be sharp
_BARRIER_DEGREES = (2, 3, *_EXIT_DEGREES)  # of those that nobody reaches
_WIDE, _NARROW = 0.5, 0.25  # how far sides stand out at first, over the width
# Of the gap that the region around this one leaves: leaving may be shown to cost less by so much
_PART = 0.02
_HALF = 0.5  # the same where moving out further was in vain
_WIDER = 2.0  # a side that is reached too cheaply moves out by this factor
_LEAST = 1e-6  # of the size of a goal
_MORE = 0.1  # over the goal, relative: leaving need not be shown to cost more
_CLEAR = 0.01  # of the most that a barrier may be: well above what rounding leaves
_MOVED = 1e-3  # of the goal: a side that raises its cost by less does not move on
_ROUNDS = 8
# Of what a function changes by in unit time: an inequality that nothing may be missing from is
# asked for with so much over, the least that what rounding leaves stays below
_MARGINS = (1e-6, 1e-5, 1e-4)
_FINE = 10**12  # of a square root
_TELLING = 0.5  # seconds: a smaller programme says little of how fast a machine is


@final
class Clock:
    """The seconds that are left, and how many a programme takes here of those that it would."""

    def __init__(self, seconds: float, paces: list[float] | None = None) -> None:
        self._until = time.monotonic() + seconds
        self._paces = [1.0] if paces is None else paces

    def share(self, among: int) -> "Clock":
        """Return a clock of an equal share of what is left."""
        return Clock(self() / among, self._paces)

    def solved(self, objective: np.ndarray, blocks: Sequence[Blocks], enough: float) -> Solved:
        """Return what `solved` does; SolveError where there is no time for a programme so large."""
        expected = self._paces[-1] * expense(blocks)
        if expected > self():
            raise LateError(f"there was no time for a programme of {expected:.0f} s")
        found = solved(objective, blocks, self, enough)
        if min(found.seconds, expense(blocks)) > _TELLING:
            self._paces.append(found.seconds / expense(blocks))
        return found

    def __call__(self) -> float:
        """Return the seconds that are left."""
        return self._until - time.monotonic()


@final
@dataclass(frozen=True, eq=False)
class Task:
    """A problem, where its trajectories of interest are, and the objective of the best known."""

    setting: Setting
    hull: Hull
    goal: float | None

    @property
    def enough(self) -> float:
        """What no function needs to exceed: where nobody stays in a region there is no limit."""
        return inf if self.goal is None else self.goal + max(abs(self.goal), _LEAST) * _MORE


@final
@dataclass(frozen=True, eq=False)
class Found:
    """A function: its value at the start, itself, and what a certificate says of it."""

    value: float
    function: Polynomial
    data: Data


@final
@dataclass(frozen=True, eq=False)
class Stage:
    """A region, the functions that close its open sides, and the subsolution on it."""

    region: Region
    exits: list[Found]
    found: Found
    degree: int


def subsolution(
    given: Setting,
    ansatz: Ansatz,
    running: Polynomial,
    ends: Demand,
    clock: Clock,
    enough: float = inf,
) -> Found:
    """Return the function of an ansatz with the largest value at the start, up to what is enough,
    that satisfies the inequality of a running cost at every vertex, and the demand on ends.
    """
    part = _speed(given, ansatz.region) * _size(given, ansatz.region)
    for share in _MARGINS:
        falls = Fraction(part * share)
        exact = falls if given.exact else Fraction(0)
        blocks = list[Blocks | None]()
        demands = chain(decrease(ansatz, running, given.vertices, exact), falling(ansatz, falls))
        for demand in chain(demands, (ends,)):
            if clock() <= 0.0:
                raise LateError("there was no time for it")
            blocks.append(None if demand.empty else Blocks.of(demand))
        wanted = [each for each in blocks if each is not None]
        found = clock.solved(value(ansatz, given.start()), wanted, enough)
        coefficients, grams = rounded(found.coefficients), iter(found.grams)
        squares = [its and shown(its, coefficients, next(grams)) for its in blocks]
        pairs = zip(wanted, filter(None, squares), strict=True)
        if all(its.left < each.demand.margin for each, its in pairs):
            proofs = [[] if its is None else proof(its) for its in squares]
            data = {"function": function(ansatz.monomials, coefficients), "proofs": proofs}
            return Found(found.value, ansatz.combined(coefficients), data)
    raise SolveError("what rounding leaves of the inequalities is too much")


def _speed(given: Setting, region: Region) -> float:
    """Return the least part of its radius that a variable crosses in unit time."""
    base = range(region.lift.base)
    used = [k for k in base if region.wide(k) and region.bounded(k) and k != given.time]
    speeds = [given.fastest(k, region.box[: len(base)]) for k in used]
    rates = [
        float(max(-low, high) / region.radius(k))
        for k, (low, high) in zip(used, speeds, strict=True)
        if low is not None and high is not None
    ]
    return min((rate for rate in rates if rate > 0.0), default=1.0)


def _size(given: Setting, region: Region) -> float:
    """Return half of what the final cost varies by on a region, one where that is not bounded."""
    low, high = span(given.final, region.box)
    return float(high - low) / 2 if low is not None and high is not None and low < high else 1.0


def ansatz_of(
    given: Setting, region: Region, degree: int, exit_: int | None = None, *, timed: bool = True
) -> Ansatz:
    """Return the functions of a degree, or those that close a side of the variable `exit_`: linear
    in what has no bounds, or without it; what enters through functions alone stands in them, and
    beside them alone where the final cost is linear in it; functions that hardly vary are left out.
    """
    lift, caps, alone = given.lift, dict[int, int](), set[int]()
    steady = {k for _, k, _ in lift.functions if region.steady(k)} | lift.rough()
    appear, through = lift.appear(steady), lift.through()
    final = given.final.degrees()
    for k in range(lift.base + len(lift.functions)):
        hidden = k in through and k not in appear
        if k in steady or (k == given.time and (given.free or hidden or not timed)):
            continue
        if hidden and final[k] <= 1:
            caps |= {k: 1} if final[k] > 0 or k == exit_ else {}
            alone.add(k)
        elif region.bounded(k):
            caps[k] = degree
        elif k < lift.base and exit_ is None:
            caps[k] = 1
            alone.add(k)
    return Ansatz(region, monomials(region, caps, degree, alone=alone))


def ends_of(given: Setting, region: Region) -> Region:
    """Return admissible ends within a region."""
    lift, box = given.lift, list(region.box[: given.lift.base])
    target = [each for each in lift.target if not lift.depends(each[0], region.clipped)]
    guards = [each for p, equal in target for each in ((-p, p) if equal else (-p,))]
    guards += lift.facts(lift.last())
    for k in range(lift.base):
        its = given.given("end", k)
        if k == given.time:
            its = (None, None) if given.free else limits(given.problem.statement["final_time"])
        box[k] = _both(box[k], _clipped(region, k, its))
        for guard in guards:
            most = _disc(guard, k)
            box[k] = box[k] if most is None else _both(box[k], (-most, most))
    return Region(lift, with_ranges(lift, box), [*region.guards, *guards])


def _clipped(region: Region, place: int, its: Limits) -> Limits:
    """Return the interval of a variable's ends as they are seen where it is clipped."""
    side = region.clipped.get(place)
    if side is None:
        return its
    edge, other = region.box[place][side], min if side else max
    low, high = (None if each is None or edge is None else other(each, edge) for each in its)
    return low, high


def _disc(guard: Polynomial, place: int) -> Fraction | None:
    """Return the largest modulus of a variable where constant - squares is at least zero."""
    terms = {tuple(map(int, e)): fraction(c) for e, c in guard.to_dict().items()}
    square = tuple(2 if k == place else 0 for k in range(len(guard.degrees())))
    constant = terms.pop((0,) * len(square), Fraction(0))
    plain = all(c < 0 and not any(n % 2 for n in e) for e, c in terms.items())
    if not plain or square not in terms or constant < 0:
        return None
    over = constant / -terms[square]
    return Fraction(isqrt(over.numerator * _FINE**2 // over.denominator) + 1, _FINE)


def _both(a: Limits, b: Limits) -> Limits:
    low = max((x for x in (a[0], b[0]) if x is not None), default=None)
    high = min((x for x in (a[1], b[1]) if x is not None), default=None)
    return low, high


def hull_of(given: Setting, spread: Spread) -> Hull:
    """Return where trajectories of interest are, by state: of known ones, and of both ends."""
    found = {}
    for k, name in enumerate(given.names[: given.time]):
        known = [*spread.get(name, ())]
        known += [
            float(x)
            for its in (given.given("start", k), given.given("end", k))
            for x in its
            if x is not None
        ]
        found[name] = (min(known), max(known))
    return found


def closed(
    task: Task, also: set[int], outer: Sequence[Stage], clock: Clock
) -> tuple[Region, list[Found]]:
    """Return a region with functions that close its open sides, which move out until leaving
    through them costs as much as the goal, or half of the time is spent.
    """
    half = clock.share(2)
    for rounds in (_ROUNDS, 1):
        region, exits = _moved(task, also, outer, half, rounds)
        if all(each.data for each in exits):
            break  # none that there was no time for
    if region is None or any(each.value == -inf for each in exits):
        raise SolveError("the states are not shown to stay within a region")
    if outer and any(each.value <= outer[-1].found.value for each in exits):
        raise SolveError("leaving a narrower region is not shown to cost more")
    return region, exits


def _moved(
    task: Task, also: set[int], outer: Sequence[Stage], clock: Clock, rounds: int
) -> tuple[Region | None, list[Found]]:
    """Return a region with functions that close its open sides, as far as they do, which moved out
    as long as that is worth it and there is time; the share of one of some rounds for a barrier.
    """
    first = _NARROW if outer else _WIDE
    # what the region around this one leaves open; without one, leaving has to cost the goal
    gap = 0.0 if task.goal is None or not outer else task.goal - outer[-1].found.value
    widening, known = dict[tuple[int, int], float](), dict[tuple[int, int], float]()
    cheap: list[tuple[int, int]] = []
    region, exits = None, list[Found]()
    for _ in range(_ROUNDS):
        last, cheap = cheap, []
        found = domain(task.setting, task.hull, widening, first, also)
        if outer and not found.region.within(outer[-1].region):
            break  # moved out of what the functions around it hold on
        try:
            its = [_exit(task, found, side, outer, (clock, rounds)) for side in found.exits]
        except (SolveError, LateError):
            if region is None:
                raise
            break  # the last sides are as good as there was time for
        region, exits = found.region, its
        for side, each in zip(found.exits, exits, strict=True):
            if task.goal is not None and each.value < task.goal - _PART * gap:
                vain = side in last and each.value - known[side] <= _MOVED * gap
                enough = each.value >= task.goal - _HALF * gap
                cheap += [] if vain and enough else [side]
            known[side] = each.value
        if not cheap:
            break
        widening |= {each: widening.get(each, first) * _WIDER for each in cheap}
    return region, exits


def _tries(
    task: Task, region: Region, outer: Sequence[Stage]
) -> Iterator[tuple[str, int, Polynomial, Polynomial, float]]:
    """Yield what may close a side: its kind, degree, running cost, what it is at most at the side,
    and what is enough at the start.
    """
    running, zero = task.setting.running, region.lift.zero
    if outer:
        for each in _EXIT_DEGREES:
            yield "outer", each, running, outer[-1].found.function, task.enough
    if task.setting.nothing_after:
        for each in _EXIT_DEGREES:
            yield "nothing", each, running, zero, task.enough
    elif not outer:
        for each in _BARRIER_DEGREES:
            yield "barrier", each, zero, zero, _size(task.setting, region)


def _exit(
    task: Task,
    within: Domain,
    side: tuple[int, int],
    outer: Sequence[Stage],
    times: tuple[Clock, int],
) -> Found:
    """Return a function that is at most the cost to go where an open side is left: nothing, or what
    the region around this one says; or a barrier, in a share of the time.
    """
    region, lift, (place, end) = within.region, within.region.lift, side
    face = region.face({place: end})
    best: Found | None = None
    late = False  # there was no time for a barrier
    reason: Exception = SolveError(f"nothing is known of who leaves '{lift.names[place]}'")
    for kind, degree, cost, floor, enough in _tries(task, region, outer):
        clock = times[0].share(times[1]) if kind == "barrier" else times[0]
        try:
            timed = not task.setting.ageless(region)
            ansatz = ansatz_of(task.setting, region, degree, place, timed=timed)
            ends = below(ansatz, "exit", face, floor)
            its = subsolution(task.setting, ansatz, cost, ends, clock, enough)
        except (SolveError, LateError) as error:
            reason, late = error, late or (kind == "barrier" and isinstance(error, LateError))
            continue
        if kind == "barrier":  # nobody gets there, or nothing is shown
            its = replace(its, value=inf if its.value > _CLEAR * enough else -inf)
        if best is None or its.value > best.value:
            best = replace(its, data={**its.data, "variable": place, "side": end, "after": kind})
        if best.value > -inf and (task.goal is None or best.value >= task.goal):
            break
    if best is None and late and times[1] > 1:
        return Found(-inf, lift.zero, {})  # there may be a barrier further out that takes less time
    if best is None:
        raise reason
    return best

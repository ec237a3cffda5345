"""Regions and the functions on them: the subsolution of a degree, and what closes open sides."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from itertools import chain, product
from math import inf, isqrt
from typing import final

import numpy as np

from socp.errors import LateError, SolveError
from socp.proof.bound.ansatz import Ansatz, below, decrease, value
from socp.proof.bound.certificate import Data, function, proof
from socp.proof.bound.domain import Hull, Setting, Spread, domain
from socp.proof.bound.lifting import Limits, Polynomial, fraction, limits
from socp.proof.bound.rounding import rounded, shown
from socp.proof.bound.sets import Region, with_ranges
from socp.proof.bound.squares import Blocks, Demand, Solved, expense, monomials, solved

_EXIT_DEGREES = (4, 6)  # of the functions that close open sides: they need not be sharp
_WIDE, _NARROW = 0.5, 0.25  # how far sides stand out at first, over the width
# Of the gap that the region around this one leaves: leaving may be shown to cost less by so much
_PART = 0.02
_HALF = 0.5  # the same where moving out further was in vain
_WIDER = 2.0  # a side that is reached too cheaply moves out by this factor
_LEAST = 1e-6  # of the size of a goal
_MORE = 0.1  # over the goal, relative: leaving need not be shown to cost more
_CLEAR = 0.01  # of a barrier, which is one at most: well above what rounding leaves
_MOVED = 1e-3  # of the goal: a side that raises its cost by less does not move on
_ROUNDS = 8
_FINE = 10**12  # of a square root
_TELLING = 0.5  # seconds: what is over sooner says little of how fast a machine is


@final
class Clock:
    """The seconds that are left, and how many a programme takes here of those that it would."""

    def __init__(self, seconds: float, paces: list[float] | None = None) -> None:
        self._until = time.monotonic() + seconds
        self._paces = [1.0] if paces is None else paces

    def share(self, among: int) -> "Clock":
        """Return a clock of an equal share of what is left."""
        return Clock(self() / among, self._paces)

    def solved(
        self, objective: np.ndarray, blocks: Sequence[Blocks], enough: float | None
    ) -> Solved:
        """Return what `solved` does; SolveError where there is no time for a programme so large."""
        expected = self._paces[-1] * expense(blocks)
        if expected > self():
            raise LateError(f"there was no time for a programme of {expected:.0f} s")
        found = solved(objective, blocks, self, enough)
        if found.seconds > _TELLING:
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
    def enough(self) -> float | None:
        """What no function needs to exceed: where nobody stays in a region there is no limit."""
        return None if self.goal is None else self.goal + max(abs(self.goal), _LEAST) * _MORE


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
    enough: float | None = None,
) -> Found:
    """Return the function of an ansatz with the largest value at the start, up to what is enough,
    that satisfies the inequality of a running cost at every vertex, and the demand on ends.
    """
    blocks = []
    for demand in chain(decrease(ansatz, running, given.vertices), (ends,)):
        if clock() <= 0.0:
            raise LateError("there was no time for it")
        blocks.append(Blocks.of(demand))
    found = clock.solved(value(ansatz, given.start()), blocks, enough)
    coefficients = rounded(found.coefficients)
    proofs = [
        proof(shown(its, coefficients, grams))
        for its, grams in zip(blocks, found.grams, strict=True)
    ]
    data = {"function": function(ansatz.monomials, coefficients), "proofs": proofs}
    return Found(found.value, ansatz.combined(coefficients), data)


def ansatz_of(given: Setting, region: Region, degree: int, *, bounded: bool = False) -> Ansatz:
    """Return the functions of a degree: linear in what has no bounds, or without it; what enters
    through functions alone stands in them alone.
    """
    lift, caps = given.lift, dict[int, int]()
    appear, through = lift.appear(), lift.through()
    for k in range(lift.base + len(lift.functions)):
        if k == given.time and (given.free or (k in through and k not in appear)):
            continue
        if region.bounded(k) and (k not in through or k in appear):
            caps[k] = degree
        elif k < lift.base and k not in through and not bounded:
            caps[k] = 1
    return Ansatz(region, monomials(region, caps, degree))


def ends_of(given: Setting, region: Region) -> Region:
    """Return admissible ends within a region."""
    lift, box = given.lift, list(region.box[: given.lift.base])
    guards = [each for p, equal in lift.target for each in ((-p, p) if equal else (-p,))]
    for k in range(lift.base):
        its = given.given("end", k)
        if k == given.time:
            its = (None, None) if given.free else limits(given.problem.statement["final_time"])
        box[k] = _both(box[k], its)
        for guard in guards:
            most = _disc(guard, k)
            box[k] = box[k] if most is None else _both(box[k], (-most, most))
    return Region(lift, with_ranges(lift, box), [*region.guards, *guards])


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
    first, half = _NARROW if outer else _WIDE, clock.share(2)
    # what the region around this one leaves open; without one, leaving has to cost the goal
    gap = 0.0 if task.goal is None or not outer else task.goal - outer[-1].found.value
    widening, known = dict[tuple[int, int], float](), dict[tuple[int, int], float]()
    cheap: list[tuple[int, int]] = []
    region, exits = None, list[Found]()
    for _ in range(_ROUNDS):
        last, cheap = cheap, []
        found = domain(task.setting, task.hull, widening, first, also)
        try:
            its = [_exit(task, found.region, side, outer, half) for side in found.exits]
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
    if region is None or any(each.value == -inf for each in exits):
        raise SolveError("the states are not shown to stay within a region")
    if outer and any(each.value <= outer[-1].found.value for each in exits):
        raise SolveError("leaving a narrower region is not shown to cost more")
    return region, exits


def _exit(
    task: Task, region: Region, side: tuple[int, int], outer: Sequence[Stage], clock: Clock
) -> Found:
    """Return a function that is at most the cost to go where an open side is left: nothing, or what
    the region around this one says.
    """
    lift, (place, end) = region.lift, side
    box = list(region.box[: lift.base])
    box[place] = (box[place][end],) * 2
    face = Region(lift, with_ranges(lift, box), region.guards)
    running, zero = task.setting.running, lift.zero
    tries: list[tuple[str, Polynomial, Polynomial, float | None]] = []
    if outer:
        tries.append(("outer", running, outer[-1].found.function, task.enough))
    if task.setting.nothing_after:
        tries.append(("nothing", running, zero, task.enough))
    elif not outer:
        tries.append(("barrier", zero, zero, 1.0))
    best: Found | None = None
    reason: Exception = SolveError(f"nothing is known of who leaves '{lift.names[place]}'")
    for (kind, cost, floor, enough), degree in product(tries, _EXIT_DEGREES):
        try:
            ansatz = ansatz_of(task.setting, region, degree, bounded=True)
            ends = below(ansatz, "exit", face, floor)
            its = subsolution(task.setting, ansatz, cost, ends, clock, enough)
        except (SolveError, LateError) as error:
            reason = error
            continue
        if kind == "barrier":  # nobody gets there, or nothing is shown
            its = replace(its, value=inf if its.value > _CLEAR else -inf)
        if best is None or its.value > best.value:
            best = replace(its, data={**its.data, "variable": place, "side": end, "after": kind})
        if task.goal is None or best.value >= task.goal:
            break
    if best is None:
        raise reason
    return best

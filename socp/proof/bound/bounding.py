"""The search for a lower bound: regions, degrees and sums of squares, until the time is up; what
counts is what the checker makes of the certificate.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from fractions import Fraction
from math import floor, inf, isqrt, log10
from typing import Any, final

import numpy as np

from socp.errors import SolveError
from socp.model import Problem, Proof, Rung, Solution
from socp.proof.bound.certificate import Data, certificate, function, proof, stage
from socp.proof.bound.checking import checked
from socp.proof.bound.domain import Hull, Setting, domain, setting
from socp.proof.bound.lifting import Limits, Polynomial, fraction, limits
from socp.proof.bound.rounding import rounded, shown
from socp.proof.bound.sets import Region, with_ranges
from socp.proof.bound.squares import Blocks, Demand, monomials, solved
from socp.proof.bound.subsolution import Ansatz, below, decrease, value

SECONDS = 60.0
_DEGREES = (2, 3, 4, 5, 6, 8, 10, 12)
_EXIT_DEGREES = (4, 6)  # of the functions that close open sides: they need not be sharp
_WIDE, _NARROW = 0.5, 0.25  # how far sides stand out at first, over the width
# Of the gap that the region around this one leaves: leaving may be shown to cost less by so much
_PART = 0.5
_WIDER = 2.0  # a side that is reached too cheaply moves out by this factor
_MORE = 0.1  # over the goal, relative: leaving need not be shown to cost more
_CLEAR = 0.01  # of a barrier, which is one at most: well above what rounding leaves
_MOVED = 1e-3  # of the goal: a side that raises its cost by less does not move on
_ROUNDS = 8
_WORTH = 0.98  # of the gap: a degree that leaves more of it was not worth it
_STALLED = 2  # such degrees in a row, and no higher one is tried
_FINE = 10**12  # of a square root
_DIGITS = 10  # of a bound as it is stated, rounded down
_GROWTH = 4.0  # a programme of the next degree takes this times as long at least


@final
class Clock:
    """The seconds that are left."""

    def __init__(self, seconds: float) -> None:
        self._until = time.monotonic() + seconds

    def share(self, among: int) -> "Clock":
        """Return a clock of an equal share of what is left."""
        return Clock(self() / among)

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


@final
@dataclass(frozen=True, kw_only=True)
class LowerBound:
    """A proved lower bound of a problem's optimum with its certificate, or why there is none."""

    problem: str
    bound: float | None = None
    degree: int = 0
    reason: str = ""
    region: tuple[str, ...] = ()
    certificate: Data = field(default_factory=dict, repr=False)
    seconds: float = 0.0

    def gap(self, solution: Solution) -> float | None:
        """Return how far the optimum may be below a solution's objective, over its magnitude."""
        if self.bound is None:
            return None
        size = max(abs(solution.objective), float(np.finfo(float).tiny))
        return (solution.objective - self.bound) / size

    def rungs(self, solution: Solution) -> tuple[Proof, ...]:
        """Return what it proves of a solution as rungs of the ladder, none where it fails."""
        gap = self.gap(solution)
        if gap is None:
            return ()
        statement = (
            f"within {100 * gap:.2g} %: no control is below {self.bound:.10g}, degree "
            f"{self.degree}, checked in fractions"
        )
        return (Proof(rung=Rung.GLOBAL, margin=gap, statement=statement),)

    @property
    def data(self) -> dict[str, Any]:
        """The bound as plain values, without its certificate."""
        found = {"proved": self.bound is not None, **asdict(self)}
        return {key: value for key, value in found.items() if key != "certificate"}

    @property
    def lines(self) -> list[tuple[str, str]]:
        """The bound as lines of a report: labels and texts."""
        if self.bound is None:
            return [("no bound", self.reason)]
        return [
            ("proved", f"no admissible control has a lower objective than {self.bound:.10g}"),
            ("region", ", ".join(self.region) or "every state"),
            ("subsolution", f"degree {self.degree}, {self.seconds:.1f} s"),
            ("arithmetic", "sums of squares, checked in fractions"),
        ]


def lower_bound(
    problem: Problem,
    solution: Solution | None = None,
    seconds: float = SECONDS,
    degree: int | None = None,
) -> LowerBound:
    """Return a proved lower bound of a problem's optimum.

    A solution shows where trajectories of interest are, and what leaving the region should cost; it
    is not believed. `degree` is that of the subsolution, the largest that the time allows if None.
    Raises SolveError where python-flint is missing.
    """
    began = time.perf_counter()
    found = LowerBound(problem=problem.name)
    try:
        for each in _bounds(setting(problem), solution, Clock(seconds), degree):
            found = each
    except SolveError as error:
        found = found if found.bound is not None else replace(found, reason=str(error))
    return replace(found, seconds=time.perf_counter() - began)


def _bounds(
    given: Setting, solution: Solution | None, clock: Clock, degree: int | None
) -> Iterator[LowerBound]:
    """Yield better and better bounds: of functions that are linear in what nothing depends on, then
    of such as bend in it too.
    """
    best: LowerBound | None = None
    reason = SolveError("there was no time for it")
    task = Task(given, _hull(given, solution), None if solution is None else solution.objective)
    idle, stages = given.idle(), list[Stage]()
    passes = [set[int](), *([idle] if idle else []), idle]
    for k, also in enumerate(passes):
        if k and stages and not stages[-1].exits and not idle:
            break
        outer, among = stages, 1 if k + 1 == len(passes) else 2
        try:
            for stage in _climbed(task, also | given.bounded(), outer, (clock, among), degree):
                each = _certified(task, [*outer, stage])
                if stages is outer or stage.found.value > stages[-1].found.value:
                    stages = [*outer, stage]
                if best is None or (each.bound or 0.0) > (best.bound or 0.0):
                    best = each
                    yield each
        except SolveError as error:
            reason = error
    if best is None:
        raise reason


def _climbed(
    task: Task,
    also: set[int],
    outer: Sequence[Stage],
    time_left: tuple[Clock, int],
    degree: int | None,
) -> Iterator[Stage]:
    """Yield functions on one region by rising degrees, as long as they rise; once the region is
    closed, what is left of the time is shared among so many regions.
    """
    whole, among = time_left
    region, exits = _closed(task, also, outer, whole)
    clock = whole.share(among)
    reason: SolveError | None = SolveError("there was no time for it")
    spent, before, stalled = 0.0, inf, 0
    for each in _DEGREES if degree is None else (degree,):
        if spent * _GROWTH > clock():
            break
        began = time.monotonic()
        ansatz = _ansatz(task.setting, region, each)
        ends = below(ansatz, "at the end", _ends(task.setting, region), task.setting.final)
        try:
            found = _subsolution(task.setting, ansatz, task.setting.running, ends, clock)
        except SolveError as error:
            reason = reason and error
            continue
        spent = time.monotonic() - began
        yield Stage(region, exits, found, each)
        reason = None
        gap = -found.value if task.goal is None else task.goal - found.value
        stalled = stalled + 1 if task.goal is not None and gap > before * _WORTH else 0
        if stalled == _STALLED:
            return
        before = min(gap, before)
    if reason is not None:
        raise reason


def _certified(task: Task, stages: Sequence[Stage]) -> LowerBound:
    data = [stage(each.region, [e.data for e in each.exits], each.found.data) for each in stages]
    found = certificate(task.setting, data)
    low = _down(checked(found))
    found["bound"] = str(low)
    return LowerBound(
        problem=task.setting.problem.name,
        bound=float(low),
        degree=stages[-1].degree,
        region=tuple(_told(task.setting, stages[-1].region)),
        certificate=found,
    )


def _down(value: Fraction) -> Fraction:
    """Return a decimal that is no larger."""
    if not value:
        return value
    grain = Fraction(10) ** (_DIGITS - 1 - floor(log10(abs(value))))
    return Fraction(floor(value * grain)) / grain


def _told(given: Setting, region: Region) -> Iterator[str]:
    for name, (low, high) in zip(given.names, region.box, strict=False):
        if low is not None and high is not None:
            yield f"{name} in [{float(low):.4g}, {float(high):.4g}]"


def _subsolution(
    given: Setting,
    ansatz: Ansatz,
    running: Polynomial,
    ends: Demand,
    clock: Clock,
    enough: float | None = None,
) -> Found:
    demands = [*decrease(ansatz, running, given.vertices), ends]
    blocks = [Blocks.of(each) for each in demands]
    found = solved(value(ansatz, given.start()), blocks, clock, enough)
    coefficients = rounded(found.coefficients)
    proofs = [
        proof(shown(its, coefficients, grams))
        for its, grams in zip(blocks, found.grams, strict=True)
    ]
    data = {"function": function(ansatz.monomials, coefficients), "proofs": proofs}
    return Found(found.value, ansatz.combined(coefficients), data)


def _ansatz(given: Setting, region: Region, degree: int, *, bounded: bool = False) -> Ansatz:
    """Return the functions of a degree: linear in what has no bounds, or without it; what enters
    through functions alone stands in them alone.
    """
    lift, caps, appear = given.lift, dict[int, int](), given.appear()
    through = {
        k for _, _, of in lift.functions for k, n in enumerate(of.degrees()[: lift.base]) if n > 0
    }
    for k in range(lift.base + len(lift.functions)):
        if k == given.time and (given.free or (k in through and k not in appear)):
            continue
        if region.bounded(k) and (k not in through or k in appear):
            caps[k] = degree
        elif k < lift.base and k not in through and not bounded:
            caps[k] = 1
    return Ansatz(region, monomials(region, caps, degree))


def _ends(given: Setting, region: Region) -> Region:
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


def _hull(given: Setting, solution: Solution | None) -> Hull:
    """Return where trajectories of interest are, by state."""
    found = {}
    for k, name in enumerate(given.names[: given.time]):
        known = [
            float(x)
            for its in (given.given("start", k), given.given("end", k))
            for x in its
            if x is not None
        ]
        if solution is not None:
            known += [
                float(x) for arc in solution.arcs for x in (np.min(arc.x[k]), np.max(arc.x[k]))
            ]
        found[name] = (min(known), max(known))
    return found


def _closed(
    task: Task, also: set[int], outer: Sequence[Stage], clock: Clock
) -> tuple[Region, list[Found]]:
    """Return a region with functions that close its open sides, which move out until leaving
    through them costs as much as the goal.
    """
    first = _NARROW if outer else _WIDE
    need = task.goal
    if need is not None and outer:
        need -= _PART * max(need - outer[-1].found.value, 0.0)
    widening, known = dict[tuple[int, int], float](), dict[tuple[int, int], float]()
    for _ in range(_ROUNDS):
        found, cheap, exits = domain(task.setting, task.hull, widening, first, also), [], []
        for side in found.exits:
            its = _exit(task, found.region, side, outer, clock)
            exits.append(its)
            if need is not None and its.value < need:
                moved = its.value - known.get(side, -inf) > _MOVED * abs(need)
                cheap += [side] if moved else []  # else the last move of it was in vain
            known[side] = its.value
        if not cheap:
            break
        widening |= {each: widening.get(each, first) * _WIDER for each in cheap}
    if any(each.value == -inf for each in exits):
        raise SolveError("the states are not shown to stay within a region")
    return found.region, exits


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
    barrier = not outer and not task.setting.nothing_after
    running, floor, enough = task.setting.running, lift.zero, None
    if barrier:
        running, enough = lift.zero, 1.0
    elif outer:
        floor = outer[-1].found.function
    if task.goal is not None and not barrier:
        enough = task.goal + abs(task.goal) * _MORE
    for degree in _EXIT_DEGREES:
        ansatz = _ansatz(task.setting, region, degree, bounded=True)
        ends = below(ansatz, "exit", face, floor)
        its = _subsolution(task.setting, ansatz, running, ends, clock, enough)
        if barrier and its.value > _CLEAR:
            its = replace(its, value=inf)  # nobody gets there
        if task.goal is None or its.value >= task.goal:
            break
    if barrier and its.value < inf:
        its = replace(its, value=-inf)
    return replace(its, data={**its.data, "variable": place, "side": end, "barrier": barrier})

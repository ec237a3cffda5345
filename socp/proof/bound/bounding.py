"""The search for a lower bound: regions, degrees and sums of squares, until the time is up; what
counts is what the checker makes of the certificate.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from math import floor, inf, log10

from socp.errors import ProblemError, SolveError
from socp.model import Problem, Solution
from socp.proof.bound.ansatz import below
from socp.proof.bound.certificate import certificate, stage
from socp.proof.bound.checking import checked
from socp.proof.bound.closing import (
    Clock,
    Stage,
    Task,
    ansatz_of,
    closed,
    ends_of,
    hull_of,
    subsolution,
)
from socp.proof.bound.domain import Setting, setting
from socp.proof.bound.sets import Region
from socp.proof.bound.told import LowerBound

SECONDS = 60.0
_DEGREES = (2, 3, 4, 5, 6, 8, 10, 12)
_WORTH = 0.98  # of the gap: a degree that leaves more of it was not worth it
_STALLED = 2  # such degrees in a row, and no higher one is tried
_DIGITS = 10  # of a bound as it is stated, rounded down
_GROWTH = 4.0  # a programme of the next degree takes this times as long at least


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
    except (SolveError, ProblemError) as error:
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
    task = Task(given, hull_of(given, solution), None if solution is None else solution.objective)
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
    region, exits = closed(task, also, outer, whole)
    clock = whole.share(among)
    reason: SolveError | None = SolveError("there was no time for it")
    spent, before, stalled = 0.0, inf, 0
    for each in _DEGREES if degree is None else (degree,):
        if spent * _GROWTH > clock():
            break
        began = time.monotonic()
        ansatz = ansatz_of(task.setting, region, each)
        ends = below(ansatz, "at the end", ends_of(task.setting, region), task.setting.final)
        try:
            found = subsolution(
                task.setting, ansatz, task.setting.running, ends, clock, task.enough
            )
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

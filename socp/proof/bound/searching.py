"""The search for a lower bound: regions, degrees and sums of squares, until the time is up; what
counts is what the checker makes of the certificate.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from math import floor, inf, log10
from typing import final

from socp.errors import LateError, SolveError
from socp.model import Problem
from socp.proof.bound.ansatz import below
from socp.proof.bound.certificate import certificate, stage
from socp.proof.bound.checking import checked
from socp.proof.bound.closing import (
    Clock,
    Found,
    Stage,
    Task,
    ansatz_of,
    closed,
    ends_of,
    hull_of,
    subsolution,
)
from socp.proof.bound.domain import Setting, Spread, setting
from socp.proof.bound.sets import Region
from socp.proof.bound.told import LowerBound

_DEGREES = (2, 3, 4, 5, 6, 8, 10, 12)
_WORTH = 0.98  # of the gap: a degree that leaves more of it was not worth it
_STALLED = 2  # such degrees in a row, and no higher one is tried
_DIGITS = 10  # of a bound as it is stated, rounded down
_GROWTH = 4.0  # a programme of the next degree takes this times as long at least


@final
@dataclass(frozen=True)
class Job:
    """A search: of a problem, with where trajectories of interest are, by state, what leaving the
    region should cost, the degree of the subsolution, None for any, until when by the clock of the
    day, and for which process.
    """

    problem: Problem
    spread: Spread
    goal: float | None
    degree: int | None
    until: float
    parent: int


def bounds(job: Job) -> Iterator[LowerBound]:
    """Yield better and better bounds: of functions that are linear in what nothing depends on, then
    of such as bend in it too. SolveError, or LateError, where there is none.
    """
    given, clock = setting(job.problem), Clock(job.until - time.time())
    search = _Search(Task(given, hull_of(given, job.spread), job.goal))
    degrees = _DEGREES if job.degree is None else (job.degree,)
    idle, grounds = given.idle(), list[_Ground]()
    passes = [set[int](), *([idle] if idle else []), idle]
    for k, also in enumerate(passes):
        if k and search.stages and not idle and (given.exact or not search.stages[-1].exits):
            break
        try:
            its = closed(search.task, also | given.bounded(), search.stages, clock)
        except (SolveError, LateError) as error:
            search.reason = error
            continue
        stages = search.stages
        for timed in (False, True) if given.ageless(its[0]) else (True,):
            grounds.append(_Ground(*its, stages, list(degrees), timed))
            yield from search.climbed(grounds[-1], clock.share(1 if k + 1 == len(passes) else 2))
    for ground in reversed(grounds):  # what there was no time for while others waited
        yield from search.climbed(ground, clock)
    if search.best is None:
        raise search.reason


@final
@dataclass(eq=False)
class _Ground:
    """A region with what closes its open sides, the stages around it, the degrees to come, whether
    functions depend on the time, how long the last one took, the gap that it left, and how many in
    a row were not worth it.
    """

    region: Region
    exits: list[Found]
    outer: list[Stage]
    degrees: list[int]
    timed: bool = True
    spent: float = 0.0
    gap: float = inf
    stalled: int = 0

    def took(self, seconds: float, gap: float | None) -> None:
        """Take in how a degree went; the gap is None where the optimum is not known."""
        self.spent = seconds
        if gap is not None:
            self.stalled = self.stalled + 1 if gap > self.gap * _WORTH else 0
            self.gap = min(gap, self.gap)
        if self.stalled == _STALLED:
            self.degrees.clear()


@final
@dataclass(eq=False)
class _Search:
    """The best bound so far, the stages of the next region, and why there is no better one."""

    task: Task
    best: LowerBound | None = None
    stages: list[Stage] = field(default_factory=list)
    reason: Exception = field(default_factory=lambda: LateError("there was no time for it"))

    def climbed(self, ground: _Ground, clock: Clock) -> Iterator[LowerBound]:
        """Yield the bounds of functions on one region by rising degrees, as long as they rise and
        there is time.
        """
        while ground.degrees and ground.spent * _GROWTH <= clock():
            began = time.monotonic()
            try:
                found = self._of_degree(ground, ground.degrees[0], clock)
            except LateError as error:
                self.reason = error
                return
            except SolveError as error:
                self.reason = error
                ground.degrees.pop(0)
                continue
            stage = Stage(ground.region, ground.exits, found, ground.degrees.pop(0))
            goal = self.task.goal
            ground.took(time.monotonic() - began, None if goal is None else goal - found.value)
            each = _certified(self.task, [*ground.outer, stage])
            if self.stages is ground.outer or found.value > self.stages[-1].found.value:
                self.stages = [*ground.outer, stage]
            if self.best is None or (each.bound or 0.0) > (self.best.bound or 0.0):
                self.best = each
                yield each

    def _of_degree(self, ground: _Ground, degree: int, clock: Clock) -> Found:
        given = self.task.setting
        ansatz = ansatz_of(given, ground.region, degree, timed=ground.timed)
        ends = below(ansatz, "at the end", ends_of(given, ground.region), given.final)
        return subsolution(given, ansatz, given.running, ends, clock, self.task.enough)


def _certified(task: Task, stages: Sequence[Stage]) -> LowerBound:
    data = [stage(each.region, [e.data for e in each.exits], each.found.data) for each in stages]
    found = certificate(task.setting.problem, task.setting.lift, data)
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
        elif low is not None:
            yield f"{name} >= {float(low):.4g}"
        elif high is not None:
            yield f"{name} <= {float(high):.4g}"

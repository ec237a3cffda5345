"""A chain of a sweep walked by one worker: every point from the one before it, each judged."""

import json
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from typing import Any, final

import numpy as np

from socp.errors import SocpError
from socp.laws import independent, noted_points, spread
from socp.model import Family, Problem, Solution, Stop, from_json, rung_of, silent, to_json, view
from socp.process import one_line, one_thread, said
from socp.search import beside, spurious
from socp.study.workers import asked
from socp.verdict import judge, learn, with_second_order, with_statement

Load = Callable[[], Problem]
_HALVED = 2  # times that the way from a neighbour is halved: more steps are as long as a search
_FAILURES = (SocpError, ArithmeticError, ValueError, RuntimeError, np.linalg.LinAlgError)


@final
@dataclass(frozen=True)
class Stated:
    """A problem as source text, a statement in JSON, for workers, which read it themselves."""

    text: str

    def __call__(self) -> Problem:
        """Read the problem."""
        return Problem.from_statement(json.loads(self.text))


@final
@dataclass(frozen=True)
class Near:
    """What a point goes on from: the number of a point, its values by name, and its certified
    solution as JSON, which is the same to the last bit wherever it has been.
    """

    point: int
    values: Mapping[str, float]
    solution: str


@final
@dataclass(frozen=True)
class Job:
    """A chain to be walked: the points' numbers and values by name, what the first goes on from,
    and of which points the solutions are wanted.
    """

    number: int
    points: tuple[tuple[int, Mapping[str, float]], ...]
    near: Near | None
    wanted: frozenset[int]


@final
@dataclass(frozen=True)
class Walked:
    """What came of a chain: its rows by point, what others go on from at the wanted ones, and whole
    solutions as JSON where they are kept.
    """

    number: int
    rows: dict[int, Mapping[str, Any]]
    near: dict[int, Near | None]
    results: dict[int, str] = field(default_factory=dict)

    @property
    def data(self) -> dict[str, Any]:
        """The same in JSON's kinds, without whole solutions."""
        near = {k: None if each is None else asdict(each) for k, each in self.near.items()}
        return {"rows": {str(k): dict(row) for k, row in self.rows.items()}, "near": near}

    @classmethod
    def from_data(cls, number: int, data: Mapping[str, Any]) -> "Walked":
        """Return what `data` has written."""
        near = {int(k): None if each is None else Near(**each) for k, each in data["near"].items()}
        return cls(number, {int(k): row for k, row in data["rows"].items()}, near)


@final
@dataclass(frozen=True)
class Task:
    """A chain walked in a worker, which loads the problem itself; None where it was asked to stop.

    `load`: how a worker comes by the problem; `fingerprint`: what it has to be known by there;
    `method` and its options solve where no neighbour leads anywhere; `keep`: whole solutions are
    wanted.
    """

    load: Load
    fingerprint: str
    method: str
    options: Mapping[str, Any]
    keep: bool = False

    @one_thread()
    def __call__(self, job: Job) -> Walked | None:
        """Walk a chain."""
        family = _family(self.load, tuple(job.points[0][1]))
        if self.fingerprint and family.problem.fingerprint != self.fingerprint:
            raise SocpError(f"{family.problem.name}: a worker has another problem of this name")
        now = None if job.near is None else _Here.of(family, job.near)
        walked = Walked(job.number, {}, {}, {})
        for number, values in job.points:
            if asked():
                return None
            began = time.perf_counter()
            found, start, message = self._solved(family, values, now)
            if found is not None and found.solution.extremal and found.solution.lawful:
                now = found.at(number)
            seconds = time.perf_counter() - began
            walked.rows[number] = _row(found, start, message, seconds)
            if number in job.wanted:
                walked.near[number] = None if now is None else now.near
            if self.keep and found is not None:
                walked.results[number] = to_json(found.whole(family))
        if now is not None and noted_points(now.problem):
            _family.cache_clear()  # what one chain has learned must not depend on those before it
        return walked

    def _solved(
        self, family: Family, values: Mapping[str, float], now: "_Here | None"
    ) -> tuple["_Here | None", int, str]:
        """Return what a point comes to, from which point it went on, -1 where it was searched for,
        and what there is to say.
        """
        try:
            if now is not None:
                near = _next(family, now, values, inside=self.keep)
                if near is not None:
                    return near, now.point, ""
            # what is searched for is derived anew: replaced, it shares nothing with others
            posed = replace(family.problem.with_(dict(values)))
            guess = None if now is None else now.whole(family)
            found = view("solve")(posed, guess, self.method, watch=silent, **self.options)
            if found.stop is Stop.INTERRUPTED:
                raise KeyboardInterrupt
            here = _Here(family.at(values), values, family.outside(found))
            return here, -1, _said(here.solution)
        except _FAILURES as error:
            return None, -1, one_line(f"{type(error).__name__}: {said(error)}")


@final
@dataclass(frozen=True, eq=False)
class _Here:
    """A point that was solved: its problem as one of its family, values and solution."""

    problem: Problem
    values: Mapping[str, float]
    solution: Solution
    point: int = -1

    @classmethod
    def of(cls, family: Family, near: Near) -> "_Here":
        """Return what another chain has left."""
        return cls(family.at(near.values), near.values, from_json(near.solution), near.point)

    def at(self, number: int) -> "_Here":
        """Return the same as the point of a number."""
        return _Here(self.problem, self.values, self.solution, number)

    def whole(self, family: Family) -> Solution:
        """Return the solution with the statement of its problem."""
        return with_statement(family.problem.with_(dict(self.values)), self.solution)

    @property
    def near(self) -> Near:
        """What other chains need of it."""
        return Near(self.point, self.values, to_json(self.solution))


def _next(family: Family, now: _Here, values: Mapping[str, float], *, inside: bool) -> _Here | None:
    """Return a certified solution as it follows from that of a neighbour, by way of points between
    the two where it is too far away; None where the neighbour does not lead there. `inside`: what
    is kept whole is looked at whole, which no rung depends on.
    """
    here = replace(now, solution=family.inside(now.solution, now.problem))
    found = _reached(family, here, values, _HALVED)
    if found is None:
        return None
    solution = with_second_order(found.problem, found.solution, inside=inside)
    return replace(found, solution=family.outside(solution))


def _reached(family: Family, now: _Here, values: Mapping[str, float], halved: int) -> _Here | None:
    """Return a certified solution that follows from a neighbour's, both of the family, the way to
    it halved up to so many times; None where there is none.
    """
    found = _beside(family, now, values)
    if found is not None or not halved:
        return found
    middle = {name: (now.values[name] + value) / 2.0 for name, value in values.items()}
    with suppress(*_FAILURES):  # between two problems there need not be one
        half = _reached(family, now, middle, halved - 1)
        return None if half is None else _reached(family, half, values, halved - 1)
    return None


def _beside(family: Family, now: _Here, values: Mapping[str, float]) -> _Here | None:
    """Return a certified solution next to that of a neighbour, by Newton along its word, or one
    next to that; None where none of these holds, or an arc is no longer than what is known of its
    ends.
    """
    problem = family.at(values)
    posed = independent(problem)
    learn(posed, now.solution)
    found = beside(posed, now.solution, now.problem)
    if found is None or spurious(found):
        return None
    if posed is not problem:
        found = judge(problem, found)
    return _Here(problem, values, found) if found.extremal else None


def _said(solution: Solution) -> str:
    """Return why a solution is not certified, empty where it is."""
    if solution.extremal:
        return ""
    reasons = solution.verdict.reasons if solution.verdict else ()
    return one_line("; ".join(reasons) or solution.message or solution.stop.value)


def _row(found: _Here | None, start: int, message: str, seconds: float) -> dict[str, Any]:
    """Return what the table says of a point besides its values."""
    if found is None:
        return nothing(message, seconds)
    solution = found.solution
    return {
        "rung": rung_of(solution).value if solution.verdict else "",
        "objective": _finite(solution.told),
        "final_time": _finite(solution.final_time),
        "word": solution.word,
        "switches": [float(t) for t in solution.junctions],
        "start": start if start >= 0 else None,
        "seconds": seconds,
        "message": message,
    }


def nothing(message: str, seconds: float | None = None) -> dict[str, Any]:
    """Return what the table says of a point that has no solution."""
    empty: dict[str, Any] = {
        "rung": "",
        "objective": None,
        "final_time": None,
        "word": "",
        "switches": [],
    }
    return {**empty, "start": None, "seconds": seconds, "message": message}


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


@lru_cache(maxsize=1)  # a worker walks chains of one sweep: laws and functions are those of all
def _family(load: Load, names: tuple[str, ...]) -> Family:
    family = Family(load(), names)
    spread(family.base)  # laws are looked for from points of this one, whichever chain comes first
    return family

"""Sweeps: one problem solved at many points, neighbours from neighbours, over any workers."""

import hashlib
import json
from collections import deque
from collections.abc import Generator, Iterator, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, final

import numpy as np

from socp.errors import MethodError, ProblemError, SolveError
from socp.methods import versions
from socp.model import Problem, Progress, Watch, silent, view
from socp.process import breakable, give_way, heard, signals_held, write_atomic
from socp.study.numbers import numbers_of
from socp.study.store import Drawer, fingerprint
from socp.study.sweeping.chain import Job, Load, Near, Stated, Task, Walked, nothing
from socp.study.sweeping.engine import engine
from socp.study.sweeping.plan import Chain, planned
from socp.study.sweeping.points import Points, points
from socp.study.workers import results_of

_RECIPE = 2  # of chains: kept ones of another recipe are worth nothing
# of the table, besides the numbers; a final time that is given is the one that there is
_COLUMNS = {"fingerprint", *nothing("")} - {"final_time"}


@final
@dataclass(frozen=True, eq=False)
class Sweep:
    """What came of a sweep: its rows in the order of the points; those not reached are left out.

    A row holds `fingerprint`, of the problem that is swept, the values of the numbers `names`, and
    rung of the ladder, objective, final time, word, switching times, `start`, the number of the row
    that it went on from, None where it was searched for, seconds and message, which says why a
    point has no certified solution. `unkept` says why finished points could not be kept.
    """

    problem: str
    names: tuple[str, ...]
    rows: tuple[Mapping[str, Any], ...]
    wanted: int
    interrupted: bool = False
    unkept: str = ""

    @property
    def certified(self) -> int:
        """How many points are certified."""
        return sum(not row["message"] for row in self.rows)

    def to_xarray(self) -> Any:
        """Return the rows as an xarray.Dataset over the numbers, where they are on a grid, else
        over the points; MethodError where xarray is not installed.
        """
        facts = {"names": list(self.names), "problem": self.problem, "wanted": self.wanted}
        return view("sweep")(self.rows, facts)


@final
@dataclass(frozen=True)
class Kept:
    """Folders: of finished chains, which are taken up again, and of whole solutions, one file a
    point; None for neither.
    """

    chains: Path | None = None
    results: Path | None = None


NOT_KEPT = Kept()


@final
@dataclass(eq=False)
class _Tally:
    """The chains walked so far, by their rows."""

    points: Points
    chains: tuple[Chain, ...]
    watch: Watch
    rows: dict[int, Mapping[str, Any]] = field(default_factory=dict)
    certified: int = 0
    unkept: str = ""

    @cached_property
    def after(self) -> dict[int, list[Chain]]:
        """The chains that go on from points of a chain, by its number, -1 for none."""
        homes = {k: chain.number for chain in self.chains for k in chain.points} | {-1: -1}
        found: dict[int, list[Chain]] = {}
        for chain in self.chains:
            found.setdefault(homes[chain.start], []).append(chain)
        return found

    @cached_property
    def starts(self) -> frozenset[int]:
        """The points from which chains go on."""
        return frozenset(chain.start for chain in self.chains)

    def add(self, walked: Walked) -> Iterator[Job]:
        """Count a chain; yields those that may go on from it, unless they are walked as well."""
        self.rows |= walked.rows
        self.certified += sum(not row["message"] for row in walked.rows.values())
        for chain in self.after.get(walked.number, ()):
            if chain.points[0] not in self.rows:
                yield self.job(chain, walked.near.get(chain.start))

    def job(self, chain: Chain, near: Near | None) -> Job:
        """Return a chain as it is handed to a worker."""
        points = tuple((k, self.points.named(k)) for k in chain.points)
        return Job(chain.number, points, near, self.starts & frozenset(chain.points))

    def tell(self) -> bool:
        """Tell the watch how far it is; returns whether that asks to stop."""
        done = len(self.rows)
        told = f"{done} of {len(self.points)} points, {self.certified} certified"
        last = next((row["objective"] for row in reversed(self.rows.values())), None)
        value = float("nan") if last is None else last
        return self.watch(Progress(told, done, value, float("nan")))


def sweep(
    problem: Problem | Load,
    numbers: Points | Mapping[str, Any],
    *,
    workers: int | str | Executor = 1,
    kept: Kept = NOT_KEPT,
    method: str = "auto",
    watch: Watch = silent,
    **options: Any,
) -> Sweep:
    """Solve a problem at many points and return a row for each; neighbours start from neighbours,
    and every result is judged.

    `numbers`: what `points` returns, or is given: by the names that `Problem.with_` knows, values
    (n,) or texts `lo:hi:n`, whose combinations are taken. `problem` travels to workers as data; a
    function in its place is called there, and loads it. `workers`: a number of processes, 1 for
    this one; any `concurrent.futures.Executor`, or a client of dask; the address of a dask
    scheduler, or `local` for one of its own on this machine. `kept`: the folders where finished
    pieces are kept, and taken up again, and where every whole result is written. `method` with
    `options` solves where no neighbour leads to a certified solution. Ctrl-C, or a true answer of
    the watch, ends it with the rows so far.

    Raises MethodError for anything else, ProblemError for a name that there is not, or a value at
    the first point that leaves no problem. What fails later is a row with a message.
    """
    found = numbers if isinstance(numbers, Points) else points(numbers)
    load, base = _posed(problem)
    for name in found.names:
        if name in _COLUMNS:
            raise MethodError(f"'{name}': the table has a column of this name; rename the number")
    base.with_(found.named(0))
    tally = _Tally(found, planned(found.values, _near(base, found)), watch)
    task = Task(load, _fingerprint(base), method, options, keep=kept.results is not None)
    drawer = Drawer(kept.chains, _key(base, task, found), "chain") if kept.chains else None
    with engine(workers) as hands:
        stopped = _run(task, tally, (drawer, kept.results), hands.workers)
    rows = tuple(
        {"fingerprint": task.fingerprint, **_filled(tally.rows[k]), **found.named(k)}
        for k in sorted(tally.rows)
    )
    return Sweep(base.name, found.names, rows, len(found), stopped, tally.unkept)


def _filled(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row with a number in every column of numbers: nan where there is none, and -1 for no
    start.
    """
    missing = {"start": -1, **dict.fromkeys(("objective", "final_time", "seconds"), float("nan"))}
    return {name: missing.get(name) if each is None else each for name, each in row.items()}


def travels(problem: Problem) -> bool:
    """Tell whether a problem can be written as data, with the constants that it has."""
    try:
        statement = problem.statement
    except ProblemError:
        return False
    return problem.formula is None or "formula" in statement


def _posed(problem: Problem | Load) -> tuple[Load, Problem]:
    """Return how workers come by a problem, and the problem as they see it; MethodError where it
    cannot travel.
    """
    if not isinstance(problem, Problem):
        return problem, problem()
    if not travels(problem):
        raise MethodError(
            f"problem '{problem.name}' cannot be written as data; give its file or its name instead"
        )
    stated = Stated(json.dumps(dict(problem.statement)))
    return stated, stated()


def _near(problem: Problem, points: Points) -> np.ndarray:
    """Return the numbers (d,) that a problem has itself, the middle of the points where it has
    none.
    """
    fixed = numbers_of(problem)
    middle = np.median(points.values, axis=0)
    return np.array([fixed.get(n, m) for n, m in zip(points.names, middle, strict=True)])


def _fingerprint(problem: Problem) -> str:
    """Return what a problem is known by, nothing where it cannot be written as data."""
    try:
        return problem.fingerprint
    except ProblemError:
        return ""


def _key(problem: Problem, task: Task, points: Points) -> str:
    """Return a hash of all that rows depend on."""
    how = task.method, task.keep, sorted(task.options.items()), sorted(versions().items())
    values = hashlib.sha256(np.ascontiguousarray(points.values).tobytes()).hexdigest()
    return fingerprint(problem, repr((_RECIPE, how, points.names, values)))


def _run(
    task: Task, tally: _Tally, kept: tuple[Drawer | None, Path | None], workers: int | Executor
) -> bool:
    """Walk all chains; returns whether that was stopped."""
    drawer = kept[0]
    waiting = deque(tally.job(chain, None) for chain in tally.after[-1])
    for number, document in drawer.documents() if drawer else ():
        waiting += tally.add(Walked.from_data(number, document))
    waiting = deque(job for job in waiting if job.points[0][0] not in tally.rows)
    hands = min(workers, len(tally.chains)) if isinstance(workers, int) else workers
    running = _here(task, waiting) if hands == 1 else results_of(task, waiting, hands)
    with signals_held():  # what is finished is counted and kept whole
        try:
            with breakable():
                return _counted(running, tally, kept, waiting)
        except BaseException as error:
            # what Ctrl-C breaks off inside other code may fail in another way
            if not isinstance(error, KeyboardInterrupt) and not heard():
                raise
            return True
        finally:
            running.close()


def _counted(
    running: Generator[tuple[Job, Walked | None], None, None],
    tally: _Tally,
    kept: tuple[Drawer | None, Path | None],
    waiting: deque[Job],
) -> bool:
    """Count and keep chains as they are walked, and hand on those that go on from them; returns
    whether that was stopped.
    """
    for job, walked in running:
        with signals_held():
            if walked is not None:
                try:
                    _keep(walked, *kept)
                except SolveError as error:  # it counts all the same
                    tally.unkept = tally.unkept or str(error)
            waiting += tally.add(walked or _lost(job))
            stopped = tally.tell()
        if stopped:
            return True
        give_way()
    return False


def _keep(walked: Walked, drawer: Drawer | None, results: Path | None) -> None:
    """Keep whole solutions, then the chain: one that is there is there with its solutions."""
    if results is not None:
        results.mkdir(parents=True, exist_ok=True)
        for number, text in walked.results.items():
            write_atomic(results / f"point-{number:06d}.socp.json", text)
    if drawer is not None:
        drawer.write(walked.number, walked.data)


def _here(task: Task, waiting: deque[Job]) -> Generator[tuple[Job, Walked | None], None, None]:
    """Walk chains in this process."""
    while waiting:
        job = waiting.popleft()
        yield job, task(job)


def _lost(job: Job) -> Walked:
    """Return what there is to say of a chain whose worker died: others go on from before it."""
    rows: dict[int, Mapping[str, Any]] = {k: nothing("its worker died") for k, _ in job.points}
    return Walked(job.number, rows, dict.fromkeys(job.wanted, job.near))

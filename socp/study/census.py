"""Census of extremals: independent starts, each refined to a certified word, clustered by objective
and word.
"""

import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from typing import final

import numpy as np

from socp.errors import MethodError, SolveError
from socp.laws import independent
from socp.methods import solve_collocated, versions
from socp.model import COMPARED, Problem, Progress, Solution, Stop, Watch, silent
from socp.process import breakable, give_way, heard, signals_held
from socp.search import Ration, Search, refine
from socp.solvers import default_backend
from socp.study.clusters import Census, Outcome, residual
from socp.study.starts import RECIPE, start
from socp.study.store import Store
from socp.study.workers import asked, loaded, results_of
from socp.transcription import Mesh, euler, single_phase, uniform
from socp.verdict import judge

_TOLERANCE, _ITERATIONS = 1e-7, 500  # words are read off direct solutions, not digits
# steps of implicit Euler, from which a word is read; words tried then; the work on them, iterations
# times variables
_FINER = ((200, 4, 1.5e5), (800, 6, 5e5), (2500, 3, 1e6))


def recipe() -> str:
    """Return what the outcome of a start depends on besides the problem."""
    return repr((RECIPE, _FINER, sorted(versions().items())))


def explore(problem: Problem, number: int, watch: Watch = silent) -> Outcome:
    """Follow one start: a direct solve, finer ones from it, and the words read off these, until one
    is certified.

    Raises KeyboardInterrupt where the solve was interrupted.
    """
    began, here = time.perf_counter(), start(problem, number)
    try:
        found, error = _explored(independent(problem), here.guess, here.mesh, watch)
    except (SolveError, MethodError, ArithmeticError, ValueError, np.linalg.LinAlgError) as reason:
        found, error = None, f"{type(reason).__name__}: {reason}"
    if found is not None:
        if independent(problem) is not problem:
            found = judge(problem, found)
        found = found.with_origin(method="census")
        found = found.with_effort(seconds={"start": time.perf_counter() - began})
    return Outcome(number, here.about, found, error)


def _explored(
    problem: Problem, guess: Solution, mesh: Mesh, watch: Watch
) -> tuple[Solution | None, str]:
    direct = _solved(problem, guess, mesh, watch)
    if not direct.stop.ok:
        return None, direct.message
    best: Solution | None = None
    for steps, words, work in _FINER:
        finer = _solved(problem, direct, uniform(euler(), steps), watch)
        if not finer.stop.ok:
            continue
        direct = finer
        search = Search(backend=Ration(work))
        found = refine(problem, direct, search, watch, words)
        if found is None:
            continue
        _go_on(found)
        found = found.with_effort(nodes=tuple(search.nodes))
        if found.extremal:
            return found, ""
        if (
            found.verdict
            and found.verdict.miss <= COMPARED
            and (best is None or residual(found) < residual(best))
        ):
            best = found
    return (best or judge(problem, direct)), ""


def _solved(problem: Problem, guess: Solution, mesh: Mesh, watch: Watch) -> Solution:
    backend = default_backend().within(_TOLERANCE).limited(_ITERATIONS)
    found = solve_collocated(single_phase(problem), [mesh], backend, guess, watch)
    _go_on(found)
    return found


def _go_on(solution: Solution) -> None:
    if solution.stop is Stop.INTERRUPTED:
        raise KeyboardInterrupt


@final
@dataclass(frozen=True)
class Task:
    """A start followed in a worker process, which loads the problem itself; None where it was asked
    to stop.
    """

    load: Callable[[], Problem]

    def __call__(self, number: int) -> Outcome | None:
        """Follow a start."""
        try:
            return explore(loaded(self.load), number, asked)
        except KeyboardInterrupt:
            return None


@final
@dataclass(eq=False)
class Tally:
    """The starts finished so far, and what a watch is told of them."""

    wanted: int
    watch: Watch
    outcomes: dict[int, Outcome] = field(default_factory=dict)
    died: list[int] = field(default_factory=list)
    best: Solution | None = None
    unkept: str = ""

    def add(self, number: int, outcome: Outcome | None) -> bool:
        """Count a start, None where its worker died; returns whether the watch asks to stop."""
        if outcome is None:
            self.died.append(number)
            return False
        self.outcomes[number] = outcome
        self.best = self.census().best
        value = outcome.solution.objective if outcome.solution else float("nan")
        return self.watch is not silent and self.see(
            Progress("", len(self.outcomes), value, float("nan"))
        )

    def keep(self, store: Store, outcome: Outcome) -> None:
        """Keep a start on the disk; one that cannot be kept counts all the same."""
        try:
            store.write(outcome)
        except SolveError as error:
            self.unkept = self.unkept or str(error)

    def see(self, now: Progress, /) -> bool:
        """Tell the watch how many starts are finished, and the best of them, with what a solver
        says.
        """
        told = f"{len(self.outcomes)} of {self.wanted} starts" + (
            f", {now.stage}" if now.stage else ""
        )
        if self.best is None:
            return self.watch(replace(now, stage=told))
        word = now.word or self.best.word
        best, violation = self.best.objective, residual(self.best)
        return self.watch(replace(now, stage=told, word=word, best=best, violation=violation))

    def census(self, *, interrupted: bool = False) -> Census:
        """Return the census so far."""
        ordered = tuple(self.outcomes[number] for number in sorted(self.outcomes))
        return Census(self.wanted, ordered, tuple(self.died), interrupted, self.unkept)


def survey(
    problem: Problem,
    starts: int,
    store: Store | None = None,
    watch: Watch = silent,
    workers: tuple[int | Executor, Callable[[], Problem]] | None = None,
) -> Census:
    """Return the census of so many starts; those kept already are not followed again, new ones are
    kept.

    workers: number of processes, or an executor, and how each of its workers loads the problem;
    none means this process.
    Ctrl-C, or a true answer of the watch, ends it with the starts finished so far.
    """
    tally = Tally(starts, watch)
    for number, outcome in (store.read() if store else {}).items():
        if number < starts:
            tally.add(number, outcome)
    todo = [number for number in range(starts) if number not in tally.outcomes]
    running = _running(problem, todo, silent if watch is silent else tally.see, workers)
    with signals_held():  # what is finished is counted and kept whole
        try:
            with breakable():
                stopped = _counted(running, tally, store)
        except BaseException as error:
            # what Ctrl-C breaks off inside other code may fail in another way
            if not isinstance(error, KeyboardInterrupt) and not heard():
                raise
            stopped = True
        finally:
            running.close()
    return tally.census(interrupted=stopped)


def _counted(
    running: Iterator[tuple[int, Outcome | None]], tally: Tally, store: Store | None
) -> bool:
    """Count and keep starts as they are finished; returns whether that was stopped."""
    for number, outcome in running:
        with signals_held():
            if store is not None and outcome is not None:
                tally.keep(store, outcome)
            stopped = tally.add(number, outcome)
        if stopped:
            return True
        give_way()
    return False


def _running(
    problem: Problem,
    todo: Sequence[int],
    watch: Watch,
    workers: tuple[int | Executor, Callable[[], Problem]] | None,
) -> Generator[tuple[int, Outcome | None]]:
    """Yield (number, outcome) of every start, None where its worker died."""
    if workers is None or workers[0] == 1:
        yield from ((number, explore(problem, number, watch)) for number in todo)
        return
    yield from results_of(Task(workers[1]), deque(todo), workers[0])

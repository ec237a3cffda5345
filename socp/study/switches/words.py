"""Words solved along their own laws: here, or in workers that load the problem themselves."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from typing import final

from socp.errors import MethodError, SolveError
from socp.methods import Follower, kept_in_box, sound
from socp.model import COMPARED, Problem, Solution, Stop, Watch, Word
from socp.search import Candidate, along_words
from socp.solvers import Backend
from socp.study.workers import asked, loaded, results_of
from socp.verdict import certified

Hands = tuple[Executor, Callable[[], Problem]]


def solved_word(
    problem: Problem,
    given: Candidate,
    dwell: float,
    backend: Backend,
    watch: Watch,
    level: float = float("inf"),
) -> Solution | None:
    """Return the judged solution along a word, its arcs `dwell` long at least; None where there is
    none that meets the problem's conditions. One that was interrupted or whose objective is not
    below a level comes back unjudged.
    """
    word = Word(problem.control_names, given.arcs)
    follower = Follower(dwell=dwell, longer=False, backend=backend)
    try:
        found = kept_in_box(
            problem,
            lambda boxed: replace(follower, boxed=boxed)(problem, word, given.guess(), watch),
        )
    except (MethodError, SolveError):
        return None
    if found.stop is Stop.INTERRUPTED:
        return found
    if not found.stop.ok or not sound(problem, found):
        return None
    return judged_word(problem, found) if found.objective < level else found


def judged_word(problem: Problem, solution: Solution) -> Solution | None:
    """Return a solution with its verdict; None where it does not meet the problem's conditions."""
    judged = solution if solution.verdict is not None else certified(problem, solution)
    return judged if judged.verdict is not None and judged.verdict.miss <= COMPARED else None


@final
@dataclass(frozen=True)
class WordTask:
    """A word, by its place among others, solved in a worker."""

    load: Callable[[], Problem]
    dwell: float

    def __call__(self, job: tuple[int, Candidate]) -> tuple[Solution | None]:
        """Solve a word."""
        return (solved_word(loaded(self.load), job[1], self.dwell, along_words(), asked),)


def solved_words(
    given: Sequence[Candidate], dwell: float, hands: Hands
) -> Iterator[tuple[int, tuple[Solution | None] | None]]:
    """Yield the places of words with what workers make of them, as it comes; None: its worker
    died.
    """
    executor, load = hands
    jobs = deque(enumerate(given))
    for (place, _), found in results_of(WordTask(load, dwell), jobs, executor):
        yield place, found

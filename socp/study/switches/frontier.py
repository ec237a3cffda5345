"""The best objective for every number of switches."""

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import groupby
from typing import final

import numpy as np

from socp.errors import MethodError
from socp.laws import arc_modes
from socp.methods import guess_along
from socp.model import (
    APPROXIMATE,
    SHORTEST,
    Modes,
    Problem,
    Progress,
    Solution,
    Stop,
    Watch,
    Word,
    search_watch,
    silent,
)
from socp.process import breakable, seconds_left
from socp.search import (
    Candidate,
    all_words,
    along_words,
    arc_insertions,
    arc_removals,
    mends,
    mode_changes,
    read,
    shortened,
    without_arc,
    word_count,
    word_of,
)
from socp.solvers import Backend
from socp.study.switches.tendency import summary
from socp.study.switches.words import Hands, judged_word, solved_word, solved_words
from socp.verdict import chattering, graded

_ALL = 200  # words up to which every one of them is solved
_MOST = 240  # words solved at most where they are too many for that
_WIDTH = 2  # words of every number of switches from which others are made
_PASSES = 3  # down and up through the numbers of switches
# Of the objective's terms: at two ends that chatter two more digits take as many words as all those
# before, and four digits tell one solution from another
_SETTLED = 1e-4
_BETTER = 1e-9  # relative: a smaller gain is rounding, and a word with fewer switches does as well


@final
@dataclass(frozen=True, eq=False)
class Frontier:
    """The best solution with at most so many switches, for each number; None where no word that was
    tried is feasible.

    `rows[n]` is judged; `words` counts those solved; `every` tells whether these were all words of
    at most so many switches.
    """

    rows: tuple[Solution | None, ...]
    words: int
    every: bool
    interrupted: bool = False

    @property
    def best(self) -> Solution | None:
        """The solution of the best objective."""
        return self.rows[-1]


@final
@dataclass(eq=False)
class _Trials:
    """The words solved so far, the best ones of every number of switches, and how to solve
    another; where controls are known to be `chattering`, only where they do more arcs are tried,
    and fewer only where nothing is known of so few.
    """

    problem: Problem
    most: int
    dwell: float
    backend: Backend
    watch: Watch
    width: int = _WIDTH
    chattering: frozenset[str] = frozenset()
    hands: Hands | None = None
    found: list[list[Solution]] = field(init=False)
    tried: set[str] = field(default_factory=set)
    words: int = 0
    interrupted: bool = False

    def __post_init__(self) -> None:
        self.found = [[] for _ in range(self.most + 1)]

    def allow(self, most: int) -> None:
        """Allow more switches, and as many words again."""
        self.found += [[] for _ in range(most - self.most)]
        self.most, self.words = most, 0

    def _new(self, given: Candidate) -> bool:
        """Tell whether a word is to be solved: it is new, and has few enough switches."""
        count = len(given.arcs) - 1
        over = self.interrupted or seconds_left() <= 0.0 or self.words >= max(_MOST, _ALL)
        if over or not 0 <= count <= self.most or given.key in self.tried:
            return False
        self.tried.add(given.key)
        self.words += 1
        return True

    def solve(self, given: Candidate) -> bool:
        """Solve a word that is new and has few enough switches; returns whether it did better than
        those before.
        """
        if not self._new(given):
            return False
        word = str(Word(self.problem.control_names, given.arcs))
        watch = search_watch(self.watch, f"word {self.words}", word, self.best(self.most))
        level = self._level(len(given.arcs))
        found = solved_word(self.problem, given, self.dwell, self.backend, watch, level)
        return self._kept(found)

    def _level(self, arcs: int) -> float:
        """Return the objective that a solution of so many arcs has to be less than to be kept."""
        row = self.found[arcs - 1]
        return row[-1].objective if len(row) == self.width else float("inf")

    def all(self, given: Iterable[Candidate]) -> bool:
        """Solve words; returns whether any did better than those before."""
        if self.hands is None:  # all of them, whichever is better
            return any([self.solve(each) for each in given])  # noqa: C419
        new = [each for each in given if self._new(each)]
        found = dict[int, Solution | None]()
        with suppress(BrokenExecutor):  # its workers are gone: what is left is solved here
            for place, answer in solved_words(new, self.dwell, self.hands):
                found |= {} if answer is None else {place: answer[0]}
                self.interrupted |= self.tell(len(new) - len(found))
                if self.interrupted:
                    break
        if len(found) < len(new) and not self.interrupted:
            self.hands = None
            for k in sorted({*range(len(new))} - set(found)):
                found[k] = solved_word(self.problem, new[k], self.dwell, self.backend, self.watch)
        # in the order of the words, however fast the workers were
        return any([self._kept(found[k]) for k in sorted(found)])  # noqa: C419

    def tell(self, left: int) -> bool:
        """Tell the watch how far workers are; returns whether that asks to stop."""
        best = self.best(self.most)
        value, word = (float("nan"), "") if best is None else (best.objective, best.word)
        stage = f"word {self.words - left} of {self.words}"
        return self.watch(Progress(stage, self.words, value, float("nan"), word, value))

    def _kept(self, solution: Solution | None) -> bool:
        """Keep a solution among the best of its number of switches, without arcs that have
        vanished. One that is no better than those is not judged.
        """
        if solution is None or solution.stop is Stop.INTERRUPTED:
            self.interrupted |= solution is not None
            return False
        row = self.found[len(solution.arcs) - 1]
        behind = not solution.objective < self._level(len(solution.arcs))
        judged = solution if behind else judged_word(self.problem, solution)
        if judged is None:
            return False
        lean = shortened(word_of(solution), SHORTEST)
        if self.dwell == 0.0 and len(lean.arcs) < len(solution.arcs):
            self.solve(lean)
        if behind:
            return False
        better = not row or solution.objective < row[0].objective
        row[:] = sorted([*row, judged], key=lambda each: each.objective)[: self.width]
        return better

    def insertions(self, now: Candidate, modes: Sequence[Modes]) -> Iterator[Candidate]:
        """Yield words with one arc more; where controls chatter only those next to their singular
        arcs, and at the ends, where the first sign is settled.
        """
        places = [k for k, c in enumerate(self.problem.control_names) if c in self.chattering]
        near = {each for each in now.arcs if any(each[k].kind == "singular" for k in places)}
        return arc_insertions(now, modes, near if places else None)

    def best(self, switches: int) -> Solution | None:
        """Return the best solution with at most so many switches, that with the fewest where others
        do no better.
        """
        best: Solution | None = None
        for row in self.found[: switches + 1]:
            if row and (
                best is None or row[0].objective < best.objective - _BETTER * abs(best.objective)
            ):
                best = row[0]
        return best


def best_by_switches(
    problem: Problem,
    most: int,
    start: Solution,
    dwell: float = 0.0,
    watch: Watch = silent,
    workers: Hands | None = None,
) -> Frontier:
    """Return the best objective for every number of switches up to the most.

    A switch is a time at which any control changes its mode; `dwell` is the least time between two
    of them, and from the ends of the horizon to the nearest. Where there are few enough words, each
    is solved; otherwise those that come of the start's word, and of the best ones found, by leaving
    arcs out and by putting others in. `workers`: an executor, and how each of its workers loads the
    problem; words that do not ask one another are solved side by side then. Raises MethodError
    for a number or a time out of range.
    """
    if most < 0 or not dwell >= 0.0:
        raise MethodError(
            f"frontier: at most {most} switches, dwell {dwell:g}: both must be at least 0"
        )
    modes = arc_modes(problem)
    every = word_count(len(modes), most) <= _ALL
    return _frontier(
        _Trials(problem, most, dwell, along_words(), watch, hands=workers),
        modes,
        start,
        every=every,
    )


def _frontier(
    trials: "_Trials", modes: Sequence[Modes], start: Solution, *, every: bool
) -> Frontier:
    try:
        with breakable():
            (_everything if every else _beam)(trials, modes, start)
    except KeyboardInterrupt:  # between two solves; inside one the backend stops by itself
        trials.interrupted = True
    rows = tuple(trials.best(n) for n in range(trials.most + 1))
    return Frontier(rows, trials.words, every and not trials.interrupted, trials.interrupted)


def distinct_rows(frontier: Frontier) -> list[Solution]:
    """Return the rows of a frontier that are better than the ones before."""
    rows = [row for row in frontier.rows if row is not None]
    return [row for k, row in enumerate(rows) if k == 0 or row is not rows[k - 1]]


def limit_switches(
    problem: Problem,
    solution: Solution,
    at_most: int,
    watch: Watch = silent,
    backend: Backend | None = None,
) -> Solution:
    """Return the best word of at most so many switches where a solution chatters, or of as many for
    each end of a singular arc where that is not enough, with the frontier in its message.

    Any other solution comes back as it is, as does one of so few switches that no such word is
    better than, and one along a word that chatters at both ends of such an arc with so few switches
    for each that more digits of the objective would cost more words than they are worth.
    """
    if (
        at_most < 1
        or seconds_left() <= 0.0
        or solution.extremal
        or not solution.stop.ok
        or not solution.structure
    ):
        return solution
    names = chattering(problem, solution)
    ends = max((_ends(solution, each) for each in names), default=0)
    if not ends:
        return solution
    few = ends > 1 and solution.lawful and len(solution.switches) <= ends * at_most
    if few and _near(problem, solution, _SETTLED):
        return solution
    where = frozenset(names)  # elsewhere its word is settled
    trials = _Trials(problem, at_most, 0.0, along_words(backend), watch, width=1, chattering=where)
    seen = _frontier(trials, arc_modes(problem), solution, every=False)
    # the direct solution may ring at an end where the best word does not
    first = seen.best or solution
    ends = max(_ends(first, each) for each in names)
    if ends > 1 and not seen.interrupted and not _near(problem, seen.best):
        trials.allow(ends * at_most)
        seen = _frontier(trials, arc_modes(problem), first, every=False)
        at_most = trials.most
    rows = distinct_rows(seen)
    if seen.interrupted:
        return replace(solution, stop=Stop.INTERRUPTED)
    worse = bool(rows) and rows[-1].objective > solution.objective + _BETTER * abs(
        solution.objective
    )
    if not rows or (worse and len(solution.switches) <= at_most):
        return solution
    return replace(rows[-1].after(solution), message=f"{solution.message}; {summary(rows)}")


def _near(problem: Problem, best: Solution | None, share: float = APPROXIMATE) -> bool:
    """Tell whether a certified or feasible word is approximately extremal, the error of its
    objective a share of its terms at most.
    """
    judged = None if best is None else graded(problem, best).verdict
    if judged is None or judged.grade is None:
        return False
    return judged.approximate and judged.grade.error <= share * judged.grade.size


def _ends(solution: Solution, control: str) -> int:
    """Return how many ends of its longest singular arc a control that chatters may do so at: those
    inside the horizon, 1 or 2; none where it has no such arc.
    """
    row = solution.structure[control]
    spans = {k: end - start for k, (mode, start, end) in enumerate(row) if mode == "s"}
    if not spans:
        return 0
    longest = max(spans, key=lambda k: spans[k])
    return (longest > 0) + (longest < len(row) - 1)


def _everything(trials: _Trials, modes: Sequence[Modes], start: Solution) -> None:
    """Solve every word, shorter ones first."""
    for _, words in groupby(all_words(modes, trials.most), key=len):
        trials.all(_cut(trials, start, arcs) for arcs in words)


def _cut(trials: _Trials, start: Solution, arcs: tuple[Modes, ...]) -> Candidate:
    """Return a word with lengths from the best solution with no more switches."""
    word = Word(trials.problem.control_names, arcs)
    source = trials.best(len(arcs) - 1) or start
    cut = Candidate.of(guess_along(trials.problem, source, word), arcs)
    return replace(cut, source=source)


def _beam(trials: _Trials, modes: Sequence[Modes], start: Solution) -> None:
    """Solve the words that come of the start's, and of the best found, until none of them does
    better.
    """
    own = start.lawful
    seed = word_of(start) if own else read(trials.problem, start)
    for mode in modes:
        trials.solve(Candidate((mode,), (seed.edges[0], seed.edges[-1]), seed.source))
    trials.solve(seed)
    _shortened(trials, seed)
    for _ in range(_PASSES):
        better = False
        for n in range(trials.most, 0, -1):
            for solution in list(trials.found[n]):
                if trials.chattering and trials.found[n - 1]:
                    continue
                fewer = list(arc_removals(word_of(solution)))
                better |= trials.all(fewer)
                if not any(trials.found[:n]):
                    better |= trials.all(
                        each for word in fewer for each in mode_changes(word, modes)
                    )
        for n in range(trials.most):
            for solution in list(trials.found[n]):
                now = word_of(solution)
                longer = [*mends(trials.problem, now, solution), *trials.insertions(now, modes)]
                better |= trials.all(longer)
        if not better:
            break


def _shortened(trials: _Trials, seed: Candidate) -> None:
    """Solve the words that a seed with too many switches comes to when its shortest arcs go
    first.
    """
    while len(seed.arcs) > 1:
        lengths = np.diff(seed.edges)
        seed = without_arc(seed, int(np.argmin(lengths)))
        trials.solve(seed)

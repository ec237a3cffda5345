"""A search over words: what it has tried, the best it has found, and the work that it may do."""

import math
from dataclasses import dataclass, field, replace
from typing import final

from socp.errors import SolveError
from socp.methods import Scouted
from socp.model import (
    APPROXIMATE,
    EXTREMAL,
    FEASIBLE,
    Node,
    Solution,
    Stop,
    Watch,
    search_watch,
    silent,
)
from socp.process import seconds_left
from socp.search.candidate import Candidate
from socp.solvers import NLP, Backend, NLPPoint, default_backend

_WORDS = 80  # words tried in the first round
# Iterations times variables in the first round: some ten seconds, and the same words at any speed
_WORK = 1e6
_SETUP = 10  # iterations that building a programme is worth
# Relative: objectives of one word that differ by less are the same solution of it
_BETTER = 1e-7
ALIKE = 1e-3  # relative: objectives of one solution on two grids differ by as much
# Of the objective: a coarse grid that claims so much less than the best solution is worth a closer
# look
FAR = 0.05
# Times how far a re-integration is off: what that may be worth in the objective, relative as well
_WORTH = 3.0
FINEST = 16  # times the steps of the first grids: those of the last round's
_TOLERANCE = 1e-11  # along words: what is certified should not be off by the solver's tolerance
_ITERATIONS = 300  # a right word takes tens; a wrong one should not take thousands


def along_words(
    backend: Backend | None = None, iterations: int = _ITERATIONS, *, near: bool = False
) -> Backend:
    """Return a backend, or the default one, as it solves along the words of a search.

    near: for guesses near the solution, as what a right word is read off or mended from is: a large
    barrier would lead away from it, and where laws are stiff not back again.
    """
    found = (backend or default_backend()).within(_TOLERANCE).limited(iterations)
    return found.nearby() if near else found


@final
@dataclass(eq=False)
class Ration:
    """A backend that stops when the work allowed in all, iterations times variables, is done.

    `given`: programmes it was given; `refusals`: why some of them could not be solved at all, in
    their errors' words.
    """

    left: float = _WORK
    backend: Backend = field(default_factory=lambda: along_words(near=True))
    given: int = 0
    refusals: list[str] = field(default_factory=list)

    def __call__(self, nlp: NLP, guess: NLPPoint, watch: Watch = silent) -> NLPPoint:
        """Solve with as many iterations as are left; without any the point is the guess, at its
        limit.
        """
        most = int(self.left / nlp.count) - _SETUP
        if most < 1:
            return replace(
                guess, stop=Stop.LIMIT, message="the work allowed for the search is done"
            )
        self.given += 1
        try:
            point = self.backend.limited(most)(nlp, guess, watch)
        except SolveError as error:
            self.refusals.append(str(error))
            raise
        self.left -= (point.iterations + _SETUP) * nlp.count
        return point


@final
@dataclass(eq=False)
class Search:
    """What a search over words has tried so far: its words that were solved, their number, and the
    best solution.

    `refine` goes on with it from one direct solution to the next. `steps`: those of the first
    grids; `grids`: steps of the grids of all rounds; `late`: whether the time allowed, `seconds`,
    ended it; `extremals`: all that were certified; `scouted`: what its coarse starts met; `better`:
    a feasible point that is clearly better than the best, which is certified; `unsigned`: the least
    objective of words that want nothing but a sign along an arc too short to show it.
    """

    solved: dict[str, float] = field(default_factory=dict)
    count: int = 0
    best: Solution | None = None
    backend: Ration = field(default_factory=Ration)
    nodes: list[Node] = field(default_factory=list)
    rounded: bool = False
    other: Solution | None = None
    words: int = _WORDS
    grids: list[int] = field(default_factory=list)
    late: bool = False
    seconds: float = 0.0
    extremals: list[Solution] = field(default_factory=list)
    scouted: Scouted | None = None
    better: Solution | None = None
    unsigned: float = math.inf
    steps: int = 100

    def begin(self, backend: Ration, words: int, steps: int) -> None:
        """Begin another round: with so much more work and so many more words, on grids of so many
        steps.
        """
        backend.given, backend.refusals = self.backend.given, self.backend.refusals
        self.backend, self.words = backend, self.count + words
        self.solved, self.rounded = {}, False
        self.grids.append(steps)

    def known(self, now: Candidate) -> bool:
        """Tell whether a word was solved as well as it may be from a candidate's guess: another
        start is worth it where it is a solution along a word that is already better.
        """
        value, source = self.solved.get(now.key), now.source
        if value is None or not source.lawful:
            return value is not None
        return not source.objective < value - _BETTER * abs(value)

    def solve(self, now: Candidate, solution: Solution) -> None:
        """Note that a candidate was solved: no start that is no better than its own, and none than
        what it came to, is worth another solve of its word.
        """
        start = now.source.objective if now.source.lawful else math.inf
        known = self.solved.get(now.key, math.inf)
        self.solved[now.key] = min(solution.objective, start, known)

    def keep(self, solution: Solution) -> None:
        """Keep a judged word if it is the best; `other` remains the best of those that are not
        certified.
        """
        if wants_sign(solution, 1.0 / (FINEST * self.steps)):
            self.unsigned = min(self.unsigned, solution.objective)
        if solution.extremal:
            self.extremals.append(solution)
        elif self.other is None or precedes(solution, self.other):
            self.other = solution
        if self.best is None or precedes(solution, self.best):
            self.best = solution

    def watched(self, watch: Watch, word: str) -> Watch:
        """Return a watch that is told of the word being tried and of the best solution so far as
        well.
        """
        return search_watch(watch, "word", word, self.best)

    def note(self, word: str, solution: Solution | None) -> None:
        """Keep what became of a word."""
        self.nodes.append(node(word, solution))

    @property
    def over(self) -> bool:
        """Whether the work allowed is done, a certified word found, or the search interrupted."""
        done = self.best is not None and (self.best.extremal or self.best.stop is Stop.INTERRUPTED)
        return bool(done) or self.spent

    @property
    def chatters(self) -> bool:
        """Whether the best word chatters and is nearly an extremal: no finite one comes nearer."""
        verdict = None if self.best is None else self.best.verdict
        if verdict is None or not verdict.chattering:
            return False
        return verdict.residual <= APPROXIMATE and verdict.miss <= FEASIBLE

    @property
    def told(self) -> bool:
        """Whether the best word's objective is that of one that wants nothing but a sign along an
        arc too short to show it, for the finest grid as well.
        """
        best = self.best
        return best is not None and self.unsigned - best.objective <= _BETTER * abs(best.objective)

    @property
    def spent(self) -> bool:
        """Whether the time, the work or the number of words allowed is done."""
        return self.backend.left <= 0 or self.count >= self.words or seconds_left() <= 0.0


def wants_sign(solution: Solution, unseen: float) -> bool:
    """Tell whether nothing stands against a judged solution but the sign of switching functions
    along stretches too short for any equal steps to show them: of less than `unseen` of the
    horizon, the shortest of them.
    """
    verdict, horizon = solution.verdict, solution.final_time - solution.initial_time
    if verdict is None or not verdict.findings:
        return False
    open_ = verdict.slack
    rows = (solution.structure[str(each.control)][(each.stretch or 1) - 1] for each in open_)
    short = all(end - start < unseen * horizon for _, start, end in rows)
    return bool(open_) and len(verdict.reasons) == len(open_) and short


def node(word: str, solution: Solution | None) -> Node:
    """Return what became of a word as a node."""
    if solution is None:
        return Node(word=word, stop="FAILED")
    verdict = solution.verdict
    judged = {} if verdict is None else {"miss": verdict.miss, "residual": verdict.residual}
    return Node(word=word, stop=solution.stop.name, objective=solution.objective, **judged)


def precedes(one: Solution, other: Solution) -> bool:
    """Tell whether one solution is to be preferred: an extremal, a feasible one, one whose control
    reaches less.

    Where their objectives differ by no more than their re-integrations allow, the one that is less
    off goes first; of two that are off by rounding alone, the one that reaches less.
    """
    if bool(one.extremal) != bool(other.extremal):
        return bool(one.extremal)
    miss, its = off(one), off(other)
    if not max(miss, its) <= FEASIBLE:
        return miss < its
    if clearly(one, other) or clearly(other, one) or max(miss, its) <= EXTREMAL:
        return one.reached < other.reached
    return miss < its


def clearly(one: Solution, other: Solution) -> bool:
    """Tell whether the control of one solution reaches less than that of another beyond what both
    are off.
    """
    doubt = ALIKE + _WORTH * max(off(one), off(other))
    return other.reached - one.reached > doubt * max(abs(one.reached), abs(other.reached))


def off(solution: Solution) -> float:
    """Return the largest figure of a solution's re-integration, infinite where there was none."""
    return max((each.off for each in solution.verified), default=float("inf"))


def rank(solution: Solution | None) -> tuple[bool, float]:
    """Order solutions: feasible ones first, by the objective that their controls reach, then others
    by their miss.
    """
    if solution is None or solution.verdict is None:
        return (True, float("inf"))
    feasible = solution.verdict.miss <= EXTREMAL
    return (False, solution.reached) if feasible else (True, solution.verdict.miss)

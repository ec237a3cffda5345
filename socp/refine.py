"""Structure refinement: from a direct solution to a word that the judge certifies, by solving, judging and mending."""

from dataclasses import dataclass, field, replace
from typing import final

import numpy as np

from socp.backends import Ipopt
from socp.chain import judge
from socp.errors import MethodError, SolveError
from socp.following import Follower, sound
from socp.hidden import revealed
from socp.junctions import chattering
from socp.mending import Candidate, mends, read, starts
from socp.nlp import NLP, NLPPoint, Watch, silent
from socp.polish import polished
from socp.problem import Problem
from socp.simulate import scales
from socp.solution import Node, Solution, Stop
from socp.substitutes import substitutes
from socp.word import Word

_SOLVES = 40  # words tried before the search from one direct solution gives up
_WORDS = 80  # the same from all direct solutions together
_WORK = 1e6  # iterations times variables in all: some ten seconds, and the same words at any speed
_FAINT = 1e-2  # costates times their states, in the objective's units: below, a tolerance of 1e-11 costs digits
_CLEAR = 0.1  # what they are scaled to: more would ask for digits that rounding does not leave
_LARGEST = 1e6  # factor on the objective: what is fainter still is lost in the rounding of the cost
_NEARLY = 1e-4  # residual and miss: what is left of a wrong word is seldom less
_PLAIN = 3  # short arcs that a grid shows are tried as they stand up to so many; more of them are ringing
_SETUP = 10  # iterations that building a programme is worth

# a right word takes tens of iterations; a wrong one should not take thousands
_BACKEND = Ipopt({"tol": 1e-11, "max_iter": 300})


@final
@dataclass(eq=False)
class Ration:
    """A backend that stops when the work allowed in all, iterations times variables, is done."""

    left: float = _WORK
    backend: Ipopt = field(default_factory=lambda: _BACKEND)

    def __call__(self, nlp: NLP, guess: NLPPoint, watch: Watch = silent) -> NLPPoint:
        """Solve with as many iterations as are left; without any the point is the guess, at its limit."""
        most = int(self.left / nlp.v.numel()) - _SETUP
        if most < 1:
            return replace(guess, stop=Stop.LIMIT, message="the work allowed for the search is done")
        allowed = self.backend
        if most < int(allowed.options["max_iter"]):
            allowed = Ipopt({**allowed.options, "max_iter": most})
        point = allowed(nlp, guess, watch)
        self.left -= (point.iterations + _SETUP) * nlp.v.numel()
        return point


@final
@dataclass(eq=False)
class Search:
    """What a search over words has tried so far: its words that were solved, their number, and the best solution.

    `refine` goes on with it from one direct solution to the next.
    """

    solved: set[str] = field(default_factory=set)
    count: int = 0
    best: Solution | None = None
    backend: Ration = field(default_factory=Ration)
    nodes: list[Node] = field(default_factory=list)

    def watched(self, watch: Watch, word: str) -> Watch:
        """Return a watch that is told of the word being tried and of the best solution so far as well."""
        if watch is silent:
            return silent
        best = self.best.objective if self.best else float("nan")
        verdict = self.best.verdict if self.best else None
        violation = verdict.residual if verdict else float("nan")
        return lambda now: watch(replace(now, stage="word", word=word, best=best, violation=violation))

    def note(self, word: str, solution: Solution | None) -> None:
        """Keep what became of a word."""
        self.nodes.append(node(word, solution))

    @property
    def over(self) -> bool:
        """Whether the work allowed is done, a certified word found, or the search interrupted."""
        done = self.best is not None and (self.best.extremal or self.best.stop is Stop.INTERRUPTED)
        return bool(done) or self.spent

    @property
    def spent(self) -> bool:
        """Whether the work or the number of words allowed is done."""
        return self.backend.left <= 0 or self.count >= _WORDS


def node(word: str, solution: Solution | None) -> Node:
    """Return what became of a word as a node."""
    if solution is None:
        return Node(word=word, stop="FAILED")
    verdict = solution.verdict
    judged = {} if verdict is None else {"miss": verdict.miss, "residual": verdict.residual}
    return Node(word=word, stop=solution.stop.name, objective=solution.objective, **judged)


def refine(
    problem: Problem, direct: Solution, search: Search, watch: Watch = silent, solves: int = _SOLVES
) -> Solution | None:
    """Search for a certified word from a direct solution; returns the best judged solution so far, or None.

    Best first: what mends the solution with the least residual is tried next. It ends with the first certified word, or
    when nothing is left to try.
    """
    first = read(problem, direct)
    queue: list[tuple[float, Candidate]] = [(0.0, revealed(problem, first)), (0.1, first)]
    queue += [(1e3, each) for each in starts(first)]
    plain = read(problem, direct, plain=True)
    queue += [(0.15, plain)] if len(plain.arcs) <= len(first.arcs) + _PLAIN else []
    seen: set[str] = set()  # what failed from another start may succeed from this one
    last = search.count + solves
    while queue and search.count < last and not search.over:
        _, now = queue.pop(min(range(len(queue)), key=lambda k: queue[k][0]))
        if now.key in seen | search.solved:
            continue
        seen.add(now.key)
        search.count += 1
        word = str(Word(problem.control_names, now.arcs))
        solution = tried(problem, now, search.backend, search.watched(watch, word))
        search.note(word, solution)
        if solution is None or not solution.stop.ok:
            if solution is not None and solution.stop is Stop.INTERRUPTED:
                search.best = solution if search.best is None else replace(search.best, stop=Stop.INTERRUPTED)
            elif solution is None:
                queue += [(0.2 + 1e-3 * k, each) for k, each in enumerate(substitutes(problem, now))]
            continue
        search.solved.add(now.key)
        if solution.extremal or _rank(solution) < _rank(search.best):
            search.best = solution
        rank = solution.verdict.residual if solution.verdict else 1.0
        queue += [(rank + 1e-3 * k, each) for k, each in enumerate(mends(problem, now, solution))]
    return search.best


def tried(problem: Problem, now: Candidate, backend: Ration, watch: Watch) -> Solution | None:
    """Solve along a candidate's word, with its laws boxed where they would leave the box; None where that fails."""
    word = Word(problem.control_names, now.arcs)
    try:
        solution = Follower(longer=False, backend=backend)(problem, word, now.guess(), watch)
        if solution.stop.ok and not sound(problem, solution):
            boxed = Follower(boxed=True, longer=False, backend=backend)(problem, word, now.guess(), watch)
            solution = boxed if boxed.stop.ok else solution
    except (MethodError, SolveError):
        return None
    if not solution.stop.ok:
        return solution
    return _settled(problem, _sharpened(problem, word, judge(problem, solution), backend, watch))


def _settled(problem: Problem, solution: Solution) -> Solution:
    """Return what Newton makes of a nearly certified solution: the solver's tolerances may be all that is amiss."""
    verdict = solution.verdict
    if solution.extremal or verdict is None or not max(verdict.residual, verdict.miss) <= _NEARLY:
        return solution
    found = polished(problem, solution)
    judged = solution if found is None else judge(problem, found)
    return judged if judged.extremal else solution


def _sharpened(problem: Problem, word: Word, solution: Solution, backend: Ration, watch: Watch) -> Solution:
    """Solve once more with the objective scaled up where costates are small: Ipopt's tolerance on them is absolute."""
    weight = float(np.nanmax(np.abs(solution.rows("costate")) * scales(problem, solution)[:, None], initial=0.0))
    if solution.extremal or not 0.0 < weight < _FAINT:
        return solution
    larger = {"obj_scaling_factor": min(_CLEAR / weight, _LARGEST)}
    scaled = Ration(backend.left, Ipopt({**backend.backend.options, **larger}))
    sharper = Follower(longer=False, backend=scaled)(problem, word, solution, watch).after(solution)
    backend.left = scaled.left
    if sharper.stop is Stop.INTERRUPTED:
        return replace(solution, stop=Stop.INTERRUPTED)
    return judge(problem, sharper) if sharper.stop.ok else solution


def _rank(solution: Solution | None) -> tuple[bool, float]:
    """Order solutions: feasible ones first, then by objective."""
    if solution is None or solution.verdict is None:
        return (True, float("inf"))
    return (not solution.verdict.miss <= 1e-6, solution.objective)


# -- what is left to say


def concluded(problem: Problem, search: Search, directs: list[Solution]) -> Solution:
    """Return the certified solution, or else the best there is with what is left open in its message.

    Of direct solutions, one at least, the one that misses least is taken where no word could be solved at all; one that
    happens to be an extremal, its switches on the grid, goes before any word that is none.
    """
    if search.best is not None and (search.best.extremal or not search.best.stop.ok):
        return search.best
    judged = [judge(problem, each) for each in directs[:2] if each.stop.ok]  # those from the best start
    certain = next((each for each in judged if each.extremal), None)
    if certain is not None:
        return certain
    best = search.best or min(judged, key=_missed, default=None)
    return directs[0] if best is None else replace(best, message=f"{best.message}; {explained(problem, search)}")


def _missed(solution: Solution) -> float:
    return solution.verdict.miss if solution.verdict else float("inf")


def explained(problem: Problem, search: Search) -> str:
    """Say in a sentence or two what a search without a certified word has left open."""
    tried = f"no word of the {search.count} tried is certified" + (
        ", and the work allowed for the search is done" if search.spent else ""
    )
    best = search.best
    if best is None or best.verdict is None:
        return f"{tried}; this is a direct solution"
    names = chattering(problem, best)
    if names:
        return (
            f"{', '.join(names)}: chattering; no finite number of switches joins a bang arc to a singular arc of even "
            f"order inside its box, so the switches pile up where they meet; this word stands for infinitely many"
        )
    return f"{tried}; the best one leaves: {best.verdict.reasons[0] if best.verdict.reasons else 'nothing'}"

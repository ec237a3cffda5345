"""Mixed-binary optimal control: which mode every arc is in, given only how many switches there may
be.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import final

import numpy as np

from socp.errors import MethodError, SolveError
from socp.laws import arc_modes
from socp.methods import guess_along, scouts, solve_collocated
from socp.model import SHORTEST, Modes, Problem, Solution, Stop, Watch, Word, silent
from socp.search.candidate import Candidate
from socp.search.effort import Ration, along_words
from socp.search.ledger import all_words, word_count
from socp.search.neighbours import shortened, word_of
from socp.search.reading import with_hidden_bangs
from socp.search.rounding import rounded_word
from socp.search.tree.attempt import Coarse
from socp.search.tree.branching import Branching, Child
from socp.search.tree.softening import end_miss, softened_problem
from socp.solvers import Backend
from socp.transcription import radau_iia, single_phase, uniform
from socp.verdict import chattering, judge

_ITERATIONS = 500  # what a direct solve has not reached by then it hardly ever reaches
_STEPS = 50  # intervals of the finer direct solves, where the scouts' words lead nowhere
_MOST = 12  # switches that are tried where their number is not given
_LARGEST = 99  # switches that may be allowed
_ROUNDED = 6  # switches of the first rounding there
_FEW = 50  # words within the bound: so many are all looked at where the search certifies none
_ALIKE = 2e-3  # relative: coarse solutions differ by so much from what they stand for
_MET = 1e-6  # of the states: softened ends are met up to the solver's tolerance


@final
@dataclass(frozen=True)
class BoundedSearch:
    """The search for a word from a bound on its switches.

    `switches` is the bound, or auto: as few as it takes; `points` the collocation points an arc;
    `solver` is search, over words, or the name of a mixed-integer solver; `time` the seconds after
    which the best is given; `starts` the most coarse solves from scattered guesses; `backend`
    solves the nonlinear programmes.
    """

    switches: str
    points: int
    solver: str
    time: float
    starts: int
    backend: Backend

    def solve(self, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
        """Search for a word that the judge certifies; else return the best with what is left open
        in its message.
        """
        began, most = time.perf_counter(), self._most()
        if self.solver != "search":
            from socp.search.integer.minlp import available

            available(self.solver)  # raises before anything is solved
        modes = arc_modes(problem)
        if not modes:
            raise MethodError(
                f"mboc: problem '{problem.name}' has no law on any arc; give laws, or solve it "
                "directly"
            )
        ration = Ration(backend=along_words(self.backend))
        coarse = Coarse(problem, lambda _: problem, self.points, ration)
        branching, directs = Branching(coarse, modes, most, most), list[Solution]()
        branching.until = time.monotonic() + self.time
        try:
            if self.solver == "search":
                self._searched(branching, guess, directs, watch)
            else:
                self._programmed(branching, guess, directs, watch)
        except KeyboardInterrupt:  # between two solves; inside one the backend stops by itself
            branching.stopped = Stop.INTERRUPTED.value
        found = self._concluded(branching, directs)
        own = {name: found.seconds.get(name, 0.0) for name in ("build", "solve")}
        seconds = {"search": time.perf_counter() - began - sum(own.values()), **own}
        return found.with_effort(seconds=seconds, nodes=tuple(branching.nodes))

    def _most(self) -> int:
        """Return the bound on the switches."""
        if self.switches == "auto":
            return _MOST
        try:
            most = int(self.switches)
        except ValueError:
            most = -1
        if not 0 <= most <= _LARGEST:
            allowed = f"auto or a whole number from 0 to {_LARGEST}"
            raise MethodError(f"mboc: switches='{self.switches}', but it should be {allowed}")
        return most

    def _searched(
        self, branching: Branching, guess: Solution, directs: list[Solution], watch: Watch
    ) -> None:
        """Search from one direct solution after another until a word is certified, or the time is
        over.
        """
        problem = branching.coarse.problem
        for direct in self._directs(problem, guess, watch):
            directs.append(direct)
            if direct.stop is Stop.INTERRUPTED:
                branching.stopped = direct.stop.value
            if branching.over:
                return
            if direct.stop.ok:
                seeds = list(self._seeds(problem, direct, branching.modes))
                if self.switches == "auto" and not branching.nodes:
                    branching.switches = min((len(each.arcs) - 1 for each in seeds), default=_MOST)
                branching.coarse.softly = cache(partial(softened_problem, problem, direct))
                branching.queue += [Child(direct.objective, each) for each in seeds]
                branching.search(watch)
        if not branching.over:
            branching.queue += _others(branching, directs)
            branching.search(watch)

    def _directs(self, problem: Problem, guess: Solution, watch: Watch) -> Iterator[Solution]:
        """Yield direct solutions, the coarse ones first, the best of them at the head."""
        met = scouts(problem, guess, self.starts, watch, self.backend)
        yield from met
        direct = self.backend.limited(_ITERATIONS)
        for start in (*met, guess):
            yield solve_collocated(
                single_phase(problem), [uniform(radau_iia(2), _STEPS)], direct, start, watch
            )

    def _seeds(
        self, problem: Problem, direct: Solution, modes: Sequence[Modes]
    ) -> Iterator[Candidate]:
        """Yield the words nearest to a direct solution in the integral, bangs that hide between its
        nodes added.
        """
        try:
            found = rounded_word(problem, direct, modes, min(self._most(), _ROUNDED))
        except SolveError:
            return
        yield with_hidden_bangs(problem, found)
        yield found

    def _programmed(
        self, branching: Branching, guess: Solution, directs: list[Solution], watch: Watch
    ) -> None:
        """Have a mixed-integer solver choose the modes; what it returns is cleaned, solved anew and
        judged.
        """
        from socp.search.integer.minlp import minlp

        problem = branching.coarse.problem
        met = scouts(problem, guess, self.starts, watch, self.backend) or [guess]
        seed = next(self._seeds(problem, met[0], branching.modes), None)
        switches = (len(seed.arcs) - 1 if seed else 2) if self.switches == "auto" else self._most()
        branching.switches = switches
        found = minlp(
            problem, self.solver, switches, self.points, self.time, met[0], watch, self.backend
        )
        directs.append(found)
        branching.nodes += found.nodes
        if not found.stop.ok and found.stop is not Stop.LIMIT:
            return
        if found.lawful:
            branching.verify(shortened(word_of(found), SHORTEST), watch)

    # -- what is left to say

    def _concluded(self, branching: Branching, directs: list[Solution]) -> Solution:
        """Return the best judged solution, or else the direct one that misses least, with what is
        left open.
        """
        interrupted = branching.stopped == Stop.INTERRUPTED.value
        best = branching.best
        if best is None:
            if not directs:
                raise KeyboardInterrupt  # nothing has been solved yet
            ok = [each for each in directs if each.stop.ok]
            if not ok or interrupted:
                return replace(directs[-1], stop=Stop.INTERRUPTED) if interrupted else directs[-1]
            best = min(
                (judge(branching.coarse.problem, each) for each in (ok[0], *ok[1:][-1:])),
                key=_missed,
            )
        said = (
            ""
            if self.solver == "search" or directs[-1].message in best.message
            else directs[-1].message
        )
        text = "; ".join(
            filter(None, (best.message, said, self._explained(branching, directs, best)))
        )
        return replace(best, message=text, stop=Stop.INTERRUPTED if interrupted else best.stop)

    def _explained(self, branching: Branching, directs: list[Solution], best: Solution) -> str:
        """Say what is known of all words, and which arc is missing where the word found is no
        extremal.
        """
        searched = (
            self.solver == "search"
        )  # other solvers look at words by themselves: there is nothing to count
        if best.extremal and branching.best is not None:
            better = [
                each
                for each in directs
                if best.objective - each.objective > _ALIKE * abs(best.objective)
            ]
            known = branching.ledger.text(branching.switches, closed=not better)
            hedged = (
                f"{known}; all of it as far as a local solver finds the best there is, which it "
                "does not prove"
            )
            return hedged if searched else ""
        none = "no word tried meets the ends" if branching.nodes else "no word was tried"
        direct = "" if branching.best or not searched else f"{none}, and this is a direct solution"
        known = branching.ledger.text(branching.switches) if searched else ""
        parts = [_missing(branching, best), direct, known, branching.stopped]
        names = chattering(branching.coarse.problem, best)
        if names:
            parts.append(
                f"{', '.join(names)}: chattering, which no finite number of switches allows"
            )
        return "; ".join(filter(None, parts))


def _others(branching: Branching, directs: Sequence[Solution]) -> Iterator[Child]:
    """Yield all words within the bound that nothing is known of, if they are few, cut where a
    direct solution fits.
    """
    problem, near = branching.coarse.problem, next((each for each in directs if each.stop.ok), None)
    if near is None or word_count(len(branching.modes), branching.switches) > _FEW:
        return
    for letters in all_words(branching.modes, branching.switches):
        if not branching.ledger.knows(letters):
            cut = guess_along(problem, near, Word(problem.control_names, letters))
            yield Child(near.objective, replace(Candidate.of(cut, letters), source=near))


def _missing(branching: Branching, best: Solution) -> str:
    """Name the arc that the judge asks for, or that a word with more switches has and none of these
    can.
    """
    words, asked = branching.coarse.problem.control_names, _asked(best) if branching.best else ""
    longer, solution = min(branching.beyond, key=lambda pair: pair[0].rank, default=(None, best))
    if not asked and longer is None:
        return "no word tried is certified"
    text = f"switches = {branching.switches} seems too small: an arc is missing{asked}"
    if longer is None:
        return text
    arcs, edges = longer.candidate.arcs, longer.candidate.edges
    k = int(np.argmin(np.diff(edges)))
    pairs = zip(words, arcs[k], arcs[k + 1 if k == 0 else k - 1], strict=True)
    arc = ", ".join(f"{name}: {mode}" for name, mode, beside in pairs if mode != beside)
    how = f"reaches {longer.rank:.8g}" if end_miss(solution) <= _MET else "comes nearer to the ends"
    return (
        f"{text}; with {longer.switches} switches the word {Word(words, arcs)} {how}, "
        f"and its shortest arc is {arc} from t = {edges[k]:.4g} to {edges[k + 1]:.4g}"
    )


def _missed(solution: Solution) -> float:
    return solution.verdict.miss if solution.verdict else float("inf")


def _asked(best: Solution) -> str:
    """Return what the judge asks for most: the control, the mode, where."""
    findings = (
        [f for f in best.verdict.findings if f.wants and not f.holds and f.t is not None]
        if best.verdict
        else []
    )
    if not findings:
        return ""
    worst = max(findings, key=lambda f: f.residual)
    return (
        f", {worst.control}: {worst.wants} at t = {worst.t:.4g} ({worst.condition} on "
        f"{worst.where}: {worst.residual:.1e})"
    )

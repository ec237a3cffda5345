"""Branch over words with a bound on their switches: solve a word, insert what lowers its objective,
judge what is left.

A node is a programme along one word with one interval an arc. Its children have one more arc, where
the mode-insertion gradient is negative; a node that none improves is solved at full accuracy,
judged, and mended if it is no extremal.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import final

import numpy as np

from socp.methods import sound
from socp.model import (
    SHORTEST,
    Modes,
    Node,
    Solution,
    Stop,
    Watch,
    Word,
    scales,
    search_watch,
    silent,
)
from socp.search.candidate import Candidate, insert_modes
from socp.search.effort import node, rank
from socp.search.ledger import Ledger
from socp.search.mending import mends
from socp.search.neighbours import shortened
from socp.search.refinement import solve_word
from socp.search.tree.attempt import Coarse, staggered, trimmed
from socp.search.tree.insertion import insertions, magnitude
from socp.search.tree.softening import end_miss
from socp.transcription import tails

# Of the Hamiltonian's terms, beside how far the mesh is off: below, an insertion gains nothing
_PAYS = 1e-6
_MISSED = 1e-6  # of the states: softened ends are met up to the solver's tolerance
_CHILDREN = 6  # insertions tried of one node, the steepest ones
_LOOKED = 0.02  # of an arc: the length of an insertion by which children are compared
_EQUAL = 1e-8  # of the objective: an arc that is worth less is not needed
_LATER = 1e-3  # of the objective: by how much what is merely possible waits for what is promising
# Of the objective: what the best child promises then is worth no more than the judge's word
_SLIGHT = 3e-5
_NODES = 60  # words tried with one bound on the switches
# Switches beyond the bound that a word may have on the way: an arc inside another, if two others
# vanish
_TRANSIT = 2


@final
@dataclass(frozen=True, eq=False)
class Child:
    """A word to try, and what it is expected to reach.

    mends: it is what the judge found wrong put right, and is worth judging even if it was solved
    before.
    """

    rank: float
    candidate: Candidate
    mends: bool = False

    @property
    def switches(self) -> int:
        """Number of switches."""
        return len(self.candidate.arcs) - 1


@final
@dataclass(eq=False)
class Branching:
    """A search over words, best first; `switches` bounds them, and is raised up to `most` when
    nothing is left.

    until: end of the time allowed, on the clock of `time.monotonic`. `lead` is the best word within
    the bound so far, `beyond` what was met on the way that has more switches, `best` the best
    judged solution.
    """

    coarse: Coarse
    modes: Sequence[Modes]
    switches: int
    most: int
    until: float = float("inf")
    nodes: list[Node] = field(default_factory=list)
    queue: list[Child] = field(default_factory=list)
    beyond: list[tuple[Child, Solution]] = field(default_factory=list)
    lead: Candidate | None = None
    best: Solution | None = None
    stopped: str = ""
    tried: set[str] = field(default_factory=set)
    judged: set[str] = field(default_factory=set)
    ledger: Ledger = field(init=False)

    def __post_init__(self) -> None:
        self.ledger = Ledger(len(self.modes))

    def search(self, watch: Watch = silent) -> None:
        """Try what is in the queue, and what comes of it, until a word is certified or nothing is
        left to try.
        """
        count = 0
        while not self.over:
            if self.lead is not None and self.lead.key not in self.judged and self._nearly_done:
                self._settle(self.lead, watch)
                continue
            child = self._next() if count < _NODES else None
            if child is not None:
                count += 1
                self._try(child, watch)
                continue
            if self.lead is not None and self.lead.key not in self.judged:
                self._settle(
                    self.lead, watch
                )  # the best of its size, though something longer would improve it
                continue
            if not self._raised(watch):
                return
            count = 0

    @property
    def _nearly_done(self) -> bool:
        """Whether no child is expected to improve the best word known by much."""
        fitting = [each.rank for each in self.queue if each.switches <= self.switches + _TRANSIT]
        known = self.lead.source.objective if self.lead else np.inf
        return known - min(fitting, default=np.inf) < _SLIGHT * abs(known)

    def _raised(self, watch: Watch) -> bool:
        """Raise the bound to the fewest switches that something is left with, False where there is
        nothing.
        """
        longer = [each.switches for each in (*self.queue, *(child for child, _ in self.beyond))]
        longer = [switches for switches in longer if switches > self.switches]
        if self.switches >= self.most or not longer:
            return False
        self.switches = min(longer)
        known, self.beyond = self.beyond, []
        for child, solution in known:
            self._branch(child, solution, watch)
        return True

    @property
    def over(self) -> bool:
        """Whether a word is certified, the work or the time allowed is done, or the search was
        interrupted.
        """
        if not self.stopped and self.coarse.ration.left <= 0:
            self.stopped = "the work allowed for the search is done"
        if not self.stopped and time.monotonic() > self.until:
            self.stopped = "the time allowed is over"
        return bool(self.stopped) or (self.best is not None and bool(self.best.extremal))

    def _next(self) -> Child | None:
        """Take the most promising child that has not too many switches."""
        known = {True: self.judged, False: self.tried}
        self.queue = [each for each in self.queue if each.candidate.key not in known[each.mends]]
        fitting = [
            k for k, each in enumerate(self.queue) if each.switches <= self.switches + _TRANSIT
        ]
        return self.queue.pop(min(fitting, key=lambda k: self.queue[k].rank)) if fitting else None

    def _try(self, child: Child, watch: Watch) -> None:
        now = child.candidate
        if child.mends and now.arcs in self.ledger.solved and child.switches <= self.switches:
            self.verify(now, watch)
            return
        self.tried.add(now.key)
        solution = self.coarse(now, self._watched(watch, now))
        if solution is not None and solution.stop is Stop.INTERRUPTED:
            self.stopped = solution.stop.value
        self._note(now, solution)
        if solution is None or not solution.stop.ok:
            self.ledger.failed.add(now.arcs)
            later = abs(child.rank) * _LATER
            self.queue += [
                Child(child.rank + later * (k + 1), c) for k, c in enumerate(staggered(now))
            ]
            return
        self.ledger.solved.add(now.arcs)
        self._branch(child, solution, watch)

    def _branch(self, child: Child, solution: Solution, watch: Watch) -> None:
        """Put the children of a solved word into the queue; judge it where there are none."""
        now = child.candidate
        full = Candidate.of(solution, now.arcs)
        short = shortened(full, SHORTEST)
        if short.arcs != now.arcs:
            if short.arcs in self.ledger.solved:
                return
            self.ledger.solved.add(short.arcs)
            self.tried.add(short.key)
        if len(short.arcs) - 1 > self.switches:
            self.beyond.append((replace(child, rank=solution.objective, candidate=short), solution))
            return
        if self.lead is None or solution.objective < self._worth(self.lead, short):
            self.lead = short
        if not sound(self.coarse.problem, solution):
            self.queue += self._ranked(
                mends(self.coarse.problem, full, solution), solution.objective
            )
            return
        children = list(self._insertions(short, solution))
        self.queue += children
        if (
            not children and end_miss(solution) > _MISSED and self.coarse.dearer()
        ):  # missing the ends is too cheap
            self.queue.append(Child(solution.objective, short))
            self.tried.clear()
            self.lead = None
        elif not children:
            self._settle(short, watch)

    def _worth(self, lead: Candidate, other: Candidate) -> float:
        """Return what another word has to be below to take the lead: a little more if it has fewer
        arcs.
        """
        more = _EQUAL if len(other.arcs) < len(lead.arcs) else 0.0
        return lead.source.objective + more * abs(lead.source.objective)

    def _insertions(self, now: Candidate, solution: Solution) -> Iterator[Child]:
        """Yield the words whose additional arc lowers the objective; enter those whose does not in
        the ledger.
        """
        found = insertions(self.coarse.problem, solution, self.modes)
        scale = scales(self.coarse.problem, solution)[:, None]
        off = max(float(tails(arc, arc.x / scale).max()) for arc in solution.arcs)
        level = -(_PAYS + off) * magnitude(self.coarse.problem, solution)
        paying = [each for each in found if each.slope < level]
        slopes: dict[tuple[int, Modes], float] = {}
        for each in found:
            key = now.place(each.t), each.modes
            slopes[key] = min(slopes.get(key, np.inf), each.slope)
        self.ledger.exclude(now.arcs, slopes, level)
        seen = set[str]()
        for each in paying:
            new = insert_modes(now, each.modes, each.t)
            if new.key not in seen and len(seen) < _CHILDREN:
                seen.add(new.key)
                length = _LOOKED * (now.edges[now.place(each.t) + 1] - now.edges[now.place(each.t)])
                yield Child(solution.objective + each.slope * length, new)

    def _settle(self, now: Candidate, watch: Watch) -> None:
        """Judge a word, but first see whether its shortest arc is needed where that is very
        short.
        """
        fewer = trimmed(now)
        if fewer is not None and fewer.key not in self.tried:
            self._try(Child(now.source.objective, fewer), watch)
        if self.lead is None or len(self.lead.arcs) >= len(now.arcs):  # it is not spurious
            self.verify(now, watch)

    def verify(self, now: Candidate, watch: Watch) -> None:
        """Solve a word at full accuracy and judge it; what the judge finds wrong are further
        children.
        """
        self.judged.add(now.key)
        solution = solve_word(
            self.coarse.problem, now, self.coarse.ration, self._watched(watch, now)
        )
        self._note(now, solution)
        if solution is None or not solution.stop.ok:
            if solution is not None and solution.stop is Stop.INTERRUPTED:
                self.stopped = solution.stop.value
            return
        self.ledger.solved.add(now.arcs)
        if solution.extremal or self.best is None or rank(solution) < rank(self.best):
            self.best = solution
        if not solution.extremal:
            self.queue += self._ranked(
                mends(self.coarse.problem, now, solution), solution.objective
            )

    def _ranked(self, candidates: Iterator[Candidate], objective: float) -> Iterator[Child]:
        for k, each in enumerate(candidates):
            yield Child(
                objective + abs(objective) * (_LATER * k / 10.0 - _SLIGHT), each, mends=True
            )

    def _watched(self, watch: Watch, now: Candidate) -> Watch:
        word = str(Word(self.coarse.problem.control_names, now.arcs))
        return search_watch(watch, "word", word, self.lead.source if self.lead else None)

    def _note(self, now: Candidate, solution: Solution | None) -> None:
        self.nodes.append(node(str(Word(self.coarse.problem.control_names, now.arcs)), solution))

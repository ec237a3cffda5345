"""A branch as it is being followed: trials along its word, and what the last two solutions
predict.
"""

from dataclasses import dataclass, field, replace
from typing import final

import numpy as np

from socp.model import Arc, Family, Problem, Progress, Solution, Watch
from socp.search import continued, past
from socp.study.branch import Event, Point
from socp.study.monitors import Clue, Margins, lengths, margins
from socp.verdict import certified, learn, with_second_order

STEPS = 20  # points that a branch has at least: enough to draw it
# Of the span: what takes shorter steps than this does not go on; events are solved for instead
SMALLEST = 1e-3
EVENT = 1e-8  # of the span: nearer to its end than this a branch has reached it
ZERO = 1e-9  # of its size: a figure that is no further from zero may be on either side of it
# Of the horizon: times further from those expected may be of another branch
ASTRAY = 0.05
_KEPT = 0.2  # of its length: what a prediction leaves of an arc


@final
@dataclass(frozen=True, eq=False)
class Trial:
    """What Newton makes of a word at a value: the solution, judged where its arcs have lengths, and
    its margins.
    """

    value: float
    solution: Solution
    margins: Margins

    @property
    def holds(self) -> bool:
        """Whether it is certified."""
        return bool(self.solution.extremal)


@final
@dataclass(frozen=True, eq=False)
class Zero:
    """A trial at which a margin is zero, and which one."""

    trial: Trial
    clue: Clue


@final
@dataclass(eq=False)
class Walk:
    """A branch as it is being followed between the `ends` of the number: what is known of it, and
    how to go on; `back` where a fold has turned it round, `last` is the event beyond which no word
    was found. Its solutions are those of the family.
    """

    family: Family
    name: str
    ends: tuple[float, float]
    watch: Watch
    points: list[Point] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    problems: dict[float, Problem] = field(default_factory=dict)
    last: Event | None = None
    back: bool = False

    @property
    def span(self) -> tuple[float, float]:
        """The end that it comes from, and the one that it goes to."""
        return self.ends[::-1] if self.back else self.ends

    def turn(self) -> None:
        """Go the other way."""
        self.back = not self.back

    @property
    def width(self) -> float:
        """How far it goes, with the sign of its direction."""
        return self.span[1] - self.span[0]

    def at(self, value: float) -> Problem:
        """Return the problem at a value of the number."""
        if value not in self.problems:
            while len(self.problems) > STEPS:
                del self.problems[next(iter(self.problems))]
            self.problems[value] = self.family.at({self.name: value})
        return self.problems[value]

    def tell(self, value: float, word: str) -> None:
        """Tell the watch where the branch is; KeyboardInterrupt where it asks to stop."""
        best = self.points[-1].solution.objective if self.points else float("nan")
        stage = f"{self.name} = {value:.6g}, {len(self.points)} points, {len(self.events)} events"
        if self.watch(Progress(stage, len(self.points), best, 0.0, word=word)):
            raise KeyboardInterrupt

    def tried(
        self, value: float, near: Point | Trial, ahead: Solution | None = None
    ) -> Trial | None:
        """Solve along the word of a solution near by, from what is predicted where it is."""
        problem = self.at(value)
        self.tell(value, near.solution.word)
        learn(problem, near.solution)
        found = continued(problem, near.solution, self.at(near.value), ahead)
        if found is None:
            return None
        return self.judged(value, found)

    def judged(self, value: float, found: Solution) -> Trial:
        """Return a trial of a solution of the conditions of its word."""
        problem = self.at(value)
        if min(each.value for each in lengths(found).values()) <= 0.0:
            return Trial(value, found, lengths(found))
        judged = with_second_order(problem, certified(problem, found))
        return Trial(value, judged, margins(problem, judged))


def predicted(before: Point | Trial | None, now: Point | Trial, value: float) -> Solution | None:
    """Return the solution that the last two predict at a value, on a straight line through them;
    None where the last one is alone on its word. No arc loses all of its length.
    """
    here = now.solution
    if before is None or not _alike(before.solution, here):
        return None
    there = before.solution
    ratio = (value - now.value) / (now.value - before.value)
    for old, new in zip(there.arcs, here.arcs, strict=True):
        length, change = np.ptp(new.t), np.ptp(new.t) - np.ptp(old.t)
        if ratio * change < (_KEPT - 1.0) * length:
            ratio = (_KEPT - 1.0) * length / change
    arcs = tuple(_line(a, b, ratio) for a, b in zip(there.arcs, here.arcs, strict=True))
    p = {k: v + ratio * (v - there.parameters[k]) for k, v in here.parameters.items()}
    return replace(here, arcs=arcs, parameters=p)


def vanishing(
    walk: Walk, before: Point | Trial | None, now: Point | Trial, value: float
) -> tuple[float, list[Solution]] | None:
    """Return where, up to a value, the last two solutions let an arc lose its length, if they do,
    and guesses along the words that may hold beyond: without the arc, and with another bound on it.
    Newton knows little there: the length may be degenerate.
    """
    if before is None or not _alike(before.solution, now.solution):
        return None
    there, here = (np.array([np.ptp(a.t) for a in e.solution.arcs]) for e in (before, now))
    share = here / np.maximum(there - here, ZERO * here.sum())  # of the last step
    share[there <= here] = np.inf
    k = int(np.argmin(share))
    near = now.value + share[k] * (now.value - before.value)
    room = abs(value - now.value) + EVENT * abs(walk.width)
    if here.size < 2 or not abs(near - now.value) <= room:
        return None
    return float(near), past(now.solution, k)


def _alike(one: Solution, other: Solution) -> bool:
    """Tell whether two solutions have one word and one mesh."""
    return one.followed == other.followed and all(
        np.array_equal(a.mesh, b.mesh) for a, b in zip(one.arcs, other.arcs, strict=True)
    )


def _line(old: Arc, new: Arc, ratio: float) -> Arc:
    t, x, u, costate = (
        b + ratio * (b - a)
        for a, b in ((old.t, new.t), (old.x, new.x), (old.u, new.u), (old.costate, new.costate))
    )
    return replace(new, t=t, x=x, u=u, costate=costate)


def apart(one: Solution, other: Solution) -> float:
    """Return how far the arcs of two solutions are apart, in horizons, at least a trifle."""
    horizon = other.final_time - other.initial_time
    times = [np.append(each.junctions, each.final_time) for each in (one, other)]
    return max(float(np.abs(times[0] - times[1]).max()) / horizon, ZERO)

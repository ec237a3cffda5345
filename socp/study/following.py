"""Following an extremal in a number of its problem, through changes of its word.

A step predicts by the last two solutions, corrects by Newton on the conditions of the word, and is
judged. Where the judge does not certify it, the word has changed on the way: the figure that has
passed through zero is located by solving for its zero in the number, and the word that holds beyond
is the one that mends what the judge has found.
"""

from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import final

import numpy as np
from scipy.optimize import brentq

from socp.errors import MethodError, SolveError
from socp.model import Arc, Problem, Progress, Solution, Watch, silent
from socp.process import breakable
from socp.search import (
    Candidate,
    Search,
    continued,
    mends,
    try_words,
    warm_start,
    without_arc,
    word_of,
)
from socp.study.branch import Branch, Event, Point
from socp.study.census import explore
from socp.study.monitors import Clue, Margins, lengths, margins
from socp.study.naming import named
from socp.verdict import certified, learn, with_second_order

_STARTS = 3  # of a census, for the first solution
_STEPS = 20  # points that a branch has at least: enough to draw it
# Of the span: what takes shorter steps than this does not go on; events are solved for instead
_SMALLEST = 1e-3
_PREDICTED = 0.01  # of the horizon: how far a prediction may be off, by which steps are chosen
_GROWN, _CUT = 2.0, 0.25  # times the last step, at most and at least
_KEPT = 0.2  # of its length: what a prediction leaves of an arc
_ZERO = 1e-9  # of its size: a figure that is no further from zero may be on either side of it
_CLEAR = 1e-7  # of its size: one that is further on the wrong side has passed through zero
_LOCATED = 1e-12  # of the span: where a zero of a figure is sought no closer
_EVENT = 1e-8  # of the span: nearer to its end than this a branch has reached it
_BEYOND = (0.25, 0.05, 1.0)  # of the step left: where the word beyond an event is tried
_WORDS = 12  # words tried there
_SAME = 1e-6  # relative: by how much the objectives of two words may differ where they meet


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
    """A branch as it is being followed: what is known of it, and how to go on."""

    problem: Problem
    name: str
    span: tuple[float, float]
    watch: Watch
    points: list[Point] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    problems: dict[float, Problem] = field(default_factory=dict)

    @property
    def width(self) -> float:
        """How far it goes, with the sign of its direction."""
        return self.span[1] - self.span[0]

    def at(self, value: float) -> Problem:
        """Return the problem at a value of the number."""
        if value not in self.problems:
            while len(self.problems) > _STEPS:
                del self.problems[next(iter(self.problems))]
            self.problems[value] = self.problem.with_({self.name: value})
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
        if min(each.value for each in lengths(found).values()) <= 0.0:
            return Trial(value, found, lengths(found))
        judged = with_second_order(problem, certified(problem, found))
        return Trial(value, judged, margins(problem, judged))


def follow(
    problem: Problem,
    numbers: Mapping[str, tuple[float, float]],
    guess: Solution | None = None,
    *,
    steps: int = _STEPS,
    watch: Watch = silent,
) -> Branch:
    """Follow an extremal while one number of the problem, by the name that `Problem.with_` knows it
    by, goes from one value to another: `follow(problem, {"current": (0.1, 2)})`.

    `guess`: a solution at the first value, or near it; without one the extremals of a few starts
    are looked for, and the best is taken. `steps`: the least number of points. Ctrl-C, or a true
    answer of the watch, ends it with what there is.

    Raises MethodError for anything but one number with two different values, ProblemError for a
    name or a value that leaves no problem, SolveError where no extremal is found to begin with.
    """
    ((name, span),) = _checked(numbers).items()
    if steps < 1:
        raise MethodError(f"steps={steps}, but it must be at least 1")
    walk = Walk(problem, name, span, watch)
    first, _ = walk.at(span[0]), walk.at(span[1])
    ended, interrupted = "", False
    start = _first(first, guess, watch)
    walk.points.append(Point(span[0], with_second_order(first, start)))
    try:
        with breakable():
            ended = _walked(walk, steps)
    except KeyboardInterrupt:
        interrupted = True
    return Branch(problem.name, name, tuple(walk.points), tuple(walk.events), ended, interrupted)


def _checked(numbers: Mapping[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    found = {name: tuple(float(each) for each in span) for name, span in numbers.items()}
    if len(found) != 1:
        raise MethodError(f"a branch is followed in one number, but {len(found)} are given")
    for name, span in found.items():
        if len(span) != 2 or span[0] == span[1] or not np.isfinite(span).all():
            raise MethodError(f"{name}={span}: give two different values, where it begins and ends")
    return {name: (span[0], span[1]) for name, span in found.items()}


def _first(problem: Problem, guess: Solution | None, watch: Watch) -> Solution:
    """Return a certified solution to begin with."""
    if guess is not None:
        found = warm_start(problem, guess, Search(), watch)
        if found is not None and found.extremal:
            return found
        raise SolveError(f"{problem.name}: the guess leads to no extremal at the first value")
    outcomes = [explore(problem, k, watch) for k in range(_STARTS)]
    known = [each.solution for each in outcomes if each.solution is not None and each.certified]
    if not known:
        raise SolveError(
            f"{problem.name}: no extremal was found at the first value; give a solution as a guess"
        )
    return min(known, key=lambda each: each.objective)


def _walked(walk: Walk, steps: int) -> str:
    """Go on to the last value; returns why that is not reached, empty where it is."""
    longest = step = walk.width / steps
    before: Point | None = None
    known = margins(walk.at(walk.span[0]), walk.points[-1].solution)
    while (now := walk.points[-1]).value != walk.span[1]:
        value = now.value + step
        if (walk.span[1] - value) / walk.width <= _SMALLEST:
            value = walk.span[1]
        near = _vanishing(walk, before, now, value)
        if near is not None and _changed(walk, Trial(now.value, now.solution, known), value, near):
            before, now = None, walk.points[-1]
            known = margins(walk.at(now.value), now.solution)
            continue
        guess = predicted(before, now, value)
        trial = walk.tried(value, now, guess)
        if trial is not None and trial.holds and not _passed(known, trial.margins):
            if guess is not None:
                grown = np.sqrt(_PREDICTED / _apart(guess, trial.solution))
                step = (value - now.value) * float(np.clip(grown, _CUT, _GROWN))
                step = step if abs(step) < abs(longest) else longest
            before, known = now, trial.margins
            walk.points.append(Point(value, trial.solution))
            continue
        if trial is None and abs(step) > _CUT**2 * abs(longest):
            step *= _CUT
            continue
        if not _changed(walk, Trial(now.value, now.solution, known), value, trial):
            if abs(step) > _SMALLEST * abs(walk.width):
                step *= _CUT
                continue
            return _lost(walk)
        before, now = None, walk.points[-1]
        known = margins(walk.at(now.value), now.solution)
    return ""


def predicted(before: Point | None, now: Point, value: float) -> Solution | None:
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


def _vanishing(
    walk: Walk, before: Point | None, now: Point, value: float
) -> tuple[float, Candidate] | None:
    """Return where, up to a value, the last two solutions let an arc lose its length, if they do,
    and the word without it. Newton knows little there: the length may be degenerate.
    """
    if before is None or not _alike(before.solution, now.solution):
        return None
    there, here = (np.array([np.ptp(a.t) for a in e.solution.arcs]) for e in (before, now))
    share = here / np.maximum(there - here, _ZERO * here.sum())  # of the last step
    share[there <= here] = np.inf
    k = int(np.argmin(share))
    near = now.value + share[k] * (now.value - before.value)
    room = abs(value - now.value) + _EVENT * abs(walk.width)
    if here.size < 2 or not abs(near - now.value) <= room:
        return None
    return float(near), without_arc(word_of(now.solution), k)


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


def _apart(one: Solution, other: Solution) -> float:
    """Return how far the arcs of two solutions are apart, in horizons, at least a trifle."""
    horizon = other.final_time - other.initial_time
    times = [np.append(each.junctions, each.final_time) for each in (one, other)]
    return max(float(np.abs(times[0] - times[1]).max()) / horizon, _ZERO)


# -- events


def _passed(before: Margins, now: Margins) -> bool:
    """Tell whether a margin has passed through zero: the judge allows what is worth less than its
    tolerance.
    """
    return any(
        now[clue].value < -_CLEAR and each.value >= -_ZERO
        for clue, each in before.items()
        if clue in now
    )


def _changed(
    walk: Walk, inside: Trial, value: float, outside: Trial | tuple[float, Candidate] | None
) -> bool:
    """Go through the change of word between the last point and a value at which its word does not
    hold; returns whether there is another word to go on with. `outside`: what Newton makes of the
    word there, or where it is expected to end, with the next one.
    """
    near = outside if isinstance(outside, tuple) else None
    trial = outside if isinstance(outside, Trial) else None
    found = None if trial is None else _located(walk, inside, trial)
    there = found.trial.value if found else inside.value if near is None else near[0]
    for place in _beyond(walk, there, value):
        known = [each for each in (found.trial if found else inside, trial) if each is not None]
        other = _mended(walk, place, known, [] if near is None else [near[1]])
        if other is None:
            continue
        if other.followed != inside.solution.followed:
            event = _event(walk, inside, found, Point(place, other))
            if event is None:
                continue
            walk.events.append(event)
        walk.points.append(Point(place, other))
        return True
    if found is not None:
        walk.events.append(_named(walk, found, found, inside.solution.word, ""))
    return False


def _beyond(walk: Walk, there: float, value: float) -> list[float]:
    """Return where the word beyond an event is tried, on the way to a value."""
    if abs(walk.span[1] - there) <= _EVENT * abs(walk.width):
        return [walk.span[1]]
    left = value - there
    if abs(left) <= _SMALLEST * abs(walk.width):
        left = walk.width / _STEPS
    return [float(np.clip(there + s * left, min(walk.span), max(walk.span))) for s in _BEYOND]


def _located(walk: Walk, inside: Trial, outside: Trial) -> Zero | None:
    """Return the first zero of a margin on the way from one trial to another; None where no margin
    passes through zero.
    """
    zeros = []
    for clue in list(inside.margins):
        a, b = inside.margins[clue], outside.margins.get(clue)
        if b is None or a.value < -_ZERO or b.value > (_ZERO if a.value > _ZERO else -_CLEAR):
            continue
        if a.value <= _ZERO:
            zeros.append(Zero(inside, clue))
        else:
            there = _zero(walk, clue, inside, outside)
            zeros += [] if there is None else [Zero(there, clue)]
    return min(zeros, key=lambda each: abs(each.trial.value - inside.value), default=None)


def _zero(walk: Walk, clue: Clue, inside: Trial, outside: Trial) -> Trial | None:
    """Solve for the value at which a margin is zero, each time by Newton from inside."""
    known = {inside.value: inside, outside.value: outside}

    def height(value: float) -> float:
        if value not in known:
            whole = [each for each in known.values() if _whole(each.solution)]
            near = min(whole, key=lambda each: abs(each.value - value))
            found = walk.tried(value, near)
            if found is None or clue not in found.margins:
                raise ArithmeticError
            known[value] = found
        return known[value].margins[clue].value

    if outside.margins[clue].value >= -_ZERO:  # it is zero there
        return outside
    with suppress(ArithmeticError, RuntimeError):
        xtol = _LOCATED * abs(walk.width)
        root = brentq(height, inside.value, outside.value, xtol=xtol, maxiter=40)
        height(root)
        return known[root]
    return None


def _whole(solution: Solution) -> bool:
    return min(each.value for each in lengths(solution).values()) > _ZERO


def _mended(
    walk: Walk, value: float, trials: list[Trial], expected: list[Candidate]
) -> Solution | None:
    """Return a certified solution at a value along a word that is expected, or that mends what is
    amiss at trials.
    """
    problem = walk.at(value)
    walk.tell(value, "")
    learn(problem, trials[0].solution)
    batches = _batches(problem, [each.solution for each in trials], expected)
    found = try_words(problem, batches, Search(), silent, _WORDS)
    return None if found is None or not found.extremal else with_second_order(problem, found)


def _batches(
    problem: Problem, starts: list[Solution], expected: list[Candidate]
) -> Iterator[list[Candidate]]:
    yield expected
    for start in starts:
        yield list(mends(problem, word_of(start), start))
    yield [word_of(starts[0])]


def _event(walk: Walk, inside: Trial, forth: Zero | None, beyond: Point) -> Event | None:
    """Return the event between a point and one beyond, None where the two are not of one branch.

    Where an arc loses its length the conditions of its word may be degenerate, and where it is one
    inside another there are none beyond. The word without it knows no such thing: the zero is
    sought on the way back along that.
    """
    back = None
    if forth is None or forth.clue.kind == "length":
        known = margins(walk.at(beyond.value), beyond.solution)
        home = walk.tried(inside.value, beyond)
        other = Trial(beyond.value, beyond.solution, known)
        back = None if home is None else _located(walk, other, home)
    there = back or forth
    if there is None:
        return None
    side = inside if back else beyond
    met = walk.tried(there.trial.value, side)
    if met is not None and not _meet(met.solution, there.trial.solution):
        return None
    return _named(walk, there, forth, inside.solution.word, beyond.solution.word)


def _meet(one: Solution, other: Solution) -> bool:
    """Tell whether two solutions of one problem are one and the same."""
    size = max(abs(one.objective), abs(other.objective))
    return abs(one.objective - other.objective) <= _SAME * size


def _named(walk: Walk, there: Zero, forth: Zero | None, before: str, after: str) -> Event:
    """Return the event at a zero of a margin, called by the zero that was met on the way forth,
    where one was.
    """
    called = forth or there
    kind, where = named(called.trial.solution, called.clue, back=forth is None)
    return Event(
        value=there.trial.value,
        error=_LOCATED * abs(walk.width),
        kind=kind,
        where=where,
        time=there.trial.margins[there.clue].time,
        before=before,
        after=after,
        solution=there.trial.solution,
    )


def _lost(walk: Walk) -> str:
    """Say where a branch ends that cannot be followed any more."""
    now = walk.points[-1]
    return (
        f"{walk.name} = {now.value:.12g}: nothing certified goes on from here; the branch ends, or "
        "folds back"
    )

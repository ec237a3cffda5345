"""Events of a branch: where the margins of its word pass through zero, and the word beyond."""

from collections.abc import Iterator
from contextlib import suppress

import numpy as np
from scipy.interpolate import BarycentricInterpolator
from scipy.optimize import brentq

from socp.model import Problem, Solution, silent
from socp.process import time_limit
from socp.search import Candidate, Search, mends, merged, neighbour, past, try_words, word_of
from socp.study.branch import Event, Point
from socp.study.monitors import CURVATURE, Clue, Margins, lengths, margins
from socp.study.naming import LEFT, MET, MINIMUM, TOUCHED, TURNED, named
from socp.study.walk import ASTRAY, EVENT, SMALLEST, STEPS, ZERO, Trial, Walk, Zero, apart
from socp.verdict import learn, with_second_order

_CLEAR = 1e-7  # of its size: one that is further on the wrong side has passed through zero
_LOCATED = 1e-12  # of the span: where a zero of a figure is sought no closer
# Of a step: how far beside the zero of the curvature, where the conditions are singular, it is
# looked at, ever nearer; the polynomial through four of them is off by the fourth power
_NEARER, _NODES = (0.1, 1e-2, 1e-3), (-2.0, -1.0, 1.0, 2.0)
_ROUNDS = 30  # of a zero that is approached from one side: secants take six or so
_BEYOND = (0.25, 0.05, 1.0)  # of the step left: where the word beyond an event is tried
_WORDS, _SECONDS = 12, 30.0  # words tried there at most, and the time for them
_SAME = 1e-6  # relative: by how much the objectives of two words may differ where they meet


def passed(before: Margins, now: Margins) -> bool:
    """Tell whether a margin has passed through zero: the judge allows what is worth less than its
    tolerance.
    """
    return any(
        now[clue].value < -_CLEAR and each.value >= -ZERO
        for clue, each in before.items()
        if clue in now and clue != CURVATURE
    )


def minimality(walk: Walk, before: Trial, now: Trial) -> Iterator[Event]:
    """Yield the event between two trials of one word at which the extremal ceases to be a minimum,
    or becomes one: an extremal it is on either side.
    """
    a, b = (each.margins.get(CURVATURE) for each in (before, now))
    if (
        a is None
        or b is None
        or not min(a.value, b.value) < -_CLEAR < _CLEAR < max(a.value, b.value)
    ):
        return
    zeros = [float("inf"), *_flattened(walk, before, now)]
    word = now.solution.word
    yield Event(
        value=zeros[-1],
        error=max(abs(zeros[-1] - zeros[-2]), _LOCATED * abs(walk.width)),
        kind=MINIMUM[a.value < b.value],
        where=walk.name,
        time=float("nan"),
        before=word,
        after=word,
        place=len(walk.points),
    )


def _flattened(walk: Walk, before: Trial, now: Trial) -> Iterator[float]:
    """Yield values of the number at which the curvature between two trials is zero, ever better:
    by the polynomial through some of them, the number over the curvature.
    """
    known, step = [before, now], now.value - before.value
    zero = _crossed(known, CURVATURE)  # they differ in sign
    yield zero
    for share in _NEARER:
        near = min((before, now), key=lambda each: abs(each.value - zero))
        tried = (walk.tried(zero + node * share * step, near) for node in _NODES)
        found = [each for each in tried if each is not None and CURVATURE in each.margins]
        if len(found) < len(_NODES):
            return
        nearer = _crossed(found, CURVATURE)
        if not min(before.value, now.value) <= nearer <= max(before.value, now.value):
            return
        zero = nearer
        yield zero


def _crossed(trials: list[Trial], clue: Clue) -> float:
    """Return the number at which a margin of trials is zero, by the polynomial through them, nan
    where it does not move.
    """
    heights = [each.margins[clue].value for each in trials]
    if len(set(heights)) < len(heights):
        return float("nan")
    return float(BarycentricInterpolator(heights, [each.value for each in trials])(0.0))


def changed(
    walk: Walk, inside: Trial, value: float, outside: Trial | tuple[float, list[Solution]] | None
) -> bool:
    """Go through the change of word between the last point and a value at which its word does not
    hold; returns whether there is another word to go on with. `outside`: what Newton makes of the
    word there, or where it is expected to end, with guesses along the next one.
    """
    near = outside if isinstance(outside, tuple) else None
    trial = outside if isinstance(outside, Trial) else None
    found = None if trial is None else _located(walk, inside, trial)
    there = found.trial.value if found else inside.value if near is None else near[0]
    expected = [] if near is None else near[1]
    if found is not None and found.clue.kind == "length":
        expected = past(inside.solution, found.clue.number)
    for place in _beyond(walk, there, value):
        known = [each for each in (found.trial if found else inside, trial) if each is not None]
        other = _mended(walk, place, known, expected)
        if other is None:
            continue
        if other.followed != inside.solution.followed:
            event = _event(walk, inside, found, Point(place, other))
            if event is None:
                continue
            walk.events.append(event)
        elif apart(inside.solution, other) > ASTRAY:  # of another branch
            continue
        walk.points.append(Point(place, other))
        return True
    walk.last = found and _named(walk, found, found, inside.solution, None)
    return False


def _beyond(walk: Walk, there: float, value: float) -> list[float]:
    """Return where the word beyond an event is tried, on the way to a value."""
    if abs(walk.span[1] - there) <= EVENT * abs(walk.width):
        return [walk.span[1]]
    left = value - there
    if abs(left) <= SMALLEST * abs(walk.width):
        left = walk.width / STEPS
    return [float(np.clip(there + s * left, min(walk.span), max(walk.span))) for s in _BEYOND]


def _located(walk: Walk, inside: Trial, outside: Trial) -> Zero | None:
    """Return the first zero of a margin on the way from one trial to another; None where no margin
    passes through zero.
    """
    zeros = []
    for clue in list(inside.margins):
        a, b = inside.margins[clue], outside.margins.get(clue)
        if b is None or a.value < -ZERO or b.value > (ZERO if a.value > ZERO else -_CLEAR):
            continue
        if a.value <= ZERO:
            zeros.append(Zero(inside, clue))
        else:
            there = _zero(walk, clue, inside, outside)
            zeros += [] if there is None else [Zero(there, clue)]

    def steps(each: Zero) -> int:
        """Return how many widths of an event a zero is away."""
        return round(abs(each.trial.value - inside.value) / (EVENT * abs(walk.width)))

    # of some as near a length, which is the first of all
    return min(zeros, key=steps, default=None)


def _zero(walk: Walk, clue: Clue, inside: Trial, outside: Trial) -> Trial | None:
    """Solve for the value at which a margin is zero, each time by Newton from inside."""
    known = {inside.value: inside, outside.value: outside}

    def height(value: float) -> float:
        """Return the function of which a zero is looked for, at a value of the number."""
        if value not in known:
            whole = [each for each in known.values() if _whole(each.solution)]
            near = min(whole, key=lambda each: abs(each.value - value))
            found = walk.tried(value, near)
            if found is None or clue not in found.margins:
                raise ArithmeticError
            known[value] = found
        return known[value].margins[clue].value

    if outside.margins[clue].value >= -ZERO:
        return outside if outside.holds else _approached(walk, clue, inside, outside)
    with suppress(ArithmeticError, RuntimeError):
        xtol = _LOCATED * abs(walk.width)
        root = brentq(height, inside.value, outside.value, xtol=xtol, maxiter=40)
        height(root)
        return known[root]
    return None


def _approached(walk: Walk, clue: Clue, inside: Trial, outside: Trial) -> Trial | None:
    """Solve for the value at which a margin is zero from inside alone: a multiplier that would have
    the wrong sign beyond is none of the judge's, who looks for others there.
    """
    good, value = [inside], (inside.value + outside.value) / 2.0
    for _ in range(_ROUNDS):
        found = walk.tried(value, good[-1])
        if found is None or not found.holds or clue not in found.margins:
            value = (good[-1].value + value) / 2.0
            continue
        good.append(found)
        if abs(found.margins[clue].value) <= ZERO:
            return found
        value = _crossed(good[-len(_NODES) :], clue)
        if not min(inside.value, outside.value) <= value <= max(inside.value, outside.value):
            return None
    return None


def _whole(solution: Solution) -> bool:
    return min(each.value for each in lengths(solution).values()) > ZERO


def _mended(
    walk: Walk, value: float, trials: list[Trial], expected: list[Solution]
) -> Solution | None:
    """Return a certified solution at a value along a word that is expected, or that mends what is
    amiss at trials.
    """
    problem, origin = walk.at(value), walk.at(trials[0].value)
    walk.tell(value, "")
    learn(problem, trials[0].solution)
    found = next(filter(None, (neighbour(problem, each, origin) for each in expected)), None)
    if found is None:
        batches = _batches(problem, [each.solution for each in trials], expected)
        with time_limit(_SECONDS):
            found = try_words(problem, batches, Search(), silent, _WORDS)
    return None if found is None or not found.extremal else with_second_order(problem, found)


def _batches(
    problem: Problem, starts: list[Solution], expected: list[Solution]
) -> Iterator[list[Candidate]]:
    yield [merged(word_of(each)) for each in expected]
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
    return _named(walk, there, forth, inside.solution, beyond.solution)


def _meet(one: Solution, other: Solution) -> bool:
    """Tell whether two solutions of one problem are one and the same."""
    size = max(abs(one.objective), abs(other.objective))
    return abs(one.objective - other.objective) <= _SAME * size


def _named(
    walk: Walk, there: Zero, forth: Zero | None, before: Solution, after: Solution | None
) -> Event:
    """Return the event at a zero of a margin, called by the zero that was met on the way forth,
    where one was, between solutions before and after it.
    """
    called = forth or there
    kind, where = named(called.trial.solution, called.clue, back=forth is None)
    if (
        kind != MET
        and after is not None
        and called.clue.kind == "length"
        and _turned(before, after)
    ):
        kind = TURNED
    if after is not None and called.clue.kind == "length":
        kind, where = _limited(before, after) or (kind, where)
    return Event(
        value=there.trial.value,
        error=_LOCATED * abs(walk.width),
        kind=kind,
        where=where,
        time=there.trial.margins[there.clue].time,
        before=before.word,
        after="" if after is None else after.word,
        place=len(walk.points),
        solution=there.trial.solution,
    )


def _limited(before: Solution, after: Solution) -> tuple[str, str] | None:
    """Return what happens to a state constraint that is followed by the arcs of one of two
    solutions alone, and to which; None where there is none.

    Its arc vanishes, or appears, where the constraint is left, or touched: which of the two figures
    passes through zero first is rounding, and the name that of what is the same either way.
    """
    on, then = _constraints(before), _constraints(after)
    if on == then:
        return None
    return (LEFT, min(on - then)) if on - then else (TOUCHED, min(then - on))


def _constraints(solution: Solution) -> set[str]:
    """Return the state constraints that arcs follow."""
    return {str(m.constraint) for arc in solution.arcs for m in arc.modes if m.constraint}


def _turned(before: Solution, after: Solution) -> bool:
    """Tell whether two words differ in nothing but which bound a control is at."""
    pairs = zip(before.followed.arcs, after.followed.arcs, strict=False)
    apart = [{a.kind, b.kind} for m, n in pairs for a, b in zip(m, n, strict=True) if a != b]
    alike = len(before.followed.arcs) == len(after.followed.arcs)
    return alike and bool(apart) and all(each == {"lower", "upper"} for each in apart)

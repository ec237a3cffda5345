"""Following an extremal in a number of its problem, through changes of its word.

A step predicts by the last two solutions, corrects by Newton on the conditions of the word, and is
judged. Where the judge does not certify it, the word has changed on the way: the figure that has
passed through zero is located by solving for its zero in the number, and the word that holds beyond
is the one that mends what the judge has found. Where the number turns back the branch goes round.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from socp.errors import MethodError, SolveError
from socp.model import Family, Problem, Solution, Watch, silent
from socp.process import breakable
from socp.search import Search, warm_start
from socp.study.branch import Branch, Point
from socp.study.census import explore
from socp.study.events import changed, minimality, passed
from socp.study.folds import rounded
from socp.study.monitors import margins
from socp.study.naming import FOLD
from socp.study.numbers import numbers_of
from socp.study.walk import ASTRAY, SMALLEST, STEPS, Trial, Walk, apart, predicted, vanishing
from socp.verdict import with_second_order, with_statement

_STARTS = 3  # of a census, for the first solution
_PREDICTED = 0.01  # of the horizon: how far a prediction may be off, by which steps are chosen
_TRIES = 2  # changes of word that are tried from one point before a branch is given up
_GROWN, _CUT = 2.0, 0.25  # times the last step, at most and at least


def follow(
    problem: Problem,
    numbers: Mapping[str, tuple[float, float]],
    guess: Solution | None = None,
    *,
    steps: int = STEPS,
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
    name, span = _checked(numbers)
    if steps < 1:
        raise MethodError(f"steps={steps}, but it must be at least 1")
    family = Family(problem, (name,))
    walk = Walk(family, name, span, watch)
    first, _ = problem.with_({name: span[0]}), problem.with_({name: span[1]})
    ended, interrupted = "", False
    start = with_second_order(first, _first(first, guess, watch))
    walk.points.append(Point(span[0], family.inside(start, family.at({name: span[0]}))))
    try:
        with breakable():
            ended = _walked(walk, steps)
    except KeyboardInterrupt:
        interrupted = True
    points = tuple(Point(each.value, _own(walk, each.value, each.solution)) for each in walk.points)
    events = tuple(
        each
        if each.solution is None
        else replace(each, solution=_own(walk, each.value, each.solution))
        for each in walk.events
    )
    return Branch(problem.name, name, points, events, ended, interrupted)


def followed_to(
    problem: Problem,
    start: Mapping[str, float],
    guess: Solution | None = None,
    *,
    watch: Watch = silent,
) -> Solution:
    """Return an extremal of a problem that is hard from nothing, by way of an easier one, in which
    a number has the value that it has in `start`: solved there, and followed to its own value.

    `guess`: a solution there, or near it. Raises MethodError for anything but one number that the
    problem has another value of, SolveError where no extremal is found to begin with, or the branch
    ends before, with what it says.
    """
    own = numbers_of(problem)
    for name in start:
        if name not in own:
            problem.with_(dict(start))  # names what there is instead
            raise MethodError(f"{name}: the problem has no value of it to follow it to")
    span = {name: (float(value), own[name]) for name, value in start.items()}
    found = follow(problem, span, guess, watch=watch)
    if found.interrupted:
        raise KeyboardInterrupt
    if found.ended:
        raise SolveError(f"{problem.name}: followed from {_told(start)}, but {found.ended}")
    return found.points[-1].solution


def _told(numbers: Mapping[str, float]) -> str:
    return ", ".join(f"{name} = {value:.6g}" for name, value in numbers.items())


def _own(walk: Walk, value: float, solution: Solution) -> Solution:
    """Return a solution of the family as one of its own problem."""
    problem = walk.family.problem.with_({walk.name: value})
    return with_statement(problem, walk.family.outside(solution))


def _checked(numbers: Mapping[str, tuple[float, float]]) -> tuple[str, tuple[float, float]]:
    if len(numbers) != 1:
        raise MethodError(f"a branch is followed in one number, but {len(numbers)} are given")
    ((name, given),) = numbers.items()
    span = tuple(float(each) for each in given)
    if len(span) != 2 or span[0] == span[1] or not np.isfinite(span).all():
        raise MethodError(f"{name}={span}: give two different values, where it begins and ends")
    return name, (span[0], span[1])


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
    longest = step = abs(walk.width) / steps
    before: Trial | None = None
    missed = 0
    here = _last(walk)
    while here.value != walk.span[1]:
        value = _ahead(walk, here.value, step)
        near = vanishing(walk, before, here, value)
        if near is not None and changed(walk, here, value, near):
            before, here = None, _last(walk)
            continue
        guess = predicted(before, here, value)
        trial = walk.tried(value, here, guess)
        if trial is not None and trial.holds and guess is not None:
            off = apart(guess, trial.solution)
            step = min(abs(value - here.value) * _times(off), longest)
            astray = off > ASTRAY
        else:
            astray = trial is None
        if astray and (turned := rounded(walk, here, value - here.value)):
            before, here, missed = (None, *turned)[-2], turned[-1], 0
            continue
        if astray and abs(value - here.value) > _CUT**2 * longest:
            step = _CUT * abs(value - here.value)
            continue
        if trial is not None and trial.holds and not passed(here.margins, trial.margins):
            walk.events += minimality(walk, here, trial)
            walk.points.append(Point(value, trial.solution))
            before, here, missed = here, trial, 0
            continue
        if changed(walk, here, value, trial):
            before, here, missed = None, _last(walk), 0
            continue
        missed, step = missed + 1, _CUT * abs(value - here.value)
        if missed >= _TRIES or step <= _CUT * SMALLEST * abs(walk.width):
            return _lost(walk, value)
    return _returned(walk) if walk.back else ""


def _last(walk: Walk) -> Trial:
    """Return the last point with its margins."""
    now = walk.points[-1]
    return Trial(now.value, now.solution, margins(walk.at(now.value), now.solution))


def _ahead(walk: Walk, value: float, step: float) -> float:
    """Return the value that is a step ahead, the last one where next to nothing is left to it."""
    found = value + float(np.copysign(step, walk.width))
    return walk.span[1] if (walk.span[1] - found) / walk.width <= SMALLEST else found


def _times(off: float) -> float:
    """Return by how much steps may grow where a prediction was so far off."""
    return float(np.clip(np.sqrt(_PREDICTED / off), _CUT, _GROWN))


def _returned(walk: Walk) -> str:
    """Say that a branch is back where it began."""
    folds = ", ".join(f"{each.value:.12g}" for each in walk.events if each.kind == FOLD)
    return (
        f"{walk.name} = {walk.span[1]:.12g}: the branch is back at the value that it began at, "
        f"round its fold at {folds}"
    )


def _lost(walk: Walk, value: float) -> str:
    """Say where a branch ends that cannot be followed any more, on the way to a value, with the
    event at which it does.
    """
    now, name = walk.points[-1], walk.name
    next_ = (
        "beyond the problem may have none, as where its end comes out of reach: solve it at "
        f"{name} = {value:.6g} by itself, which tells"
    )
    if walk.last is not None:
        walk.events.append(walk.last)
        return (
            f"{name} = {walk.last.value:.12g}: no word was found beyond this event, the last "
            f"extremal is at {now.value:.12g}; {next_}"
        )
    return f"{name} = {now.value:.12g}: the last extremal that is certified; {next_}"

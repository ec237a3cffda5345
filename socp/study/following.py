"""Following an extremal in a number of its problem, through changes of its word.

A step predicts by the last two solutions, corrects by Newton on the conditions of the word, and is
judged. Where the judge does not certify it, the word has changed on the way: the figure that has
passed through zero is located by solving for its zero in the number, and the word that holds beyond
is the one that mends what the judge has found.
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
from socp.study.events import changed, passed
from socp.study.monitors import margins
from socp.study.walk import SMALLEST, STEPS, Trial, Walk, apart, predicted, vanishing
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
    walk.points.append(Point(span[0], family.inside(start, {name: span[0]})))
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
    longest = step = walk.width / steps
    before: Point | None = None
    missed = 0
    known = margins(walk.at(walk.span[0]), walk.points[-1].solution)
    while (now := walk.points[-1]).value != walk.span[1]:
        value = now.value + step
        if (walk.span[1] - value) / walk.width <= SMALLEST:
            value = walk.span[1]
        near = vanishing(walk, before, now, value)
        if near is not None and changed(walk, Trial(now.value, now.solution, known), value, near):
            before, now = None, walk.points[-1]
            known = margins(walk.at(now.value), now.solution)
            continue
        guess = predicted(before, now, value)
        trial = walk.tried(value, now, guess)
        if trial is not None and trial.holds and not passed(known, trial.margins):
            if guess is not None:
                grown = np.sqrt(_PREDICTED / apart(guess, trial.solution))
                step = (value - now.value) * float(np.clip(grown, _CUT, _GROWN))
                step = step if abs(step) < abs(longest) else longest
            before, known, missed = now, trial.margins, 0
            walk.points.append(Point(value, trial.solution))
            continue
        if trial is None and abs(step) > _CUT**2 * abs(longest):
            step *= _CUT
            continue
        if not changed(walk, Trial(now.value, now.solution, known), value, trial):
            missed += 1
            if missed < _TRIES and abs(step) > SMALLEST * abs(walk.width):
                step *= _CUT
                continue
            return _lost(walk, value)
        missed = 0
        before, now = None, walk.points[-1]
        known = margins(walk.at(now.value), now.solution)
    return ""


def _lost(walk: Walk, value: float) -> str:
    """Say where a branch ends that cannot be followed any more, on the way to a value, with the
    event at which it does.
    """
    now, name = walk.points[-1], walk.name
    next_ = (
        f"beyond the problem may have none, as where its end comes out of reach: solve it at "
        f"{name} = {value:.6g} by itself, which tells; or the branch folds back there: follow it "
        "from the other end"
    )
    if walk.last is not None:
        walk.events.append(walk.last)
        return (
            f"{name} = {walk.last.value:.12g}: no word was found beyond this event, the last "
            f"extremal is at {now.value:.12g}; {next_}"
        )
    return f"{name} = {now.value:.12g}: the last extremal that is certified; {next_}"

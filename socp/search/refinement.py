"""Structure refinement: from a direct solution to a word that the judge certifies, by solving,
judging and mending.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from socp.errors import MethodError, SolveError
from socp.laws import arc_modes
from socp.methods import Follower, follow_word, polished
from socp.model import (
    EXTREMAL,
    SHORTEST,
    Condition,
    Problem,
    Solution,
    Stop,
    Watch,
    Word,
    scales,
    silent,
)
from socp.process import seconds_left
from socp.search.candidate import Candidate
from socp.search.effort import Ration, Search, clearly
from socp.search.mending import collapsed, mends, starts, substitutes
from socp.search.neighbours import without_length
from socp.search.reading import read, with_hidden_bangs
from socp.verdict import learn, lower_sides, second_order, tested

_SOLVES = 40  # words tried before the search from one direct solution gives up
# Costates times their states, in the objective's units: below, a tolerance of 1e-11 costs digits
_FAINT = 1e-2
_CLEAR = 0.1  # what they are scaled to: more would ask for digits that rounding does not leave
_LARGEST = 1e6  # factor on the objective: what is fainter still is lost in the rounding of the cost
_NEARLY = 1e-4  # residual and miss: what is left of a wrong word is seldom less
# What Newton solves, and of the tolerance: below it holds three digits better than it has to
_SOLVED = frozenset(
    {
        *(Condition.SWITCH, Condition.INITIAL_TIME, Condition.FINAL_TIME, Condition.CONSTANT),
        *(Condition.START, Condition.PARAMETER, Condition.MOTION, Condition.OBJECTIVE),
    }
)
_EXACT = 1e-3
_DESCENTS = 4  # times that a search leaves an extremal that is no minimum for a lower one
_SIDE = 10  # words tried from one side of it: a switch has moved, or an arc has gone
_LATE = 1e3  # rank of what is tried once no mend is left: whatever mends it goes first
# Rank of what a grid shows: what mends a word whose residual is less goes first, as that is nearer
_SHOWN = 0.1
# Short arcs that a grid shows are tried as they stand up to so many; more of them are ringing
_PLAIN = 3


def refine(
    problem: Problem,
    direct: Solution,
    search: Search,
    watch: Watch = silent,
    solves: int = _SOLVES,
    *,
    late: bool = False,
) -> Solution | None:
    """Search for a certified word from a direct solution; returns the best judged solution so far,
    or None.

    Best first: what mends the solution with the least residual is tried next. It ends with the
    first certified word, or when nothing is left to try. `late` has other words to begin with, for
    when those have led nowhere.
    """
    learn(problem, direct)
    if late:
        return try_words(problem, _late(problem, direct, search), search, watch, solves)
    first, limits = read(problem, direct), read(problem, direct, limits=True)
    read_off = [first] if limits.key == first.key else [first, limits]
    shown = [with_hidden_bangs(problem, each) for each in read_off]
    return try_words(problem, _early(read_off), search, watch, solves, shown)


def try_words(
    problem: Problem,
    batches: Iterator[list[Candidate]],
    search: Search,
    watch: Watch = silent,
    solves: int = _SOLVES,
    shown: Sequence[Candidate] = (),
) -> Solution | None:
    """Try the words that are shown and what mends them, best first, another batch of words once
    none is left; returns as `refine` does.
    """
    queue = [(_SHOWN, each) for each in shown]
    seen: set[str] = set()  # what failed from another start may succeed from this one
    last = search.count + solves
    while search.count < last and not search.over:
        while not queue and (more := next(batches, None)) is not None:
            queue += [(_LATE, each) for each in more]
        if not queue:
            break
        _, now = queue.pop(min(range(len(queue)), key=lambda k: queue[k][0]))
        if search.known(now) or (now.key in seen and now.key not in search.solved):
            continue
        seen.add(now.key)
        search.count += 1
        word = str(Word(problem.control_names, now.arcs))
        solution = solve_word(problem, now, search.backend, search.watched(watch, word))
        search.note(word, solution)
        if solution is None or not solution.stop.ok:
            if solution is not None and solution.stop is Stop.INTERRUPTED:
                search.best = (
                    solution if search.best is None else replace(search.best, stop=Stop.INTERRUPTED)
                )
            else:
                near = substitutes(problem, now) if solution is None else collapsed(now, solution)
                queue += [(0.2 + 1e-3 * k, each) for k, each in enumerate(near)]
            continue
        search.solve(now, solution)
        search.keep(solution)
        residual = _residual(solution)
        queue += [
            (residual + 1e-3 * k, each) for k, each in enumerate(mends(problem, now, solution))
        ]
    return search.best


def lowered(
    problem: Problem, solution: Solution, backend: Ration, watch: Watch = silent
) -> Solution:
    """Return the best certified solution that is found from both sides of one that is no minimum,
    and so on; one that may be a minimum comes back as it is.
    """
    for _ in range(_DESCENTS):
        if seconds_left() <= 0.0 or second_order(problem, solution).descent is None:
            break
        searches = [Search(backend=backend) for _ in range(2)]
        for side, search in zip(lower_sides(problem, solution), searches, strict=False):
            refine(problem, side, search, watch, _SIDE)
        found = [each.best for each in searches if each.best is not None and each.best.extremal]
        best = min(found, key=lambda each: each.objective, default=solution)
        if not clearly(best, solution):
            break
        solution = best
    return solution


def _residual(solution: Solution) -> float:
    """Return the residual of a judged solution but for its arcs without length, which are dropped
    at no cost: what is left is how far its word is from the right one.
    """
    if solution.verdict is None:
        return 1.0
    kept = [each for each in solution.verdict.findings if each.kind is not Condition.NO_LENGTH]
    return max((each.residual for each in kept), default=1.0)


def _early(read_off: Sequence[Candidate]) -> Iterator[list[Candidate]]:
    """Yield what labels show first, then what either reading shows with bangs at the ends."""
    yield [read_off[0]]
    yield from (list(starts(each)) for each in read_off)


def _late(problem: Problem, direct: Solution, search: Search) -> Iterator[list[Candidate]]:
    """Yield the word of the grid as it stands, and once a search words near the controls in the
    integral.
    """
    first, plain = read(problem, direct), read(problem, direct, plain=True)
    if len(plain.arcs) <= len(first.arcs) + _PLAIN:
        yield [plain]
    if search.rounded:
        return
    search.rounded = True
    from socp.search.rounding import rounded_word  # it brings scipy's optimisers

    modes = arc_modes(problem)
    for switches in (max(len(first.arcs) - 1, 1), len(first.arcs) - 1 + _PLAIN):
        try:
            yield [rounded_word(problem, direct, modes, switches)]
        except SolveError:
            continue


def solve_word(problem: Problem, now: Candidate, backend: Ration, watch: Watch) -> Solution | None:
    """Solve along a candidate's word; None where there is no such programme.

    Where laws clearly leave the box and all else is as the principle has it, that is what is
    returned: where they are outside bounds belong, which the best motion inside the box hides.
    """
    word = Word(problem.control_names, now.arcs)
    follower = Follower(longer=False, exact=True, backend=backend)
    shown = list[tuple[Solution, Solution]]()

    def telling(outside: Solution) -> bool:
        shown.append((outside, tested(problem, outside)))
        verdict = shown[-1][1].verdict
        return verdict is not None and verdict.residual <= EXTREMAL and not verdict.feasible

    try:
        solution = follow_word(problem, word, now.guess(), follower, watch, telling)
    except (MethodError, SolveError):
        return None
    if not solution.stop.ok:
        return solution
    known = next((judged for given, judged in shown if given is solution), None)
    judged = known or tested(problem, solution)
    return _settled(problem, _sharpened(problem, word, judged, backend, watch))


def _settled(problem: Problem, solution: Solution) -> Solution:
    """Return what Newton makes of a nearly certified solution: the solver's tolerances may be all
    that is amiss, or arcs without length, without which the word has the same motion. Where every
    condition holds an arc is slack, and where those that Newton solves do so far better than asked,
    the others are not for it to mend.
    """
    verdict = solution.verdict
    if solution.extremal or verdict is None:
        return solution
    off = max(verdict.miss, verdict.drift)
    amiss = {each.kind for each in verdict.findings if not each.holds}
    if amiss == {Condition.NO_LENGTH} and off <= EXTREMAL:
        shortest = SHORTEST * (solution.final_time - solution.initial_time)
        found = _polished(problem, solution, without_length(solution, shortest))
        if found.extremal:
            return found
    if not max(_residual(solution), verdict.miss) <= _NEARLY:  # an arc may have a length thereafter
        return solution
    solved = (each.residual for each in verdict.findings if each.kind in _SOLVED)
    if not (amiss or off > EXTREMAL) or max(off, *solved) <= _EXACT * EXTREMAL:
        return solution
    return _polished(problem, solution, solution)


def _polished(problem: Problem, solution: Solution, guess: Solution) -> Solution:
    """Return what Newton makes of a guess where that is certified, else the solution."""
    found = polished(problem, guess)
    judged = solution if found is None else tested(problem, found)
    return judged if judged.extremal else solution


def _sharpened(
    problem: Problem, word: Word, solution: Solution, backend: Ration, watch: Watch
) -> Solution:
    """Solve once more with the objective scaled up where costates are small: a solver's tolerance
    on them is absolute.
    """
    weight = float(
        np.nanmax(
            np.abs(solution.rows("costate")) * scales(problem, solution)[:, None], initial=0.0
        )
    )
    if solution.extremal or not 0.0 < weight < _FAINT:
        return solution
    factor = min(_CLEAR / weight, _LARGEST)
    scaled = Ration(backend.left, backend.backend.scaled(factor))
    sharper = Follower(longer=False, backend=scaled)(problem, word, solution, watch).after(solution)
    backend.left = scaled.left
    if sharper.stop is Stop.INTERRUPTED:
        return replace(solution, stop=Stop.INTERRUPTED)
    return tested(problem, sharper) if sharper.stop.ok else solution

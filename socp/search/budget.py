"""More of everything while nothing is certified and time is left: finer grids, motions as guesses,
more iterations along a word.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cmp_to_key
from itertools import islice
from typing import final

from socp.errors import SolveError
from socp.methods import descended, motions, scouts_from_motions, solve_directly
from socp.model import FEASIBLE, Problem, Solution, Stop, Watch, silent, staged
from socp.process import seconds_left, time_limit
from socp.search.effort import FAR, FINEST, Ration, Search, along_words, off, precedes
from socp.search.motions import adapted, held_solution, own_motion, stated_error
from socp.search.neighbours import word_of
from socp.search.refinement import refine, try_words
from socp.solvers import Backend
from socp.transcription import Mesh, euler, knotted, radau_iia
from socp.verdict import chattering


@final
@dataclass(frozen=True)
class Round:
    """What one more round of a search may do.

    finer: times the steps of the first grids; work: iterations times variables; words: tried;
    iterations: along one word, of which a right one may take thousands where its laws carry
    costates; share: of the time that is left; near: whether words are solved as from nearby.
    """

    finer: int
    work: float
    words: int
    iterations: int
    share: float
    near: bool


# each four times as fine as the one before and some ten times its work: time ends them, not these.
# What words near their guesses have not led to is left to the last
ROUNDS = (Round(4, 1e7, 120, 1000, 0.6, near=True), Round(FINEST, 1e8, 240, 5000, 1.0, near=False))
# Of the time allowed: what the search leaves for what concludes it, the best direct solution on
# finer grids and the words of fewer switches of one that chatters; of this, what is left for the
# verdict on what is returned
_CONCLUDING, _VERDICT = 0.2, 0.08
# Of the time allowed, at most: coarse grids may show none but wrong words, without end
_FIRST = 0.25
# The same of scouting: what has been met by then leaves time for a word
_SCOUTING = _FIRST / 2.0
# Of the time that the first round leaves, at most: motions as guesses, where no grid has followed
# one; and of what these leave, a control improved along its own motion
_MOVING, _DESCENDING = 0.4, 0.25
# Of the time that a round has, at most: stiff motions of many solutions take longer than a word
_LOOKING = 0.25
# Of the time that the rounds have, at most: what is returned where no word is certified
_HOLDING = 0.2
_STARTS = 3  # solutions in hand from which a round starts; others are worse
# Relative: a grid whose control takes the states further from what it claims has not followed the
# motion, and is no start
_CLAIMED = 1e-2
# The same beyond which all grids so far are taken to have jumped over the motion: coarse ones are
# off by a few per cent where they have not
_JUMPED = 0.1
# Of the time of a round, at most: a finer grid may show the right word at once, where no mend leads
# on from the best one so far
_LEADING = 0.25
_LED = 20  # words tried from the best one of the rounds before: half of what one grid is worth
# Of the time of a round, at most, and grids: each cut has up to four times as fine a look at where
# it matters, and three of them find what is over within a hundredth of a first interval
_ADAPTING, _ADAPTED = 0.4, 4
_ITERATIONS = 500  # what a direct solve has not reached by then it hardly ever reaches
_MOTIONS = 3  # those that keep best to the box; other horizons are the scouts' concern


def time_shares(seconds: float) -> tuple[float, float, float, float]:
    """Return how much of the time allowed goes into all but the verdict, into the search, into its
    first round, and of this into scouting.
    """
    shares = 1.0 - _VERDICT, 1.0 - _CONCLUDING, _FIRST, _SCOUTING
    return shares[0] * seconds, shares[1] * seconds, shares[2] * seconds, shares[3] * seconds


def escalate(
    problem: Problem,
    search: Search,
    directs: list[Solution],
    first: tuple[Solution | None, int, Backend],
    watch: Watch = silent,
) -> None:
    """Go on with a search that has certified nothing, round by round, until it has, or its time is
    over.

    first: the guess, None where no other is to be tried, the steps of the first grids, and the
    solver of direct problems. Where no direct solution is that of its own control, motions are
    guesses, and a control is improved along its own motion; the best one is solved again with
    controls that are held over every interval. What is solved joins the direct solutions; where
    none ever is, there are no words to read. Where the best word chatters, no number of words
    certifies one.
    """
    guess, steps, backend = first
    apart: list[Solution] = []
    lost = not _done(problem, search) and not any(_followed(problem, each) for each in directs)
    if guess is not None and lost:
        with time_limit(_MOVING * seconds_left()):
            directs += scouts_from_motions(problem, guess, staged(watch, "motions"), backend)
        if directs and directs[-1].stop is Stop.INTERRUPTED:
            raise KeyboardInterrupt
        with time_limit(_DESCENDING * seconds_left()):
            found = descended(problem, guess)
        apart += [] if found is None else [found]
    try:
        if not _done(problem, search):
            apart += _held(problem, [*directs, *apart], backend, staged(watch, "held controls"))
        _rounds(problem, search, (directs, apart), (steps, backend), watch)
    finally:  # to conclude with; its many short arcs show words no better than a grid's
        directs += apart


def _rounds(
    problem: Problem,
    search: Search,
    known: tuple[list[Solution], list[Solution]],
    grids: tuple[int, Backend],
    watch: Watch,
) -> None:
    """Go through the rounds, from direct solutions and those that stand apart, the steps of the
    first grids and the solver of direct ones.
    """
    (directs, apart), (steps, backend) = known, grids
    for number, more in enumerate(ROUNDS, 2):
        if (
            _done(problem, search)
            or seconds_left() <= 0.0
            or not any(each.stop.ok for each in directs)
        ):
            break
        patient = along_words(backend, more.iterations, near=more.near)
        search.begin(Ration(more.work, patient), more.words, more.finer * steps)
        told = staged(watch, f"round {number} of {len(ROUNDS) + 1}")
        with time_limit(seconds_left() * more.share):
            with time_limit(_LEADING * seconds_left()):
                lead(problem, search, told)
            if not search.over and more is ROUNDS[0]:
                with time_limit(_ADAPTING * seconds_left()):
                    apart += _cut(problem, search, [*directs, *apart], backend, told)
            how = meshes(problem, more.finer * steps), backend.limited(_ITERATIONS)
            if not search.over:
                _round(problem, search, directs, how, told)
    search.late = seconds_left() <= 0.0


def lead(problem: Problem, search: Search, watch: Watch = silent) -> None:
    """Go on from the best word that is not certified, with what the judge misses there: it is
    solved again from its own solution, with as many iterations as the round has, and mended.
    """
    best = search.other
    if best is None or not best.lawful or not off(best) <= _CLAIMED:
        return
    try_words(problem, iter([[word_of(best)]]), search, watch, _LED)


def _cut(
    problem: Problem, search: Search, known: Sequence[Solution], backend: Backend, watch: Watch
) -> list[Solution]:
    """Go from the best solution over grids that are cut where it is worth it, and refine from that
    of the least error; returns what is solved on them.
    """
    start = next((each for each in _starts(problem, known) if each.stop.ok), None)
    if start is None:
        return []
    with time_limit(seconds_left() / 2.0):
        grids = adapted(problem, start, backend, staged(watch, "grid"))
        found = list(islice(grids, _ADAPTED))
    if found:
        refine(problem, min(reversed(found), key=stated_error), search, watch)
    return found


def _round(
    problem: Problem,
    search: Search,
    directs: list[Solution],
    how: tuple[Sequence[Mesh], Backend],
    watch: Watch,
) -> None:
    for start in _starts(problem, list(directs)):
        for direct in _shown(problem, start, how, watch):
            directs.append(direct)
            own = own_motion(problem, direct)  # states that the control does lead to, if it does
            refine(problem, own if off(own) <= _CLAIMED else direct, search, watch)
            if search.over:
                return


def _held(
    problem: Problem, directs: Sequence[Solution], backend: Backend, watch: Watch
) -> list[Solution]:
    """Return what direct solutions come to with held controls, those that claim far less than the
    best one first: of a motion that no grid has followed theirs may be wrong in digits alone.
    Nothing where that fails.
    """
    found: list[Solution] = []
    with time_limit(_HOLDING * seconds_left()):
        solved = [each for each in directs if each.stop.ok]
        best = next((each for each in _starts(problem, solved) if each.stop.ok), None)
        for start in [] if best is None else [*_claiming(best, solved), best]:
            held = held_solution(problem, start, backend, watch)
            if held is not None and held.stop is Stop.INTERRUPTED:
                raise KeyboardInterrupt
            if held is not None and held.stop.ok:
                found.append(held)
                if off(own_motion(problem, held)) <= FEASIBLE:
                    break
    return found


def _claiming(best: Solution, solved: Sequence[Solution]) -> list[Solution]:
    """Return the direct solution of the finer grids that claims least, where that is far less than
    the best one reaches.
    """
    finest = max(each.t.size for each in solved)
    fine = [each for each in solved if 2 * each.t.size >= finest]
    least = min(fine, key=lambda each: each.objective)
    less = best.reached - least.objective > FAR * abs(least.objective)
    return [least] if less and least.objective < best.objective else []  # else it is the best one


def _done(problem: Problem, search: Search) -> bool:
    """Tell whether nothing is to be gained: a word is certified or chatters, all is told but
    what no grid shows, or the search was interrupted.
    """
    best = search.best
    return best is not None and (
        bool(best.extremal or search.told)
        or best.stop is Stop.INTERRUPTED
        or bool(best.structure and chattering(problem, best))
    )


def _followed(problem: Problem, direct: Solution) -> bool:
    """Tell whether the control of a direct solution reaches what the solution claims, roughly."""
    if not direct.stop.ok:
        return False
    return off(own_motion(problem, direct)) <= _JUMPED


def meshes(problem: Problem, steps: int) -> tuple[Mesh, ...]:
    """Return the grids from which words are read: a precise one, and one that rings little."""
    return knotted(problem, radau_iia(2), steps // 2), knotted(problem, euler(), 2 * steps)


def _starts(problem: Problem, directs: Sequence[Solution]) -> Iterator[Solution]:
    """Yield the solutions in hand, the best ones first, then motions: grids may have jumped over
    what these follow. None where nothing is in hand.
    """
    if not directs:
        return
    with time_limit(_LOOKING * seconds_left()):
        solved = [own_motion(problem, each) for each in directs if each.stop.ok]
    ordered = sorted(solved, key=cmp_to_key(_order))
    groups = [iter(ordered[:_STARTS]), _runs(problem, (ordered or directs)[0])]
    if not ordered or not off(ordered[0]) <= _CLAIMED:
        groups.reverse()
    for group in groups:
        yield from group


def _runs(problem: Problem, start: Solution) -> Iterator[Solution]:
    """Yield motions from the start, over its own horizon."""
    with time_limit(_LOOKING * seconds_left()):
        found = list(islice(motions(problem, start, own=True), _MOTIONS))
    yield from found


def _order(one: Solution, other: Solution) -> int:
    return -1 if precedes(one, other) else 1


def _shown(
    problem: Problem, start: Solution, how: tuple[Sequence[Mesh], Backend], watch: Watch
) -> Iterator[Solution]:
    """Yield the direct solutions from a start, each mesh from the one before it."""
    for mesh in how[0]:
        if seconds_left() <= 0.0:
            return
        try:
            direct = solve_directly(problem, mesh, how[1], start, staged(watch, "grid"))
        except SolveError:
            continue
        if direct.stop is Stop.INTERRUPTED:
            raise KeyboardInterrupt
        if direct.stop.ok:
            start = direct
            yield direct

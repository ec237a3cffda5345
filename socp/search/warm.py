"""Warm starts: a neighbouring problem along the word of its guess, without scouting."""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from socp.errors import MethodError
from socp.methods import Follower, limits_met, polished, sound
from socp.model import SAME_TIME, Origin, Problem, Solution, Stop, Watch, known_problem, silent
from socp.search.effort import Ration, Search
from socp.search.neighbours import past, word_of
from socp.search.refinement import try_words
from socp.transcription import refined_meshes, resampled, unresolved
from socp.verdict import certified, learn

# Words tried from the guess's own before the search begins anew: where that does not hold any more,
# an arc has come or gone, or its switches have to be solved for from afar
_WORDS = 10
# Arcs of a word that may have come to an end between a guess and a problem: as many as turn where
# start and end both pass through a singular surface
_TURNS = 2
_ALONG = "Newton on the conditions of the guess's word"
_BESIDE = "Newton on the conditions of a word next to the guess's"


def warm_start(
    problem: Problem, guess: Solution, search: Search, watch: Watch = silent
) -> Solution | None:
    """Return a certified solution along the word of a guess, or along one next to it; None where
    the guess has no word or that leads to none. One that is interrupted comes back with that stop,
    the guess itself where nothing better is known yet.

    Newton on the conditions of the word starts from the guess's states and lengths, with the
    multipliers that fit them best. Where it does not settle, or on no extremal, the word is solved
    by collocation and mended. What leads nowhere takes neither words nor work from the search.
    """
    if not guess.lawful:
        return None
    own = Search(backend=Ration(search.backend.left, search.backend.backend), steps=search.steps)
    try:
        found = _found(problem, guess, own, watch)
    except KeyboardInterrupt:
        found = replace(own.best or _unjudged(problem, guess), stop=Stop.INTERRUPTED)
    search.nodes += own.nodes
    if found is not None and found.extremal:
        search.keep(found)
        search.count += own.count
    return found


def _found(problem: Problem, guess: Solution, own: Search, watch: Watch) -> Solution | None:
    found = next_to(problem, guess, _origin(problem, guess), own)
    if found is not None:
        return found
    best = try_words(problem, iter([[word_of(guess)]]), own, watch, _WORDS)
    if best is None or not (best.extremal or best.stop is Stop.INTERRUPTED):
        return None
    return best


def next_to(problem: Problem, guess: Solution, origin: Problem, search: Search) -> Solution | None:
    """Return the certified solution that Newton makes of a guess, a solution of `origin`, once it
    is learned from, and note it in a search; None where there is none, the guess where that is
    interrupted.
    """
    try:
        learn(problem, guess)
        found = beside(problem, guess, origin)
    except KeyboardInterrupt:
        return replace(_unjudged(problem, guess), stop=Stop.INTERRUPTED)
    if found is not None:
        search.note(found.word, found)
    return found


def beside(
    problem: Problem, guess: Solution, origin: Problem, turns: int = _TURNS
) -> Solution | None:
    """Return the certified solution that Newton makes of a guess along its word, or along one that
    holds where arcs of it have lost their lengths, up to so many in turn; None where there is none.
    `origin`: the problem that the guess is a solution of.
    """
    along = continued(problem, guess, origin)
    if along is None:
        finer = _finer(origin, guess)
        along = None if finer is None else continued(problem, finer, origin)
    if along is None:
        return None
    lengths = np.array([arc.t[-1] - arc.t[0] for arc in along.arcs])
    if lengths.min() > 0.0:
        return _held(problem, along)
    gone = [int(k) for k in np.argsort(lengths) if lengths[k] <= 0.0] if turns else []
    others = (each for k in gone for each in reversed(past(guess, k)))
    tried = (beside(problem, each, origin, turns - 1) for each in others)
    found = next(filter(None, tried), None)
    return None if found is None else replace(found, message=_BESIDE)


def neighbour(
    problem: Problem, guess: Solution, origin: Problem, ahead: Solution | None = None
) -> Solution | None:
    """Return what Newton makes of a guess, where that is certified; arguments as of `continued`."""
    found = continued(problem, guess, origin, ahead)
    return None if found is None else _held(problem, found)


def _held(problem: Problem, found: Solution) -> Solution | None:
    """Return a solution of the conditions of a word with its verdict, on finer meshes where those
    that it has leave out too much of it; None where it is not certified.
    """
    judged = _certified(problem, found)
    if judged is not None or min(arc.t[-1] - arc.t[0] for arc in found.arcs) <= 0.0:
        return judged
    finer = _finer(problem, found)
    along = None if finer is None else continued(problem, finer, problem)
    return None if along is None else _certified(problem, along)


def _finer(problem: Problem, found: Solution) -> Solution | None:
    """Return a solution on finer meshes, None where it has no need of these: meshes are handed on
    from guess to guess, and may be those of a motion that wanted less.
    """
    with np.errstate(all="ignore"):
        rest = unresolved(problem, found)
        meshes = refined_meshes(found.arcs, rest, Follower.points, Follower.tolerance)
    return None if meshes is None else resampled(found, meshes)


def _certified(problem: Problem, found: Solution) -> Solution | None:
    """Return a solution with its verdict, None where it is not certified."""
    shortest = SAME_TIME * (found.final_time - found.initial_time)
    if not all(arc.t[-1] - arc.t[0] > shortest for arc in found.arcs):
        return None
    if not sound(problem, found):
        return None
    judged = certified(problem, found)
    return judged if judged.extremal else None


def continued(
    problem: Problem, guess: Solution, origin: Problem, ahead: Solution | None = None
) -> Solution | None:
    """Return the solution of the conditions of a guess's word next to it, which nobody judged, or
    None where Newton does not settle. `origin`: the problem that the guess is a solution of;
    `ahead`: what is predicted from the guess, with which Newton begins.

    It goes on where the word holds no more: lengths of arcs may be negative then.
    """
    found = None
    failures = np.linalg.LinAlgError, ValueError, ArithmeticError, MethodError
    with np.errstate(all="ignore"), suppress(*failures):
        # far from home Newton may overflow on its way to nowhere
        active = limits_met(guess, origin)
        found = polished(problem, _unjudged(problem, guess), active=active, ahead=ahead)
    return found


def _unjudged(problem: Problem, guess: Solution) -> Solution:
    """Return a guess as a solution of a problem, without what was said of it elsewhere."""
    return Solution(
        problem=problem.name,
        arcs=guess.arcs,
        objective=guess.objective,
        stop=Stop.SOLVED,
        message=_ALONG,
        state_names=guess.state_names,
        control_names=guess.control_names,
        parameters=guess.parameters,
        origin=Origin(method=guess.method),
    )


def _origin(problem: Problem, guess: Solution) -> Problem:
    """Return the problem that a guess is a solution of, as far as it tells; one of other states,
    controls or parameters is no neighbour.
    """
    own = known_problem(guess)
    return problem if own is None or _named(own) != _named(problem) else own


def _named(problem: Problem) -> tuple[tuple[str, ...], ...]:
    return problem.state_names, problem.control_names, problem.parameter_names

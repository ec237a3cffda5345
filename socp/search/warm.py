"""Warm starts: a neighbouring problem along the word of its guess, without scouting."""

from contextlib import suppress

import numpy as np

from socp.errors import ProblemError
from socp.methods import polished, sound
from socp.model import SHORTEST, Problem, Solution, Stop, Watch, silent
from socp.search.effort import Search
from socp.search.neighbours import word_of
from socp.search.refinement import try_words
from socp.verdict import certified, learn

# Words tried from the guess's own before the search begins anew: where that does not hold any more,
# an arc has come or gone, or its switches have to be solved for from afar
_WORDS = 10


def warm_start(
    problem: Problem, guess: Solution, search: Search, watch: Watch = silent
) -> Solution | None:
    """Return a certified solution along the word of a guess, or along one next to it; None where
    the guess has no word or that leads to none.

    Newton on the conditions of the word starts from the guess's states and lengths, with the
    multipliers that fit them best. Where it does not settle, or on no extremal, the word is solved
    by collocation and mended.
    """
    if not guess.lawful:
        return None
    learn(problem, guess)
    found = _neighbour(problem, guess)
    if found is not None:
        search.keep(found)
        search.note(found.word, found)
        return found
    best = try_words(problem, iter([[word_of(guess)]]), search, watch, _WORDS)
    stopped = best is not None and best.stop is Stop.INTERRUPTED
    return best if best is not None and (best.extremal or stopped) else None


def _neighbour(problem: Problem, guess: Solution) -> Solution | None:
    """Return what Newton makes of a guess, where that is certified."""
    start = Solution(
        method=guess.method,
        problem=problem.name,
        arcs=guess.arcs,
        objective=guess.objective,
        stop=Stop.SOLVED,
        message="Newton on the conditions of the guess's word",
        state_names=guess.state_names,
        control_names=guess.control_names,
        parameters=guess.parameters,
    )
    found = None
    with np.errstate(all="ignore"), suppress(np.linalg.LinAlgError, ValueError, ArithmeticError):
        # far from home Newton may overflow on its way to nowhere
        found = polished(problem, start, origin=_origin(problem, guess))
    if found is None or not sound(problem, found):
        return None
    shortest = SHORTEST * (found.final_time - found.initial_time)
    if not all(arc.t[-1] - arc.t[0] > shortest for arc in found.arcs):
        return None
    judged = certified(problem, found)
    return judged if judged.extremal else None


def _origin(problem: Problem, guess: Solution) -> Problem:
    """Return the problem that a guess is a solution of, as far as it tells."""
    if guess.statement is None:
        return problem
    try:
        return Problem.from_statement(guess.statement)
    except ProblemError:
        return problem

"""Digits: a certified solution computed twice, until as many digits agree as are asked for."""

from dataclasses import replace

import numpy as np

from socp.errors import MethodError, SolveError
from socp.methods import Follower, polished, sound
from socp.model import TINY, Agreement, Problem, Solution, Stop, Watch, Word, silent
from socp.process import seconds_left
from socp.search.neighbours import without_arc, word_of
from socp.solvers import Solver
from socp.verdict import certified

_FINER = (
    1e-9,
    1e-11,
    1e-13,
)  # tolerances of the meshes that are compared where Newton does not settle
_BRIEF = 1e-2  # of the horizon: a longer arc is one, however little is known of its ends
# Their collocation points: other polynomials than those of the solution that they are compared with
_POINTS = 12


def with_agreement(
    problem: Problem, solution: Solution, digits: int, backend: Solver, watch: Watch = silent
) -> Solution:
    """Return a certified solution with the agreement of two computations of it, certified again.

    What has been computed twice already is left at that; Newton on its conditions follows for the
    others. Arcs shorter than the errors of their ends go, where they are left. Where Newton does
    not settle, or leaves less than `digits` digits, finer meshes are compared. What cannot be
    computed twice comes back as it is.
    """
    twice = _twice(problem, solution, digits)
    best = settled(problem, twice, backend, watch)
    if best is not twice:
        best = _twice(problem, best, digits)
    if agrees(best, digits) or best.stop is Stop.INTERRUPTED or seconds_left() <= 0.0:
        return best
    return _compared(problem, best, (digits, backend), watch)


def _twice(problem: Problem, solution: Solution, digits: int) -> Solution:
    """Return what Newton makes of a certified solution, certified again, where it does and is in
    time; else the solution, certified.
    """
    if solution.stop is Stop.INTERRUPTED or seconds_left() <= 0.0:
        return solution
    if not agrees(solution, digits) and (found := polished(problem, solution)) is not None:
        judged = certified(problem, found)
        if judged.extremal:
            return judged
    return certified(problem, solution)


def settled(
    problem: Problem, solution: Solution, backend: Solver, watch: Watch = silent
) -> Solution:
    """Return a certified solution without the arcs that are shorter than the errors of their ends,
    where that does.

    Where two controls hand over at one time, an arc between the two switches is hardly felt: the
    errors of its ends show it. The switches on both sides become one, and what is solved so is kept
    if it is certified and no worse.
    """
    for _ in range(len(solution.arcs)):
        short = spurious(solution)
        if not short or seconds_left() <= 0.0:
            break
        now = word_of(solution)
        for k in reversed(short):
            now = without_arc(now, k)
        if len(now.arcs) >= len(solution.arcs):
            break
        word = Word(problem.control_names, now.arcs)
        try:
            merged = Follower(longer=False, backend=backend)(problem, word, now.guess(), watch)
        except (MethodError, SolveError):
            break
        if merged.stop is Stop.INTERRUPTED:
            return replace(solution, stop=Stop.INTERRUPTED, message=merged.message)
        judged = certified(problem, merged.after(solution)) if merged.stop.ok else merged
        if not judged.extremal or not sound(problem, judged) or _is_worse(judged, solution):
            break
        solution = judged
    return solution


def spurious(solution: Solution) -> list[int]:
    """Return the arcs that are shorter than the error of one of their ends, never all of them."""
    errors = dict(solution.verdict.switch_errors) if solution.verdict else {}
    times, known = np.array(list(errors)), np.array(list(errors.values()))
    if not times.size:
        return []
    joints = np.concatenate([[-np.inf], solution.junctions, [np.inf]])
    nearest = [
        float(known[np.argmin(np.abs(times - t))]) if np.isfinite(t) else 0.0 for t in joints
    ]
    lengths = np.array([arc.t[-1] - arc.t[0] for arc in solution.arcs])
    allowed = np.minimum(np.maximum(nearest[:-1], nearest[1:]), _BRIEF * lengths.sum())
    return np.flatnonzero(lengths < allowed).tolist()


def _is_worse(merged: Solution, solution: Solution) -> bool:
    """Tell whether the objective is worse by more than both are known to."""
    errors = [each.verdict.objective_error for each in (merged, solution) if each.verdict]
    return merged.objective > solution.objective + sum(errors)


def _compared(
    problem: Problem, best: Solution, wanted: tuple[int, Solver], watch: Watch
) -> Solution:
    """Return the solution on the mesh that agrees best with the one before it, or the given one
    where none agrees.
    """
    word = best.followed
    last = best
    for tolerance in _FINER:
        if seconds_left() <= 0.0:
            break
        follower = Follower(points=_POINTS, tolerance=tolerance, longer=False, backend=wanted[1])
        try:
            finer = follower(problem, word, last, watch)
        except (MethodError, SolveError):
            break
        if finer.stop is Stop.INTERRUPTED:
            return replace(best, stop=Stop.INTERRUPTED, message=finer.message)
        judged = (
            certified(problem, finer.after(last).with_judgement(agreement=apart(last, finer)))
            if finer.stop.ok
            else finer
        )
        if not judged.extremal or not sound(problem, judged):
            break
        best, last = min(best, judged, key=_worse), judged
        if agrees(best, wanted[0]):
            break
    return best


def apart(one: Solution, other: Solution) -> Agreement:
    """Return how far two solutions along one word are apart."""
    size = max(abs(one.objective), abs(other.objective), TINY)
    ends = np.abs(
        np.append(one.junctions, one.final_time) - np.append(other.junctions, other.final_time)
    )
    return Agreement(
        objective=abs(one.objective - other.objective) / size, switches=float(ends.max())
    )


def agrees(solution: Solution, digits: int) -> bool:
    """Tell whether as many digits are agreed on, of the objective and of the times against the
    horizon.
    """
    return _worse(solution) <= 10.0**-digits


def _worse(solution: Solution) -> float:
    found, horizon = solution.judgement.agreement, solution.final_time - solution.initial_time
    return np.inf if found is None else max(found.objective, found.switches / horizon)

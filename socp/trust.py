"""Digits: a certified solution computed twice, until as many digits agree as are asked for."""

from dataclasses import replace

import numpy as np

from socp.chain import judge
from socp.errors import MethodError, SolveError
from socp.following import Follower, sound
from socp.nlp import Backend, Watch, silent
from socp.polish import polished
from socp.problem import Problem
from socp.solution import Agreement, Solution, Stop
from socp.word import Mode, Word

_FINER = (1e-9, 1e-11, 1e-13)  # tolerances of the meshes that are compared where Newton does not settle
_POINTS = 12  # their collocation points: other polynomials than those of the solution that they are compared with


def trusted(problem: Problem, solution: Solution, digits: int, backend: Backend, watch: Watch = silent) -> Solution:
    """Return a certified solution with the agreement of two computations of it, certified again.

    Newton on its conditions comes first. Where that does not settle, or leaves less than `digits` digits, finer meshes
    are compared. What cannot be computed twice comes back as it is.
    """
    found = polished(problem, solution)
    best = solution if found is None else judge(problem, found)
    best = best if best.extremal else solution
    return best if reached(best, digits) else _compared(problem, best, (digits, backend), watch)


def _compared(problem: Problem, best: Solution, wanted: tuple[int, Backend], watch: Watch) -> Solution:
    """Return the solution on the mesh that agrees best with the one before it, or the given one where none agrees."""
    word = Word(problem.control_names, tuple(tuple(map(Mode.parse, arc.modes)) for arc in best.arcs))
    last = best
    for tolerance in _FINER:
        follower = Follower(points=_POINTS, tolerance=tolerance, longer=False, backend=wanted[1])
        try:
            finer = follower(problem, word, last, watch)
        except (MethodError, SolveError):
            break
        if finer.stop is Stop.INTERRUPTED:
            return replace(best, stop=Stop.INTERRUPTED, message=finer.message)
        judged = judge(problem, replace(finer.after(last), agreement=apart(last, finer))) if finer.stop.ok else finer
        if not judged.extremal or not sound(problem, judged):
            break
        best, last = min(best, judged, key=_worse), judged
        if reached(best, wanted[0]):
            break
    return best


def apart(one: Solution, other: Solution) -> Agreement:
    """Return how far two solutions along one word are apart."""
    size = max(abs(one.objective), abs(other.objective), 1e-300)
    ends = np.abs(np.append(one.junctions, one.final_time) - np.append(other.junctions, other.final_time))
    return Agreement(objective=abs(one.objective - other.objective) / size, switches=float(ends.max()))


def reached(solution: Solution, digits: int) -> bool:
    """Tell whether as many digits are agreed on, of the objective and of the times against the horizon."""
    return _worse(solution) <= 10.0**-digits


def _worse(solution: Solution) -> float:
    found, horizon = solution.agreement, solution.final_time - solution.initial_time
    return np.inf if found is None else max(found.objective, found.switches / horizon)

"""Digits: a certified solution computed twice, until as many digits agree as are asked for."""

from dataclasses import replace

import numpy as np

from socp.chain import judge
from socp.errors import MethodError, SolveError
from socp.following import Follower, sound
from socp.nlp import Backend, Watch, silent
from socp.polish import polished
from socp.problem import Problem
from socp.solution import Agreement, Solution
from socp.word import Mode, Word

_FINER = (1e-9, 1e-11, 1e-13)  # tolerances of the meshes that are compared where Newton does not settle
_POINTS = 12  # their collocation points: other polynomials than those of the solution that they are compared with


def trusted(problem: Problem, solution: Solution, digits: int, backend: Backend, watch: Watch = silent) -> Solution:
    """Return a certified solution with the agreement of two computations of it, certified again.

    Newton on its conditions comes first. Where that does not settle, or leaves less than `digits` digits, finer meshes
    are compared. What cannot be computed twice comes back as it is.
    """
    best = solution
    polish = polished(problem, solution)
    if polish is not None:
        judged = judge(problem, polish)
        if judged.extremal:
            best = judged
        if best is judged and reached(best, digits):
            return best
    word = Word(problem.control_names, tuple(tuple(map(Mode.parse, arc.modes)) for arc in solution.arcs))
    last = solution
    for tolerance in _FINER:
        try:
            finer = Follower(points=_POINTS, tolerance=tolerance, longer=False, backend=backend)(
                problem, word, last, watch
            )
        except (MethodError, SolveError):
            break
        if not finer.stop.ok or not sound(problem, finer):
            break
        judged = judge(problem, replace(finer.after(last), agreement=apart(last, finer)))
        if not judged.extremal:
            break
        last = judged
        if best.agreement is None or _worse(best) > _worse(judged):
            best = judged
        if reached(best, digits):
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

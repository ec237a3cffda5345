"""Lessons: points of a solution where a control seems to be singular, to look from there for laws
not found yet.
"""

import numpy as np

from socp.errors import LateError, MethodError
from socp.laws import (
    LostError,
    derive,
    extremal_arc,
    forget_derivation,
    note_points,
    noted_points,
)
from socp.model import LAWS, Mode, Modes, Problem, Solution, parameters_of
from socp.process import time_limit
from socp.verdict.structure import structure_of

_POINTS = 12  # taken along one stretch
# Of the horizon: a shorter stretch that looks singular is a switch between two nodes, or ringing
_SHORTEST = 0.02
_INNER = 0.15  # of a stretch, left out at both its ends: a coarse grid blurs its joints
_SOLUTIONS = 4  # whose points are kept for one problem: more of them show the same arcs


def learn(problem: Problem, solution: Solution) -> bool:
    """Note points where a control without a derived law looks singular, and forget that there was
    no law.

    Returns whether there was anything to learn. The points are near the arc as far as the solution
    is good, and its costates known; what they are worth is decided where the law is derived.
    """
    if len(noted_points(problem)) >= _SOLUTIONS:
        return False
    shortest = _SHORTEST * (solution.final_time - solution.initial_time)
    points = [
        _along(problem, solution, a + _INNER * (b - a), b - _INNER * (b - a))
        for name, stretches in (solution.structure or structure_of(problem, solution)).items()
        if (inner := [(a, b) for mode, a, b in stretches if mode == "s" and b - a > shortest])
        and not _has_law(problem, name)
        for a, b in inner
    ]
    found = np.hstack(points) if points else np.zeros((0, 0))
    found = found[:, np.isfinite(found).all(axis=0)]
    if not found.size:
        return False
    note_points(problem, found)
    forget_derivation(problem)
    return True


def _has_law(problem: Problem, name: str) -> bool:
    """Tell whether a control has a singular law, or may have one that is not found in time."""
    try:
        with time_limit(LAWS):
            derive(problem, (name,))
    except LateError:
        return True
    except MethodError:
        return False
    return True


def left_open(problem: Problem, i: int, modes: Modes) -> bool:
    """Tell whether it is proved that control i has no singular law while the others are in their
    modes: that the principle leaves it open wherever its switching function vanishes there.
    """
    try:
        with time_limit(LAWS):
            extremal_arc(problem, (*modes[:i], Mode("singular"), *modes[i + 1 :]))
    except LostError as error:
        return error.proved
    except MethodError:
        return False
    return False


def _along(problem: Problem, solution: Solution, first: float, last: float) -> np.ndarray:
    """Return points (nv, n) of a solution between two times, the costates of the size of random
    ones.
    """
    t = np.linspace(first, last, _POINTS)
    x, u, costate = (solution.at(t, which) for which in ("x", "u", "costate"))
    p = np.repeat(parameters_of(problem, solution)[:, None], t.size, axis=1)
    return np.vstack([t[None, :], x, p, costate, u])

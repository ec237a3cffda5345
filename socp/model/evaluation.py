"""Values and sizes of a problem along a solution."""

import numpy as np

from socp.model.problem import Problem
from socp.model.solution import Solution


def parameters_of(problem: Problem, solution: Solution) -> np.ndarray:
    """Return the values of the parameters (np,) in the problem's order."""
    return np.array([solution.parameters[name] for name in problem.parameter_names], dtype=float)


def scales(problem: Problem, solution: Solution) -> np.ndarray:
    """Return the magnitude of every state (nx,): the largest of its bounds, its ends and its size
    on the solution.

    It serves to scale; what a solution claims is not measured by it, since a claimed state may be
    of any size.
    """
    return sizes(problem, solution.rows("x"))


def sizes(problem: Problem, x: np.ndarray) -> np.ndarray:
    """Return the magnitude of every state (nx,): the largest of its bounds, its ends and its size
    on states (nx, n).
    """
    given = np.vstack([problem.state_box, problem.start_box, problem.end_box])
    given = np.where(np.isfinite(given), np.abs(given), 0.0).max(axis=0)
    magnitude: np.ndarray = np.maximum(given, np.nanmax(np.abs(x), axis=1, initial=0.0))
    return np.where(magnitude > 0, magnitude, 1.0)

"""The problem that a solution carries as data."""

from socp.errors import ProblemError
from socp.model.problem import Problem
from socp.model.result.solution import Solution


def carried_problem(solution: Solution) -> Problem | None:
    """Return the problem that a solution carries, None where it carries none; ProblemError where
    its statement is no problem.
    """
    return None if solution.statement is None else Problem.from_statement(solution.statement)


def known_problem(solution: Solution) -> Problem | None:
    """Return the problem that a solution carries, None as well where that cannot be read."""
    try:
        return carried_problem(solution)
    except ProblemError:
        return None

"""The problem that a solution carries, read back from its statement."""

from socp.errors import ProblemError
from socp.model.problem import Problem
from socp.model.solution import Solution


def carried(solution: Solution) -> Problem | None:
    """Return the problem that a solution carries, in symbols of its own; None where it carries none
    that can be read.
    """
    if solution.statement is None:
        return None
    try:
        return Problem.from_statement(solution.statement)
    except ProblemError:
        return None

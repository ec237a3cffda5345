"""The problem that a solution carries as data."""

from socp.errors import ProblemError, SolveError
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


def check_names(path: str, guess: Solution, problem: Problem) -> Solution:
    """Return a solution as it is; SolveError where its states, controls or parameters are not
    the problem's.
    """
    for kind in ("state", "control"):
        saved, wanted = (getattr(each, f"{kind}_names") for each in (guess, problem))
        if saved != wanted:
            has, needs = (", ".join(names) or "none" for names in (saved, wanted))
            raise SolveError(
                f"{path}: its {kind}s are {has}, but those of problem '{problem.name}' are {needs}"
            )
    missing = [name for name in problem.parameter_names if name not in guess.parameters]
    if missing:
        raise SolveError(
            f"{path}: has no parameter '{missing[0]}', which problem '{problem.name}' needs"
        )
    return guess

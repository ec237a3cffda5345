"""The chain from a method to a judged solution: solve, read the structure, re-integrate,
certify.
"""

import platform
from collections.abc import Iterator
from contextlib import suppress
from functools import cache
from importlib import metadata
from typing import Any

import casadi
import numpy as np

from socp.errors import ContractError
from socp.laws import check_laws, independent
from socp.methods.contract import Method, check_options, options
from socp.model import (
    Arc,
    Family,
    Problem,
    Solution,
    Stop,
    Watch,
    check_solvable,
    family_of,
    silent,
)
from socp.process import breakable, give_way, one_thread, signals_held
from socp.verdict import judge, with_second_order, with_statement


@one_thread()
def run(method: Method, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
    """Solve with a method and return its solution stamped with name, options and versions, verified
    and judged.

    The method is given end conditions none of which follows from the others; the judge holds its
    solution against all. Ctrl-C while it is judged gives the solution without a verdict. Raises
    MethodError for options out of range and for what the method cannot try, ProblemError for a
    wrong user-given law and for controls that have no use, ContractError for a method that returns
    no solution of it.
    """
    check_options(method)
    check_solvable(problem)
    check_laws(problem)
    solved: list[tuple[Problem, Solution]] = []
    family = family_of(problem)
    try:
        with breakable():
            give_way()
            solved.append(_solved(method, problem, family, guess, watch))
    except KeyboardInterrupt:
        if not solved:
            raise
    with signals_held():  # what has been solved is not lost for want of a judgement
        posed, found = solved[0]
        solution = check_solution(method.name, posed, found)
        solution = solution.with_origin(
            method=method.name, options=option_values(method), versions=versions()
        )
        for step in (judge, with_second_order):
            with suppress(KeyboardInterrupt), breakable():
                solution = step(posed, solution)
        if family is not None:
            solution = family.outside(solution)
        return with_statement(problem, solution)


def _solved(
    method: Method, problem: Problem, family: Family | None, guess: Solution, watch: Watch
) -> tuple[Problem, Solution]:
    """Return a problem as it was solved, and the solution: as one of its family, which shares what
    is derived, where the guess leads to it.

    A search derives anew: a constant that is zero may change laws, and so may a start that no
    control moves away from, from which points that decide what vanishes are drawn.
    """
    origin = family.origin(guess) if family is not None and guess.lawful else None
    if family is not None and origin is not None:
        member, inside = family.member(problem), family.inside(guess, origin)
        found = method.near(independent(member), inside, origin, watch)
        if found is not None:
            family.note(problem, member)
            return member, family.inside(found, member)
    return problem, method.solve(independent(problem), guess, watch)


def check_solution(method: str, problem: Problem, returned: Any) -> Solution:
    """Return what a method returned, if it can be a solution of the problem; ContractError says why
    it cannot.
    """
    if not isinstance(returned, Solution):
        raise ContractError(
            f"method '{method}': solve returned {_what(returned)}, where a Solution is needed"
        )
    fault = next(_faults(problem, returned), "")
    if fault:
        raise ContractError(
            f"method '{method}': solve returned a Solution that is none of this problem: {fault}"
        )
    return returned


def _what(returned: Any) -> str:
    kind = type(returned).__name__
    return (
        "nothing" if returned is None else f"{'an' if kind[0].lower() in 'aeiou' else 'a'} {kind}"
    )


def _faults(problem: Problem, solution: Any) -> Iterator[str]:
    if not isinstance(solution.stop, Stop):
        yield f"its stop is {solution.stop!r}, not a Stop"
    if isinstance(solution.objective, bool) or not isinstance(solution.objective, (int, float)):
        yield f"its objective is {_what(solution.objective)}, not a number"
    if not isinstance(solution.arcs, tuple) or not solution.arcs:
        yield "its arcs are no tuple of at least one Arc"
        return
    names = {"x": problem.state_names, "u": problem.control_names, "costate": problem.state_names}
    arcs: tuple[Any, ...] = solution.arcs
    for arc in arcs:
        if not isinstance(arc, Arc):
            yield f"among its arcs is {_what(arc)}"
            return
        for which, wanted in names.items():
            shape = np.shape(getattr(arc, which))
            if shape != (len(wanted), np.size(arc.t)):
                yield (
                    f"{which} of an arc has shape {shape}, where "
                    f"{(len(wanted), np.size(arc.t))} is needed"
                )
    if (solution.state_names, solution.control_names) != (
        problem.state_names,
        problem.control_names,
    ):
        yield f"its states and controls are {solution.state_names} and {solution.control_names}"


def option_values(method: Method) -> dict[str, Any]:
    """Return the options of a method as plain values, those of a backend under its name:
    `ipopt.tol`.
    """
    found: dict[str, Any] = {}
    for each in options(type(method)):
        value = getattr(method, each.name)
        if isinstance(value, (str, int, float, bool, type(None))):
            found[each.name] = value
        else:
            name = getattr(value, "name", type(value).__name__.lower())
            found |= {
                each.name: name,
                **{f"{name}.{k}": v for k, v in getattr(value, "options", {}).items()},
            }
    return found


def versions() -> dict[str, str]:
    """Return the versions of Python, socp and what computes for it."""
    return dict(_versions())


@cache
def _versions() -> dict[str, str]:
    found = {"python": platform.python_version(), "socp": "unknown", "scipy": "unknown"}
    for name in ("socp", "scipy"):
        with suppress(metadata.PackageNotFoundError):
            found[name] = metadata.version(name)
    # these say it themselves: to read the metadata of all takes as long as to judge a solution
    return found | {each.__name__: each.__version__ for each in (casadi, np)}

"""Saved results with their problems: the one that a result carries as data, unless the user names
another.
"""

from collections.abc import Mapping
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING

from socp.cli.session import Session
from socp.errors import ProblemError, SolveError
from socp.model import check_names
from socp.registry import load_problem

if TYPE_CHECKING:
    from socp.model import Problem, Solution
    from socp.registry import Registry

_TOLD = 6  # places told in which two problems differ; more are another problem altogether


def open_result(
    session: Session, path: str, given: str | None, registry: "Registry | None" = None
) -> "tuple[Solution, Problem | None]":
    """Return a saved result and its problem: the given one, or that which it carries, or a
    registered one of its name.

    What a result says of itself opens no file and runs no code: the name in it is looked up among
    registered problems alone. Where two of these problems differ, a warning says where. The problem
    is None where there is none of them. SolveError says what is wrong with the file, or that it is
    not a result of its problem.
    """
    from socp.model import carried_problem, quotation

    registry = registry or session.registry()
    solution = _loaded(path, registry)
    try:
        own = carried_problem(solution)
    except ProblemError as error:
        raise SolveError(f"{path}: its statement is no problem: {quotation(error)}") from error
    if given is not None:
        problem = load_problem(given, registry)
        if own is not None:
            _compare(
                session, own, problem, f"problem '{given}' is used; that of the result differs"
            )
        return _agreeing(path, check_names(path, solution, problem), problem), problem
    registered = _registered(solution.problem, registry)
    if own is not None:
        if registered is not None:
            told = f"the result's own problem is used; the registered '{solution.problem}' differs"
            _compare(session, own, _valued(own, registered), told)
        return solution, own
    if registered is None:
        return solution, None
    try:
        check_names(path, solution, registered)
    except SolveError:  # another problem of the same name
        return solution, None
    session.warn(
        f"{path} carries no statement of its problem: the registered '{solution.problem}' is used"
    )
    return _agreeing(path, solution, registered), registered


def _loaded(path: str, registry: "Registry") -> "Solution":
    """Return a saved result; SolveError says so where a problem stands in its place."""
    from socp.model import load

    try:
        return load(path)
    except SolveError as error:
        if path not in registry.entries and Path(path).suffix != ".py":
            raise
        told = f"this is a problem, and the command takes its result: socp solve {quote(path)}"
        raise SolveError(f"{path}: {told} writes one") from error


def problem_missing(solution: "Solution") -> str:
    """Return why a saved result is without a problem, and what to do."""
    from socp.model import quotation

    reason = f" ({quotation(solution.origin.unstated)})" if solution.origin.unstated else ""
    lacking = f"the result carries no statement of its problem '{solution.problem}'{reason}"
    return f"{lacking}, and no such problem is registered; give --problem FILE"


def _registered(name: str, registry: "Registry") -> "Problem | None":
    try:
        return registry.problem(name) if name in registry.entries else None
    except ProblemError:  # it says nothing about the result that an installed problem is broken
        return None


def _valued(own: "Problem", registered: "Problem") -> "Problem":
    """Return a registered problem with the constants of a result's own: `--set` changes them, and a
    report says which they are.
    """
    named = {k: v.value for k, v in own.constants.items() if k in registered.constants}
    try:
        return registered.with_(named)
    except ProblemError:  # no problem has these values any more
        return registered


def _agreeing(path: str, solution: "Solution", problem: "Problem") -> "Solution":
    """Return a saved result as it is; SolveError where its arcs follow constraints that the problem
    does not have.
    """
    from socp.model import check_constraints

    try:
        check_constraints(solution, [constraint.name for constraint in problem.constraints])
    except ProblemError as error:
        raise SolveError(f"{path}: {error}") from error
    return solution


def _compare(session: Session, own: "Problem", other: "Problem", told: str) -> None:
    """Warn where two problems differ."""
    from socp.model import differences

    try:
        places = differences(own, other)
    except ProblemError as error:  # it holds what cannot be written, which no statement does
        session.warn(f"{told}: {error}")
        return
    if places:
        more = f" and {len(places) - _TOLD} more places" if len(places) > _TOLD else ""
        session.warn(f"{told} in: {', '.join(places[:_TOLD])}{more}")


def opened_beside(
    session: Session, first: "Problem | None", others: Mapping[str, str]
) -> "dict[str, Solution]":
    """Return other results, paths by name, that are shown beside one of a problem; a message says
    which numbers of theirs are others.
    """
    found = {}
    for name, path in others.items():
        found[name], own = open_result(session, path, None)
        apart = [] if first is None or own is None else _apart(first, own)
        if apart:
            session.note(f"{name} is of other numbers: {', '.join(apart)}")
    return found


def _apart(first: "Problem", other: "Problem") -> list[str]:
    """Return in what a problem differs from a first one: constants with their values, then places
    that these do not explain.
    """
    from socp.model import differences

    try:
        constants = {name: each.value for name, each in first.constants.items()}
        values = {name: each.value for name, each in other.constants.items()}
        told = [
            f"{name} = {value:g} in place of {constants[name]:g}"
            for name, value in values.items()
            if value != constants.get(name, value)
        ]
        known = {name: value for name, value in constants.items() if name in values}
        places = differences(first, other.with_(known) if known else other)
    except ProblemError:  # what cannot be written as data is not compared
        return []
    return [*told, *places[:_TOLD]]

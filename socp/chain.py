"""The chain from a method to a judged solution: solve, read the structure, re-integrate, certify."""

import platform
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from importlib import metadata
from typing import Any

import numpy as np

from socp import checks, pmp
from socp.accuracy import sharpened
from socp.arc import Arc
from socp.errors import ContractError, ProblemError
from socp.given import check_laws
from socp.interruption import breakable, give_way, held
from socp.lessons import learn
from socp.method import Method, check_options, options
from socp.nlp import Watch, silent
from socp.problem import Problem
from socp.simulate import verify
from socp.solution import Solution, Stop
from socp.structure import structure_of
from socp.verdict import Verdict


def run(method: Method, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
    """Solve with a method and return its solution stamped with name, options and versions, verified and judged.

    Ctrl-C while it is judged gives the solution without a verdict.
    Raises MethodError for options out of range and for what the method cannot try, ProblemError for a wrong
    user-given law and for controls that have no use, ContractError for a method that returns no solution of it.
    """
    check_options(method)
    checks.useful(problem)
    check_laws(problem)
    solved: list[Solution] = []
    try:
        with breakable():
            give_way()
            solved.append(method.solve(problem, guess, watch))
    except KeyboardInterrupt:
        if not solved:
            raise
    with held():  # what has been solved is not lost for want of a judgement
        solution = checked(method.name, problem, solved[0])
        solution = replace(solution, method=method.name, options=described(method), versions=versions())
        solution = carrying(problem, solution)
        with suppress(KeyboardInterrupt), breakable():
            return judge(problem, solution)
    return solution


def checked(method: str, problem: Problem, found: Any) -> Solution:
    """Return what a method returned, if it can be a solution of the problem; ContractError says why it cannot."""
    if not isinstance(found, Solution):
        raise ContractError(f"method '{method}': solve returned {_what(found)}, where a Solution is needed")
    fault = next(_faults(problem, found), "")
    if fault:
        raise ContractError(f"method '{method}': solve returned a Solution that is none of this problem: {fault}")
    return found


def _what(found: Any) -> str:
    kind = type(found).__name__
    return "nothing" if found is None else f"{'an' if kind[0].lower() in 'aeiou' else 'a'} {kind}"


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
                yield f"{which} of an arc has shape {shape}, where {(len(wanted), np.size(arc.t))} is needed"
    if (solution.state_names, solution.control_names) != (problem.state_names, problem.control_names):
        yield f"its states and controls are {solution.state_names} and {solution.control_names}"


def judge(problem: Problem, solution: Solution) -> Solution:
    """Return a solution with its structure, its verification, its verdict and its problem, all worked out anew."""
    solution = carrying(problem, solution)
    values = [each for arc in solution.arcs for each in (arc.x, arc.u)]
    values.append(np.array(list(solution.parameters.values()), dtype=float))
    if not all(np.isfinite(each).all() for each in values):
        verdict = Verdict(miss=float("inf"), notes=("the solution is not finite",))
        return replace(solution, verified=(), verdict=verdict)
    began = time.perf_counter()
    with np.errstate(all="ignore"):  # what overflows is infinite or nan, and no condition holds with either
        solution = replace(solution, structure=structure_of(problem, solution))
        learn(problem, solution)
        solution = replace(solution, verified=verify(problem, solution))
    integrated = time.perf_counter()
    try:
        with np.errstate(all="ignore"):
            verdict, arcs = certify(problem, solution)
    except (np.linalg.LinAlgError, ValueError, ArithmeticError, RecursionError) as error:
        worst = max(solution.verified, key=lambda f: f.off)
        notes = (f"the principle could not be judged: {error}",)
        verdict, arcs = Verdict(miss=worst.off, miss_at=worst.off_at, notes=notes), solution.arcs
    verdict = sharpened(problem, replace(solution, arcs=arcs, verdict=verdict)) or verdict
    seconds = {"verify": integrated - began, "judge": time.perf_counter() - integrated}
    return replace(solution, arcs=arcs, verdict=verdict, seconds={**solution.seconds, **seconds})


def carrying(problem: Problem, solution: Solution) -> Solution:
    """Return a solution that carries the statement of its problem, or the reason why it cannot."""
    try:
        return replace(solution, problem=problem.name, statement=problem.statement, unstated="")
    except ProblemError as error:
        return replace(solution, problem=problem.name, statement=None, unstated=str(error))


def described(method: Method) -> dict[str, Any]:
    """Return the options of a method as plain values, those of a backend under its name: `ipopt.tol`."""
    found: dict[str, Any] = {}
    for each in options(type(method)):
        value = getattr(method, each.name)
        if isinstance(value, (str, int, float, bool, type(None))):
            found[each.name] = value
        else:
            name = type(value).__name__.lower()
            found |= {each.name: name, **{f"{name}.{k}": v for k, v in getattr(value, "options", {}).items()}}
    return found


def versions() -> dict[str, str]:
    """Return the versions of Python, socp and what computes for it."""
    found = {"python": platform.python_version()}
    for name in ("socp", "casadi", "numpy", "scipy"):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "unknown"
    return found

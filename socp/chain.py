"""The chain from a method to a judged solution: solve, read the structure, re-integrate, certify."""

import platform
import time
from dataclasses import replace
from importlib import metadata
from typing import Any

import numpy as np

from socp import pmp
from socp.errors import ProblemError
from socp.given import check_laws
from socp.method import Method, check_options, options
from socp.nlp import Watch, silent
from socp.problem import Problem
from socp.simulate import verify
from socp.solution import Solution
from socp.structure import structure
from socp.verdict import Verdict


def run(method: Method, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
    """Solve with a method and return its solution stamped with name, options and versions, verified and judged.

    Ctrl-C while it is judged gives the solution without a verdict.
    Raises MethodError for options out of range and for what the method cannot try, ProblemError for a wrong
    user-given law.
    """
    check_options(method)
    check_laws(problem)
    solution = method.solve(problem, guess, watch)
    solution = replace(solution, method=method.name, options=described(method), versions=versions())
    solution = carrying(problem, solution)
    try:
        return judge(problem, solution)
    except KeyboardInterrupt:  # what has been solved is not lost for want of a judgement
        return solution


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
        solution = replace(solution, structure=structure(problem, solution), verified=verify(problem, solution))
    integrated = time.perf_counter()
    try:
        with np.errstate(all="ignore"):
            verdict, arcs = pmp.certify(problem, solution)
    except (np.linalg.LinAlgError, ValueError, ArithmeticError, RecursionError) as error:
        miss = max((f.worst for f in solution.verified), default=float("inf"))
        verdict, arcs = Verdict(miss=miss, notes=(f"the principle could not be judged: {error}",)), solution.arcs
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

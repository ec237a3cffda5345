"""Problems by path, by `path.py:name` or by registered name."""

import linecache
import os
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from socp.errors import ProblemError, SolveError
from socp.process import a, said, short
from socp.registry.entries import line_of, reason, suggest
from socp.registry.executing import code_of, execute
from socp.registry.plugins import Registry

if TYPE_CHECKING:
    from socp.model import Problem, Solution


def load_problem(given: str, registry: Registry) -> "Problem":
    """Return the problem that a path, a `path.py:name` or a registered name stands for.

    Raises ProblemError with the file and the line where loading it went wrong.
    """
    path, colon, name = given.rpartition(":")
    if colon and path.endswith(".py"):
        return load_file(Path(path), name)
    if given in registry.entries:
        return registry.problem(given)
    if not given.strip():
        raise ProblemError(
            "an empty name where a problem is needed; give a problem file or a name, see 'socp "
            "list'"
        )
    # as below
    if given.endswith(".py") or os.path.exists(given) or len(Path(given).parts) > 1:  # noqa: PTH110
        return load_file(Path(given))
    return registry.problem(given)


def load_file(path: Path, name: str = "problem") -> "Problem":
    """Run a problem file and return the problem that it defines under a name."""
    # Path.exists raises for a name too long
    if path.suffix == ".json" and os.path.exists(path):  # noqa: PTH110
        raise ProblemError(
            f"{path} is no problem file; to start from a result, give --guess {path}"
        )
    module = ModuleType(f"socp_problem_{path.stem}")
    module.__file__ = str(path)
    try:
        code = code_of(path)
        execute(code, module, path.parent)
    except (ProblemError, KeyboardInterrupt) as error:
        if isinstance(error, KeyboardInterrupt) or line_of(error, str(path)) is None:
            raise
        raise ProblemError(_located(path, error)) from error
    except BaseException as error:
        raise ProblemError(_located(path, error)) from error
    return _pick(module, path, name)


def load_guess(path: str, problem: "Problem") -> "Solution":
    """Return a saved result as a guess; SolveError says why it cannot be one for this problem."""
    from socp.model import load

    return as_guess(path, load(path), problem)


def as_guess(path: str, solution: "Solution", problem: "Problem") -> "Solution":
    """Return a solution as a guess; SolveError, starting with where it is from, says why it cannot
    be one for this problem.
    """
    import numpy as np

    from socp.model import check_names

    guess = check_names(path, solution, problem)
    if not all(np.isfinite(each).all() for arc in guess.arcs for each in (arc.x, arc.u)):
        raise SolveError(f"{path}: states or controls in it are not finite; it is no guess")
    return guess


def _pick(module: ModuleType, path: Path, name: str) -> "Problem":
    from socp.model import Problem

    found = [key for key, value in vars(module).items() if isinstance(value, Problem)]
    if name in vars(module):
        value = vars(module)[name]
        if isinstance(value, Problem):
            return value
        raise ProblemError(
            f"{path}: '{name}' is {a(value)}, not a Problem; {_instead(value, name, path, found)}"
        )
    if name == "problem":
        hint = f"write {path}:{found[0]}" if found else "assign one: problem = Problem(...)"
        there = f" (it has {', '.join(found)})" if found else ""
        raise ProblemError(f"{path}: defines no 'problem'{there}; {hint}")
    raise ProblemError(f"{path}: defines no '{short(name)}'{suggest(name, found)}")


def _instead(value: Any, name: str, path: Path, found: list[str]) -> str:
    """Return what to write where a name stands for something else than a problem."""
    from socp.model import Problem

    if isinstance(value, (list, tuple, set, dict)) and len(value) > 0:
        inside = value.values() if isinstance(value, dict) else value
        if all(isinstance(each, Problem) for each in inside):
            return f"give each a name of its own, such as first = ..., and write {path}:first"
    if found:
        return f"write {path}:{found[0]}"
    if callable(value):
        return f"if it makes one, call it in the file and assign what it returns to {name}"
    return "assign one: problem = Problem(...)"


def _located(path: Path, error: BaseException) -> str:
    """Return the message of an error in a problem file, with the line of the file, and that line
    itself.
    """
    line = line_of(error, str(path))
    text = f"the file calls exit({said(error)})" if isinstance(error, SystemExit) else reason(error)
    if line is None:
        return f"{path}: {text}"
    linecache.checkcache(str(path))
    shown = short(linecache.getline(str(path), line))
    return f"{path}, line {line}: {text}" + (f"\n  {line} | {shown}" if shown else "")

"""Problems by path, by `path.py:name` or by registered name."""

import linecache
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import decode_source
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from socp.entries import line_of, reason, suggest
from socp.errors import ProblemError, SolveError
from socp.registry import Registry, as_problem

if TYPE_CHECKING:
    from socp.problem import Problem
    from socp.solution import Solution


def load_problem(given: str, registry: Registry) -> "Problem":
    """Return the problem that a path, a `path.py:name` or a registered name stands for.

    Raises ProblemError with the file and the line where loading it went wrong.
    """
    path, colon, name = given.rpartition(":")
    if colon and path.endswith(".py"):
        return load_file(Path(path), name)
    if given in registry.entries:
        return registry.problem(given)
    if given.endswith(".py") or Path(given).exists() or len(Path(given).parts) > 1:
        return load_file(Path(given))
    return registry.problem(given)


def load_file(path: Path, name: str = "problem") -> "Problem":
    """Run a problem file and return the problem that it defines under a name."""
    if path.is_dir():
        raise ProblemError(f"{path} is a directory; give a problem file inside it")
    if path.suffix == ".json" and path.exists():
        raise ProblemError(f"{path} is no problem file; to start from a result, give --guess {path}")
    try:
        source = decode_source(path.read_bytes())
    except OSError as error:
        raise ProblemError(f"{path}: {error.strerror or error}{_neighbours(path)}") from error
    except (SyntaxError, UnicodeDecodeError) as error:
        raise ProblemError(f"{path}: not a Python file: {reason(error)}") from error
    module = ModuleType(f"socp_problem_{path.stem}")
    module.__file__ = str(path)
    try:
        code = compile(source, str(path), "exec")
        with _as_script(module, path.parent):
            exec(code, vars(module))  # noqa: S102 - a problem file is a program of the user's
    except (Exception, SystemExit) as error:
        raise ProblemError(_located(path, error)) from error
    return _pick(module, path, name)


def load_guess(path: str, problem: "Problem") -> "Solution":
    """Return a saved result as a guess; SolveError says why it cannot be one for this problem."""
    import numpy as np

    from socp.solution import Solution

    guess = fitting(path, Solution.load(path), problem)
    if not all(np.isfinite(each).all() for arc in guess.arcs for each in (arc.x, arc.u)):
        raise SolveError(f"{path}: states or controls in it are not finite; it is no guess")
    return guess


def fitting(path: str, guess: "Solution", problem: "Problem") -> "Solution":
    """Return a saved result as it is; SolveError where its states, controls or parameters are not the problem's."""
    for kind in ("state", "control"):
        saved, wanted = (getattr(each, f"{kind}_names") for each in (guess, problem))
        if saved != wanted:
            has, needs = (", ".join(names) or "none" for names in (saved, wanted))
            raise SolveError(f"{path}: its {kind}s are {has}, but those of problem '{problem.name}' are {needs}")
    missing = [name for name in problem.parameter_names if name not in guess.parameters]
    if missing:
        raise SolveError(f"{path}: has no parameter '{missing[0]}', which problem '{problem.name}' needs")
    return guess


def _pick(module: ModuleType, path: Path, name: str) -> "Problem":
    from socp.problem import Problem

    if hasattr(module, name):
        return as_problem(getattr(module, name), f"{path}: '{name}'")
    found = [key for key, value in vars(module).items() if isinstance(value, Problem)]
    if name == "problem":
        hint = f"write {path}:{found[0]}" if found else "assign one: problem = Problem(...)"
        there = f" (it has {', '.join(found)})" if found else ""
        raise ProblemError(f"{path}: defines no 'problem'{there}; {hint}")
    raise ProblemError(f"{path}: defines no '{name}'{suggest(name, found)}")


def _located(path: Path, error: BaseException) -> str:
    """Return the message of an error in a problem file, with the line of the file, and that line itself."""
    line = line_of(error, str(path))
    text = f"the file calls exit({error})" if isinstance(error, SystemExit) else reason(error)
    if line is None:
        return f"{path}: {text}"
    linecache.checkcache(str(path))
    shown = linecache.getline(str(path), line).strip()
    return f"{path}, line {line}: {text}" + (f"\n  {line} | {shown}" if shown else "")


def _neighbours(path: Path) -> str:
    """Suggest the problem files beside a path that does not exist."""
    there = sorted(each.name for each in path.parent.glob("*.py")) if path.parent.is_dir() else []
    return suggest(path.name, there).replace("there", f"in {path.parent} there") if there else ""


@contextmanager
def _as_script(module: ModuleType, folder: Path) -> Iterator[None]:
    """Let a file import its neighbours, and dataclasses in it find their module, as when Python runs it."""
    sys.modules[module.__name__] = module
    sys.path.insert(0, str(folder.resolve()))
    try:
        yield
    finally:
        sys.path.remove(str(folder.resolve()))
        del sys.modules[module.__name__]

"""`socp solve`."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import click

from socp.cli.loading import load_guess, load_problem
from socp.cli.options import DEFAULT_METHOD, build, pairs
from socp.cli.progress import progress
from socp.cli.session import Exit, Session, heading, messages, show, write_json
from socp.cli.show import facts, report
from socp.errors import MethodError, SolveError

if TYPE_CHECKING:
    from socp.problem import Problem
    from socp.solution import Solution


@final
@dataclass(frozen=True, kw_only=True)
class Asked:
    """What `socp solve` was asked for."""

    problem: str
    method: str
    options: tuple[str, ...]
    guess: str | None
    out: str | None
    as_json: bool
    quiet: bool


@click.command(short_help="Solve a problem with one method and write the result file.")
@click.argument("problem", metavar="FILE_OR_NAME")
@click.option("-m", "--method", default=DEFAULT_METHOD, show_default=True, help="Method, see 'socp methods'.")
@click.option("-o", "--option", "options", multiple=True, metavar="KEY=VALUE", help="See 'socp describe METHOD'.")
@click.option("--guess", metavar="FILE", help="Start from a saved result.")
@click.option("--out", metavar="FILE", help="Result file.  [default: PROBLEM.socp.json]")
@click.option("--json", "as_json", is_flag=True, help="Write the report as JSON.")
@click.option("--quiet", is_flag=True, help="Write no progress and no messages.")
@click.pass_obj
def solve(session: Session, /, **given: Any) -> int:
    """Solve a problem, given as a path, as path.py:name or as a registered name.

    The report goes to standard output, progress and messages to standard error, the whole solution to the result file.
    """
    from socp.chain import run
    from socp.guess import default_guess

    asked = Asked(**given)
    session.quiet = asked.quiet
    registry = session.registry()
    session.complain(registry)
    method = build(registry.method(asked.method), pairs(asked.options))
    problem = load_problem(asked.problem, registry)
    guess = _guess(asked.guess, problem) if asked.guess else default_guess(problem)
    path = _writable(Path(asked.out or f"{problem.name}.socp.json"))
    with progress(messages(), f"{problem.name}, {method.name}", quiet=asked.quiet) as watch:
        solution = run(method, problem, guess, watch)
    solution.save(path)
    for line in registry.solved(problem, solution):
        session.warn(line)
    _show(problem, solution, path, as_json=asked.as_json)
    if solution.verdict is None:
        session.note(f"interrupted before it was verified: the result is in {path}")
        return Exit.INTERRUPTED
    if solution.stop.name == "INTERRUPTED":
        session.note(f"interrupted: the last iterate is in {path}")
        return Exit.INTERRUPTED
    return Exit.SOLVED if solution.stop.ok else Exit.UNSOLVED


def _show(problem: "Problem", solution: "Solution", path: Path, *, as_json: bool) -> None:
    if as_json:
        write_json({**facts(problem, solution), "result": str(path)})
        return
    show(heading(problem.name, problem.title), report(problem, solution, str(path)))


def _guess(path: str, problem: "Problem") -> "Solution":
    try:
        return load_guess(path, problem)
    except SolveError as error:
        raise MethodError(f"--guess {error}") from error


def _writable(path: Path) -> Path:
    """Return a path that can be written; MethodError says before the solve, not after it, why one cannot."""
    folder = path.parent
    if path.is_dir():
        raise MethodError(f"--out {path}: is a directory; name a file in it")
    if not folder.is_dir():
        raise MethodError(f"--out {path}: there is no directory {folder}")
    if not os.access(folder, os.W_OK):
        raise MethodError(f"--out {path}: directory {folder.resolve()} cannot be written; name a file elsewhere")
    return path

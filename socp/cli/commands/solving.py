"""`socp solve`."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import click

from socp.cli.commands.advising import advice
from socp.cli.commands.completing import keys, methods, problems
from socp.cli.commands.recording import live_option, record_option, recording, recording_watch
from socp.cli.keeping import ENDING, Place, keep
from socp.cli.options import DEFAULT_METHOD, pairs
from socp.cli.outcome import code, require_option
from socp.cli.posing import load_posed, named_after, set_option, told, with_changes
from socp.cli.progress import progress
from socp.cli.proofs import Proofs, proofs_of, provable
from socp.cli.running import made, run_method
from socp.cli.session import (
    Exit,
    Session,
    heading,
    messages,
    show,
    writable,
    write_json,
)
from socp.cli.show import facts, report
from socp.errors import MethodError, SolveError
from socp.process import signals_held
from socp.registry import load_guess

if TYPE_CHECKING:
    from socp.model import Problem, Solution, Watch


@final
@dataclass(frozen=True, kw_only=True)
class Asked:
    """What `socp solve` was asked for."""

    problem: str
    changes: tuple[str, ...]
    method: str
    options: tuple[str, ...]
    digits: int | None
    max_switches: int | None
    seconds: float | None
    guess: str | None
    start: tuple[str, ...]
    out: str | None
    record: str | None
    live: bool
    strict: bool
    require: str | None
    prove: bool
    bound: bool
    as_json: bool
    quiet: bool

    def named(self) -> list[str]:
        """Return the words of a command line that name the problem, with what is `--set`."""
        return [self.problem, *(word for each in self.changes for word in ("--set", each))]

    def shortened(self) -> list[tuple[str, str]]:
        """Return the options of the method that have a name of their own on the command line."""
        given = {
            "digits": self.digits,
            "max_switches": self.max_switches,
            "seconds": self.seconds,
        }
        return [(name, str(value)) for name, value in given.items() if value is not None]


@click.command()
@click.argument("problem", metavar="FILE_OR_NAME", shell_complete=problems)
@set_option
@click.option(
    "-m",
    "--method",
    default=DEFAULT_METHOD,
    show_default=True,
    help="Method, see 'socp methods'.",
    shell_complete=methods,
)
@click.option(
    "-o",
    "--option",
    "options",
    multiple=True,
    metavar="KEY=VALUE",
    shell_complete=keys,
    help="See 'socp describe METHOD'.",
)
@click.option(
    "--digits", type=int, metavar="N", help="The same as -o digits=N: digits to agree on."
)
@click.option(
    "--max-switches",
    type=int,
    metavar="N",
    help="The same as -o max_switches=N: where a control chatters.",
)
@click.option(
    "--seconds",
    type=float,
    metavar="S",
    help="The same as -o seconds=S: the time that a search may take.",
)
@click.option("--guess", metavar="FILE", help="Start from a saved result.")
@click.option(
    "--from",
    "start",
    multiple=True,
    metavar="NAME=VALUE",
    help="Solve with this value first, and follow the solution to the number's own.",
)
@click.option(
    "--out", metavar="FILE", help="Result file.  [default: PROBLEM.socp.json, with what is set]"
)
@click.option(
    "--strict", is_flag=True, help="Exit code 1 unless the result is certified as an extremal."
)
@require_option
@click.option("--prove", is_flag=True, help="Prove that the extremal exists, as 'socp prove'.")
@click.option("--bound", is_flag=True, help="Prove a lower bound too, as 'socp bound': a minute.")
@record_option
@live_option
@click.option("--json", "as_json", is_flag=True, help="Write the report as JSON.")
@click.option("--quiet", is_flag=True, help="Write no progress and no messages.")
@click.pass_obj
def solve(session: Session, /, **given: Any) -> int:
    """Solve a problem, given as a path, as path.py:name or as a registered name.

    The report goes to standard output, progress and messages to standard error, the whole solution
    to the result file.

    Exit code 0 if there is an answer: a certified extremal, or a feasible point at which the solver
    met its tolerances; the report's outcome says which. With --strict a certified extremal only,
    with --require what reaches a rung of the ladder.
    Exit code 1 if the solver reached its limit, failed, or ended at a point that misses the
    problem's conditions; the result is written all the same.
    """
    from socp.methods import default_guess

    asked = Asked(**given)
    session.quiet = asked.quiet
    registry = session.registry()
    session.complain(registry)
    method = made(registry, asked.method, [*asked.shortened(), *pairs(asked.options)])
    problem = load_posed(asked.problem, asked.changes, registry)
    easier = with_changes(problem, asked.start, "--from")
    guess = _guess(asked.guess, easier) if asked.guess else default_guess(easier)
    if asked.prove or asked.bound:
        provable()
    path = writable(
        Path(asked.out) if asked.out else named_after(problem.name, ENDING, asked.changes)
    )
    with (
        signals_held(),
        recording(session, registry, problem, asked.record, live=asked.live) as recorder,
    ):
        with progress(messages(), f"{problem.name}, {method.name}", quiet=asked.quiet) as watch:
            if asked.start:
                first = run_method(registry, method, easier, guess, watch)
                guess = _led(problem, asked.start, first, watch)
            solution = run_method(
                registry, method, problem, guess, recording_watch(watch, recorder)
            )
        wanted = asked.prove, asked.bound
        proofs = proofs_of(problem, solution, path, asked=wanted, quiet=asked.quiet)
        solution, place = proofs.solution, keep(problem, proofs.solution, path)
        session.written += [place.path, *proofs.certificates]
        recorder.finish(problem, solution)
    with signals_held():
        _show(problem, proofs, place.path, asked)
    for line in registry.solved(problem, solution):
        session.warn(line)
    return _ended(session, solution, place, asked)


def _ended(session: Session, solution: "Solution", place: Place, asked: Asked) -> int:
    """Say what else there is to know of a result, and return the exit code."""
    place.tell(session.warn)
    if solution.verdict is None:
        session.note(f"interrupted before it was verified: the result is in {place.path}")
        return Exit.INTERRUPTED
    if solution.stop.name == "INTERRUPTED":
        session.note(f"interrupted: the last iterate is in {place.path}")
        return Exit.INTERRUPTED
    return code(solution, strict=asked.strict, required=asked.require)


def _show(problem: "Problem", proofs: Proofs, path: Path, asked: Asked) -> None:
    solution = proofs.solution
    told = advice(solution, asked.named(), str(path))
    if asked.as_json:
        more = {"proofs": proofs.data} if proofs.data else {}
        found = {**facts(problem, solution), **more}
        write_json({**found, "advice": list(told), "result": str(path)})
        return
    table = report(problem, solution, str(path), proofs.lines)
    show(heading(problem.name, problem.title), table, *told)


def _led(
    problem: "Problem", start: tuple[str, ...], first: "Solution", watch: "Watch"
) -> "Solution":
    """Return a solution of a problem that is followed from that of an easier one."""
    from socp.study import followed_to

    numbers = {name: float(text) for name, text in told(start, "--from").items()}
    if not first.extremal:
        raise SolveError(f"{problem.name}: no extremal was certified at --from {', '.join(start)}")
    return followed_to(problem, numbers, first, watch=watch)


def _guess(path: str, problem: "Problem") -> "Solution":
    try:
        return load_guess(path, problem)
    except SolveError as error:
        raise MethodError(f"--guess {error}") from error

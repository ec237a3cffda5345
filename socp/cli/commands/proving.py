"""`socp prove`, a proof that a saved extremal exists; `socp bound`, a proved lower bound of a
problem's optimum; and the check of its certificate.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import click

from socp.cli.commands.completing import files, problems
from socp.cli.opening import open_result, problem_missing
from socp.cli.options import DEFAULT_METHOD
from socp.cli.posing import load_posed, named_after, set_option
from socp.cli.progress import progress
from socp.cli.proofs import BOUND, searched
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
from socp.cli.show import ladder, row, table_lines
from socp.errors import MethodError, ProblemError, SolveError
from socp.process import read_text, signals_held, write_atomic
from socp.view import gap_bar, top_text

if TYPE_CHECKING:
    from socp.model import Problem, Solution
    from socp.registry import Registry

_FORMAT = "socp bound "
_LEAST, _MOST = 64, 4096  # bits: with fewer nothing is proved, with more it takes hours
_LARGEST_DEGREE = 16  # a programme of it is beyond any machine's memory with two states already


@final
@dataclass(frozen=True, kw_only=True)
class Asked:
    """What the command line asked for."""

    problem: str
    changes: tuple[str, ...]
    result: str | None
    seconds: float
    degree: int | None
    out: Path | None
    as_json: bool
    quiet: bool


@click.command()
@click.argument("result", metavar="RESULT", shell_complete=files)
@click.option(
    "--bits",
    type=click.IntRange(_LEAST, _MOST),
    default=128,
    show_default=True,
    help="Bits of the balls.",
)
@click.option(
    "--problem", metavar="FILE_OR_NAME", help="Its problem.  [default: that of the result]"
)
@click.option("--json", "as_json", is_flag=True, help="Write the proof as JSON.")
@click.pass_obj
def prove(session: Session, /, result: str, bits: int, problem: str | None, as_json: bool) -> int:
    """Prove that the extremal of a saved result exists, enclose its objective and switching times,
    and prove that it is a local minimum of its word.

    Krawczyk's test on the word's equations in ball arithmetic shows that they have exactly one
    solution in a small box; enclosures show that it satisfies every condition of Pontryagin's
    principle, and the sign of the Hessian of the word's own problem. The laws of singular and
    boundary arcs are derived anew. It needs python-flint: `pip install 'socp[prove]'`. Exit code 1
    where the extremal is not proved; the report says at which step, and why.
    """
    from socp.proof import prove as proof_of

    solution, found = open_result(session, result, problem)
    if found is None:
        raise ProblemError(f"{result}: {problem_missing(solution)}")
    proof = proof_of(found, solution, bits)
    proved = solution.with_judgement(proofs=proof.rungs(solution))
    if as_json:
        write_json({**proof.data, "ladder": ladder(proved)})
    else:
        lines = [*proof.lines, ("rung", top_text(proved))]
        show(heading(found.name, found.title), table_lines(map(row, lines)))
    return Exit.SOLVED if proof.holds else Exit.UNSOLVED


@click.command()
@click.argument("problem", metavar="PROBLEM_OR_RESULT", shell_complete=problems)
@set_option
@click.option(
    "--result", metavar="RESULT", help="A saved result to compare with.  [default: auto solves it]"
)
@click.option(
    "--seconds",
    type=click.FloatRange(min=1.0),
    default=60.0,
    show_default=True,
    help="Time for the search of the bound; it is begun with low degrees.",
)
@click.option(
    "--degree",
    type=click.IntRange(1, _LARGEST_DEGREE),
    help="Degree of the subsolution.  [default: the largest that there is time for]",
)
@click.option(
    "-o",
    "--out",
    type=click.Path(path_type=Path),
    help="File of the certificate.  [default: PROBLEM.bound.json]",
)
@click.option("--json", "as_json", is_flag=True, help="Write the bound as JSON.")
@click.option("-q", "--quiet", is_flag=True, help="No messages.")
@click.pass_obj
def bound(session: Session, /, **given: Any) -> int:
    """Prove that no admissible control has a lower objective than a bound.

    Of a problem, as a file or a name, or of a saved result (.json) and its problem. A subsolution
    of the Hamilton-Jacobi-Bellman equation is found by sums of squares; the certificate, in exact
    fractions, is checked anew before anything is told, and written: `socp check` checks it again. A
    result shows how far the best known control may be from the optimum. Ctrl-C ends the search with
    the best bound so far. It needs python-flint: `pip install 'socp[prove]'`. Exit code 1 where
    there is no bound; the report says why.
    """
    return _bounded(session, Asked(**given))


def _bounded(session: Session, asked: Asked) -> int:
    session.quiet = asked.quiet
    registry = session.registry()
    problem, solution = _posed(session, registry, asked)
    path = writable(asked.out or named_after(problem.name, BOUND, asked.changes))
    with signals_held():
        found = searched(problem, solution, asked.seconds, asked.degree, quiet=asked.quiet)
        gap = found.gap(solution)
        proved = solution.with_judgement(proofs=found.rungs(solution))
        if found.bound is not None:
            write_atomic(path, json.dumps(found.certificate))
        if asked.as_json:
            write_json({**found.data, "gap": gap, "ladder": ladder(proved)})
        else:
            lines = [*found.lines, ("objective", f"{solution.objective:.12g}, {solution.word}")]
            if gap is not None:
                lines += [("gap", f"{100 * gap:.3g} %"), ("", gap_bar(solution.objective, gap))]
                lines += [("rung", top_text(proved)), ("certificate", str(path))]
            show(heading(problem.name, problem.title), table_lines(map(row, lines)))
    if found.interrupted:
        session.note(f"interrupted: the best bound so far is in {path}")
        return Exit.INTERRUPTED
    return Exit.UNSOLVED if found.bound is None else Exit.SOLVED


def _posed(session: Session, registry: "Registry", asked: Asked) -> "tuple[Problem, Solution]":
    """Return a problem and a result of it: the given one, or what `auto` finds."""
    from socp.methods import default_guess

    if Path(asked.problem).suffix == ".json":
        if asked.changes or asked.result:
            raise MethodError(f"{asked.problem} is a result: give --set and --result a problem")
        solution, own = open_result(session, asked.problem, None, registry)
        if own is None:
            raise ProblemError(f"{asked.problem}: {problem_missing(solution)}")
        return own, solution
    problem = load_posed(asked.problem, asked.changes, registry)
    if asked.result is None:
        method = made(registry, DEFAULT_METHOD, ())
        with progress(messages(), f"{problem.name}, {method.name}", quiet=asked.quiet) as watch:
            return problem, run_method(registry, method, problem, default_guess(problem), watch)
    solution, own = open_result(session, asked.result, None, registry)
    if own is None or own.fingerprint != problem.fingerprint:
        raise ProblemError(f"{asked.result}: it is no result of the problem '{problem.name}'")
    return problem, solution


def certificate_in(path: str) -> Mapping[str, Any] | None:
    """Return the certificate that a file holds, None where it is another file."""
    try:
        text = read_text(path)
        found = json.loads(text) if f'"{_FORMAT}' in text else None
    except (SolveError, ValueError, RecursionError):
        return None  # whoever reads it as a result says what is wrong
    is_one = isinstance(found, dict) and str(found.get("format", "")).startswith(_FORMAT)
    return found if is_one else None


def check_certificate(
    session: Session, path: str, certificate: Mapping[str, Any], given: str | None, as_json: bool
) -> int:
    """Check a certificate of a lower bound, and show what it proves."""
    from socp.model import Problem
    from socp.proof import checked
    from socp.registry import load_problem

    try:
        proved = checked(certificate)
        problem = Problem.from_statement(certificate["problem"])
    except (SolveError, ProblemError) as error:
        reason = str(error)
        if as_json:
            write_json({"proved": False, "reason": reason})
        else:
            show(heading(path, ""), table_lines([row(("not proved", reason))]))
        return Exit.UNSOLVED
    if given is not None:
        other = load_problem(given, session.registry())
        if other.fingerprint != problem.fingerprint:
            raise ProblemError(f"{path}: it bounds another problem than '{given}'")
    if as_json:
        data = {"problem": problem.name, "fingerprint": problem.fingerprint}
        write_json({"proved": True, "bound": float(proved), **data})
        return Exit.SOLVED
    lines = [
        ("proved", f"no admissible control has a lower objective than {float(proved):.10g}"),
        ("problem", f"{problem.name}, fingerprint {problem.fingerprint[:16]}"),
        ("arithmetic", "every inequality expanded anew, in fractions"),
    ]
    show(heading(problem.name, problem.title), table_lines(map(row, lines)))
    return Exit.SOLVED

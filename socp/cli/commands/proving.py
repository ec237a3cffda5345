"""`socp prove`, a proof that a saved extremal exists; `socp bound`, a proved lower bound of a
problem's optimum; and the check of its certificate.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import click

from socp.cli.opening import open_result, problem_missing
from socp.cli.options import DEFAULT_METHOD
from socp.cli.posing import load_posed, named_after, set_option
from socp.cli.running import made, run_method
from socp.cli.session import Exit, Session, heading, show, writable, write_json
from socp.cli.show import ladder, table_lines
from socp.errors import ProblemError, SolveError
from socp.process import read_text, write_atomic
from socp.view import Row, Tone, top_text

if TYPE_CHECKING:
    from socp.model import Problem, Solution
    from socp.registry import Registry

ENDING = ".bound.json"
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
@click.argument("result", metavar="RESULT")
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
    """Prove that the extremal of a saved result exists, and enclose its objective and switching
    times.

    Krawczyk's test on the word's equations in ball arithmetic shows that they have exactly one
    solution in a small box; enclosures show that it satisfies every condition of Pontryagin's
    principle. The laws of singular and boundary arcs are derived anew. It needs python-flint:
    `pip install 'socp[prove]'`. Exit code 1 where it is not proved; the report says at which step,
    and why.
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
        show(heading(found.name, found.title), _table([*proof.lines, ("rung", top_text(proved))]))
    return Exit.SOLVED if proof.holds else Exit.UNSOLVED


@click.command()
@click.argument("problem", metavar="FILE_OR_NAME")
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

    A subsolution of the Hamilton-Jacobi-Bellman equation is found by sums of squares; the
    certificate, in exact fractions, is checked anew before anything is told, and written: `socp
    check` checks it again. A result shows how far the best known control may be from the optimum.
    It needs python-flint: `pip install 'socp[prove]'`. Exit code 1 where there is no bound; the
    report says why.
    """
    return _bounded(session, Asked(**given))


def _bounded(session: Session, asked: Asked) -> int:
    from socp.proof import lower_bound

    session.quiet = asked.quiet
    registry = session.registry()
    problem = load_posed(asked.problem, asked.changes, registry)
    path = writable(asked.out or named_after(problem.name, ENDING, asked.changes))
    solution = _known(session, registry, problem, asked.result)
    found = lower_bound(problem, solution, asked.seconds, asked.degree)
    gap = found.gap(solution)
    proved = solution.with_judgement(proofs=found.rungs(solution))
    if found.bound is not None:
        write_atomic(path, json.dumps(found.certificate))
    if asked.as_json:
        write_json({**found.data, "gap": gap, "ladder": ladder(proved)})
        return Exit.UNSOLVED if found.bound is None else Exit.SOLVED
    lines = [*found.lines, ("objective", f"{solution.objective:.12g}, {solution.word}")]
    if gap is not None:
        lines += [("gap", f"{100 * gap:.3g} %"), ("rung", top_text(proved))]
        lines += [("certificate", str(path))]
    show(heading(problem.name, problem.title), _table(lines))
    return Exit.UNSOLVED if found.bound is None else Exit.SOLVED


def _table(lines: Sequence[tuple[str, str]]) -> Any:
    return table_lines([Row(label, (((text, Tone.PLAIN),),)) for label, text in lines])


def _known(
    session: Session, registry: "Registry", problem: "Problem", result: str | None
) -> "Solution":
    """Return a result of a problem: the given one, or what `auto` finds."""
    from socp.methods import default_guess
    from socp.model import silent

    if result is None:
        method = made(registry, DEFAULT_METHOD, ())
        return run_method(registry, method, problem, default_guess(problem), silent)
    solution, its = open_result(session, result, None, registry)
    if its is None or its.fingerprint != problem.fingerprint:
        raise ProblemError(f"{result}: it is no result of the problem '{problem.name}'")
    return solution


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
            show(heading(path, ""), _table([("not proved", reason)]))
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
    show(heading(problem.name, problem.title), _table(lines))
    return Exit.SOLVED

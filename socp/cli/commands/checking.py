"""`socp check`: judge a saved result."""

import click

from socp.cli.commands.completing import files
from socp.cli.commands.proving import certificate_in, check_certificate
from socp.cli.opening import open_result, problem_missing
from socp.cli.outcome import require_option, required_rung
from socp.cli.session import Exit, Session, heading, show, write_json
from socp.cli.show import plain, table_lines
from socp.errors import ProblemError, SolveError
from socp.view import Outcome, detailed_rows, outcome_of


@click.command()
@click.argument("result", metavar="RESULT", shell_complete=files)
@click.option(
    "--problem", metavar="FILE_OR_NAME", help="Its problem.  [default: that of the result]"
)
@require_option
@click.option("--json", "as_json", is_flag=True, help="Write the verdict as JSON.")
@click.pass_obj
def check(
    session: Session, /, result: str, problem: str | None, require: str | None, as_json: bool
) -> int:
    """Judge a saved result: whether it is feasible, whether it is an extremal of Pontryagin's
    principle, how clearly.

    Everything is worked out anew from the problem that the result carries, as data, and from its
    states and controls. Exit code 0 if the result is certified as an extremal, 1 if it is not or
    cannot be read. The certificate of a lower bound, as `socp bound` writes it, is checked instead:
    exit code 0 if it proves its bound.
    """
    from socp.verdict import judge, with_second_order

    try:
        solution, found = open_result(session, result, problem)
    except SolveError:
        certificate = certificate_in(result)
        if certificate is None:
            raise
        return check_certificate(session, result, certificate, problem, as_json)
    if found is None:
        raise ProblemError(f"{result}: {problem_missing(solution)}")
    solution = with_second_order(found, judge(found, solution))
    verdict = solution.verdict
    if verdict is None:
        return Exit.UNSOLVED
    if as_json:
        write_json({"problem": found.name, "word": solution.word, **plain(solution, verdict)})
    else:
        show(heading(found.name, found.title), table_lines(detailed_rows(solution, verdict)))
    if require is None:
        return Exit.SOLVED if outcome_of(solution) is Outcome.EXTREMAL else Exit.UNSOLVED
    return Exit.SOLVED if required_rung(solution, require) else Exit.UNSOLVED

"""`socp prove`: a proof in ball arithmetic that a saved extremal exists."""

import click

from socp.cli.opening import open_result, problem_missing
from socp.cli.session import Exit, Session, heading, show, write_json
from socp.cli.show import ladder, table_lines
from socp.errors import ProblemError
from socp.view import Row, Tone, top_text

_LEAST, _MOST = 64, 4096  # bits: with fewer nothing is proved, with more it takes hours


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
        lines = [*proof.lines, ("rung", top_text(proved))]
        rows = [Row(label, (((text, Tone.PLAIN),),)) for label, text in lines]
        show(heading(found.name, found.title), table_lines(rows))
    return Exit.SOLVED if proof.holds else Exit.UNSOLVED

"""`socp report`: saved results as a page that needs no network and no viewer."""

from pathlib import Path

import click

from socp.cli.commands.completing import files
from socp.cli.commands.exporting import stem
from socp.cli.opening import open_result, opened_beside, problem_missing
from socp.cli.session import Exit, Session, writable


@click.command()
@click.argument("results", metavar="RESULT...", nargs=-1, required=True, shell_complete=files)
@click.option("-o", "--out", metavar="FILE", help="File, .html.  [default: RESULT.html]")
@click.option(
    "--problem", metavar="FILE_OR_NAME", help="Its problem.  [default: that of the result]"
)
@click.pass_obj
def report(
    session: Session, /, results: tuple[str, ...], out: str | None, problem: str | None
) -> int:
    """Write saved results as one HTML file to hand on: what the report says, plots that can be
    zoomed, the problem's formula, the verdict with its margins, and how it was found.

    The file holds all that it shows, and opens in any browser, without a network. Of several
    results the others are drawn beside the first, and compared in a table.
    """
    from socp.process import write_atomic
    from socp.view import to_page

    path = writable(Path(out or f"{stem(results[0])}.html"), "-o")
    first, *others = results
    solution, own = open_result(session, first, problem)
    if own is None:
        session.note(f"no bounds and no formula: {problem_missing(solution)}")
    beside = opened_beside(session, own, {stem(each): each for each in others})
    write_atomic(path, to_page(solution, own, beside).encode())
    session.tell(path)
    return Exit.SOLVED

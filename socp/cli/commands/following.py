"""`socp follow`: an extremal over one number of its problem, through changes of its word."""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich import box
from rich.table import Table
from rich.text import Text

from socp.cli.commands.completing import problems
from socp.cli.commands.recording import record_page, record_place
from socp.cli.options import DEFAULT_METHOD
from socp.cli.posing import load_posed, named_after, set_option, span_of, told_line, with_changes
from socp.cli.progress import progress
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
from socp.errors import SolveError
from socp.process import signals_held
from socp.registry import load_guess
from socp.view import times

if TYPE_CHECKING:
    from socp.model import Problem, Solution, Watch
    from socp.registry import Registry
    from socp.study import Branch


@click.command()
@click.argument("problem", metavar="FILE_OR_NAME", shell_complete=problems)
@set_option
@click.option(
    "--steps",
    default=20,
    show_default=True,
    type=click.IntRange(1, 100_000),
    help="Points at least.",
)
@click.option("--guess", metavar="FILE", help="Begin with a saved result.")
@click.option("--out", metavar="FILE", help="Table.  [default: PROBLEM.follow.parquet]")
@click.option("--record", metavar="FILE", help="Record the branch, its number as the timeline.")
@click.option("--json", "as_json", is_flag=True, help="Write the table as JSON.")
@click.option("--quiet", is_flag=True, help="Write no progress and no messages.")
@click.pass_obj
def follow(session: Session, /, **given: Any) -> int:
    """Follow an extremal while one number goes from a value to another, --set NAME=FROM:TO.

    Every point is certified. Where the word changes, as an arc vanishes or a constraint is touched,
    the value at which it does is located, and the branch goes on along the next word. The table is
    written as Parquet: 'socp plot' draws it.

    Exit code 1 if the branch ends before the last value.
    """
    from socp.study import follow as followed
    from socp.view import branch_page, rows_to_parquet

    session.quiet = given["quiet"]
    registry = session.registry()
    name, span, others = span_of(given["changes"])
    posed = load_posed(given["problem"], others, registry)
    path = writable(
        Path(given["out"]) if given["out"] else named_after(posed.name, ".follow.parquet", others)
    )
    recording = record_place(given["record"])
    rows_to_parquet([{"value": 0.0}], {})  # what is lacking is said before the work, not after it
    first = with_changes(posed, (f"{name}={span[0]!r}",))
    with progress(messages(), f"{posed.name}, follow", quiet=session.quiet) as watch:
        start = _start(registry, first, given["guess"], watch)
        found = followed(posed, {name: span}, start, steps=given["steps"], watch=watch)
    with signals_held():
        _written(session, posed, found, path)
        if recording is not None:
            solutions = [each.solution for each in found.points]
            page = branch_page(name, solutions, found.rows)
            record_page(session, registry, recording, posed.name, page)
        if given["as_json"]:
            write_json({**_facts(posed, found), "rows": found.rows, "table": str(path)})
        else:
            above = heading(posed.name, posed.title), *told_line(given["changes"])
            ended = [Text(f"ended  {found.ended}")] if found.ended else []
            show(*above, _table(found), *ended, Text(f"table  {path}"))
    if found.interrupted:
        session.note("interrupted: the table is of the points before")
        return Exit.INTERRUPTED
    return Exit.UNSOLVED if found.ended else Exit.SOLVED


def _start(
    registry: "Registry", problem: "Problem", guess: str | None, watch: "Watch"
) -> "Solution":
    """Return a certified solution at the first value, by the default method."""
    from socp.methods import default_guess

    start = load_guess(guess, problem) if guess else default_guess(problem)
    solution = run_method(registry, made(registry, DEFAULT_METHOD, []), problem, start, watch)
    if not solution.extremal:
        raise SolveError(f"{problem.name}: no extremal was certified at the first value")
    return solution


def _facts(problem: "Problem", found: "Branch") -> Mapping[str, Any]:
    return {
        "kind": "branch",
        "problem": problem.name,
        "title": problem.title,
        "name": found.name,
        "ended": found.ended,
        "interrupted": found.interrupted,
    }


def _written(session: Session, problem: "Problem", found: "Branch", path: Path) -> None:
    from socp.process import write_atomic
    from socp.view import rows_to_parquet

    write_atomic(path, rows_to_parquet(found.rows, _facts(problem, found)))
    session.written.append(path)


def _table(found: "Branch") -> Table:
    table = Table(box=box.SIMPLE_HEAD, header_style="bold")
    for head in (found.name, "objective"):
        table.add_column(Text(head), justify="right", no_wrap=True)
    for head in ("word", "switching times", "verdict or event"):
        table.add_column(head, overflow="fold")
    for row in found.rows:
        event = f"{row['event']}: {row['where']}" if row["event"] else ""
        if event and not math.isnan(row["time"]):
            event += f" at t = {row['time']:.7g}"
        digits = 12 if event else 9
        cells = (
            f"{row['value']:.{digits}g}",
            f"{row['objective']:.10g}",
            "" if event else "\n".join(row["word"].split("; ")),
            times(row["switches"], 7),
            event or row["rung"],
        )
        table.add_row(*map(Text, cells), style="bold" if event else None)
    return table

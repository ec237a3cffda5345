"""`socp sweep`: one problem at many points, a row each."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich import box
from rich.table import Table
from rich.text import Text

from socp.cli.commands.completing import problems
from socp.cli.options import DEFAULT_METHOD
from socp.cli.posing import Named, load_posed, named_after, ranges_of, told_line
from socp.cli.progress import progress
from socp.cli.session import (
    Exit,
    Session,
    heading,
    messages,
    show,
    writable,
    write_json,
)
from socp.errors import KeepingError
from socp.process import short, signals_held, write_atomic

if TYPE_CHECKING:
    from socp.model import Problem
    from socp.study import Sweep


_TOLD = 5  # messages of a report: the table has them all


@click.command()
@click.argument("problem", metavar="FILE_OR_NAME", shell_complete=problems)
@click.option(
    "--set",
    "changes",
    multiple=True,
    metavar="NAME=LO:HI:N",
    help="A number on a grid; NAME~normal(MEAN,DEVIATION) or NAME~uniform(LO,HI) is drawn, "
    "NAME=VALUE is held. Every combination is solved.",
)
@click.option("--from", "table", metavar="FILE", help="Rows of numbers, .csv or .parquet.")
@click.option("--sample", type=click.IntRange(1, 1_000_000), help="Number of draws.")
@click.option("--seed", default=0, show_default=True, type=click.IntRange(0), help="Of the draws.")
@click.option(
    "-j",
    "--jobs",
    type=click.IntRange(1, 1024),
    help="Worker processes.  [default: 1; with --dask local one a core]",
)
@click.option("--dask", metavar="ADDRESS", help="Scheduler of dask, or 'local' for one of its own.")
@click.option(
    "--seconds",
    type=click.FloatRange(1.0),
    metavar="S",
    help="The time that the search for one point may take.  [default: 60]",
)
@click.option("--keep", metavar="DIR", help="Write every whole result there.")
@click.option("-o", "--out", metavar="FILE", help="Table.  [default: PROBLEM.sweep.parquet]")
@click.option("--json", "as_json", is_flag=True, help="Write the table as JSON.")
@click.option("--quiet", is_flag=True, help="Write no progress and no messages.")
@click.pass_obj
def sweep(session: Session, /, **given: Any) -> int:
    """Solve a problem at every combination of numbers: a row for each, in a Parquet file.

    Neighbours start from neighbours, and every result is judged. What is finished is kept in a
    directory beside the table: the same command goes on where it was interrupted, and ends in the
    same table. 'socp plot' draws it.

    Exit code 1 if no point is certified.
    """
    from socp.study import Kept, engine, points, travels
    from socp.study import sweep as swept
    from socp.view import columns_from, rows_to_parquet

    session.quiet = given["quiet"]
    ranges, held = ranges_of(given["changes"])
    found = points(
        ranges,
        columns_from(Path(given["table"])) if given["table"] else None,
        given["sample"],
        given["seed"],
    )
    named = Named(given["problem"], held)
    posed = load_posed(named.given, named.changes, session.registry())
    path = writable(
        Path(given["out"]) if given["out"] else named_after(posed.name, ".sweep.parquet", held)
    )
    rows_to_parquet([{"value": 0.0}], {})  # what is lacking is said before the work, not after it
    kept = Kept(path.with_suffix(""), Path(given["keep"]) if given["keep"] else None)
    with (
        engine(given["dask"] or given["jobs"] or 1, given["jobs"]) as hands,
        progress(messages(), f"{posed.name}, sweep", quiet=session.quiet) as watch,
    ):
        if hands.dashboard:
            session.note(f"dashboard  {hands.dashboard}")
        source = posed if travels(posed) else named
        options = {name: given[name] for name in ("seconds",) if given[name] is not None}
        result = swept(
            source,
            found,
            workers=hands.workers,
            kept=kept,
            method=DEFAULT_METHOD,
            watch=watch,
            **options,
        )
    with signals_held():
        _written(session, posed, result, path)
        if given["as_json"]:
            write_json({**_facts(posed, result), "rows": result.rows, "table": str(path)})
        else:
            above = heading(posed.name, posed.title), *told_line(given["changes"])
            show(*above, *_tables(result), Text(f"table  {path}"))
    if result.unkept:
        raise KeepingError(f"{result.unkept}; the table holds them, but another sweep begins anew")
    if result.interrupted:
        session.note(
            f"interrupted: {len(result.rows)} of {result.wanted} points are kept in {kept.chains}"
        )
        return Exit.INTERRUPTED
    return Exit.SOLVED if result.certified else Exit.UNSOLVED


def _facts(problem: "Problem", found: "Sweep") -> Mapping[str, Any]:
    known = problem.constants
    return {
        "kind": "sweep",
        "problem": problem.name,
        "title": problem.title,
        "names": list(found.names),
        "units": {k: known[k].unit for k in found.names if k in known},
        "wanted": found.wanted,
        "certified": found.certified,
        "interrupted": found.interrupted,
    }


def _written(session: Session, problem: "Problem", found: "Sweep", path: Path) -> None:
    from socp.view import rows_to_parquet

    write_atomic(path, rows_to_parquet(found.rows, _facts(problem, found)))
    session.written.append(path)


def _tables(found: "Sweep") -> list[Table | Text]:
    """Return what the points came to, by word, and what is said of those that are not certified."""
    table = Table(box=box.SIMPLE_HEAD, header_style="bold")
    table.add_column("word", overflow="fold")
    for head in ("points", "objective", "seconds"):
        table.add_column(head, justify="right", no_wrap=True)
    good = [row for row in found.rows if not row["message"]]
    for word, count in Counter(row["word"] for row in good).most_common():
        rows = [row for row in good if row["word"] == word]
        cells = "\n".join(word.split("; ")), str(count), _span(rows), _seconds(rows)
        table.add_row(*map(Text, cells))
    bad = Counter(short(row["message"]) for row in found.rows if row["message"])
    told = [Text(f"{count} not certified: {message}") for message, count in bad.most_common(_TOLD)]
    total = f"{found.certified} of {found.wanted} points certified"
    return [*([table] if good else []), Text(total), *told]


def _span(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the least and the largest objective."""
    values = [row["objective"] for row in rows]
    return f"{min(values):.7g} ... {max(values):.7g}"


def _seconds(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the mean seconds of a point."""
    return f"{math.fsum(row['seconds'] for row in rows) / len(rows):.2f}"

"""`socp plot`: a figure of a saved result."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import click

from socp.cli.commands.completing import files
from socp.cli.commands.exporting import stem
from socp.cli.opening import open_result, opened_beside, problem_missing
from socp.cli.session import Exit, Session, writable
from socp.errors import MethodError


@final
@dataclass(frozen=True, kw_only=True)
class Asked:
    """What `socp plot` was asked for."""

    results: tuple[str, ...]
    out: str | None
    panels: str | None
    width: float
    stretch: bool
    title: bool
    problem: str | None


@click.command()
@click.argument("results", metavar="RESULT...", nargs=-1, required=True, shell_complete=files)
@click.option(
    "-o", "--out", metavar="FILE", help="File, .png, .svg or .pdf.  [default: RESULT.svg]"
)
@click.option(
    "--panels", metavar="NAME,...", help="Some of the panels below.  [default: all but hamiltonian]"
)
@click.option(
    "--width",
    type=click.FloatRange(2, 30),
    default=7.0,
    metavar="INCHES",
    help="Width.  [default: 7]",
)
@click.option("--title", is_flag=True, help="Say above what it is: objective, final time, verdict.")
@click.option("--stretch", is_flag=True, help="Widen short arcs on the time axis.")
@click.option(
    "--problem", metavar="FILE_OR_NAME", help="Its problem.  [default: that of the result]"
)
@click.pass_obj
def plot(session: Session, /, **given: Any) -> int:
    """Draw a figure of saved results: controls with their arcs, switching functions, states,
    costates and the path; of the table of 'socp follow', or of 'socp sweep' over one number,
    objective and switching times over that number; of one over two, maps of the objective and of
    the words.

    Of several results the others are drawn beside the first, in the same panels.

    Panels: scene, controls, switching, states, costates, multipliers, hamiltonian. What is not
    known is left out: bounds, switching functions, units and the scene need the problem. Below 5
    inches they stand in one column.
    """
    from socp.process import write_atomic
    from socp.view import (
        DEFAULT,
        ENDINGS,
        check,
        draw,
        draw_branch,
        draw_sweep,
        rows_from_parquet,
        to_bytes,
    )

    asked = Asked(**given)
    if math.isnan(asked.width):
        raise MethodError("--width nan: it must be a number of inches from 2 to 30")
    path = writable(Path(asked.out or f"{stem(asked.results[0])}.svg"), "-o")
    ending = path.suffix.removeprefix(".").lower()
    if ending not in ENDINGS:
        endings = ", ".join(f".{each}" for each in ENDINGS)
        raise MethodError(f"-o {path}: it ends with '{path.suffix}'; figures end with {endings}")
    panels = asked.panels.replace(" ", "").split(",") if asked.panels else DEFAULT
    check(panels)
    first, *others = asked.results
    if first.endswith(".parquet"):
        rows, facts = rows_from_parquet(Path(first))
        drawn = draw_sweep if facts.get("kind") == "sweep" else draw_branch
        figure = drawn(rows, facts, width=asked.width)
        write_atomic(path, to_bytes(figure, ending))
        session.tell(path)
        return Exit.SOLVED
    solution, problem = open_result(session, first, asked.problem)
    if problem is None:
        session.note(f"no bounds and no scene: {problem_missing(solution)}")
    beside = opened_beside(session, problem, {stem(each): each for each in others})
    figure = draw(
        solution,
        problem,
        panels,
        width=asked.width,
        stretch=asked.stretch,
        beside=beside,
        title=asked.title,
    )
    write_atomic(path, to_bytes(figure, ending))
    session.tell(path)
    return Exit.SOLVED

"""`socp sensitivity`: how a saved extremal moves with its data."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click
from rich.table import Table
from rich.text import Text

from socp.cli.commands.completing import files
from socp.cli.opening import open_result, problem_missing
from socp.cli.session import Exit, Session, heading, show, write_json
from socp.errors import ProblemError

if TYPE_CHECKING:
    from socp.model import Problem, Sensitivities, Solution


@click.command()
@click.argument("result", metavar="RESULT", shell_complete=files)
@click.option(
    "--to",
    "names",
    multiple=True,
    metavar="NAME",
    help="A datum: start.x, end.x, u.upper, a parameter; may be repeated.  [default: all]",
)
@click.option(
    "--at",
    "times",
    multiple=True,
    type=float,
    metavar="TIME",
    help="A time at which the states are derived too; may be repeated.",
)
@click.option(
    "--problem", metavar="FILE_OR_NAME", help="Its problem.  [default: that of the result]"
)
@click.option("--json", "as_json", is_flag=True, help="Write the derivatives as JSON.")
@click.pass_obj
def sensitivity(
    session: Session,
    /,
    result: str,
    names: Sequence[str],
    times: Sequence[float],
    problem: str | None,
    as_json: bool,
) -> int:
    """Derive a saved extremal by its data: objective, switching times, final time, parameters and
    states, per unit of what is changed.

    Data are values at the ends, `start.x` and `end.x`, `initial_time` and `final_time`, parameters
    with equal bounds, bounds of controls and states, `u.upper`, and levels of end conditions,
    `target.NAME`. The derivatives are those along the word of the result; 0 is what is within the
    rounding of its quantity. Exit code 1 where there are none; the message says why.
    """
    from socp.verdict import derivatives, judge

    solution, found = open_result(session, result, problem)
    if found is None:
        raise ProblemError(f"{result}: {problem_missing(solution)}")
    solution = judge(found, solution)
    derived = derivatives(found, solution, names, times)
    if as_json:
        write_json(derived.data)
    else:
        reasons = map(Text, derived.missing.values())
        show(heading(found.name, found.title), _table(found, solution, derived), *reasons)
    return Exit.SOLVED


def _table(problem: "Problem", solution: "Solution", derived: "Sensitivities") -> Table:
    """Return the derivatives, quantities by data; there are rows of what there is more of."""
    rows = [("objective", [each.objective for each in derived])]
    if any(each.initial_time for each in derived):
        rows.append(("initial time", [each.initial_time for each in derived]))
    for k, t in enumerate(solution.junctions):
        rows.append((f"switch at {t:.6g}", [each.junctions[k] for each in derived]))
    rows.append(("final time", [each.final_time for each in derived]))
    rows += [(name, [e.parameters[name] for e in derived]) for name in problem.parameter_names]
    for t in derived[0].states if len(derived) else ():
        for i, name in enumerate(problem.state_names):
            rows.append((f"{name} at {t:g}", [each.states[t][i] for each in derived]))
    corner, heads = "derivative of", [f"by {each.to}" for each in derived]
    if len(heads) > len(rows):
        turned = zip(heads, zip(*(values for _, values in rows), strict=True), strict=True)
        corner, heads = "derivative", [f"of {label}" for label, _ in rows]
        rows = [(head, list(values)) for head, values in turned]
    table = Table(header_style="bold", box=None)
    table.add_column(corner, no_wrap=True)
    for head in heads:
        table.add_column(Text(head), justify="right", overflow="fold")
    for label, values in rows:
        table.add_row(Text(label), *(Text(f"{value:.9g}") for value in values))
    return table

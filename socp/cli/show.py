"""What the commands show of a solution: its facts as plain values, and its report on a terminal."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any

from rich.table import Table
from rich.text import Text

from socp.cli.outcome import UNJUDGED, outcome
from socp.view import Line, Row, Tone, infeasible, solution_rows, to_reference

if TYPE_CHECKING:
    from socp.model import Problem, Solution, Verdict

COLOURS = {Tone.PLAIN: "", Tone.GOOD: "green", Tone.BAD: "red", Tone.NOTE: "yellow"}


def facts(problem: "Problem", solution: "Solution") -> dict[str, Any]:
    """Return what a solution says, without the values at its nodes."""
    came_to, none = outcome(solution), infeasible(solution)
    return {
        "problem": problem.name,
        "title": problem.title,
        "constants": {name: each.value for name, each in problem.constants.items()},
        "method": solution.method,
        "options": solution.options,
        "outcome": came_to.name,
        "solved": came_to.answer,
        "stop": solution.stop.name,
        "message": solution.message,
        "objective": None if none else solution.told,
        "value": solution.objective,
        "objective_reached": solution.reached,
        "initial_time": solution.initial_time,
        "final_time": solution.final_time,
        "parameters": solution.parameters,
        "nodes": int(solution.t.size),
        "word": None if none else solution.word,
        "switches": solution.switches,
        "structure": solution.structure,
        "total_variation": variations(solution),
        "verified": [
            {**asdict(each), "worst": each.worst, "off": each.off} for each in solution.verified
        ],
        "starts": None if solution.starts is None else asdict(solution.starts),
        "verdict": None if solution.verdict is None else plain(solution, solution.verdict),
        "iterations": solution.effort.iterations,
        "seconds": solution.seconds,
        "reference": None if none else to_reference(problem, solution),
    }


def plain(solution: "Solution", verdict: "Verdict") -> dict[str, Any]:
    """Return the verdict of a solution as plain values, with what follows from them and the
    ladder.
    """
    from socp.model import rung_of

    derived: dict[str, Any] = {
        name: getattr(verdict, name)
        for name in ("feasible", "extremal", "approximate", "residual", "reasons", "rings")
    }
    own = {each.name: getattr(verdict, each.name) for each in fields(verdict)}
    own["findings"] = [finding.data for finding in verdict.findings]
    own["grade"] = None if verdict.grade is None else asdict(verdict.grade)
    own["second_order"] = verdict.second_order and verdict.second_order.data
    derived["rung"] = rung_of(solution).name
    derived["ladder"] = ladder(solution)
    return {**derived, **own}


def ladder(solution: "Solution") -> list[dict[str, Any]]:
    """Return the rungs that a solution was asked for as plain values."""
    from socp.model import ladder_steps

    return [{**asdict(step), "rung": step.rung.name} for step in ladder_steps(solution)]


def variations(solution: "Solution") -> dict[str, float]:
    """Return the total variation of every control by name."""
    return dict(zip(solution.control_names, solution.total_variation().tolist(), strict=True))


def worst(solution: "Solution") -> float:
    """Return the largest figure of re-integration, by time and by feedback."""
    return max((each.off for each in solution.verified), default=float("nan"))


def report(
    problem: "Problem", solution: "Solution", path: str, more: Sequence[tuple[str, str]] = ()
) -> Table:
    """Return the report of a solve, one fact a row, with more of them at its end."""
    return table_lines([*solution_rows(problem, solution, UNJUDGED, path), *map(row, more)])


def row(line: tuple[str, str]) -> Row:
    """Return a label and a text as a row."""
    label, text = line
    return Row(label, (((text, Tone.PLAIN),),))


def table_lines(rows: Iterable[Row]) -> Table:
    """Return rows as a table without lines, each label once."""
    grid = Table.grid(padding=(0, 2, 0, 0))
    grid.add_column(style="bold", no_wrap=True)
    grid.add_column(overflow="fold")
    for row in rows:
        for k, line in enumerate(row.lines):
            grid.add_row(row.label if k == 0 else "", _coloured(line))
    return grid


def _coloured(line: Line) -> Text:
    if len(line) == 1:  # a tone of its own colours the whole cell
        ((text, tone),) = line
        return Text(text, COLOURS[tone])
    return Text.assemble(*((text, COLOURS[tone]) for text, tone in line))

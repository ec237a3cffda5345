"""`socp compare`: one problem, several methods, one table."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import click
from rich import box
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table
from rich.text import Text

from socp.cli.commands.completing import files, methods, problems
from socp.cli.commands.recording import record_option, recording, recording_watch
from socp.cli.keeping import ENDING, keep
from socp.cli.machine import lacking
from socp.cli.opening import opened_beside
from socp.cli.options import options_by_method
from socp.cli.posing import load_posed, named_after, set_option, told, told_line
from socp.cli.progress import progress
from socp.cli.running import made, run_method
from socp.cli.session import Exit, Session, messages, results, show, writable, write_json
from socp.cli.show import facts, variations, worst
from socp.errors import MethodError, SocpError
from socp.model import COMPARED
from socp.process import heard, one_line, signals_held
from socp.registry import Registry, reason
from socp.view import signed_error, small, stated_error, switching_times, times, to_reference

if TYPE_CHECKING:
    from socp.methods import Method
    from socp.model import Problem, Solution
    from socp.registry import Guarded


@final
@dataclass(frozen=True)
class Row:
    """A method with its solution, or with the reason why there is none; a saved result by its
    file's name.
    """

    method: str
    solution: "Solution | None" = None
    error: str = ""
    bug: bool = False

    @property
    def interrupted(self) -> bool:
        """Whether the solve was interrupted, or its judgement."""
        return self.solution is not None and (
            self.solution.verdict is None or self.solution.stop.name == "INTERRUPTED"
        )

    @property
    def ok(self) -> bool:
        """Whether the method's solver met its tolerances."""
        return self.solution is not None and self.solution.stop.ok


@click.command()
@click.argument("problem", metavar="FILE_OR_NAME", shell_complete=problems)
@click.option(
    "-m",
    "--method",
    "names",
    multiple=True,
    default=("euler-ipopt", "lgr", "auto"),  # the calmest grid, the most accurate one, the arcs
    show_default="euler-ipopt, lgr, auto",
    metavar="NAME",
    help="Method; give several.",
    shell_complete=methods,
)
@click.option(
    "-o",
    "--option",
    "given",
    multiple=True,
    metavar="[METHOD.]KEY=VALUE",
    help="Option of one method, or of each that has it.",
)
@set_option
@click.option(
    "--with",
    "beside",
    multiple=True,
    metavar="RESULT",
    help="A saved result of the problem, for a row of its own; give several.",
    shell_complete=files,
)
@click.option("--keep", metavar="DIR", help="Write the result of every method there.")
@record_option
@click.option("--json", "as_json", is_flag=True, help="Write the table as JSON.")
@click.option("--quiet", is_flag=True, help="Write no progress and no messages.")
@click.pass_obj
def compare(
    session: Session, /, problem: str, names: tuple[str, ...], given: tuple[str, ...], **how: Any
) -> int:
    """Solve a problem with several methods, each from the default guess, and print one table;
    results are written where --keep says.

    Objectives are what controls reach by re-integration where a method claims another. Errors are
    to the best one: the lowest of those that re-integration finds feasible to 1e-6 (relative), or
    else that of the most feasible solution. Exit code 0 if every method's solver met
    its tolerances, 1 if one did not; how feasible each is stands in the table.
    """
    session.quiet = quiet = how["quiet"]
    registry = session.registry()
    session.complain(registry)
    chosen = [registry.method(name) for name in dict.fromkeys(names)]
    options = options_by_method(chosen, given)
    built = [made(registry, method.name, options[method.name]) for method in chosen]
    posed = load_posed(problem, how["changes"], registry)
    saved = _saved(session, posed, how["beside"], [method.name for method in built])
    places = _places(posed, built, how["keep"], how["changes"])
    with (
        signals_held(),
        recording(session, registry, posed, how["record"], runs=len(built)) as recorder,
    ):
        solved = _rows(registry, posed, built, recorder, quiet=quiet)
    rows = [*solved, *saved]
    best = best_of(rows)
    with signals_held():
        kept = [
            keep(posed, row.solution, path)
            for row, path in zip(solved, places, strict=False)
            if row.solution is not None
        ]
        if how["as_json"]:
            write_json(
                {
                    "problem": posed.name,
                    "set": told(how["changes"]),
                    "best": best,
                    "rows": [_record(posed, row, best) for row in rows],
                }
            )
        else:
            show(*told_line(how["changes"]), _fitting(results(), posed, rows, best))
    for row in rows:
        if row.error:
            session.warn(f"{row.method}: {row.error}")
    for place in kept:
        place.tell(session.warn)
    if len(solved) < len(built) or heard():
        session.note(f"interrupted: the table is of {len(solved)} of {len(built)} methods")
        return Exit.INTERRUPTED
    if any(row.bug for row in rows):
        return Exit.INTERNAL
    return Exit.SOLVED if all(row.ok for row in rows) else Exit.UNSOLVED


def best_of(rows: list[Row]) -> float:
    """Return the lowest objective of the feasible solutions, or that of the most feasible one; nan
    where none is.
    """
    found = [row.solution for row in rows if row.ok and row.solution is not None]
    feasible = [solution.told for solution in found if worst(solution) <= COMPARED]
    if feasible:
        return min(feasible)
    return min(found, key=worst).told if found else math.nan


def _saved(
    session: Session, problem: "Problem", paths: tuple[str, ...], taken: list[str]
) -> list[Row]:
    """Return a row for every saved result, named after its file; SolveError where one has other
    states or controls.
    """
    if not paths:
        return []
    from socp.model import check_names

    stems = {path: Path(path).name.removesuffix(ENDING) for path in paths}
    names = [*taken, *stems.values()]
    labels = {stem if names.count(stem) == 1 else path: path for path, stem in stems.items()}
    found = opened_beside(session, problem, labels)
    return [
        Row(label, check_names(labels[label], solution, problem))
        for label, solution in found.items()
    ]


def _places(
    problem: "Problem", methods: "list[Method]", folder: str | None, changes: Sequence[str]
) -> list[Path]:
    """Return the path of every method's result in a folder, which is made, none without one;
    MethodError says before the work why one cannot be written.
    """
    if folder is None:
        return []
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except (OSError, ValueError) as error:
        raise MethodError(f"--keep {folder}: {error}; give another name") from error
    names = [named_after(problem.name, f".{each.name}{ENDING}", changes) for each in methods]
    return [writable(Path(folder) / name, "--keep") for name in names]


def _rows(
    registry: Registry,
    problem: "Problem",
    methods: "list[Method]",
    recorder: "Guarded",
    *,
    quiet: bool,
) -> list[Row]:
    """Return a row for every method; an interruption ends with the methods solved before, if there
    are any.
    """
    rows: list[Row] = []
    for method in methods:
        try:
            rows.append(_solved(registry, problem, method, recorder, quiet=quiet))
        except KeyboardInterrupt:
            if not rows:
                raise
            break
        if rows[-1].interrupted:
            break
    return rows


def _solved(
    registry: Registry, problem: "Problem", method: "Method", recorder: "Guarded", *, quiet: bool
) -> Row:
    from socp.methods import default_guess

    try:
        with progress(messages(), f"{problem.name}, {method.name}", quiet=quiet) as watch:
            solution = run_method(
                registry, method, problem, default_guess(problem), recording_watch(watch, recorder)
            )
    except SocpError as error:
        return Row(method.name, error=str(error))
    except Exception as error:  # noqa: BLE001
        # the rows of the other methods are worth as much as before
        said = lacking(error)
        return Row(method.name, error=said or f"internal error: {reason(error)}", bug=not said)
    recorder.finish(problem, solution)
    return Row(method.name, solution)


def _record(problem: "Problem", row: Row, best: float) -> dict[str, Any]:
    if row.solution is None:
        return {"row": row.method, "method": row.method, "solved": False, "error": row.error}
    objective = row.solution.told
    known = {
        "objective": objective,
        "claimed": row.solution.objective,
        "word": row.solution.word,
        "reference": to_reference(problem, row.solution),
    }
    more = {
        "to_best": objective - best,
        "within": stated_error(row.solution.verdict),
        "feasibility": worst(row.solution),
    }
    return {"row": row.method, **facts(problem, row.solution), **known, **more}


def _fitting(console: Console, problem: "Problem", rows: list[Row], best: float) -> Table:
    """Return the table with a method a row, or with a method a column where that is too wide for
    the console.
    """
    cells = {row.method: _cells(problem, row, best) for row in rows}
    labels = list(dict.fromkeys(label for cell in cells.values() for label in cell))
    by_method = {
        method: [cell.get(label, "") for label in labels] for method, cell in cells.items()
    }
    wide = _table(problem, "method", labels, by_method)
    if (
        Measurement.get(console, console.options.update(max_width=10_000), wide).maximum
        <= console.width
    ):
        return wide
    body = {label: [cell.get(label, "") for cell in cells.values()] for label in labels}
    return _table(problem, "", list(cells), body)


def _table(problem: "Problem", corner: str, heads: list[str], body: dict[str, list[str]]) -> Table:
    title = one_line(f"{problem.name}: {problem.title}" if problem.title else problem.name)
    table = Table(title=Text(title), title_justify="left", header_style="bold", box=box.SIMPLE_HEAD)
    table.add_column(corner, style="bold", no_wrap=True)
    for head in heads:
        table.add_column(
            Text(head), justify="left" if head == "switching times" else "right", overflow="fold"
        )
    for label, cells in body.items():
        table.add_row(Text(label), *(Text(cell) for cell in cells))
    return table


def _cells(problem: "Problem", row: Row, best: float) -> dict[str, str]:
    solution = row.solution
    if solution is None:
        return {"N": "-", "objective": "not solved"}
    objective = solution.told
    cells = {
        "N": str(solution.t.size),
        "objective": f"{objective:.10g}",
        "to best": signed_error(objective - best),
    }
    error = stated_error(solution.verdict)
    cells["within"] = "-" if math.isnan(error) else small(error)
    if problem.reference is not None:
        cells["to reference"] = signed_error(objective - problem.reference.objective)
    cells["switching times"] = "\n".join(
        f"{name}: {times(each, 7)}" for name, each in switching_times(solution).items()
    )
    cells |= {f"TV({name})": f"{value:.4g}" for name, value in variations(solution).items()}
    cells |= {
        "feasibility": small(worst(solution)),
        "iterations": str(solution.effort.iterations),
        "seconds": f"{sum(solution.seconds.values()):.2f}",
    }
    return cells if solution.stop.ok else {**cells, "stop": solution.stop.name.lower()}

"""`socp census` and `socp frontier`: many solves of one problem, one table."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich import box
from rich.table import Table
from rich.text import Text

from socp.cli.commands.completing import problems
from socp.cli.keeping import ENDING, keep
from socp.cli.posing import Named, load_posed, named_after, set_option, told, told_line
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
from socp.errors import KeepingError, SolveError
from socp.process import signals_held
from socp.view import small, switching_times, times

if TYPE_CHECKING:
    from concurrent.futures import Executor

    from socp.model import Problem, Solution
    from socp.study import Census, Cluster, Frontier


def _output_options(command: Callable[..., int]) -> Callable[..., int]:
    """Add changes of the problem, and where a table and its best result go, to the options of a
    command.
    """
    for option in (
        set_option,
        click.option("--quiet", is_flag=True, help="Write no progress and no messages."),
        click.option("--json", "as_json", is_flag=True, help="Write the table as JSON."),
        click.option(
            "--out",
            metavar="FILE",
            help="Result file of the best one.  [default: PROBLEM.socp.json, with what is set]",
        ),
    ):
        command = option(command)
    return command


def _worker_options(command: Callable[..., int]) -> Callable[..., int]:
    """Add whose hands do the work to the options of a command."""
    for option in (
        click.option(
            "--dask", metavar="ADDRESS", help="Scheduler of dask, or 'local' for one of its own."
        ),
        click.option(
            "-j",
            "--jobs",
            default=1,
            show_default=True,
            type=click.IntRange(1, 1024),
            help="Worker processes.",
        ),
    ):
        command = option(command)
    return command


@click.command()
@click.argument("problem", metavar="FILE_OR_NAME", shell_complete=problems)
@click.option(
    "--starts",
    default=20,
    show_default=True,
    type=click.IntRange(1, 10_000),
    help="Number of starts.",
)
@_worker_options
@_output_options
@click.pass_obj
def census(session: Session, /, **given: Any) -> int:
    """Solve a problem from many starts and print the extremals that they end in; the best one is
    the result.

    Finished starts are kept in a directory beside the result, PROBLEM.census: the same command goes
    on where it was interrupted, and more starts add to the ones that are there.
    """
    from socp.methods import versions
    from socp.model import check_solvable
    from socp.study import Store, engine, fingerprint, recipe, survey

    session.quiet, starts = given["quiet"], given["starts"]
    named = Named(given["problem"], given["changes"])
    posed = load_posed(named.given, named.changes, session.registry(plugins=False))
    check_solvable(posed)
    path = writable(
        Path(given["out"]) if given["out"] else named_after(posed.name, ENDING, given["changes"])
    )
    store = Store(path.parent / named_after(posed.name, ".census"), fingerprint(posed, recipe()))
    with (
        engine(given["dask"] or given["jobs"], given["jobs"]) as hands,
        progress(messages(), f"{posed.name}, census", quiet=session.quiet) as watch,
    ):
        if hands.dashboard:
            session.note(f"dashboard  {hands.dashboard}")
        found = survey(posed, starts, store, watch, (hands.workers, named))
    with signals_held():
        best, place = found.best, None
        if best is not None:
            place = keep(
                posed, best.with_origin(options={"starts": starts}, versions=versions()), path
            )
            session.written.append(place.path)
    with signals_held():
        if given["as_json"]:
            more = {"set": told(named.changes), "result": str(place.path) if place else None}
            write_json({**_facts(posed, found), **more})
        else:
            result = [Text(f"result  {place.path}")] if place else []
            first = heading(posed.name, posed.title), *told_line(named.changes)
            show(*first, *_tables(found), *result)
    for number in found.died:
        session.warn(f"start {number}: its worker process died")
    if place is not None:
        place.tell(session.warn)
    if found.unkept:
        raise KeepingError(f"{found.unkept}; the table counts them, but another census begins anew")
    if found.interrupted:
        where = "finished" if found.unkept else f"kept in {store.folder}"
        session.note(f"interrupted: {len(found.outcomes)} of {starts} starts are {where}")
        return Exit.INTERRUPTED
    return Exit.SOLVED if found.extremals else Exit.UNSOLVED


def _facts(problem: "Problem", found: "Census") -> dict[str, Any]:
    from socp.study import unseen

    return {
        "problem": problem.name,
        "title": problem.title,
        "starts": found.wanted,
        "finished": len(found.outcomes),
        "extremals": [_record(each) for each in found.extremals],
        "uncertified": [_record(each) for each in found.others],
        "failed": [
            {"start": each.number, "about": each.about, "error": each.error}
            for each in found.failed
        ],
        "died": found.died,
        "interrupted": found.interrupted,
        "unseen": None if (left := unseen(found)) is None else asdict(left),
    }


def _record(cluster: "Cluster") -> dict[str, Any]:
    return {**_solved(cluster.solution), "starts": cluster.starts}


def _solved(solution: "Solution") -> dict[str, Any]:
    verdict = solution.verdict
    return {
        "objective": solution.told,
        "claimed": solution.objective,
        "final_time": solution.final_time,
        "word": solution.word,
        "switching_times": switching_times(solution),
        "extremal": bool(solution.extremal),
        "residual": verdict.residual if verdict else None,
        "miss": verdict.miss if verdict else None,
        "reasons": verdict.reasons if verdict else (),
    }


def _tables(found: "Census") -> list[Table | Text]:
    """Return the table of extremals, that of other local solutions, and what became of the
    starts.
    """
    parts: list[Table | Text] = []
    if found.extremals:
        parts.append(_table("Certified extremals", found.extremals))
    if found.others:
        parts.append(_table("Not certified", found.others))
    count = len(found.outcomes)
    certified = sum(len(each.starts) for each in found.extremals)
    sentence = (
        f"{count} of {found.wanted} starts finished, {certified} of them in a certified extremal"
    )
    for number, what in (
        (len(found.failed), "led nowhere"),
        (len(found.died), "lost with their worker process"),
    ):
        sentence += f", {number} {what}" if number else ""
    return [*parts, Text(sentence), *map(Text, _of_unseen(found))]


def _of_unseen(found: "Census") -> list[str]:
    """Return what is to be expected of extremals that no start has met, a sentence an entry."""
    from socp.study import unseen

    left = unseen(found)
    if left is None:
        return []
    own = ", starts that end in none counted as one more" if left.nowhere else ""
    told = (
        "too few starts to say how many extremals are unseen"
        if left.expected is None
        else f"expected unseen: {left.expected:.2g} extremals{own}, with {left.share:.2g} of all "
        f"starts; there is none with a probability of {left.complete:.2g}"
    )
    sure = (
        f"an extremal in which more than {left.missed:.1%} of the starts of this generator end "
        "would have been missed with a probability below 5 %; one that it does not lead to is "
        "missed by any number of starts"
    )
    return [told, sure]


def _framed(title: str, columns: Sequence[tuple[str, bool]]) -> Table:
    """Return an empty table with columns, each with whether it is of numbers."""
    table = Table(title=Text(title), title_justify="left", header_style="bold", box=box.SIMPLE_HEAD)
    for head, numbers in columns:
        table.add_column(head, justify="right" if numbers else "left", overflow="fold")
    return table


def _table(title: str, clusters: "Sequence[Cluster]") -> Table:
    table = _framed(title, (("objective", True), ("word", False), ("switching times", False)))
    for head in ("starts", "residual"):
        table.add_column(head, justify="right", no_wrap=True)
    for cluster in clusters:
        table.add_row(*map(Text, _cells(cluster.solution, len(cluster.starts)).values()))
    return table


def _cells(solution: "Solution", starts: int) -> Mapping[str, str]:
    verdict = solution.verdict
    return {
        "objective": f"{solution.told:.10g}",
        "word": "\n".join(solution.word.split("; ")),
        "switching times": "\n".join(
            f"{name}: {times(each, 7)}" for name, each in switching_times(solution).items()
        ),
        "starts": str(starts),
        "residual": small(verdict.residual) if verdict else "-",
    }


@click.command()
@click.argument("problem", metavar="FILE_OR_NAME", shell_complete=problems)
@click.option(
    "--max-switches",
    "most",
    required=True,
    type=click.IntRange(0, 100),
    help="Largest number of switches.",
)
@click.option(
    "--dwell",
    default=0.0,
    show_default=True,
    type=click.FloatRange(min=0.0),
    help="Least time between two switches, and from the ends.",
)
@_worker_options
@_output_options
@click.pass_obj
def frontier(session: Session, /, **given: Any) -> int:
    """Solve the words of a problem with few switches and print the best objective for every number
    of switches.

    A switch is a time at which any of the controls changes its mode. The best solution is the
    result.
    """
    from socp.methods import versions
    from socp.model import check_solvable
    from socp.study import best_by_switches as search
    from socp.study import explore

    session.quiet = given["quiet"]
    named = Named(given["problem"], given["changes"])
    posed = load_posed(named.given, named.changes, session.registry(plugins=False))
    check_solvable(posed)
    path = writable(
        Path(given["out"]) if given["out"] else named_after(posed.name, ENDING, given["changes"])
    )
    most, dwell = given["most"], given["dwell"]
    with (
        _executor(session, given) as executor,
        progress(messages(), f"{posed.name}, frontier", quiet=session.quiet) as watch,
    ):
        first = explore(posed, 0, watch)
        if first.solution is None:
            raise SolveError(f"{posed.name}: no direct solution to begin with: {first.error}")
        workers = None if executor is None else (executor, named)
        found = search(posed, most, first.solution, dwell, watch, workers)
    best, place = found.best, None
    with signals_held():
        if best is not None:
            asked = {"max_switches": most, "dwell": dwell}
            best = best.with_origin(method="frontier", options=asked, versions=versions())
            place = keep(posed, best, path)
            session.written.append(place.path)
    with signals_held():
        if given["as_json"]:
            write_json(
                {
                    **_ladder(posed, found),
                    "set": told(given["changes"]),
                    "dwell": dwell,
                    "result": str(place.path) if place else None,
                }
            )
        else:
            result = [Text(f"result  {place.path}")] if place else []
            above = heading(posed.name, posed.title), *told_line(given["changes"])
            show(*above, _rows(found), Text(_words(found)), *result)
    if place is not None:
        place.tell(session.warn)
    if found.interrupted:
        session.note("interrupted: the table is of the words solved before")
        return Exit.INTERRUPTED
    return Exit.SOLVED if best is not None else Exit.UNSOLVED


@contextmanager
def _executor(session: Session, given: Mapping[str, Any]) -> "Iterator[Executor | None]":
    """Yield an executor of the workers that were asked for, None for this process alone."""
    from socp.study import engine, pool

    with engine(given["dask"] or given["jobs"], given["jobs"]) as hands:
        if hands.dashboard:
            session.note(f"dashboard  {hands.dashboard}")
        if not isinstance(hands.workers, int):
            yield hands.workers
        elif hands.workers == 1:
            yield None
        else:
            with pool(hands.workers) as own:
                yield own


def _ladder(problem: "Problem", found: "Frontier") -> dict[str, Any]:
    """Return a frontier as plain values."""
    rows = []
    for n, solution in enumerate(found.rows):
        more = {} if solution is None else {**_solved(solution), "gap": _gap(found, solution)}
        rows.append({"switches": n, "objective": None, **more})
    return {
        "problem": problem.name,
        "title": problem.title,
        "rows": rows,
        "words": found.words,
        "every": found.every,
        "interrupted": found.interrupted,
    }


def _rows(found: "Frontier") -> Table:
    table = _framed(
        "Best objective with at most so many switches", (("switches", True), ("word", False))
    )
    for head in ("objective", "gap"):
        table.add_column(head, justify="right", no_wrap=True)
    table.add_column("verdict", overflow="fold")
    for n, solution in enumerate(found.rows):
        if solution is None:
            table.add_row(str(n), "-", "no feasible word found", "", "")
            continue
        word, gap = Text("\n".join(solution.word.split("; "))), _gap(found, solution)
        verdict = solution.verdict.reasons if solution.verdict else ("not judged",)
        said = Text(verdict[0] if verdict else "extremal")
        table.add_row(str(n), word, f"{solution.objective:.12g}", small(gap), said)
    return table


def _gap(found: "Frontier", solution: "Solution") -> float:
    """Return how far a solution is above the best one."""
    return solution.objective - (found.best.objective if found.best else solution.objective)


def _words(found: "Frontier") -> str:
    from socp.study import distinct_rows, limit

    end = limit(distinct_rows(found))
    tends = (
        ""
        if end is None
        else f"; Aitken's extrapolation of the last three objectives is {end:.12g}"
    )
    which = "all there are" if found.every else "not all there are"
    return f"{found.words} words solved, {which}{tends}"

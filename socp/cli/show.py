"""What the commands show of a solution: its facts as plain values, and as text."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from rich.table import Table
from rich.text import Text

from socp.cli import outcome
from socp.cli.commands.checking import lines, plain
from socp.errors import MethodError
from socp.model import EXTREMAL

if TYPE_CHECKING:
    from socp.model import Feasibility, Problem, Solution

MANY = 8  # more switching times of one control than this are counted, not listed


def facts(problem: "Problem", solution: "Solution") -> dict[str, Any]:
    """Return what a solution says, without the values at its nodes."""
    return {
        "problem": problem.name,
        "title": problem.title,
        "method": solution.method,
        "options": solution.options,
        "outcome": outcome.outcome(solution).name,
        "solved": outcome.outcome(solution).answer,
        "stop": solution.stop.name,
        "message": solution.message,
        "objective": None if outcome.infeasible(solution) else solution.objective,
        "value": solution.objective,
        "objective_reached": solution.reached,
        "initial_time": solution.initial_time,
        "final_time": solution.final_time,
        "parameters": solution.parameters,
        "nodes": int(solution.t.size),
        "word": None if outcome.infeasible(solution) else solution.word,
        "switches": solution.switches,
        "structure": solution.structure,
        "total_variation": variations(solution),
        "verified": [
            {**asdict(each), "worst": each.worst, "off": each.off} for each in solution.verified
        ],
        "verdict": None if solution.verdict is None else plain(solution.verdict),
        "iterations": solution.iterations,
        "seconds": solution.seconds,
        "reference": None if outcome.infeasible(solution) else to_reference(problem, solution),
    }


def variations(solution: "Solution") -> dict[str, float]:
    """Return the total variation of every control by name."""
    return dict(zip(solution.control_names, solution.total_variation().tolist(), strict=True))


def switching(solution: "Solution") -> dict[str, list[float]]:
    """Return the switching times of every control by name."""
    return {name: [end for _, _, end in row[:-1]] for name, row in solution.structure.items()}


def worst(solution: "Solution") -> float:
    """Return the largest figure of re-integration, by time and by feedback."""
    return max((each.off for each in solution.verified), default=float("nan"))


def to_reference(problem: "Problem", solution: "Solution") -> dict[str, Any] | None:
    """Return the errors to the reference of a problem, None where it has none.

    The error of the switching times is the largest, None where there are more or fewer than in the
    reference.
    """
    reference = problem.reference
    if reference is None:
        return None
    pairs = list(zip(reference.switches, solution.switches, strict=False))
    comparable = pairs and len(reference.switches) == len(solution.switches)
    return {
        "objective": reference.objective,
        "error": solution.objective - reference.objective,
        "switches": max(abs(a - b) for a, b in pairs) if comparable else None,
        "word": same_word(problem, solution),
        "tolerance": reference.tolerance,
        "source": reference.source,
    }


def same_word(problem: "Problem", solution: "Solution") -> bool | None:
    """Tell whether a solution has the word of the reference, None where that has no word."""
    from socp.model import Word

    if problem.reference is None or not problem.reference.word:
        return None
    try:
        word = Word.parse(problem.reference.word, problem.control_names)
    except MethodError:
        return None
    found = {
        name: " ".join(mode.partition("[")[0] for mode, _, _ in row)
        for name, row in solution.structure.items()
    }
    return all(
        found.get(name) == re.sub(r"\[[^]]*\]", "", word.of(name)) for name in problem.control_names
    )


def report(problem: "Problem", solution: "Solution", path: str) -> Table:
    """Return the report of a solve, one fact a row."""
    grid = Table.grid(padding=(0, 2, 0, 0))
    grid.add_column(style="bold", no_wrap=True)
    grid.add_column(overflow="fold")
    seconds, came_to = solution.seconds, outcome.outcome(solution)
    grid.add_row("method", Text(_method(solution)))
    grid.add_row("outcome", Text(came_to.value, "green" if came_to.answer else "red"))
    _labelled(grid, "objective", outcome.objective(solution))
    if outcome.initial_time(solution):
        grid.add_row("initial time", f"{solution.initial_time:.12g}")
    grid.add_row("final time", outcome.final_time(problem, solution))
    for name, value in solution.parameters.items():
        grid.add_row("parameter", f"{name} = {value:.12g}")
    if outcome.infeasible(solution):
        grid.add_row("word", "none: the point is infeasible")
    else:
        _labelled(
            grid, "word", (f"{name}: {_modes(row)}" for name, row in solution.structure.items())
        )
        _labelled(
            grid,
            "switches",
            (f"{name}: {times(each)}" for name, each in switching(solution).items()),
        )
    _labelled(grid, "digits", agreed(solution))
    grid.add_row("stop", Text(f"{solution.stop.value}", "green" if solution.stop.ok else "red"))
    if solution.message:
        grid.add_row("", Text(solution.message))
    _labelled(grid, "feasibility", (sentence(each) for each in solution.verified))
    _labelled(grid, "verdict", [] if solution.verdict is None else lines(solution.verdict))
    if not outcome.infeasible(solution):
        _labelled(grid, "reference", _reference(to_reference(problem, solution)))
    grid.add_row("iterations", str(solution.iterations))
    parts = " + ".join(f"{name} {value:.2f}" for name, value in seconds.items())
    grid.add_row("seconds", f"{sum(seconds.values()):.2f} ({parts})")
    grid.add_row("result", Text(path))
    return grid


def agreed(solution: "Solution") -> list[str]:
    """Return the digits on which two computations of a solution agree, nothing where there was one
    alone.

    No digit is counted, and no switching time said to be known, beyond what the errors of the
    verdict leave.
    """
    from socp.model import digits_of

    found, verdict = solution.agreement, solution.verdict
    if found is None:
        return []
    known = verdict is not None and verdict.extremal
    left = (
        digits_of(verdict.remaining_error, solution.objective, found.digits)
        if known and verdict
        else found.digits
    )
    errors = (
        [found.switches, *(error for _, error in verdict.switch_errors if known)]
        if verdict
        else [found.switches]
    )
    places = "" if not solution.switches else _places(errors)
    return [f"{left} of the objective: two computations differ by {small(found.objective)}{places}"]


def _places(errors: list[float]) -> str:
    """Return how well switching times are known, those apart that are not determined."""
    known = [error for error in errors if math.isfinite(error)]
    text = (
        f", switching times within {small(max(known))}"
        if len(known) > 1 or len(errors) == 1
        else ""
    )
    count = len(errors) - len(known)
    return text + (
        f", {count} of {len(errors) - 1} switching times not determined" if count else ""
    )


def sentence(found: "Feasibility") -> Text:
    """Return what one re-integration found; every figure is relative to the problem's own
    magnitudes.
    """
    how = "laws as feedback" if found.feedback else "control over time"
    if found.error:
        return Text.assemble(f"{how}: ", (found.error, "red"))
    parts = [f"end missed by {small(found.miss)}" + (f" at {found.miss_at}" if found.miss else "")]
    if found.path_at:
        parts.append(
            f"path violated by {small(found.path)}" + (f" at {found.path_at}" if found.path else "")
        )
    if found.box:
        parts.append(f"box violated by {small(found.box)}")
    parts.append(f"states off by {small(found.drift)}")
    if found.gap > EXTREMAL:
        parts.append(f"objective {found.objective:.6g}")
    return Text(f"{how}: {', '.join(parts)}")


def times(values: Sequence[float], digits: int = 12) -> str:
    """Return switching times as text, or their number where there are many."""
    if len(values) > MANY:
        return f"{len(values)} switches"
    return "  ".join(f"{value:.{digits}g}" for value in values) or "none"


def small(value: float) -> str:
    """Return a violation or an error in two digits."""
    return "0" if value == 0 else f"{value:.1e}"


def signed(value: float) -> str:
    """Return an error with its sign in two digits."""
    return "0" if value == 0 else f"{value:+.1e}"


def _method(solution: "Solution") -> str:
    given = ", ".join(f"{key}={value}" for key, value in solution.options.items() if value != "")
    return f"{solution.method} ({given})" if given else solution.method


def _modes(row: Iterable[tuple[str, float, float]]) -> str:
    modes = [mode for mode, _, _ in row]
    if len(modes) > MANY + 1:
        return f"{' '.join(modes[:4])} ... {' '.join(modes[-2:])} ({len(modes)} arcs)"
    return " ".join(modes)


def _labelled(grid: Table, label: str, rows: Iterable[Text | str]) -> None:
    for k, row in enumerate(rows):
        grid.add_row(label if k == 0 else "", row if isinstance(row, Text) else Text(row))


def _reference(found: Mapping[str, Any] | None) -> list[str]:
    if found is None:
        return []
    lines = [f"objective {signed(found['error'])} from {found['objective']:.12g}"]
    if found["switches"] is not None:
        lines.append(f"switching times within {small(found['switches'])}")
    if found["word"] is not None:
        lines.append("the same word" if found["word"] else "another word")
    return [", ".join(lines)]

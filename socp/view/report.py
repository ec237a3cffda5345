"""What is said of a solution and of its verdict, as plain values: rows of a label and its lines.

The terminal, notebooks and recordings render these rows and add nothing to their wording.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING, final

from socp.model import APPROXIMATE, EXTREMAL, FEASIBLE
from socp.view.errors import small, switch_error
from socp.view.ladder import (
    minimum_line,
    order_lines,
    proof_lines,
    rung_texts,
    starts_lines,
    top_text,
)
from socp.view.outcomes import Outcome, infeasible, outcome_of
from socp.view.reference import reference_lines

if TYPE_CHECKING:  # `socp --help` loads this module, and casadi is not worth it there
    from socp.model import Feasibility, Grade, Problem, Solution, Verdict

MANY = 8  # more switching times of one control than this are counted, not listed
_TOLD = 4  # reasons told in the report of a solution; that of its verdict tells them all
_NOTHING = 1e-12  # share of the horizon below which an initial time is 0
_SHORT = 1e-9  # share of a fixed final time: as printed, with some digits to spare


class Tone(Enum):
    """How a piece of text is meant, which a renderer may show by its colour."""

    PLAIN = "plain"
    GOOD = "good"
    BAD = "bad"
    NOTE = "note"


Line = tuple[tuple[str, Tone], ...]  # pieces of text, each with its tone


@final
@dataclass(frozen=True)
class Row:
    """A fact: its label, and the lines that tell it."""

    label: str
    lines: tuple[Line, ...]

    @property
    def texts(self) -> list[str]:
        """The lines as text alone."""
        return ["".join(text for text, _ in line) for line in self.lines]


def solution_rows(
    problem: "Problem | None",
    solution: "Solution",
    unjudged: Outcome | None = None,
    path: str = "",
) -> list[Row]:
    """Return all that is said of a solution, with the path of its result where there is one.

    Without its problem nothing is said of a reference, nor of a final time that is not reached.
    `unjudged` is what a solution without a verdict came to, where that is known.
    """
    rows = [] if problem is None else [_row("constants", constant_lines(problem))]
    rows += [_method(solution), _came_to(outcome_of(solution) or unjudged)]
    rows.append(_row("rung", filter(None, [top_text(solution)])))
    rows += _point(problem, solution)
    rows += [_row("digits", agreed_digits(solution)), _stop(solution)]
    rows.append(Row("feasibility", tuple(_reintegrated(each) for each in solution.verified)))
    if solution.verdict is not None:
        rows.append(Row("verdict", tuple(_judged(solution.verdict, _TOLD))))
    rows.append(_row("proved", proof_lines(solution)))
    if problem is not None and not infeasible(solution):
        rows.append(_row("reference", reference_lines(problem, solution)))
    rows.append(_row("starts", starts_lines(solution.starts, extremal=bool(solution.extremal))))
    rows.append(_row("iterations", [str(solution.effort.iterations)]))
    parts = " + ".join(f"{name} {value:.2f}" for name, value in solution.seconds.items())
    total = f"{sum(solution.seconds.values()):.2f} ({parts})"
    rows.append(_row("seconds", [total] if solution.seconds else []))
    rows.append(_row("result", [path] if path else []))
    return [row for row in rows if row.lines]


def constant_lines(problem: "Problem") -> list[str]:
    """Return the named constants of a problem with their values and units, a line each."""
    named = problem.constants.items()
    return [f"{name} = {each.value:.12g} {each.unit}".rstrip() for name, each in named]


def verdict_rows(verdict: "Verdict") -> list[Row]:
    """Return all that is said of a verdict but for its conditions, which are a table of their
    own.
    """
    left = verdict.distance
    least = [] if left is None else [f"no multipliers leave less than {left:.1e} at worst"]
    rows = [
        Row("verdict", tuple(_judged(verdict, len(verdict.reasons)))),
        _row("distance", least),
        _row("Legendre-Clebsch", (f"{k}: {v:.1e}" for k, v in verdict.legendre_clebsch.items())),
        _row("bang margins", (f"{k}: {v:.1e}" for k, v in verdict.margins.items())),
        _row("normality", [f"{verdict.normality:.1e}"]),
        _row(
            "variation",
            (f"{k}: {v:.3g} times that of its mean" for k, v in verdict.ringing.items()),
        ),
        _row(
            "switches", (f"{t:.12g}, {switch_error(error)}" for t, error in verdict.switch_errors)
        ),
        _row(
            "second order",
            () if verdict.second_order is None else order_lines(verdict.second_order),
        ),
    ]
    return [row for row in rows if row.lines]


def ladder_row(solution: "Solution") -> Row:
    """Return the rungs of the ladder that a solution was asked for, with what decides each."""
    lines = []
    for rung, holds, said in rung_texts(solution):
        answer = (f"{'yes' if holds else 'no':4}{rung}", Tone.GOOD if holds else Tone.NOTE)
        lines.append((answer, (f": {said}" if said else "", Tone.PLAIN)))
    return Row("ladder", tuple(lines))


def conditions(verdict: "Verdict") -> list[tuple[str, str, str]]:
    """Return the conditions of the principle as a table: heads, then a condition a row; none where
    the verdict has none.
    """
    rows = [
        (
            each.condition,
            f"{each.residual:.1e}{'' if each.holds else ', broken'}",
            each.where + ("" if each.t is None else f" at t = {each.t:.6g}"),
        )
        for each in verdict.findings
    ]
    return [("condition", f"residual, at most {EXTREMAL:.0e}", "where"), *rows] if rows else []


def judgement(verdict: "Verdict | None") -> str:
    """Return a verdict in a word or two."""
    if verdict is None:
        return "not judged"
    if not verdict.feasible:
        return "not feasible"
    if verdict.approximate and verdict.grade is not None:
        near = f"objective within {verdict.grade.error:.0e} of the nearby extremal's"
        return f"approximately extremal, {near}"
    return "extremal" if verdict.extremal else "feasible, not extremal"


def stated_error(verdict: "Verdict | None") -> float:
    """Return the error of the objective that a verdict stands for, nan where it stands for none."""
    if verdict is None or not (verdict.extremal or verdict.approximate):
        return math.nan
    return verdict.objective_error if verdict.grade is None else verdict.grade.error


def switching_times(solution: "Solution") -> dict[str, list[float]]:
    """Return the switching times of every control by name."""
    return {name: [end for _, _, end in row[:-1]] for name, row in solution.structure.items()}


def times(values: Sequence[float], digits: int = 12) -> str:
    """Return switching times as text, or their number where there are many."""
    if len(values) > MANY:
        return f"{len(values)} switches"
    return "  ".join(f"{value:.{digits}g}" for value in values) or "none"


def agreed_digits(solution: "Solution") -> list[str]:
    """Return the digits on which two computations of a solution agree, nothing where there was one
    alone.

    No digit is counted, and no switching time said to be known, beyond what the errors of the
    verdict leave.
    """
    from socp.model import digits_of

    found, verdict = solution.judgement.agreement, solution.verdict
    if found is None:
        return []
    left, errors = found.digits, [found.switches]
    if verdict is not None and verdict.extremal:
        left = digits_of(verdict.remaining_error, solution.objective, left)
        errors += [error for _, error in verdict.switch_errors]
    places = _places(errors) if solution.switches else ""
    return [f"{left} of the objective: two computations differ by {small(found.objective)}{places}"]


def _places(errors: list[float]) -> str:
    """Return how well switching times are known, those apart that are not determined."""
    known = [error for error in errors if math.isfinite(error)]
    told = len(known) > 1 or len(errors) == 1
    text = f", switching times within {small(max(known))}" if told else ""
    count = len(errors) - len(known)
    return text + (
        f", {count} of {len(errors) - 1} switching times not determined" if count else ""
    )


def _row(label: str, texts: Iterable[str]) -> Row:
    return Row(label, tuple(_line(text) for text in texts))


def _line(text: str, tone: Tone = Tone.PLAIN) -> Line:
    return ((text, tone),)


def _method(solution: "Solution") -> Row:
    given = ", ".join(f"{key}={value}" for key, value in solution.options.items() if value != "")
    return _row("method", [f"{solution.method} ({given})" if given else solution.method])


def _came_to(outcome: Outcome | None) -> Row:
    if outcome is None:
        return Row("outcome", (_line(judgement(None), Tone.NOTE),))
    return Row("outcome", (_line(outcome.value, Tone.GOOD if outcome.answer else Tone.BAD),))


def _point(problem: "Problem | None", solution: "Solution") -> Iterator[Row]:
    """Yield what a solution is: its objective, times and word."""
    start = _initial_time(solution)
    yield _row("objective", _objective(solution))
    yield _row("initial time", [f"{start:.12g}"] if start else [])
    yield _row("final time", [_final_time(problem, solution)])
    for name, value in solution.parameters.items():
        yield _row("parameter", [f"{name} = {value:.12g}"])
    if infeasible(solution):
        yield _row("word", ["none: the point is infeasible"])
        return
    yield _row("word", words(solution))
    yield _row(
        "switches", (f"{name}: {times(each)}" for name, each in switching_times(solution).items())
    )


def _objective(solution: "Solution") -> tuple[str, ...]:
    """Return the objective, what the control reaches too where it differs; that of an infeasible
    point is none.
    """
    if not infeasible(solution):
        return solution.headline
    own = f"{solution.objective:.12g}"
    none = "none: the point is infeasible" + ("" if own == "nan" else f" (its value {own})")
    return (none, solution.headline[0]) if len(solution.headline) > 1 else (none,)


def _initial_time(solution: "Solution") -> float:
    """Return the initial time, 0 where it is rounding."""
    t0, horizon = solution.initial_time, abs(solution.final_time - solution.initial_time)
    return 0.0 if abs(t0) <= _NOTHING * horizon else t0


def _final_time(problem: "Problem | None", solution: "Solution") -> str:
    """Return the final time; one that is fixed is that of the problem, whatever was reached."""
    reached = solution.final_time
    if not infeasible(solution):
        return f"{reached:.12g}"
    low, high = (-math.inf, math.inf) if problem is None else problem.final_time_box
    if low == high:
        missed = abs(reached - low) > _SHORT * max(abs(low), 1.0)
        return f"{low:.12g}" + (
            f" (not reached: the point ends at {reached:.6g})" if missed else ""
        )
    return f"none: the point is infeasible (its value {reached:.12g})"


def words(solution: "Solution") -> list[str]:
    """Return the modes of every control, shortened where there are many."""
    return [f"{name}: {_modes(row)}" for name, row in solution.structure.items()]


def _modes(row: Iterable[tuple[str, float, float]]) -> str:
    modes = [mode for mode, _, _ in row]
    if len(modes) > MANY + 1:
        return f"{' '.join(modes[:4])} ... {' '.join(modes[-2:])} ({len(modes)} arcs)"
    return " ".join(modes)


def _stop(solution: "Solution") -> Row:
    stop = _line(solution.stop.value, Tone.GOOD if solution.stop.ok else Tone.BAD)
    said = filter(None, solution.message.split("; "))
    return Row("stop", (stop, *map(_line, said)))


def _reintegrated(feasibility: "Feasibility") -> Line:
    """Return what one re-integration found; every figure is relative to the problem's own
    magnitudes.
    """
    how = "laws as feedback" if feasibility.feedback else "control over time"
    if feasibility.error:
        return ((f"{how}: ", Tone.PLAIN), (feasibility.error, Tone.BAD))
    parts = [
        f"end missed by {small(feasibility.miss)}"
        + (f" at {feasibility.miss_at}" if feasibility.miss else "")
    ]
    if feasibility.path_at:
        parts.append(
            f"path violated by {small(feasibility.path)}"
            + (f" at {feasibility.path_at}" if feasibility.path else "")
        )
    if feasibility.box:
        parts.append(f"box violated by {small(feasibility.box)}")
    parts.append(f"states off by {small(feasibility.drift)}")
    if feasibility.gap > EXTREMAL:
        parts.append(f"objective {feasibility.objective:.6g}")
    return _line(f"{how}: {', '.join(parts)}")


def _judged(verdict: "Verdict", told: int) -> Iterator[Line]:
    """Yield a verdict in a few lines, with so many of its reasons."""
    margin = f"re-integration off by {verdict.miss:.1e} (allowed {FEASIBLE:.0e})"
    yield _answer(verdict.feasible, "feasible", margin)
    if verdict.grade is not None:
        yield _graded(verdict, verdict.grade)
    if verdict.findings:
        margin = f"residual {verdict.residual:.1e} (allowed {EXTREMAL:.0e})"
        yield _answer(verdict.extremal, "extremal", margin)
    yield from (_line(f"  {reason}", Tone.BAD) for reason in verdict.reasons[:told])
    if len(verdict.reasons) > told:
        yield _line(f"  and {len(verdict.reasons) - told} more reasons; see socp check")
    if verdict.extremal:
        yield _line(f"objective within {verdict.objective_error:.1e}: {verdict.digits} digits")
    if verdict.second_order is not None:
        shown = verdict.second_order.kind.shown
        lowered = verdict.second_order.descent is not None
        tone = Tone.GOOD if shown else Tone.BAD if lowered else Tone.NOTE
        yield _line(minimum_line(verdict.second_order), tone)
    if verdict.rings:
        ratios = (
            f"{name} varies {verdict.ringing[name]:.3g} times as much as its mean"
            for name in verdict.rings
        )
        yield _line(f"ringing: {', '.join(ratios)}", Tone.NOTE)
    yield from (_line(note, Tone.NOTE) for note in verdict.notes)


def _graded(verdict: "Verdict", grade: "Grade") -> Line:
    """Return how near a solution is to an extremal."""
    allowed = f"(allowed {APPROXIMATE * grade.size:.1e})"
    # of other extremals, which may be better, a grade knows nothing
    margin = f"objective within {grade.error:.1e} of the nearby extremal's {allowed}"
    if not verdict.approximate:
        margin = f"objective up to {grade.error:.1e} off the nearby extremal's {allowed}"
    if not grade.curved:
        margin += f", Legendre-Clebsch condition {grade.curvature:.1e}"
    if verdict.drift > FEASIBLE:
        margin += f", states off by {verdict.drift:.1e} (allowed {FEASIBLE:.0e})"
    return _answer(verdict.approximate, "approximately extremal", margin)


def _answer(holds: bool, what: str, margin: str) -> Line:
    answer = (what, Tone.GOOD) if holds else (f"not {what}", Tone.BAD)
    return (answer, (f": {margin}", Tone.PLAIN))

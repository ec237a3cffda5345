"""What `print` shows of solutions and verdicts: the rows of their reports as plain text."""

from collections.abc import Iterable
from functools import singledispatch

from socp.model import Solution, Verdict, known_problem
from socp.process import printable
from socp.view.report import Row, Tone, ladder_row, solution_rows, verdict_rows

_GAP = 2  # blanks between a label and what it labels


@singledispatch
def text(thing: object) -> str:
    """Return a solution or a verdict as text, as the command line reports it."""
    return printable(str(thing))


@text.register
def solution_text(solution: Solution) -> str:
    """Return the report of a solution, a fact a line, under the name of its problem."""
    problem = known_problem(solution)
    title = "" if problem is None else problem.title
    heading = printable(f"{solution.problem}  {title}".rstrip())
    return "\n".join([heading, *_lines(solution_rows(problem, solution))])


@text.register
def verdict_text(verdict: Verdict) -> str:
    """Return a verdict in full, as `socp check` tells it but for the ladder, which is its
    solution's.
    """
    return "\n".join(_lines(_judged(verdict)))


def detailed_rows(solution: Solution, verdict: Verdict) -> list[Row]:
    """Return all that is said of a verdict, with a rung and a condition a line."""
    said, *more = _judged(verdict)
    return [said, ladder_row(solution), *more]


def _judged(verdict: Verdict) -> list[Row]:
    said, *more = verdict_rows(verdict)
    tones = {True: Tone.PLAIN, False: Tone.BAD}
    each = tuple(((str(finding), tones[finding.holds]),) for finding in verdict.findings)
    return [said, Row("conditions", each), *more]


def _lines(rows: Iterable[Row]) -> Iterable[str]:
    """Yield the lines of rows, each label once, what it labels in one column."""
    rows = list(rows)
    width = max((len(row.label) for row in rows), default=0) + _GAP
    for row in rows:
        for k, line in enumerate(row.texts):
            yield f"{row.label if k == 0 else '':{width}}{printable(line)}".rstrip()

"""What notebooks show of solutions, verdicts and problems: HTML with nothing in it that needs a
network.
"""

from collections.abc import Iterable, Iterator
from functools import singledispatch
from html import escape
from itertools import groupby

from socp.errors import MethodError
from socp.model import Problem, Solution, Verdict, known_problem
from socp.process import printable
from socp.view.ladder import ladder_table
from socp.view.report import Row, Tone, conditions, solution_rows, verdict_rows

_WIDTH = 7.0  # inches of the figure in a notebook
_CELL = 'style="text-align:left;vertical-align:top;padding:2px 12px 2px 0"'
_COLOURS = {Tone.GOOD: "#2e8b57", Tone.BAD: "#d13438", Tone.NOTE: "#b8860b"}  # on light and dark
Cell = tuple[str, str]  # a label and HTML


@singledispatch
def html(thing: object) -> str:
    """Return a solution, a verdict or a problem as HTML."""
    return _text(str(thing))


@html.register
def solution_html(solution: Solution) -> str:
    """Return a solution as HTML: what its report says, and a figure if matplotlib is there."""
    said = framed(solution.problem, "", cells(solution_rows(known_problem(solution), solution)))
    return said + tabulated(ladder_table(solution)) + _figure(solution)


@html.register
def verdict_html(verdict: Verdict) -> str:
    """Return a verdict as HTML: its answers, then a condition a row."""
    return framed("", "", cells(verdict_rows(verdict))) + tabulated(conditions(verdict))


@html.register
def problem_html(problem: Problem) -> str:
    """Return a problem as HTML: what it minimises and subject to what, in its own symbols."""
    from socp.view.statement import notes, statement_rows

    lines = [(label, f"<code>{_text(text)}</code>") for label, text in statement_rows(problem)]
    lines += [(label, _text(text)) for label, text in notes(problem)]
    lines += [("source", _text(problem.source))] if problem.source else []
    return framed(problem.name, problem.title, lines)


def cells(rows: Iterable[Row]) -> Iterator[Cell]:
    """Yield a label and HTML for every line of a report."""
    for row in rows:
        for line in row.lines:
            yield row.label, "".join(_coloured(text, tone) for text, tone in line)


def _coloured(text: str, tone: Tone) -> str:
    colour = _COLOURS.get(tone)
    return f'<span style="color:{colour}">{_text(text)}</span>' if colour else _text(text)


def tabulated(rows: Iterable[Iterable[str]]) -> str:
    """Return rows as a table, heads first, nothing where there are none."""
    lines = "".join(_line("td" if k else "th", row) for k, row in enumerate(rows))
    return f"<table>{lines}</table>" if lines else ""


def _line(kind: str, cells: Iterable[str]) -> str:
    inner = "".join(f"<{kind} {_CELL}>{_text(cell)}</{kind}>" for cell in cells)
    return f"<tr>{inner}</tr>"


def _figure(solution: "Solution") -> str:
    """Return a small figure as inline SVG, nothing where matplotlib is not installed."""
    from socp.view.figures import draw as figures

    try:
        figure = figures.draw(solution, panels=("controls", "states"), width=_WIDTH)
    except MethodError:
        return ""
    svg = figures.to_bytes(figure, "svg").decode()
    return f'<div style="max-width:44em;background:white">{svg[svg.index("<svg") :]}</div>'


def framed(name: str, title: str, rows: Iterable[Cell]) -> str:
    """Return a heading and a table of rows, a label only where it changes."""
    heading = f"<b>{_text(name)}</b> {_text(title)}" if name else ""
    return f"<div>{heading}<table>{''.join(_lines(rows))}</table></div>"


def _lines(rows: Iterable[Cell]) -> Iterator[str]:
    for label, group in groupby(rows, key=lambda row: row[0]):
        for k, (_, content) in enumerate(group):
            shown = label if k == 0 else ""
            yield f"<tr><th {_CELL}>{shown}</th><td {_CELL}>{content}</td></tr>"


def _text(text: str) -> str:
    return escape(printable(text))

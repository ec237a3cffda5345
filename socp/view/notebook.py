"""What notebooks show of solutions, verdicts and problems: HTML with nothing in it that needs a
network.
"""

from collections.abc import Iterable, Iterator, Sequence
from functools import singledispatch
from html import escape
from itertools import groupby

from socp.model import EXTREMAL, Problem, Solution, Verdict
from socp.process import printable

_MANY = 8  # more arcs of one control than this are counted, not listed
_WIDTH = 7.0  # inches of the figure in a notebook
_CELL = 'style="text-align:left;vertical-align:top;padding:2px 12px 2px 0"'
_MODES = {"-": "lower bound", "+": "upper bound", "s": "singular", "*": "free"}
Row = tuple[str, str]  # a label and HTML


@singledispatch
def html(thing: object) -> str:
    """Return a solution, a verdict or a problem as HTML."""
    return _text(str(thing))


@html.register
def solution_html(solution: Solution) -> str:
    """Return a solution as HTML: its key figures, its arcs, its verdict in words, a figure if
    matplotlib is there.
    """
    found = [
        ("method", _text(solution.method)),
        *(("objective", text) for text in solution.headline),
    ]
    found.append(("time", f"{solution.initial_time:.12g} to {solution.final_time:.12g}"))
    found += [
        ("parameter", f"{_text(name)} = {value:.12g}")
        for name, value in solution.parameters.items()
    ]
    found += [(f"arcs of {_text(name)}", _arcs(row)) for name, row in solution.structure.items()]
    found.append(("stop", _text(solution.stop.value)))
    found.append(("verdict", "not judged" if solution.verdict is None else words(solution.verdict)))
    if solution.iterations:
        found.append(
            ("iterations", f"{solution.iterations}, {sum(solution.seconds.values()):.2f} s")
        )
    return _framed(solution.problem, "", found) + _figure(solution)


@html.register
def verdict_html(verdict: Verdict) -> str:
    """Return a verdict as HTML: its answers, then a condition a row."""
    found = [("verdict", words(verdict))]
    found += [("against it", _text(reason)) for reason in verdict.reasons]
    if verdict.extremal:
        found.append(
            ("objective", f"within {verdict.objective_error:.1e}: {verdict.digits} digits")
        )
    tables = (("Legendre-Clebsch", verdict.legendre_clebsch), ("bang margin", verdict.margins))
    found += [
        (label, f"{_text(str(name))}: {value:.1e}")
        for label, table in tables
        for name, value in table.items()
    ]
    for t, error in verdict.switch_errors[:_MANY]:
        known = f"within {error:.1e}" if error < float("inf") else "not determined"
        found.append(("switch", f"{t:.12g}, {known}"))
    found += [("note", _text(note)) for note in verdict.notes]
    head = (
        f"<tr><th {_CELL}>condition</th><th {_CELL}>residual, at most "
        f"{EXTREMAL:.0e}</th><th {_CELL}>where</th></tr>"
    )
    rows = "".join(
        f"<tr><td {_CELL}>{_text(each.condition)}</td><td {_CELL}>{each.residual:.1e}"
        f"{'' if each.holds else ', <b>broken</b>'}</td><td {_CELL}>{_text(each.where)}"
        f"{'' if each.t is None else f' at t = {each.t:.6g}'}</td></tr>"
        for each in verdict.findings
    )
    return _framed("", "", found) + (f"<table>{head}{rows}</table>" if rows else "")


@html.register
def problem_html(problem: Problem) -> str:
    """Return a problem as HTML: what it minimises and subject to what, in its own symbols."""
    from socp.view.statement import notes, stated

    lines = [(label, f"<code>{_text(text)}</code>") for label, text in stated(problem)]
    lines += [(label, _text(text)) for label, text in notes(problem)]
    lines += [("source", _text(problem.source))] if problem.source else []
    return _framed(problem.name, problem.title, lines)


def words(verdict: Verdict) -> str:
    """Return in a sentence what a verdict says."""
    if not verdict.feasible:
        return f"not feasible: re-integration off by {verdict.miss:.1e}"
    if not verdict.findings:
        return (
            f"feasible: re-integration off by {verdict.miss:.1e}; not held against Pontryagin's "
            "principle"
        )
    rings = f"; {', '.join(map(_text, verdict.rings))} rings" if verdict.rings else ""
    if verdict.extremal:
        return (
            "feasible, and an extremal of Pontryagin's principle: residual "
            f"{verdict.residual:.1e}{rings}"
        )
    return (
        "feasible, but not an extremal of Pontryagin's principle: "
        f"{_text(verdict.reasons[0])}{rings}"
    )


def _arcs(row: Sequence[tuple[str, float, float]]) -> str:
    if len(row) > _MANY:
        return f"{len(row)} arcs"
    names = [
        f"{_MODES.get(mode, 'boundary' + _text(mode[1:].replace('[', ' ').rstrip(']')))}"
        for mode, _, _ in row
    ]
    ends = [f" <small>until {end:.10g}</small>, " for _, _, end in row[:-1]]
    return "".join(name + end for name, end in zip(names, [*ends, ""], strict=True))


def _figure(solution: "Solution") -> str:
    """Return a small figure as inline SVG, nothing where matplotlib is not installed."""
    from socp.errors import MethodError
    from socp.view.figures import draw as figures

    try:
        figure = figures.draw(solution, panels=("controls", "states"), width=_WIDTH)
    except MethodError:
        return ""
    svg = figures.to_bytes(figure, "svg").decode()
    return f'<div style="max-width:44em;background:white">{svg[svg.index("<svg") :]}</div>'


def _framed(name: str, title: str, rows: Iterable[Row]) -> str:
    """Return a heading and a table of rows, a label only where it changes."""
    heading = f"<b>{_text(name)}</b> {_text(title)}" if name else ""
    return f"<div>{heading}<table>{''.join(_lines(rows))}</table></div>"


def _lines(rows: Iterable[Row]) -> Iterator[str]:
    for label, group in groupby(rows, key=lambda row: row[0]):
        for k, (_, content) in enumerate(group):
            shown = label if k == 0 else ""
            yield f"<tr><th {_CELL}>{shown}</th><td {_CELL}>{content}</td></tr>"


def _text(text: str) -> str:
    return escape(printable(text))

"""A report as one HTML page that needs no network: what is said of a solution, its plots, its
problem's formula, its verdict, and how it was found.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from html import escape
from typing import TYPE_CHECKING, Any

from socp import errors
from socp.model import known_problem
from socp.process import printable
from socp.view.beside import solutions_table, words_table
from socp.view.figures import style
from socp.view.figures.curves import curves_of, has_scene, scene_of_group
from socp.view.figures.overlay import Group, overlaid
from socp.view.ladder import ladder_table, top_text
from socp.view.notebook import cells, framed, tabulated
from socp.view.report import conditions, solution_rows, verdict_rows
from socp.view.statement import notes, statement_rows
from socp.view.web.mathml import mathml
from socp.view.web.plots import Plot, curve_plot, label_html, scene_plot, trace_plot
from socp.view.web.skeleton import PAGE, SCRIPT, STYLE

if TYPE_CHECKING:
    from socp.model import Problem, Solution

_FIRST = ("outcome", "rung")  # what a reader should know before anything else
_GROUPS = {
    "controls": "Controls",
    "switching": "Switching functions",
    "states": "States",
    "costates": "Costates",
    "multipliers": "Multipliers of state constraints",
    "hamiltonian": "Hamiltonian",
}


def to_page(
    solution: "Solution",
    problem: "Problem | None" = None,
    beside: "Mapping[str, Solution] | Iterable[Solution]" = (),
) -> str:
    """Return the report of a solution as one HTML page with interactive plots, all of it inside.

    The problem is the one that the solution carries, unless another is given; without one, bounds,
    switching functions and the formula are left out. `beside`: other solutions, drawn in the same
    plots and compared in a table, in a list or by the names that the legend gives them.

    Raises MethodError where plotly is not installed, and for solutions that share no state or
    control.
    """
    plotly = errors.load("plotly.offline", "report", "a report as a page")
    problem = problem or known_problem(solution)
    group = overlaid(problem, solution, beside)
    drawn = list(_drawn(problem, solution, group))
    found = trace_plot(solution)
    title = "" if problem is None else problem.title
    rows = solution_rows(problem, solution)
    first = [row for row in rows if row.label in _FIRST]
    rest = [row for row in rows if row not in first]
    parts = [
        f"<header><h1>{_safe(solution.problem)}</h1><p>{_safe(title)}</p>",
        *(f'<p class="first">{line}</p>' for _, line in cells(first)),
        "</header>",
        _section("What it is", framed("", "", cells(rest))),
        _section("Beside one another", _compared(solution, group)),
        _section("How it runs", _legend(solution, group), *_plotted(drawn)),
        _section("The problem", *_formula(problem)),
        _section("The verdict", *_judged(solution)),
        _section("How it was found", *_effort(solution, found)),
    ]
    plots = [plot for _, each in drawn for plot in each] + ([found] if found else [])
    data = json.dumps([each.data for each in plots], allow_nan=False).replace("<", "\\u003c")
    return PAGE.format(
        title=_safe("; ".join(filter(None, (solution.problem, top_text(solution))))),
        style=STYLE,
        body="\n".join(filter(None, parts)),
        data=data,
        library=plotly.get_plotlyjs().replace("</script", "<\\/script"),
        script=SCRIPT,
    )


def _drawn(
    problem: "Problem | None", solution: "Solution", group: Group
) -> Iterator[tuple[str, list[Plot]]]:
    """Yield the plots of the scene, and of every kind of curves, with their headings."""
    if problem is not None and has_scene(problem):
        seen, labels = scene_of_group(solution, problem, group)
        named = [label_html(each.replace("$", "")) for each in labels]
        yield "", [scene_plot(seen, (named[0], named[1]), group)]
    names = {look: name for name, look in group.names}
    for kind, heading in _GROUPS.items():
        plots = [curve_plot(curve, names) for curve in curves_of(kind, solution, problem, group)]
        if plots:
            yield heading, plots


def _plotted(drawn: list[tuple[str, list[Plot]]]) -> Iterator[str]:
    """Yield a heading and the places of its plots, numbered in their order on the page."""
    for heading, plots in drawn:
        yield (f"<h3>{heading}</h3>" if heading else "") + (
            f'<div class="plots">{"".join(map(_place, plots))}</div>'
        )


def _place(plot: Plot) -> str:
    wide = " wide" if plot.wide else ""
    return (
        f'<figure class="{wide.strip()}"><figcaption>{plot.title}</figcaption>'
        f'<div class="plot" style="height:{plot.height}px"></div></figure>'
    )


def _legend(solution: "Solution", group: Group) -> str:
    """Return what the colours of the arcs and the lines of several solutions mean."""
    kinds = {style.kind(mode) for row in solution.structure.values() for mode, _, _ in row}
    arcs = [
        f'<span><i style="background:{colour}"></i>{name}</span>'
        for sign, (name, colour, _) in style.MODES.items()
        if sign in kinds
    ]
    lines = [
        f'<span><b style="border-top:2px {"solid" if k == 0 else "dashed"} {colour}"></b>'
        f"{_safe(name)}</span>"
        for k, (name, (colour, _)) in enumerate(group.names)
    ]
    return (
        f'<p class="legend">{"".join([*lines, *arcs])}'
        "<small>Drag to zoom in time, all plots together; double-click to go back.</small></p>"
    )


def _compared(solution: "Solution", group: Group) -> str:
    if not group.others:
        return ""
    named = [name for name, _ in group.names]
    heads, *rows = solutions_table([solution, *(each.solution for each in group.others)])
    shown = [(name, *row) for name, row in zip(named, rows, strict=True)]
    return tabulated([("result", *heads), *shown])


def _formula(problem: "Problem | None") -> Iterator[str]:
    """Yield the statement of a problem, its formulas set, and what is known beside it."""
    if problem is None:
        return
    lines = [(label, mathml(text)) for label, text in statement_rows(problem)]
    lines += [(label, _safe(text)) for label, text in notes(problem)]
    lines += [("source", _safe(problem.source))] if problem.source else []
    yield framed("", "", lines)


def _judged(solution: "Solution") -> Iterator[str]:
    """Yield the ladder, the verdict in full, and its conditions."""
    if solution.verdict is None:
        yield "<p>Nobody judged this solution.</p>"
        return
    yield framed("", "", cells(verdict_rows(solution.verdict)))
    yield tabulated(ladder_table(solution))
    yield tabulated(conditions(solution.verdict))


def _effort(solution: "Solution", trace: Plot | None) -> Iterator[str]:
    """Yield the words that were tried, the solver's trace, and the versions at work."""
    words = tabulated(words_table(solution))
    if words:
        yield f"<details open><summary>Words tried</summary>{words}</details>"
    if trace is not None:
        yield f'<div class="plots">{_place(trace)}</div>'
    if solution.origin.versions:
        known = (f"{name} {version}" for name, version in solution.origin.versions.items())
        yield f"<p><small>{_safe(', '.join(known))}</small></p>"


def _section(heading: str, *parts: str) -> str:
    inner = "\n".join(f'<div class="part">{each}</div>' for each in parts if each)
    return f"<section><h2>{heading}</h2>{inner}</section>" if inner else ""


def _safe(text: Any) -> str:
    return escape(printable(text))

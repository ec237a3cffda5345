"""The summary of a solution as Markdown: what it is, what is known of it, and what a search tried
on the way.
"""

from collections.abc import Iterable, Sequence

from socp.model import EXTREMAL, Problem, Solution, Verdict
from socp.process import markdown, markdown_code

_MANY = 12  # more switching times or arcs than this are counted, not listed


def summary(problem: Problem, solution: Solution) -> str:
    """Return what a solution says of itself and what the judge says of it."""
    arcs = [(markdown(name), row) for name, row in solution.structure.items()]
    rows = [
        ("objective", f"{solution.objective:.12g}"),
        *([("initial time", f"{solution.initial_time:.12g}")] if solution.initial_time else []),
        ("final time", f"{solution.final_time:.12g}"),
        *(
            (f"parameter {markdown(name)}", f"{value:.12g}")
            for name, value in solution.parameters.items()
        ),
        *((f"word of {name}", _word([mode for mode, _, _ in row])) for name, row in arcs),
        *((f"switches of {name}", _times([end for *_, end in row[:-1]])) for name, row in arcs),
        ("stop", solution.stop.value),
        ("message", markdown(solution.message) or "-"),
        ("nodes", str(solution.t.size)),
        ("iterations", str(solution.iterations)),
        ("seconds", f"{sum(solution.seconds.values()):.2f}"),
    ]
    parts = [
        f"# {markdown(problem.title or problem.name)}",
        table(("method", markdown(solution.method)), rows),
        _verdict(solution.verdict),
    ]
    if problem.reference is not None:
        error = solution.objective - problem.reference.objective
        known = f"{problem.reference.objective:.12g}, error {error:+.1e}"
        parts.append(f"## Reference\n\n{known}\n\n{markdown(problem.reference.source)}")
    if solution.versions:
        known = ", ".join(
            markdown(f"{name} {version}") for name, version in solution.versions.items()
        )
        parts.append(f"## Versions\n\n{known}")
    return "\n\n".join(parts)


def search(solution: Solution) -> str:
    """Return the nodes of a search, one a row."""
    rows = [
        (
            str(k),
            markdown_code(node.word),
            markdown(node.stop),
            f"{node.objective:.9g}",
            *map(_small, (node.bound, node.miss, node.residual)),
        )
        for k, node in enumerate(solution.nodes)
    ]
    return "# Words tried\n\n" + table(
        ("", "word", "stop", "objective", "bound", "miss", "residual"), rows
    )


def comparison(problem: Problem, solutions: Sequence[Solution]) -> str:
    """Return several solutions of a problem, one a row."""
    rows = [
        (
            markdown(each.method),
            f"{each.objective:.10g}",
            str(each.t.size),
            markdown_code(each.word),
            _judgement(each.verdict),
            f"{sum(each.seconds.values()):.2f}",
        )
        for each in solutions
    ]
    heads = ("method", "objective", "nodes", "word", "verdict", "seconds")
    return f"# {markdown(problem.title or problem.name)}\n\n" + table(heads, rows)


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _verdict(verdict: Verdict | None) -> str:
    if verdict is None:
        return "## Verdict\n\nnot judged"
    parts = [f"## Verdict: {_judgement(verdict)}", f"re-integration off by {_small(verdict.miss)}"]
    parts += [f"- {markdown(reason)}" for reason in verdict.reasons]
    findings = [
        (
            f"{each.residual:.1e}",
            markdown(each.condition),
            markdown(each.where),
            "" if each.t is None else f"{each.t:.4g}",
        )
        for each in verdict.findings
    ]
    if findings:
        parts.append(f"Residuals of Pontryagin's principle, allowed {EXTREMAL:.0e}:")
        parts.append(table(("residual", "condition", "where", "t"), findings))
    parts += [f"- {markdown(note)}" for note in verdict.notes]
    return "\n\n".join(parts)


def _judgement(verdict: Verdict | None) -> str:
    if verdict is None:
        return "not judged"
    return (
        "extremal"
        if verdict.extremal
        else "feasible, no extremal"
        if verdict.feasible
        else "infeasible"
    )


def _word(modes: Sequence[str]) -> str:
    return markdown_code(" ".join(modes)) if len(modes) <= _MANY else f"{len(modes)} arcs"


def _times(values: Sequence[float]) -> str:
    return (
        "none"
        if not values
        else ", ".join(f"{v:.9g}" for v in values)
        if len(values) <= _MANY
        else str(len(values))
    )


def _small(value: float) -> str:
    return "" if value != value else f"{value:.3g}"  # noqa: PLR0124 - nan

"""The summary of a solution as Markdown: what it is, what is known of it, and what a search tried
on the way.
"""

from collections.abc import Iterable, Sequence

from socp.model import Problem, Solution
from socp.process import markdown, markdown_code
from socp.view.beside import Table, solutions_table, words_table
from socp.view.ladder import ladder_table
from socp.view.report import conditions, judgement, solution_rows


def summary(problem: Problem, solution: Solution) -> str:
    """Return what a solution says of itself and what the judge says of it."""
    said = [
        (row.label if k == 0 else "", markdown(text.strip()))
        for row in solution_rows(problem, solution)
        for k, text in enumerate(row.texts)
    ]
    parts = [
        f"# {markdown(problem.title or problem.name)}",
        table(said[0], [*said[1:], ("nodes", str(solution.t.size))]),
        f"## Verdict: {judgement(solution.verdict)}",
    ]
    found = [] if solution.verdict is None else conditions(solution.verdict)
    parts += [
        table(each[0], (map(markdown, row) for row in each[1:]))
        for each in (ladder_table(solution), found)
        if each
    ]
    if problem.reference is not None:
        parts.append(f"## Reference\n\n{markdown(problem.reference.source)}")
    if versions := solution.origin.versions:
        known = (markdown(f"{name} {version}") for name, version in versions.items())
        parts.append(f"## Versions\n\n{', '.join(known)}")
    return "\n\n".join(parts)


def search(solution: Solution) -> str:
    """Return the nodes of a search, one a row."""
    return "# Words tried\n\n" + _with_words(words_table(solution), 1)


def comparison(problem: Problem, solutions: Sequence[Solution]) -> str:
    """Return several solutions of a problem, one a row."""
    shown = _with_words(solutions_table(solutions), 3)
    return f"# {markdown(problem.title or problem.name)}\n\n" + shown


def _with_words(rows: Table, column: int) -> str:
    """Return a table in Markdown, with words as code in one of its columns."""
    heads, *others = rows
    safe = ([(markdown_code if k == column else markdown)(cell) for k, cell in enumerate(row)]
            for row in others)  # fmt: skip
    return table(heads, safe)


def table(heads: Sequence[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table in Markdown."""
    lines = [heads, ["---"] * len(heads), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)

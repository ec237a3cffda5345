"""Tables of what was tried and of several solutions beside one another: heads, then a row each."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from socp.view.report import judgement, words

if TYPE_CHECKING:
    from socp.model import Solution

Table = list[tuple[str, ...]]


def words_table(solution: "Solution") -> Table:
    """Return the nodes of a search in their order; none where nothing was searched."""
    heads = ("", "word", "stop", "objective", "bound", "miss", "residual")
    rows = [
        (
            str(k),
            node.word,
            node.stop,
            f"{node.objective:.9g}",
            *map(_small, (node.bound, node.miss, node.residual)),
        )
        for k, node in enumerate(solution.nodes)
    ]
    return [heads, *rows] if rows else []


def solutions_table(solutions: "Sequence[Solution]") -> Table:
    """Return several solutions of a problem, a solution a row."""
    rows = [
        (
            each.method,
            f"{each.objective:.10g}",
            str(each.t.size),
            "; ".join(words(each)),
            judgement(each.verdict),
            f"{sum(each.seconds.values()):.2f}",
        )
        for each in solutions
    ]
    return [("method", "objective", "nodes", "word", "verdict", "seconds"), *rows]


def _small(value: float) -> str:
    return "" if value != value else f"{value:.3g}"  # noqa: PLR0124 - nan

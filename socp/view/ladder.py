"""What is said of an extremal beyond the principle, in words: its second order, its ladder."""

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # `socp --help` loads the report, and casadi is not worth it there
    from socp.model import Curvature, Descent, SecondOrder, Solution, Starts, Step

_BAR = 40  # characters of a bar
_PARTS = " \u258f\u258e\u258d\u258c\u258b\u258a\u2589"  # eighths of a character
_TOLD = 4  # coarse local solutions told, the best first


def minimum_line(found: "SecondOrder") -> str:
    """Return in a line which kind of minimum an extremal is, and how clearly."""
    kind = found.kind.value
    if found.descent is not None:
        return f"{kind}: {_descent(found.descent)}"
    if found.kind.shown and found.word is not None:
        return f"{kind}: {curvature_text(found.word)}"
    return f"{kind}: {'; '.join(found.limits)}" if found.limits else kind


def order_lines(found: "SecondOrder") -> Iterator[str]:
    """Yield all that is known of the second order, a line each."""
    yield minimum_line(found)
    if found.theorem:
        yield f"by {found.theorem}"
    if found.singular is not None:
        yield f"with the singular control free: {curvature_text(found.singular)}"
    if found.kind.shown:
        yield from (f"no more is claimed: {limit}" for limit in found.limits)


def rung_texts(solution: "Solution") -> Iterator[tuple[str, bool, str]]:
    """Yield the rungs of the ladder: in words, whether it holds, and what decides it."""
    from socp.model import Rung, ladder_steps

    for step in ladder_steps(solution):
        figure = ""
        if step.figure is not None and step.allowed is not None:
            sign = "above" if step.rung in {Rung.WORD, Rung.STRONG} else "at most"
            figure = f"{step.figure:.1e}, {sign} {step.allowed:.1e}"
        elif step.rung not in {Rung.BEST, Rung.GLOBAL} and step.figure not in {None, math.inf}:
            figure = f"{step.figure:.1e}"
        yield _rung(step), step.holds, "; ".join(filter(None, (figure, step.why)))


def ladder_table(solution: "Solution") -> list[tuple[str, str, str]]:
    """Return the ladder as a table: heads, then a rung a row; none where nobody judged."""
    rows = [(rung, "yes" if holds else "no", said) for rung, holds, said in rung_texts(solution)]
    return [("rung", "reached", "decided by"), *rows] if rows else []


def top_text(solution: "Solution") -> str:
    """Return the highest rungs that a solution reaches, one a branch, empty where there are
    none.
    """
    from socp.model import top_steps

    return "; ".join(map(_rung, top_steps(solution)))


def proof_lines(solution: "Solution") -> Iterator[str]:
    """Yield what is proved of a solution, a line each, and a bar of what a bound leaves open."""
    from socp.model import Rung

    for proof in solution.proofs:
        yield proof.statement
        if proof.rung is Rung.GLOBAL:
            yield gap_bar(solution.objective, proof.margin)


def gap_bar(objective: float, gap: float) -> str:
    """Return a bar from a lower bound to an objective, as full as the gap between them leaves it,
    relative to the objective; it is full where nothing is open.
    """
    eighths = int(max(1.0 - gap, 0.0) * 8 * _BAR)
    bar = "\u2588" * (eighths // 8) + _PARTS[eighths % 8]
    low = objective - gap * abs(objective)
    return f"{low:.10g} |{bar:{_BAR}.{_BAR}}| {objective:.10g}"


def _rung(step: "Step") -> str:
    """Return a rung in words, with the figure that it is named by."""
    from socp.model import Rung

    if step.rung is Rung.BEST and step.figure is not None:
        return _best_of(int(step.figure))
    if step.rung is Rung.GLOBAL and step.figure is not None:
        return f"within {100 * step.figure:.2g} % of the global optimum, proved"
    proved = step.proved and "proved" not in step.rung.value
    return f"{step.rung.value}, proved" if proved else step.rung.value


def _best_of(count: int) -> str:
    return "best of 1 start" if count == 1 else f"best of {count} starts"


def curvature_text(found: "Curvature") -> str:
    """Return a curvature with its error and the number of directions that are free."""
    if found.free == 0:
        return "no direction is free, nothing to test"
    directions = "1 direction" if found.free == 1 else f"{found.free} directions"
    if found.least == -math.inf:
        return f"curvature not bounded below, {directions} free"
    return f"least curvature {found.least:.3g} within {found.error:.1e}, {directions} free"


def _descent(found: "Descent") -> str:
    moved = [*found.times, *found.parameters]
    by = ", ".join(f"{change:+.3g}" for change in moved)
    what = "times and parameters" if found.parameters else "times"
    return (
        f"changing its {what} by {by} changes the objective by {found.found:.3g}, simulated "
        f"({found.predicted:.3g} by the second order)"
    )


def starts_lines(found: "Starts | None", *, extremal: bool) -> list[str]:
    """Return from how many starts a solution is the best, and what else was met; of one that is no
    `extremal` no more than how many starts there were.
    """
    if found is None:
        return []
    count = len(found.coarse)
    met = ", ".join(f"{each.objective:.6g} ({each.starts})" for each in found.coarse[:_TOLD])
    more = f" and {count - _TOLD} more" if count > _TOLD else ""
    which = "a local solution" if count == 1 else f"{count} local solutions"
    all_of = "all" if found.tried > 1 else "it"
    share = f"{found.ended} of them" if found.ended < found.tried else all_of
    plain = "1 start" if found.tried == 1 else f"{found.tried} starts"
    tried = _best_of(found.tried) if extremal else plain
    told = f"{tried}; {share} ended in {which}, on a coarse grid at {met}{more}"
    if not count:
        told = f"none of {found.tried} ended in a local solution of the coarse grid"
    others = [
        f"{'another' if extremal else 'an'} extremal was certified at {each.objective:.12g}: "
        f"{each.word}"
        for each in found.extremals
    ]
    if found.better is not None:
        others.insert(0, f"a feasible point that is no extremal reaches {found.better:.12g}")
    return [told, *(others or [f"no {'other ' if extremal else ''}extremal was certified"])]

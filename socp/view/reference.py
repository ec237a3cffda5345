"""What a solution misses of its problem's reference."""

import re
from typing import TYPE_CHECKING, Any

from socp.errors import MethodError
from socp.view.errors import signed_error, small

if TYPE_CHECKING:
    from socp.model import Problem, Solution


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
        "error": solution.told - reference.objective,
        "switches": max(abs(a - b) for a, b in pairs) if comparable else None,
        "word": _same_word(problem, solution),
        "tolerance": reference.tolerance,
        "source": reference.source,
    }


def reference_lines(problem: "Problem", solution: "Solution") -> list[str]:
    """Return the errors to the reference of a problem as text, nothing where it has none."""
    comparison = to_reference(problem, solution)
    if comparison is None:
        return []
    parts = [f"objective {signed_error(comparison['error'])} from {comparison['objective']:.12g}"]
    if comparison["switches"] is not None:
        parts.append(f"switching times within {small(comparison['switches'])}")
    if comparison["word"] is not None:
        parts.append("the same word" if comparison["word"] else "another word")
    return [", ".join(parts)]


def _same_word(problem: "Problem", solution: "Solution") -> bool | None:
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

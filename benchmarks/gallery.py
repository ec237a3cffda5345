"""Every registered problem from a cold start: `auto`, and `trapezoidal` with 400 steps as a
baseline.

Run as `python benchmarks/gallery.py [NAME ...]`.
"""

import argparse
import math
import time
from dataclasses import dataclass
from typing import final

from rich.console import Console
from rich.table import Table

from socp import Problem, Solution, default_guess, run
from socp.errors import SocpError
from socp.registry.plugins import Registry
from socp.search import refinement as refine

_DIGITS = 15  # of a float


@final
@dataclass(frozen=True)
class Row:
    """One run: seconds with verification and judgement, words tried, digits right, and what it
    ended with.
    """

    seconds: float
    words: int
    digits: str
    verdict: str
    word: str


def digits(problem: Problem, solution: Solution) -> str:
    """Return how many digits of the objective agree with the reference, as text."""
    if problem.reference is None:
        return "-"
    wanted = problem.reference.objective
    error = abs(solution.objective - wanted) / max(abs(wanted), 1e-300)
    trusted = -math.log10(
        max(problem.reference.tolerance / max(abs(wanted), 1e-300), 10.0**-_DIGITS)
    )
    found = -math.log10(max(error, 10.0**-_DIGITS))
    return f"{'>= ' if found > trusted else ''}{min(found, trusted):.1f}"


def measure(registry: Registry, method: str, name: str) -> Row:
    """Run a method on a problem, cold."""
    problem, counts = registry.problem(name), [0]
    tried = refine._tried  # noqa: SLF001 - counted from outside, so that no count burdens the search itself

    def counted(*given: object) -> Solution | None:
        counts[0] += 1
        return tried(*given)  # type: ignore[arg-type]

    refine._tried = counted  # type: ignore[assignment]  # noqa: SLF001
    began = time.perf_counter()
    try:
        solution = run(registry.methods[method](), problem, default_guess(problem))
    except SocpError as error:
        return Row(time.perf_counter() - began, counts[0], "-", str(error), "")
    finally:
        refine._tried = tried  # noqa: SLF001
    verdict = "extremal" if solution.extremal else f"not certified ({solution.stop.name.lower()})"
    seconds = time.perf_counter() - began
    return Row(seconds, counts[0], digits(problem, solution), verdict, solution.word)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "names", nargs="*", metavar="NAME", help="problems; all registered ones if none is named"
    )
    registry = Registry.load()
    names = parser.parse_args().names or sorted(registry.problems)
    table = Table("problem", "s", "words", "digits", "verdict", "trap. s", "trap. digits", "word")
    for name in names:
        found, base = measure(registry, "auto", name), measure(registry, "trapezoidal", name)
        table.add_row(
            name,
            f"{found.seconds:.2f}",
            str(found.words),
            found.digits,
            found.verdict,
            f"{base.seconds:.2f}",
            base.digits,
            found.word,
        )
    Console().print(table)


if __name__ == "__main__":
    main()

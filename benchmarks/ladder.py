"""What the second order says of the registered problems, and what it costs.

Run as `python benchmarks/ladder.py [NAME ...]`: every problem is solved by `auto`, and what its
verdict says beyond the principle is worked out once more by itself, timed in this process.
"""

import argparse
import os
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does

from rich.console import Console
from rich.table import Table

from socp import Solution, default_guess
from socp.methods import run
from socp.model import Curvature, cached
from socp.registry.plugins import Registry
from socp.verdict import second_order


def shown(found: Curvature | None) -> str:
    """Return a curvature in short."""
    if found is None:
        return "-"
    return "nothing free" if found.free == 0 else f"{found.least:.3g} ± {found.error:.0e}"


def row(registry: Registry, name: str, seconds: float) -> list[str]:
    """Solve a problem and return its row."""
    problem = registry.problem(name)
    began = time.process_time()
    solution: Solution = run(
        registry.method("auto")(seconds=seconds), problem, default_guess(problem)
    )
    whole = time.process_time() - began
    if not solution.extremal:
        return [name, solution.word, "not certified", "", "", f"{whole:.2f}", ""]
    cached(problem, second_order).clear()  # the solve itself asked
    began = time.process_time()
    found = second_order(problem, solution)
    taken = time.process_time() - began
    return [
        name,
        solution.word,
        found.kind.value,
        shown(found.word),
        shown(found.singular),
        f"{whole:.2f}",
        f"{taken:.2f} ({taken / (whole - taken):.0%})",
    ]


def main() -> None:
    """Print the table."""
    registry = Registry.load()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=sorted(registry.entries), metavar="NAME")
    parser.add_argument("--seconds", type=float, default=60.0, help="allowed to each solve")
    given = parser.parse_args()
    table = Table("problem", "word", "claim", "of the word", "singular", "s", "second order")
    for name in given.names:
        table.add_row(*row(registry, name, given.seconds))
    Console(width=180).print(table)


if __name__ == "__main__":
    main()

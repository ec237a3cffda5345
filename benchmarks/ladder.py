"""The rungs of the ladder that every registered problem reaches, what decides it, and what that
costs.

Run as `python benchmarks/ladder.py [NAME ...]`: every problem is solved by `auto`, and what its
verdict says beyond the principle is worked out once more by itself, in CPU seconds of this process.
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
from socp.view import top_text


def shown(found: Curvature | None) -> str:
    """Return a curvature in short."""
    if found is None:
        return "-"
    return "nothing free" if found.free == 0 else f"{found.least:.3g} ± {found.error:.0e}"


def row(registry: Registry, name: str, seconds: float) -> tuple[list[str], float, float]:
    """Solve a problem and return its row, with the CPU seconds of solve and second order."""
    problem = registry.problem(name)
    began = time.process_time()
    solution: Solution = run(
        registry.method("auto")(seconds=seconds), problem, default_guess(problem)
    )
    whole = time.process_time() - began
    verdict = solution.verdict
    rung = top_text(solution)
    if verdict is None or not verdict.extremal:
        return [name, solution.word, rung, "", "", "", f"{whole:.2f}", ""], whole, 0.0
    cached(problem, second_order).clear()  # the solve itself asked
    began = time.process_time()
    found = second_order(problem, solution)
    taken = time.process_time() - began
    share = taken / (whole - taken)
    cells = [
        *(name, solution.word, rung, shown(found.word), shown(found.singular)),
        *("; ".join(found.limits[:2]), f"{whole:.2f}", f"{taken:.2f} ({share:.0%})"),
    ]
    return cells, whole, taken


def main() -> None:
    """Print the table."""
    registry = Registry.load()
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=sorted(registry.entries), metavar="NAME")
    parser.add_argument("--seconds", type=float, default=60.0, help="allowed to each solve")
    given = parser.parse_args()
    heads = ("problem", "word", "rung", "of the word", "singular", "no more for", "solve, s")
    table, solves, orders = Table(*heads, "second order, s"), 0.0, 0.0
    for name in given.names:
        cells, whole, taken = row(registry, name, given.seconds)
        table.add_row(*cells)
        solves, orders = solves + whole - taken, orders + taken
    console = Console(width=200)
    console.print(table)
    console.print(f"second order in all: {orders:.2f} s, {orders / solves:.0%} of the solves' time")


if __name__ == "__main__":
    main()

"""What `socp prove` proves of the registered problems: the enclosure of the objective, the radius
of the box with exactly one solution, and what that costs.

Run as `python benchmarks/proofs.py [NAME ...]`: every problem is solved by `auto`, and proved in
CPU seconds of this process; what is not proved is told with the step and the reason.
"""

import argparse
import os
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does

from rich.console import Console
from rich.table import Table

from socp import default_guess
from socp.methods import run
from socp.proof import prove
from socp.registry.plugins import Registry


def row(registry: Registry, name: str, seconds: float, bits: int) -> list[str]:
    """Solve a problem, prove it, and return its row."""
    problem = registry.problem(name)
    method = registry.method("auto")(seconds=seconds)
    solution = run(method, problem, default_guess(problem))
    began = time.process_time()
    proof = prove(problem, solution, bits)
    spent = f"{time.process_time() - began:.1f}"
    if not proof.holds:
        return [name, solution.word, f"not proved: {proof.step}: {proof.reason}", "", spent]
    return [name, solution.word, " ± ".join(proof.objective), f"{proof.radius:.0e}", spent]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="problems; all that are registered by default")
    parser.add_argument("--seconds", type=float, default=60.0, help="of auto, a problem")
    parser.add_argument("--bits", type=int, default=128)
    given = parser.parse_args()
    registry = Registry.load()
    table = Table("problem", "word", "objective", "radius", "CPU s", box=None)
    for name in given.names or sorted(registry.problems):
        table.add_row(*row(registry, name, given.seconds, given.bits))
    Console(width=160).print(table)


if __name__ == "__main__":
    main()

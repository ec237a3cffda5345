"""What `socp prove` and `socp bound` prove of the registered problems: the enclosure of the
objective, the radius of the box with exactly one solution, what the curvature of the word's own
problem is at least, the lower bound of every control's objective, its gap, and what these cost.

Run as `python benchmarks/proofs.py [NAME ...]`: every problem is solved by `auto`, and proved, with
the CPU seconds of it; what is not proved is told with the step and the reason. `--only bound`
and `--only prove` leave the other out.
"""

import argparse
import os
import resource
import time
from collections.abc import Callable

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does

from rich.console import Console
from rich.table import Table

from socp import default_guess
from socp.methods import run
from socp.model import Problem, Solution
from socp.proof import lower_bound, prove
from socp.registry.plugins import Registry


def row(registry: Registry, name: str, given: argparse.Namespace) -> list[str]:
    """Solve a problem, prove what is asked for, and return its row."""
    problem = registry.problem(name)
    method = registry.method("auto")(seconds=given.seconds)
    solution = run(method, problem, default_guess(problem))
    cells = [name, solution.word]
    if given.only != "bound":
        cells += timed(existence, problem, solution, given)
    if given.only != "prove":
        cells += timed(bounded, problem, solution, given)
    return cells


def timed(
    prover: Callable[[Problem, Solution, argparse.Namespace], list[str]],
    problem: Problem,
    solution: Solution,
    given: argparse.Namespace,
) -> list[str]:
    """Return the cells of a proof and its CPU seconds."""
    began = spent()
    return [*prover(problem, solution, given), f"{spent() - began:.1f}"]


def spent() -> float:
    """Return the CPU seconds of this process and of those that it waited for: bounds have one."""
    children = resource.getrusage(resource.RUSAGE_CHILDREN)
    return time.process_time() + children.ru_utime + children.ru_stime


def existence(problem: Problem, solution: Solution, given: argparse.Namespace) -> list[str]:
    """Return the enclosure of the objective, the radius of the box and the least curvature."""
    proof = prove(problem, solution, given.bits)
    if not proof.holds:
        return [f"not proved: {proof.step}: {proof.reason}", "", ""]
    least, free = proof.minimum.least, proof.minimum.free
    curvature = "nothing free" if least is None else f"{least:.6g} ({free})"
    radius = f"{proof.radius:.0e}"
    return [" ± ".join(proof.objective), radius, proof.minimum.reason or curvature]


def bounded(problem: Problem, solution: Solution, given: argparse.Namespace) -> list[str]:
    """Return the lower bound and its gap."""
    found = lower_bound(problem, solution, given.bound_seconds)
    gap = found.gap(solution)
    if gap is None:
        return [f"no bound: {found.reason}", ""]
    return [f"{found.bound:.10g}", f"{100 * gap:.2g} %"]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", help="problems; all that are registered by default")
    parser.add_argument("--seconds", type=float, default=60.0, help="of auto, a problem")
    parser.add_argument("--bits", type=int, default=128)
    parser.add_argument("--bound-seconds", type=float, default=120.0, help="of a bound")
    parser.add_argument("--only", choices=("prove", "bound"), help="one of the two")
    given = parser.parse_args()
    registry = Registry.load()
    columns = ["problem", "word"]
    columns += ["objective", "radius", "curvature", "CPU s"] if given.only != "bound" else []
    columns += ["lower bound", "gap", "CPU s"] if given.only != "prove" else []
    table = Table(*columns, box=None)
    for name in given.names or sorted(registry.problems):
        table.add_row(*row(registry, name, given))
    Console(width=160).print(table)


if __name__ == "__main__":
    main()

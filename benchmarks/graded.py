"""How well the error that the judge states for a grid's objective covers the true one.

`python benchmarks/graded.py [NAME ...]` solves the registered problems with direct methods on
several grids, and prints for each the true error of the objective (of the returned value or of what
the control reaches, whichever is worse), the stated one, and their quotient, the effectivity. Below
1 the stated error would be false. Left out are problems whose grids go to another extremal than the
reference's.

A grid that is not feasible is graded all the same, and says so.
"""

import argparse
import math
import os

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does

from rich.console import Console
from rich.table import Table

from socp import Problem, Solution, default_guess, run
from socp.errors import SocpError
from socp.model import Grade
from socp.registry import Registry
from socp.verdict import grade

GRIDS = (
    ("euler-ipopt", {"steps": 200}),
    ("euler-ipopt", {"steps": 800}),
    ("trapezoidal", {"steps": 50}),
    ("trapezoidal", {"steps": 100}),
    ("trapezoidal", {"steps": 400}),
    ("hermite-simpson", {"steps": 100}),
    ("lgr", {"intervals": 20, "points": 3}),
    ("lgr", {"intervals": 60, "points": 3}),
)
ELSEWHERE = {"auv_reverse"}  # grids go to the extremal of 14.95, the reference is the one of 14.49


def error_of(problem: Problem, solution: Solution) -> float:
    """Return the true error of an objective as returned or as reached, nan without a reference."""
    known = math.nan if problem.reference is None else problem.reference.objective
    return max(abs(each - known) for each in (solution.objective, solution.reached))


def rung(solution: Solution) -> str:
    """Return what the verdict calls a solution."""
    verdict = solution.verdict
    if verdict is None or not verdict.feasible:
        return "not feasible"
    return (
        "extremal" if verdict.extremal else "approximate" if verdict.approximate else "not extremal"
    )


def main() -> None:
    """Print the table and how many are covered."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME")
    registry, console = Registry.load(), Console(width=140)
    names = parser.parse_args().names or sorted(set(registry.problems) - ELSEWHERE)
    table = Table("problem", "grid", "rung", "true", "stated", "effectivity", "of the terms")
    quotients: list[float] = []
    for name in names:
        problem = registry.problem(name)
        for method, options in GRIDS:
            label = f"{method} {' '.join(map(str, options.values()))}"
            try:
                solution = run(registry.method(method)(**options), problem, default_guess(problem))
                found: Grade | None = grade(problem, solution) if solution.stop.ok else None
            except SocpError:
                found = None
            if found is None:
                table.add_row(name, label, "none")
                continue
            true = error_of(problem, solution)
            quotients.append(found.error / true)
            share = found.error / found.size
            figures = (f"{true:.1e}", f"{found.error:.1e}", f"{quotients[-1]:.2f}", f"{share:.1e}")
            table.add_row(name, label, rung(solution), *figures)
    console.print(table)
    covered = sum(each >= 1.0 for each in quotients)
    middle = sorted(quotients)[len(quotients) // 2]
    console.print(f"{covered} of {len(quotients)} covered, median effectivity {middle:.2g}")


if __name__ == "__main__":
    main()

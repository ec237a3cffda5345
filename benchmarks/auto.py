"""How long `auto` takes on the vehicle against one trapezoidal solve with 400 steps, in the same
process.

Run as `python benchmarks/auto.py [NAME ...]`. `solve` is the method alone; `run` adds what every
solution gets: verification and judgement. The median of some runs each, taken in turns, after one
that is not counted.
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable
from functools import partial

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does

from rich.console import Console
from rich.table import Table

from socp import Method, Problem, Solution, default_guess, run
from socp.registry.plugins import Registry

_RUNS = 5


def seconds(call: Callable[[], object]) -> float:
    """Return how long a call takes."""
    began = time.perf_counter()
    call()
    return time.perf_counter() - began


def alone(method: Method, problem: Problem) -> Solution:
    """Solve without verification and judgement of the result."""
    return method.solve(problem, default_guess(problem))


def judged(method: Method, problem: Problem) -> Solution:
    """Solve as the command line does."""
    return run(method, problem, default_guess(problem))


def main() -> None:
    """Print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", default=["auv", "auv_reverse"], metavar="NAME")
    registry = Registry.load()
    table = Table("problem", "", "auto s", "trapezoidal s", "ratio")
    for name in parser.parse_args().names:
        problem = registry.problem(name)
        methods = [registry.methods[each]() for each in ("auto", "trapezoidal")]
        for label, how in (("solve", alone), ("run", judged)):
            calls = [partial(how, method, problem) for method in methods]
            times = [[seconds(call) for call in calls] for _ in range(_RUNS + 1)][1:]
            ours, theirs = (statistics.median(column) for column in zip(*times, strict=True))
            table.add_row(name, label, f"{ours:.2f}", f"{theirs:.2f}", f"{ours / theirs:.2f}")
    Console().print(table)


if __name__ == "__main__":
    main()

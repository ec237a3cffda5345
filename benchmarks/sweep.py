"""How many certified solutions a second a sweep gives, against solving each cold, over 1 and 2
workers and over dask, and whether its memory stays flat.

Run as `python benchmarks/sweep.py`, some half an hour, or briefly with `--points 32 --cold 3`. Two
sets: the vehicle's starts over x in 20..60, y in -5..5, and strengths of its current in 0.1..2.
Wall seconds, of whole runs with their workers' start; ratios within one run hold on any machine
that is otherwise idle. Memory is the most that this process, which does the work of one worker, has
had after so many points.
"""

import argparse
import os
import resource
import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import contextmanager
from functools import partial

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does

import numpy as np
from rich.console import Console
from rich.table import Table

import socp
from socp import Problem, Watch, silent
from socp.model import Progress
from socp.registry import Registry
from socp.study import Points, engine, points, pool, results_of


def sets(count: int) -> dict[str, Points]:
    """Return the points of both sets, about so many each."""
    rows = max(round(np.sqrt(count / 4)), 2)  # four times as wide as it is high
    starts = points({"start.x": f"20:60:{count // rows}", "start.y": f"-5:5:{rows}"})
    return {"starts": starts, "current": points({"current": f"0.1:2:{count}"})}


def cold(problem: Problem, at: Points, count: int) -> tuple[float, int]:
    """Return the seconds a point, each solved anew, over some of the points, and how many of these
    were certified.
    """
    chosen = np.linspace(0, len(at) - 1, count).astype(int)
    began, certified = time.perf_counter(), 0
    for k in chosen:
        posed = problem.with_(at.named(int(k)))
        certified += bool(socp.solve(posed, watch=silent).extremal)
    return (time.perf_counter() - began) / count, certified


@contextmanager
def workers(given: str) -> Iterator[int | Executor]:
    """Yield processes, or two of dask's workers."""
    with engine("local" if given == "dask" else int(given), 2) as hands:
        yield hands.workers


def measured(problem: Problem, at: Points, given: str, watch: Watch) -> tuple[float, int, float]:
    """Return the seconds of a sweep, how many points it certified, and the seconds of a point that
    went on from a neighbour, in the middle.
    """
    began = time.perf_counter()
    with workers(given) as hands:
        found = socp.sweep(problem, at, workers=hands, watch=watch)
    spent = time.perf_counter() - began
    near = [row["seconds"] for row in found.rows if row["start"] >= 0]
    return spent, found.certified, float(np.median(near))


def see(sizes: list[tuple[int, float]], now: Progress) -> bool:
    """Note how many points were solved, and the most MiB that this process has had by then."""
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    sizes.append((now.iteration, most))
    return False


def overhead(count: int) -> dict[str, float]:
    """Return the seconds that a task which does nothing costs, by engine: two processes, and two of
    dask's workers.
    """
    found = {}
    with pool(2) as two, engine("local", 2) as cluster:
        for name, hands in (("processes", two), ("dask", cluster.workers)):
            list(results_of(abs, deque(range(8)), hands))  # workers are there
            began = time.perf_counter()
            list(results_of(abs, deque(range(count)), hands))
            found[name] = (time.perf_counter() - began) / count
    return found


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=1000, help="of each set")
    parser.add_argument("--cold", type=int, default=20, help="of these, solved cold")
    parser.add_argument("--tasks", type=int, default=500, help="that do nothing, for overheads")
    parser.add_argument("--workers", nargs="*", default=["1", "2", "dask"])
    asked = parser.parse_args()
    problem = Registry.load().problem("auv")
    head = ("set", "workers", "points", "certified", "s", "certified a second", "s a neighbour")
    table, memory = Table(*head, "times cold"), Table("set", "points", "MiB at most")
    for name, at in sets(asked.points).items():
        alone, sure = cold(problem, at, asked.cold)
        table.add_row(name, "cold", str(asked.cold), str(sure), "", f"{1 / alone:.2f}", "", "1")
        for given in asked.workers:
            sizes: list[tuple[int, float]] = []
            spent, certified, near = measured(problem, at, given, partial(see, sizes))
            rate = certified / spent
            cells = str(len(at)), str(certified), f"{spent:.1f}", f"{rate:.2f}", f"{near:.3f}"
            table.add_row(name, given, *cells, f"{rate * alone:.1f}")
            for k in np.linspace(0, len(sizes) - 1, min(8, len(sizes))).astype(int):
                if given == "1":
                    memory.add_row(name, str(sizes[k][0]), f"{sizes[k][1]:.0f}")
    Console().print(table)
    Console().print(memory)
    table = Table("engine", "ms a task that does nothing")
    for name, seconds in overhead(asked.tasks).items():
        table.add_row(name, f"{1e3 * seconds:.2f}")
    Console().print(table)


if __name__ == "__main__":
    main()

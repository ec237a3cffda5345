"""How long `auto` takes against a fixed yardstick, where its time goes, and how direct solves grow.

Run as `python benchmarks/speed.py [NAME ...]`, without names over all registered problems, with
`--growth` for uniform grids of 1e3 to 1e5 steps, and chains of 10 to 100 states (tests/chains.py).
All times are CPU seconds of one process, the
least of some runs taken in turns; ratios within one run hold on any machine. The yardstick is a
trapezoidal rule of 400 steps, written out in casadi with the stock options of Ipopt: no progress of
ours moves it. The shares of `auto`'s stages are those of one more run, under a profiler.
"""

import argparse
import os
import resource
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "tests"))
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does

import chains
import stages
import yardstick
from rich.console import Console
from rich.table import Table

from socp import Method, Problem, Solution, default_guess, run
from socp.registry.plugins import Registry
from socp.verdict import judge

_SECONDS = 300.0  # allowed each: the machine may be busy
_GROWTH = (1000, 10_000, 100_000)
_DIRECT = ("euler-ipopt", "trapezoidal")
_STATES = (10, 30, 100)


def cpu(call: Callable[[], object]) -> tuple[float, object]:
    """Return how long a call takes, and what it returns."""
    began = time.process_time()
    found = call()
    return time.process_time() - began, found


def fresh(problem: Problem) -> Problem:
    """Return a problem of which nothing is known: what an earlier run worked out is not kept."""
    return replace(problem)


def least(calls: list[Callable[[], object]], runs: int) -> list[tuple[float, object]]:
    """Return the least time of each call, taken in turns, and what it returned last."""
    rounds = [[cpu(call) for call in calls] for _ in range(runs)]
    return [(min(s for s, _ in each), each[-1][1]) for each in zip(*rounds, strict=True)]


def row(method: Method, problem: Problem, runs: int) -> tuple[list[str], float, float]:
    """Return the row of a problem, the seconds of `auto` and their ratio to the yardstick."""
    guess = default_guess(problem)
    (ours, found), (grid, stop), (radau, _) = least(
        [
            lambda: run(method, new := fresh(problem), default_guess(new)),
            lambda: yardstick.trapezoid(problem, guess),
            lambda: yardstick.collocation(problem, guess),
        ],
        runs,
    )
    assert isinstance(found, Solution)
    new = fresh(problem)
    spent = stages.shares(lambda: run(method, new, default_guess(new)))
    shares = [f"{100 * spent[each]:.0f} %" for each in stages.NAMES]
    certified = "certified" if found.extremal else "-"
    cells = [problem.name, certified, f"{ours:.2f}", f"{grid:.2f}", f"{radau:.2f}"]
    return [*cells, f"{ours / grid:.2f}", str(stop), *shares], ours, ours / grid


def growth(registry: Registry, name: str) -> None:
    """Print how the time and the memory of direct solves grow with their steps."""
    table = Table("method", "steps", "s", "a decade", "MiB at most", "stop", title=name)
    problem = registry.problem(name)
    for kind in _DIRECT:
        before = None
        for steps in _GROWTH:
            method = registry.method(kind)(steps=steps)
            spent, found = cpu(lambda m=method: m.solve(problem, default_guess(problem)))
            ratio = "" if before is None else f"x {spent / before:.1f}"
            peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
            stop = found.message if isinstance(found, Solution) else ""
            table.add_row(kind, str(steps), f"{spent:.2f}", ratio, f"{peak:.0f}", stop)
            before = spent
    Console(width=120).print(table)


def many(registry: Registry) -> None:
    """Print how the time and the memory of direct solves and of their judgement grow with states,
    on the grids that the methods have by themselves.
    """
    heads = ("problem", "method", "states", "solve s", "judge s", "MiB at most", "stop")
    table = Table(*heads, title="states")
    for made, share in ((chains.masses, 2), (chains.rod, 1)):
        for kind in _DIRECT:
            for count in _STATES:
                problem, method = made(count // share), registry.method(kind)()
                guess = default_guess(problem)
                spent, found = cpu(lambda p=problem, m=method, g=guess: m.solve(p, g))
                assert isinstance(found, Solution)
                judged, _ = cpu(lambda p=problem, s=found: judge(p, s))
                peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
                cells = (f"{spent:.2f}", f"{judged:.2f}", f"{peak:.0f}", found.message)
                table.add_row(made.__name__, kind, str(count), *cells)
    Console(width=120).print(table)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--growth", action="store_true", help="growth of uniform grids instead")
    parser.add_argument("--runs", type=int, default=3, help="times that each is run")
    given, registry = parser.parse_args(), Registry.load()
    names = given.names or sorted(registry.problems)
    if given.growth:
        for name in given.names or ["auv"]:
            growth(registry, name)
        many(registry)
        return
    method = registry.method("auto")(seconds=_SECONDS)
    heads = ["problem", "auto", "auto s", "yardstick s", "radau s", "ratio", "yardstick"]
    table = Table(*heads, *stages.NAMES)
    seconds, ratios = [], []
    for name in names:
        cells, ours, ratio = row(method, registry.problem(name), given.runs)
        table.add_row(*cells)
        print(*cells, sep="  ", flush=True)
        seconds.append(ours)
        ratios.append(ratio)
    Console(width=180).print(table)
    print(f"median {statistics.median(seconds):.2f} s, ratio {statistics.median(ratios):.2f}")


if __name__ == "__main__":
    main()

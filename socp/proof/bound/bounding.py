"""The search for a lower bound, in a process of its own: it ends in time, whatever a solver does,
and what was found by then stands.
"""

import json
import os
import pickle
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from math import isfinite, nan
from queue import Empty, SimpleQueue
from subprocess import DEVNULL, PIPE, Popen
from threading import Thread

import numpy as np

from socp.errors import ProblemError, SolveError
from socp.model import Problem, Progress, Solution, Watch, silent
from socp.process import ended_after
from socp.proof.balls import flint
from socp.proof.bound.domain import Spread, setting
from socp.proof.bound.searching import Job
from socp.proof.bound.told import LowerBound

SECONDS = 60.0
# Of the time: over it, for what was solved in time is rounded and checked still
_GRACE = 0.05
_LOOK = 0.2  # seconds between two looks at whether the watch asks to stop


def lower_bound(
    problem: Problem,
    solution: Solution | None = None,
    seconds: float = SECONDS,
    degree: int | None = None,
    watch: Watch = silent,
) -> LowerBound:
    """Return a proved lower bound of a problem's optimum.

    A solution shows where trajectories of interest are, and what leaving the region should cost; it
    is not believed. `degree` is that of the subsolution, the largest that the time allows if None.
    Ctrl-C, or a watch that answers true, ends the search: what comes back is the bound in hand.
    Raises SolveError where python-flint is missing, KeyboardInterrupt where there is none in hand.
    """
    flint()
    began, until = time.perf_counter(), time.time() + seconds
    found = LowerBound(problem=problem.name, reason="there was no time for it")
    if solution is not None and not isfinite(solution.objective):
        solution = None  # nothing was found
    goal = None if solution is None else solution.objective
    try:
        setting(problem)  # what has no bound is said at once
        job = Job(problem, spread_of(solution), goal, degree, until, os.getpid())
        for each in _told(pickle.dumps(job), until + _GRACE * seconds):
            if isinstance(each, LowerBound):
                found = each
            _shown(found, int(each is None), watch)
    except (SolveError, ProblemError) as error:
        found = found if found.bound is not None else replace(found, reason=str(error))
    except KeyboardInterrupt:
        if found.bound is None:
            raise
        found = replace(found, interrupted=True)
    return replace(found, seconds=time.perf_counter() - began)


def _shown(found: LowerBound, count: int, watch: Watch) -> None:
    """Show a watch what is in hand; KeyboardInterrupt where it asks to stop."""
    known = nan if found.bound is None else found.bound
    stage = "no bound yet" if found.bound is None else f"degree {found.degree}"
    if watch(Progress(stage, count, known, nan)):
        raise KeyboardInterrupt


def spread_of(solution: Solution | None) -> Spread:
    """Return where the states of a solution are."""
    if solution is None:
        return {}
    ends = [(np.min(arc.x, axis=1), np.max(arc.x, axis=1)) for arc in solution.arcs]
    low, high = np.min([a for a, _ in ends], axis=0), np.max([b for _, b in ends], axis=0)
    spread = zip(low.tolist(), high.tolist(), strict=True)
    return dict(zip(solution.state_names, spread, strict=True))


def _told(job: bytes, until: float) -> Iterator[LowerBound | None]:
    """Yield what a search finds as it does, and None from time to time, until it ends or has to."""
    # -P: a file such as signal.py or json.py in the current folder is none of Python's
    command = [sys.executable, "-P", "-m", "socp.proof.bound.worker"]
    with ended_after(command, stdin=PIPE, stdout=PIPE, stderr=DEVNULL) as process:
        lines: SimpleQueue[bytes] = SimpleQueue()
        Thread(target=_moved, args=(process, job, lines), daemon=True).start()
        while (left := until - time.time()) > 0.0:
            try:
                line = lines.get(timeout=min(left, _LOOK))
            except Empty:
                yield None
                continue
            if not line:
                if process.wait():
                    raise SolveError(f"the search died with exit code {process.returncode}")
                return
            yield LowerBound(**json.loads(line))


def _moved(process: Popen[bytes], job: bytes, lines: "SimpleQueue[bytes]") -> None:
    """Give a process its job, and pass its lines on; an empty one is the last."""
    given, told = process.stdin, process.stdout
    if given is not None and told is not None:
        with told, suppress(OSError):  # it was ended
            with given:
                given.write(job)
            for line in told:
                if line.endswith(b"\n"):
                    lines.put(line)
    lines.put(b"")

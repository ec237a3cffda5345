"""Mixed-integer solvers in processes of their own: time limits that hold, and only what was checked
is believed.
"""

import contextlib
import json
import math
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, final

import casadi
import numpy as np

from socp.model import Progress, Stop, Watch
from socp.process import ended_after
from socp.solvers.contract import NLP, NLPPoint
from socp.solvers.worker import TOLD

LACKING = "; no feasible point"
GRACE = 1.0  # seconds after its limit that a solver has to end by itself
FEASIBLE = 1e-5  # largest violation of a row or a bound of a point that is believed
INTEGRAL = 1e-4  # largest distance of a binary from 0 or 1, before it is rounded
_PAUSE = 0.02  # seconds between two looks at what a solver has told


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Outcome:
    """What a mixed-integer solver came to, as far as it could be checked.

    `point`: the best point that was verified, its binaries rounded, with why the solver stopped;
    where there is none, the guess. `bound`: lower bound of the objective that the solver proved,
    nan where it proves none. `violation` of rows and bounds by the point and `integrality`, the
    distance of its binaries from 0 or 1 before rounding, are evaluated here, not by the solver;
    both are nan where no point was verified. `nodes` is their number, 0 if unknown.
    """

    point: NLPPoint
    bound: float = math.nan
    violation: float = math.nan
    integrality: float = math.nan
    nodes: int = 0

    @property
    def found(self) -> bool:
        """Whether a point was verified."""
        return math.isfinite(self.violation)

    @property
    def gap(self) -> float:
        """Distance of the objective from the bound, relative to the larger of the two; nan where
        either is missing.
        """
        if not self.found or not math.isfinite(self.bound):
            return math.nan
        size = max(abs(self.point.objective), abs(self.bound), 1e-10)
        return max(0.0, self.point.objective - self.bound) / size

    def or_better(self, known: "Outcome") -> "Outcome":
        """Return this outcome, with a known point in place of its own where that one is better."""
        if not known.found or (self.found and self.point.objective <= known.point.objective):
            return self
        stop = Stop.LIMIT if self.point.stop in {Stop.INFEASIBLE, Stop.FAILED} else self.point.stop
        message = (
            f"{self.point.message.removesuffix(LACKING)}; the point is an earlier one, "
            f"{known.point.message}"
        )
        point = replace(
            self.point, v=known.point.v, objective=known.point.objective, stop=stop, message=message
        )
        return replace(self, point=point, violation=known.violation, integrality=known.integrality)


@final
@dataclass(frozen=True)
class Job:
    """One run of a solver: the module whose `work` is called, for so many seconds, with what
    `prepared` says of the programme and writes into a folder.
    """

    module: str
    name: str
    seconds: float
    prepared: Callable[[Path], Mapping[str, Any]]


@final
@dataclass(eq=False)
class _Reports:
    """What was told so far: the best verified point, the best bound, the last status, and what was
    not believed.
    """

    nlp: NLP
    name: str
    best: Outcome | None = None
    bound: float = -math.inf
    status: str = ""
    error: str = ""
    nodes: int = 0
    refused: list[str] = field(default_factory=list)

    def hear(self, line: str) -> None:
        """Take in one line."""
        try:
            record = json.loads(line)
            v = None if record.get("v") is None else np.array(record["v"], dtype=float)
            bound = float(record.get("bound", math.nan))
            self.nodes = max(self.nodes, int(record.get("nodes", 0)))
            self.status, self.error = (
                str(record.get("status", self.status)),
                str(record.get("error", self.error)),
            )
        except (ValueError, TypeError, AttributeError):
            self.refused.append(f"it said what cannot be read: {line[:60]!r}")
            return
        if bound > self.bound and bound < math.inf:
            self.bound = bound
        if v is not None:
            self._point(v)

    def _point(self, v: np.ndarray) -> None:
        if v.shape != (self.nlp.count,) or not np.isfinite(v).all():
            self.refused.append("its point is not one of this problem")
            return
        found = evaluated_point(self.nlp, v)
        if found.integrality > INTEGRAL:
            self.refused.append(f"a binary of its point is {found.integrality:.1g} from 0 or 1")
        elif not found.violation <= FEASIBLE:
            self.refused.append(f"its point violates the constraints by {found.violation:.1g}")
        elif self.best is None or found.point.objective < self.best.point.objective:
            self.best = found


def programme_job(nlp: NLP, starts: Sequence[NLPPoint], folder: Path) -> dict[str, Any]:
    """Save a programme to a folder and return what a job says of it: starts, boxes and binaries."""
    casadi.Function("nlp", [nlp.v], [nlp.f, nlp.g]).save(str(folder / "nlp.casadi"))
    return {
        "starts": [start.v.tolist() for start in starts],
        "v_box": nlp.v_box.tolist(),
        "g_box": nlp.g_box.tolist(),
        "binary": nlp.binary.tolist(),
    }


def evaluated_point(nlp: NLP, v: np.ndarray) -> Outcome:
    """Return a point (n,) with its binaries rounded, and its objective and violations evaluated by
    casadi.
    """
    rounded = np.where(nlp.binary, np.round(np.clip(v, 0.0, 1.0)), v)
    integrality = float(np.abs(v - rounded)[nlp.binary].max(initial=0.0))
    f, g = (
        each.full().ravel() for each in casadi.Function("point", [nlp.v], [nlp.f, nlp.g])(rounded)
    )
    off = [
        np.maximum(low - at, at - high)
        for at, (low, high) in ((rounded, nlp.v_box), (g, nlp.g_box))
    ]
    violation = float(np.concatenate(off).max(initial=0.0))  # nan where a row cannot be computed
    point = NLPPoint(v=rounded, objective=float(f[0]), stop=Stop.LIMIT)
    return Outcome(point=point, violation=violation, integrality=integrality)


def solved_apart(nlp: NLP, guess: NLPPoint, job: Job, watch: Watch) -> Outcome:
    """Run a solver in a process of its own, end it where it does not end in time, and return what
    holds.

    Ctrl-C, or a watch that answers true, ends it too; then the best point so far comes back as
    interrupted.
    """
    until = time.time() + job.seconds
    with tempfile.TemporaryDirectory(prefix="socp-") as place:
        folder = Path(place)
        said = job.prepared(folder)
        began, told = time.perf_counter(), _Reports(nlp, job.name)
        kill_after = max(until - time.time(), 0.0) + GRACE
        limits = {"until": until, "killed_after": kill_after, "parent": os.getpid()}
        (folder / "job.json").write_text(json.dumps({**said, **limits}), encoding="utf-8")
        ended = "interrupted"
        with contextlib.suppress(KeyboardInterrupt):
            ended = _attended((job.module, folder), told, watch, began + kill_after)
        return _outcome(told, guess, ended, time.perf_counter() - began)


def _attended(run: tuple[str, Path], reports: _Reports, watch: Watch, deadline: float) -> str:
    """Listen to a solver until it ends or has to be ended; returns how it ended."""
    # -P: a file such as signal.py or json.py in the current folder is none of Python's
    (module, folder), count = run, 0
    command = [sys.executable, "-P", "-m", "socp.solvers.worker", module, str(folder)]
    # in its folder: solvers read files such as `bonmin.opt` where they run, unasked
    with (
        (folder / "log.txt").open("wb") as log,
        ended_after(command, folder, stdout=log, stderr=log) as process,
    ):
        lines = _lines(folder / TOLD)
        while True:
            code = process.poll()  # before reading: what it said at its end is then read too
            for line in iter(lambda: next(lines), ""):
                reports.hear(line)
                count += 1
                if watch(_progress(reports, count)):
                    return "interrupted"
            if code is not None:
                return "" if code == 0 else f"it died with {_how(code)}"
            if time.perf_counter() > deadline:
                return "it did not keep its time limit and was ended"
            time.sleep(_PAUSE)


def _progress(reports: _Reports, count: int) -> Progress:
    if reports.best is None:
        return Progress(reports.name, count, math.nan, math.nan)
    return Progress(
        reports.name,
        count,
        reports.best.point.objective,
        reports.best.violation,
        best=reports.best.point.objective,
    )


def _lines(path: Path) -> Iterator[str]:
    """Yield the lines that have been added to a file, and an empty text whenever there are no more
    so far.
    """
    rest, place = "", 0
    while True:
        if path.exists():
            with path.open(encoding="utf-8", errors="replace") as file:
                file.seek(place)
                rest += file.read()
                place = file.tell()
        *whole, rest = rest.split("\n")
        yield from filter(None, whole)
        yield ""


def _how(code: int) -> str:
    return f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"


def _outcome(reports: _Reports, guess: NLPPoint, ended: str, seconds: float) -> Outcome:
    bound = reports.bound if math.isfinite(reports.bound) else math.nan
    if reports.best is not None and bound > reports.best.point.objective + FEASIBLE * max(
        1.0, abs(bound)
    ):
        reports.refused.append(
            f"its bound {bound:.9g} lies above the objective of a feasible point"
        )
        bound = math.nan
    stop = _stop(reports, ended)
    said = (
        "finished" if reports.status == "optimal" else reports.status
    )  # what that proves is its bound, nothing else
    status = reports.error or ended or said or "it ended without a word"
    best = reports.best or Outcome(point=replace(guess, objective=math.nan))
    refused = f" (not believed: {reports.refused[-1]})" if reports.refused else ""
    lacking = "" if reports.best else LACKING
    point = replace(
        best.point,
        stop=stop,
        message=f"{reports.name}: {status}{refused}{lacking}",
        seconds={"solve": seconds},
        iterations=reports.nodes,
    )
    return replace(best, point=point, bound=bound, nodes=reports.nodes)


def _stop(reports: _Reports, ended: str) -> Stop:
    if ended == "interrupted":
        return Stop.INTERRUPTED
    if reports.best is not None:
        return (
            Stop.SOLVED
            if reports.status == "optimal" and not (ended or reports.error)
            else Stop.LIMIT
        )
    if reports.status == "infeasible" and not (ended or reports.error):
        return Stop.INFEASIBLE
    return Stop.LIMIT if reports.status == "limit" or "time limit" in ended else Stop.FAILED

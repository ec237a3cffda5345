"""A solve written as it goes, to a rerun file (.rrd), to rerun's viewer, or to both."""

import os
import time
from dataclasses import dataclass, field
from pathlib import Path
from threading import Thread
from typing import Any, final
from urllib.parse import urlsplit

import numpy as np

from socp import SolveError
from socp.errors import load
from socp.model import Problem, Progress, Solution
from socp.process import file_stem, one_line
from socp.view import (
    CONTROLS,
    FITTED,
    HELP,
    PALETTE,
    RUNNING,
    Item,
    Note,
    Page,
    Picture,
    Plane,
    Run,
    comparison,
    control_frame,
    control_lines,
    ground,
    items,
    layout,
    log10,
    picture_of,
    scale,
    streaming,
    together,
)

from . import viewer
from .translate import blueprint, send, strips

SCHEMA = 1  # version of what a recording holds, in its properties
_FOOTER = b"RRF2FOOT"  # near the end of every file that was closed in order
_EVERY = 0.2  # seconds between two writes while a solver runs
_WRITING, _ENDING = (
    15.0,
    10.0,
)  # seconds to wait for what is not yet written, and for the end of the stream
_ASTRAY = 1e8  # of an infeasibility: how far beyond that a solve has gone astray flattens all else
_GONE = 1.0  # the same where the viewer is gone, or the writer has given up
_SHARE, _APART = (
    0.05,
    1 / 12,
)  # iterates take this share of the time at most, and wait for that share of it


@final
@dataclass(eq=False)
class Recorder:
    """A recording in progress: rerun's stream, and what is still to be written to it."""

    stream: Any
    path: Path | None
    live: str
    several: bool
    problem: Problem
    began: float = field(default_factory=time.monotonic)
    written: float = 0.0
    count: int = 0
    rows: list[tuple[int, float, float]] = field(default_factory=list)
    stage: str = ""
    lifting: float = 0.0
    lifted: float = 0.0
    paths: list[tuple[int, np.ndarray]] = field(default_factory=list)
    finished: list[Solution] = field(default_factory=list)
    items: list[Item] = field(default_factory=list)

    @classmethod
    def open(cls, problem: Problem, path: Path | None, live: str, *, several: bool) -> "Recorder":
        """Open the file, the viewer at the address `live`, or both; what rerun raises comes
        through.
        """
        stream = _opened(f"{problem.name}{'-compare' if several else ''}", path, live)
        stream.send_blueprint(blueprint(streaming(len(problem.control_names)), "progress"))
        for each in control_frame(problem, CONTROLS):
            send(stream, each)
        rr = load("rerun", "record", "a recording")
        stream.log("/help", rr.TextDocument(HELP, media_type=rr.MediaType.MARKDOWN), static=True)
        for part, colour in (("objective", PALETTE[0]), ("infeasibility", PALETTE[1])):
            stream.log(
                f"/progress/{part}",
                rr.SeriesLines(names=[part], colors=[colour], widths=[1.5]),
                static=True,
            )
        return cls(stream, path, live, several, problem)

    def __call__(self, now: Progress, /) -> None:
        """Keep the progress of an iteration, and write what has gathered once in a while."""
        elapsed = time.monotonic() - self.began
        self.rows.append((self.count, now.objective, now.infeasibility))
        if (now.word or now.stage) != self.stage:
            self.stage = now.word or now.stage
            self._stage()
        spent = self.lifting <= _SHARE * elapsed and elapsed - self.lifted >= _APART * elapsed
        if now.iterate is not None and spent:
            began = time.monotonic()
            self._iterate(now.iterate())
            ended = time.monotonic()
            self.lifting, self.lifted = self.lifting + ended - began, ended - self.began
        self.count += 1
        if elapsed - self.written >= _EVERY:
            self.written = elapsed
            self._write()

    def finish(self, problem: Problem, solution: Solution) -> None:
        """Write everything there is of a solution; its path is the last of the iterates."""
        self._write()
        if self.count and not self.several:
            self._iterate(solution)
        colour = PALETTE[len(self.finished) % len(PALETTE)]
        among = picture_of(problem, self.finished[0]) if self.finished else None
        run = (
            Run(f"/runs/{solution.method}", colour, solution.method, among)
            if self.several
            else Run()
        )
        found = items(problem, solution, run)
        for each in found:
            if not (self.several and each.path == f"{run.root}/summary"):
                send(self.stream, each)
        self.finished.append(solution)
        self.items += found

    def close(self) -> None:
        """Write the layout, close the file and make sure that it is whole; SolveError says what is
        wrong with it.
        """
        self._write()
        if self.finished:
            self._conclude()
        _closed(self.stream, self.path, self.live)

    def _conclude(self) -> None:
        import rerun as rr

        first = self.finished[0]
        about = {
            "schema": SCHEMA,
            "problem": one_line(self.problem.name),
            "title": one_line(self.problem.title),
            "runs": len(self.finished),
        }
        seen = together([picture_of(self.problem, each) for each in self.finished])
        if self.several:
            send(self.stream, Note(path="/summary", text=comparison(self.problem, self.finished)))
            roots = [f"/runs/{each.method}" for each in self.finished]
            for each in ground(seen, f"{roots[0]}/plan"):
                send(self.stream, each)
        else:
            roots = [""]
            about |= {
                "method": one_line(first.method),
                "stop": first.stop.name,
                "objective": first.objective,
            }
            about |= {"word": one_line(first.word), "extremal": str(first.extremal)}
            about |= {f"version {k}": one_line(v) for k, v in first.origin.versions.items()}
        self.stream.send_property(
            "socp", rr.AnyValues(**{key.replace(" ", "_"): value for key, value in about.items()})
        )
        methods = ", ".join(each.method for each in self.finished)
        self.stream.send_recording_name(one_line(f"{self.problem.name}: {methods}"))
        self._fit(seen)
        tabs = layout(self.problem, first, self.items, roots, seen)
        self.stream.send_blueprint(blueprint(tabs, "t"))

    def _write(self) -> None:
        import rerun as rr

        if not self.rows:
            return
        index, objective, infeasibility = (
            np.array(column) for column in zip(*self.rows, strict=True)
        )
        self.rows.clear()
        at = rr.TimeColumn("progress", sequence=index.astype(int))
        for name, values in (
            ("objective", objective),
            ("infeasibility", log10(np.minimum(infeasibility, _ASTRAY))),
        ):
            self.stream.send_columns(f"/progress/{name}", [at], rr.Scalars.columns(scalars=values))

    def _stage(self) -> None:
        import rerun as rr

        self.stream.set_time("progress", sequence=self.count)
        self.stream.log("/progress/stage", rr.StateChange(state=one_line(self.stage)))

    def _iterate(self, now: Solution) -> None:
        """Draw the path and the controls of an iterate."""
        seen = picture_of(self.problem, now)
        if not np.isfinite(seen.path).all():
            return
        self.stream.set_time("progress", sequence=self.count)
        if not self.paths:
            send(self.stream, Plane(path=RUNNING, scale=scale(seen)))
        self.paths.append((self.count, seen.path))
        self.stream.log(f"{RUNNING}/iterate", strips([seen.path.T]))
        lines = control_lines(self.problem, now)
        self.stream.log(f"{CONTROLS}/iterate", strips(lines))

    def _fit(self, seen: Picture) -> None:
        """Draw the iterates again, to the scale of what they led to, which nobody knew before."""
        if not self.paths:
            return
        send(self.stream, Plane(path=FITTED, scale=scale(seen)))
        for each in ground(seen, FITTED):
            send(self.stream, each)
        for count, path in self.paths:
            self.stream.set_time("progress", sequence=count)
            self.stream.log(f"{FITTED}/iterate", strips([path.T]))


def written(path: Path, name: str, page: Page) -> None:
    """Write a recording that is no solve's; SolveError says what is wrong with it."""
    import rerun as rr

    stream = _opened(f"{name}-branch", path, "")
    for each in page.items:
        send(stream, each, page.timeline)
    about = {"schema": SCHEMA, "problem": one_line(name), "timeline": one_line(page.timeline)}
    stream.send_property("socp", rr.AnyValues(**about))
    stream.send_recording_name(one_line(f"{name}: {page.timeline}"))
    stream.send_blueprint(blueprint(page.layout, one_line(page.timeline)))
    _closed(stream, path, "")


def _opened(name: str, path: Path | None, live: str) -> Any:
    """Open the file, the viewer at the address `live`, or both, for a layout of a name; what rerun
    raises comes through.
    """
    if os.environ.get("RERUN", "").lower() in {"off", "0", "false", "no"}:
        raise SolveError("not recorded: the environment variable RERUN turns rerun off")
    # what goes wrong is found out below and told in one line
    os.environ.setdefault("RUST_LOG", "off")
    rr = load("rerun", "record", "a recording")
    rr.set_strict_mode(True)
    called = file_stem(name)
    stream = rr.RecordingStream(f"socp-{called}", recording_id=f"{called}-{time.time_ns():x}")
    stream.set_log_time_enabled(False)
    if path is not None and live:
        stream.set_sinks(rr.FileSink(str(path)), rr.GrpcSink(live))
    elif path is not None:
        stream.save(str(path))
    else:
        stream.connect_grpc(live)
    return stream


def _closed(stream: Any, path: Path | None, live: str) -> None:
    """Close the file and make sure that it is whole; SolveError says what is wrong with it."""
    gone = bool(live) and not viewer.answers(urlsplit(live).port or viewer.PORT)
    sent = True
    try:
        stream.flush(timeout_sec=_GONE if gone else _WRITING)
    except RuntimeError:  # rerun's writer has given up, or the viewer is gone
        sent = False
    sent = _disconnected(stream, _ENDING if sent or gone else _GONE) and sent
    if path is not None and not ((sent or gone) and _complete(path)):
        raise SolveError(f"{path}: the recording is not whole; is the disk full?")
    if gone or not sent:
        kept = "" if path is None else f"; the recording in {path} is whole"
        raise SolveError(f"not shown to its end: the viewer is gone{kept}")


def _disconnected(stream: Any, patience: float) -> bool:
    """End a stream, waiting so many seconds at most, and tell whether it has ended.

    On a full disk it may never do, nor let the process end.
    """
    import rerun as rr

    ending = Thread(target=stream.disconnect, daemon=True)
    ending.start()
    ending.join(patience)
    if ending.is_alive():
        rr.unregister_shutdown()
    return not ending.is_alive()


def _complete(path: Path) -> bool:
    """Tell whether a file ends as rerun ends those that it closes in order."""
    if not path.is_file():
        return False
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - 64))
        return _FOOTER in file.read()

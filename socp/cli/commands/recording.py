"""`socp record`, `socp view`, and the options of other commands that record what they do."""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from socp.cli.commands.completing import files
from socp.cli.locking import locked
from socp.cli.opening import open_result, problem_missing
from socp.cli.session import Exit, Session, writable
from socp.errors import MethodError, ProblemError, SolveError
from socp.process import signals_held
from socp.registry import Registry

if TYPE_CHECKING:
    from socp.model import Problem, Progress, Watch
    from socp.registry import Guarded
    from socp.view import Page

Command = TypeVar("Command", bound=Callable[..., Any])
ENDING = ".rrd"
_MAGIC = b"RRF2"  # what recordings begin with


def record_option(command: Command) -> Command:
    """Add `--record` to a command."""
    return click.option(
        "--record", metavar="FILE", help="Record the solve for rerun's viewer, in a file .rrd."
    )(command)


def live_option(command: Command) -> Command:
    """Add `--live` to a command."""
    return click.option(
        "--live", is_flag=True, help="Show the solve in rerun's viewer while it runs."
    )(command)


@contextmanager
def recording(
    session: Session,
    registry: Registry,
    problem: "Problem",
    record: str | None,
    *,
    live: bool = False,
    runs: int = 1,
) -> "Iterator[Guarded]":
    """Yield a recorder for the file and the viewer that were asked for; one without either records
    nothing.

    What goes wrong with it becomes one warning. MethodError, before anything is solved, says why
    the file cannot be written, or that no plugin records or offers a viewer.
    """
    from socp.registry import Guarded

    path = record_place(record)
    address = _address(session, registry) if live else ""
    if path is None and not address:
        yield Guarded(None)
        return
    with locked(path):
        recorder = registry.recorder(problem, path, address, runs)
        try:
            yield recorder
        finally:
            with signals_held():
                whole = recorder.close()
            for line in recorder.complaints:
                session.warn(line)
        if whole and path is not None:
            session.note(f"recording in {path}; see it with: socp view {path}")


def record_place(record: str | None) -> Path | None:
    """Return where `--record` writes, None where it is not asked for; MethodError where nothing can
    be written.
    """
    return None if record is None else _place(Path(record), "--record")


def record_page(session: Session, registry: Registry, path: Path, name: str, page: "Page") -> None:
    """Write a recording that is no solve's; what goes wrong with it becomes a warning."""
    with locked(path):
        complaints = registry.record(path, name, page)
    for line in complaints:
        session.warn(line)
    if not complaints:
        session.note(f"recording in {path}; see it with: socp view {path}")


def recording_watch(watch: "Watch", recorder: "Guarded") -> "Watch":
    """Return a watch that tells a recorder of the progress as well; the recorder never stops a
    solve.
    """
    if recorder.recorder is None:
        return watch

    def see(now: "Progress", /) -> bool:
        """Record an iterate, then ask the watch whether to stop."""
        recorder(now)
        return watch(now)

    return see


@click.command()
@click.argument("result", metavar="RESULT", shell_complete=files)
@click.option(
    "-o", "--out", metavar="FILE", help="Recording.  [default: RESULT with the ending .rrd]"
)
@click.option(
    "--problem", metavar="FILE_OR_NAME", help="Its problem.  [default: that of the result]"
)
@click.pass_obj
def record(session: Session, /, result: str, out: str | None, problem: str | None) -> int:
    """Record a saved result: the file .rrd opens in rerun's viewer, with 'socp view'."""
    name = Path(result).name.removesuffix(".json").removesuffix(".socp")
    path = _place(Path(out or f"{name}{ENDING}"), "--out")
    _record(session, session.registry(), path, result, problem)
    session.tell(path)
    return Exit.SOLVED


@click.command()
@click.argument("source", metavar="FILE", shell_complete=files)
@click.option("--problem", metavar="FILE_OR_NAME", help="Problem of a result.  [default: its own]")
@click.pass_obj
def view(session: Session, /, source: str, problem: str | None) -> int:
    """Open a recording .rrd, or a saved result, in rerun's native viewer, which listens on this
    computer alone.
    """
    path = Path(source)
    if not path.is_file():
        raise SolveError(f"{path}: there is no such file")
    recorded = _is_recording(path)
    if path.suffix == ENDING and not recorded:
        raise SolveError(f"{path}: is no recording: it does not begin as one")
    registry = session.registry()
    viewer = registry.viewer()
    if recorded:
        viewer.show(path)
        return Exit.SOLVED
    with tempfile.TemporaryDirectory(prefix="socp-") as folder:
        made = Path(folder) / f"{path.name.removesuffix('.json').removesuffix('.socp')}{ENDING}"
        _record(session, registry, made, source, problem)
        viewer.show(made)
    return Exit.SOLVED


def _record(
    session: Session, registry: Registry, path: Path, result: str, given: str | None
) -> None:
    """Record a saved result; SolveError says why it cannot be, ProblemError that its problem is not
    known.
    """
    solution, problem = open_result(session, result, given, registry)
    if problem is None:
        raise ProblemError(f"{result}: {problem_missing(solution)}")
    with locked(path):
        recorder = registry.recorder(problem, path)
        recorder.finish(problem, solution)
        recorder.close()
    if recorder.complaints:
        raise SolveError(recorder.complaints[0])


def _place(path: Path, option: str) -> Path:
    """Return a path for a recording; MethodError where none can be, or where a result or the like
    may stand.
    """
    if path.suffix not in {"", ENDING}:
        raise MethodError(
            f"{option} {path}: it ends with '{path.suffix}'; recordings end with {ENDING}"
        )
    return writable(path, option, replaced=False)


def _is_recording(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(_MAGIC)) == _MAGIC


def _address(session: Session, registry: Registry) -> str:
    """Return the address of a viewer, empty where it cannot be had: the solve goes on unseen."""
    try:
        return registry.viewer().ready()
    except SolveError as error:
        session.warn(f"--live: {error}")
        return ""

"""Recordings of solves as rerun files (.rrd), and rerun's own viewer, which shows them."""

from pathlib import Path
from typing import TYPE_CHECKING

from socp import Problem, hookimpl
from socp.registry import Viewer

if TYPE_CHECKING:
    from socp.view import Page

    from .recorder import Recorder


@hookimpl
def socp_recorder(problem: Problem, path: Path | None, live: str, runs: int) -> "Recorder":
    """Return a recorder of one solve, or of several runs side by side."""
    from .recorder import Recorder

    return Recorder.open(problem, path, live, several=runs > 1)


@hookimpl
def socp_page(path: Path, name: str, page: "Page") -> bool:
    """Write the recording of a branch."""
    from .recorder import written

    written(path, name, page)
    return True


@hookimpl
def socp_viewer() -> Viewer:
    """Return rerun's native viewer: a module that starts it, shows in it, and waits for it."""
    from . import viewer

    return viewer

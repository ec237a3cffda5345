"""What a plugin may provide; pluggy calls these by name.

Problems need no hook: they are entries of the group `socp.problems`, so that they can be listed
without being imported.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import pluggy

if TYPE_CHECKING:
    from pathlib import Path

    from socp.methods import Method
    from socp.model import Problem, Solution
    from socp.registry.recorder import Recorder
    from socp.registry.viewer import Viewer

hookspec = pluggy.HookspecMarker("socp")
hookimpl = pluggy.HookimplMarker("socp")


@hookspec
def socp_methods() -> "Iterable[type[Method]]":  # type: ignore[empty-body]
    """Return the methods that a plugin adds."""


@hookspec
def socp_solved(problem: "Problem", solution: "Solution") -> None:
    """Look at a finished solve: a recorder or a writer. What it raises is reported and fails
    nothing.
    """


@hookspec
def socp_recorder(
    problem: "Problem", path: "Path | None", live: str, runs: int
) -> "Recorder | None":
    """Return a recorder of one solve of a problem, or of several `runs` to be compared.

    It writes to the file `path`, to the viewer at the address `live`, or to both; None and "" mean
    neither. The first plugin that returns one is asked. What it raises, then or later, is reported,
    ends the recording and fails nothing.
    """


@hookspec(firstresult=True)
def socp_page(path: "Path", name: str, page: Any) -> "bool | None":
    """Write a recording that is no solve's, as that of a branch, to a file: `page`, a
    `socp.view.Page`, of what is called `name`; returns true where it did.

    What it raises is reported and fails nothing.
    """


@hookspec(firstresult=True)
def socp_viewer() -> "Viewer | None":
    """Return a viewer of recordings, for `socp view` and `--live`.

    The first plugin that returns one is asked. What it raises is reported: `socp view` ends there,
    a solve goes on unseen.
    """

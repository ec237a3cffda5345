"""What a plugin may provide; pluggy calls these by name.

Problems need no hook: they are entries of the group `socp.problems`, so that they can be listed without being imported.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import pluggy

if TYPE_CHECKING:
    from socp.method import Method
    from socp.problem import Problem
    from socp.solution import Solution

hookspec = pluggy.HookspecMarker("socp")
hookimpl = pluggy.HookimplMarker("socp")


@hookspec
def socp_methods() -> "Iterable[type[Method]]":  # type: ignore[empty-body]
    """Return the methods that a plugin adds."""


@hookspec
def socp_solved(problem: "Problem", solution: "Solution") -> None:
    """Look at a finished solve: a recorder or a writer. What it raises is reported and fails nothing."""

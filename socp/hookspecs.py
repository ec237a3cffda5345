"""What a plugin may provide; pluggy calls these by name."""

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
def socp_problems() -> "Iterable[Problem]":  # type: ignore[empty-body]
    """Return problems that a plugin adds beside those of the entry-point group `socp.problems`."""


@hookspec
def socp_solved(problem: "Problem", solution: "Solution") -> None:
    """Look at a finished solve: a recorder or a writer. What it raises is reported and fails nothing."""

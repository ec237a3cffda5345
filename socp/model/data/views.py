"""Who shows problems, solutions and verdicts: functions that installed packages register, looked up
by name.

Records hold values and know nothing of pictures. What shows them is an entry point of the group
`socp.views`: `figure`, `html` and `dataset` are socp's own, and another package may register one of
its own under the same name.
"""

from collections.abc import Callable
from functools import cache
from importlib import metadata
from typing import Any

from socp.errors import MethodError

GROUP = "socp.views"


@cache
def view(name: str) -> Callable[..., Any]:
    """Return the function that is registered under a name; one that is not socp's own goes first.

    Raises MethodError where there is none.
    """
    points = sorted(metadata.entry_points(group=GROUP, name=name), key=_own)
    if not points:
        raise MethodError(
            f"no view '{name}' is registered under the entry points '{GROUP}'; install socp again"
        )
    shown: Callable[..., Any] = points[0].load()
    return shown


def _own(point: metadata.EntryPoint) -> bool:
    return point.value.startswith("socp.")

"""The schemes that `socp.transcription.schemes` makes, found there: a new one is tested as well."""

import inspect
from collections.abc import Callable

from socp.transcription import schemes
from socp.transcription.schemes import Scheme

_MAKERS = [
    make
    for make in vars(schemes).values()
    if callable(make) and inspect.get_annotations(make).get("return") is Scheme
]
# those of one interval, and those of any number of points
FIXED: list[Callable[[], Scheme]] = [
    make for make in _MAKERS if not inspect.signature(make).parameters
]
FAMILIES: list[Callable[[int], Scheme]] = [
    make for make in _MAKERS if list(inspect.signature(make).parameters) == ["points"]
]


def every(points: list[int]) -> list[Scheme]:
    """Return every scheme, families with each of these numbers of points."""
    return [make() for make in FIXED] + [make(n) for make in FAMILIES for n in points]

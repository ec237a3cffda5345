"""The time that a piece of work may take: said once, where it begins, and kept by every solve that
it calls.
"""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from socp.errors import LateError

_UNTIL: ContextVar[float] = ContextVar("until", default=float("inf"))


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """Allow what runs inside so many seconds, and never more than what is allowed around it."""
    token = _UNTIL.set(min(_UNTIL.get(), time.monotonic() + seconds))
    try:
        yield
    finally:
        _UNTIL.reset(token)


@contextmanager
def overtime(seconds: float) -> Iterator[None]:
    """Allow what runs inside so many seconds even where fewer are left: it is what a result cannot
    do without.
    """
    token = _UNTIL.set(max(_UNTIL.get(), time.monotonic() + seconds))
    try:
        yield
    finally:
        _UNTIL.reset(token)


def seconds_left() -> float:
    """Return the seconds that are left, at least 0; infinite where no time is set."""
    return max(_UNTIL.get() - time.monotonic(), 0.0)


def in_time(what: str, needed: float = 0.0) -> None:
    """Raise LateError, naming what was asked for, where no more than the seconds needed are left
    for it.
    """
    if seconds_left() <= needed:
        raise LateError(f"{what}: the time for it is over")

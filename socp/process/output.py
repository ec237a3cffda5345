"""Solvers kept off the caller's output: some print to descriptor 1 whatever their options say."""

import contextlib
import ctypes
import os
import sys
import threading
from collections.abc import Iterator
from functools import cache
from typing import Any

_OUT = 1  # the descriptor of standard output
_LOCK = threading.Lock()
_INSIDE: list[
    int | None
] = []  # for every body under way: the first holds the descriptor kept, None for a closed one


@contextlib.contextmanager
def output_discarded() -> Iterator[None]:
    """Discard what the body prints to descriptor 1; what Python's `sys.stdout` holds is not lost.

    A descriptor belongs to the whole process: of several threads the first one in turns it away and
    the last one out brings it back. A descriptor 1 that is closed is closed again afterwards.
    """
    with _LOCK:
        _INSIDE.append(_turned() if not _INSIDE else None)
    try:
        yield
    finally:
        with _LOCK:
            kept = _INSIDE.pop() if len(_INSIDE) == 1 else _INSIDE.pop(1)
            if not _INSIDE:
                restore(kept)


def _turned() -> int | None:
    """Turn descriptor 1 to the null device; returns a copy of what it was, None where it was
    closed.
    """
    flush_own()
    flush_library()
    try:
        kept = os.dup(_OUT)
    except OSError:
        kept = None
    null = os.open(os.devnull, os.O_WRONLY)
    if (
        null != _OUT
    ):  # the lowest that is free: where 1 was closed, and 0 is open, it is there already
        os.dup2(null, _OUT)
        os.close(null)
    return kept


def restore(kept: int | None) -> None:
    """Bring descriptor 1 back, after what the C library still holds for it has gone where it was
    meant to go.
    """
    flush_library()
    if kept is None:
        os.close(_OUT)
    else:
        os.dup2(kept, _OUT)
        os.close(kept)


def flush_own() -> None:
    """Flush `sys.stdout` where it writes to descriptor 1; one that is replaced, closed or broken is
    left as it is.
    """
    with contextlib.suppress(OSError, ValueError, AttributeError):
        if sys.stdout.fileno() == _OUT:
            sys.stdout.flush()


def flush_library() -> None:
    """Flush the C library's own standard output; all of its streams at once could wait for one that
    is being read.
    """
    library = _library()
    with contextlib.suppress(OSError, ValueError, AttributeError):
        if library is not None:
            name = "__stdoutp" if sys.platform == "darwin" else "stdout"
            library.fflush(ctypes.c_void_p.in_dll(library, name))


@cache
def _library() -> Any:
    try:
        return ctypes.CDLL(None)
    except (OSError, TypeError):  # there is none under that name on Windows
        return None

"""Descriptor 1, to which solvers and the C library print past Python: flushed, and brought back."""

import contextlib
import ctypes
import os
import sys
from functools import cache
from typing import Any

_OUT = 1  # the descriptor of standard output


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

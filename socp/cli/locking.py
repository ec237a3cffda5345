"""One writer a file: whoever writes a file for a while holds it, so that a second one is told and
destroys nothing.
"""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from socp.errors import MethodError

_HELD = (errno.EWOULDBLOCK, errno.EACCES)  # what a lock that somebody else has is refused with


@contextmanager
def locked(path: Path | None) -> Iterator[None]:
    """Hold a file that is written in the body; MethodError where another process, or another
    command here, has it.

    A file made by this is removed again where nothing was written to it. Where a file system knows
    no locks, the body goes on without one.
    """
    if path is None:
        yield
        return
    made = not path.exists()
    handle = None
    with suppress(OSError):  # whoever writes the file says what is wrong with it
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o644)
    try:
        if handle is not None:
            _lock(handle, path)
        yield
    finally:
        if handle is not None:
            os.close(handle)
            with suppress(OSError):
                if made and path.stat().st_size == 0:
                    path.unlink()


def _lock(handle: int, path: Path) -> None:
    try:
        import fcntl
    except ImportError:  # no such locks here
        return
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in _HELD:
            raise MethodError(
                f"{path}: another command is recording into this file; name another one"
            ) from error

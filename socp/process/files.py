"""Files read whole and written whole: regular ones alone, and none that is larger than its kind can
be.
"""

import os
import secrets
import stat
from pathlib import Path

from socp.errors import SolveError

# the largest results, with long traces and many meshes, have some ten megabytes
LARGEST = 256 * 2**20


def read_text(path: str | Path, largest: int = LARGEST) -> str:
    """Return a file's text; SolveError names the path where it is no regular file, too large, or no
    UTF-8.

    A pipe or a device is refused before anything is read: it may have no end.
    """
    try:
        # without O_NONBLOCK to open a pipe waits for whoever writes to it
        handle = os.open(
            path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
        )
        try:
            _check(path, os.fstat(handle), largest)
            with os.fdopen(handle, "rb", closefd=False) as file:
                content = file.read(largest + 1)
        finally:
            os.close(handle)
    except (OSError, ValueError) as error:  # a path with a null character is a ValueError
        reason = error.strerror if isinstance(error, OSError) else None
        raise SolveError(f"{path}: {reason or error}") from error
    if len(content) > largest:
        raise SolveError(f"{path}: is longer than {largest} bytes, which no result is")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError as error:
        raise SolveError(f"{path}: not a socp result: byte {error.start} is not UTF-8") from error


def write_atomic(path: Path, content: str | bytes) -> None:
    """Write text or bytes to a file beside `path`, then rename it; SolveError names the path where
    that fails.

    A new file has the permissions that the umask leaves; one that is replaced keeps its own.
    """
    temporary = path.parent / f".socp-{secrets.token_hex(8)}.part"
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise SolveError(f"{path}: is no regular file, which alone can be replaced")
        handle = os.open(
            temporary, os.O_WRONLY | os.O_CREAT | os.O_EXCL | getattr(os, "O_BINARY", 0), 0o666
        )
    except OSError as error:
        raise SolveError(f"{path}: cannot be written: {error.strerror or error}") from error
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())  # a rename may reach the disk before the content does
        if path.exists():
            temporary.chmod(stat.S_IMODE(path.stat().st_mode))
        temporary.replace(path)
    except OSError as error:
        raise SolveError(f"{path}: cannot be written: {error.strerror or error}") from error
    finally:
        temporary.unlink(missing_ok=True)


def _check(path: str | Path, about: os.stat_result, largest: int) -> None:
    if stat.S_ISDIR(about.st_mode):
        raise SolveError(f"{path}: Is a directory; name a result file in it")
    if not stat.S_ISREG(about.st_mode):
        raise SolveError(
            f"{path}: is no regular file but a pipe or a device; save what it gives in a file first"
        )
    if about.st_size > largest:
        raise SolveError(f"{path}: has {about.st_size} bytes; a result has at most {largest}")

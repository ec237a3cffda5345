"""Run a problem file as Python runs a script, and leave the command as it stood, whatever the file
did.
"""

import contextlib
import os
import stat
import sys
import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import decode_source
from pathlib import Path
from types import CodeType, ModuleType

from socp.errors import ProblemError
from socp.registry.entries import reason, suggest

_LARGEST = 50_000_000  # bytes of a problem file; what is longer was not written by anybody
_started: list[threading.Thread] = []  # by problem files, and not ended by them


def code_of(path: Path) -> CodeType:
    """Return the code of a problem file; ProblemError says why it cannot be read, or is no
    Python.
    """
    try:
        status = path.stat()
        if stat.S_ISDIR(status.st_mode):
            raise ProblemError(f"{path} is a directory; give a problem file inside it")
        if not stat.S_ISREG(status.st_mode):
            raise ProblemError(f"{path} is no file but a device or a pipe; give a problem file")
        if status.st_size > _LARGEST:
            raise ProblemError(
                f"{path}: has {status.st_size} bytes; a problem file has at most {_LARGEST}"
            )
        source = decode_source(path.read_bytes())
    except (OSError, ValueError) as error:
        if isinstance(error, UnicodeDecodeError):
            raise ProblemError(
                f"{path}: not a Python file: {reason(error)}; save it as UTF-8"
            ) from error
        text = error.strerror or error if isinstance(error, OSError) else reason(error)
        raise ProblemError(f"{path}: {text}{_neighbours(path)}") from error
    except SyntaxError as error:
        raise ProblemError(f"{path}: not a Python file: {reason(error)}") from error
    return compile(source, str(path), "exec", dont_inherit=True)


def execute(code: CodeType, module: ModuleType, folder: Path) -> None:
    """Run the code of a file in a module; it raises whatever the file raises."""
    before = set(threading.enumerate())
    try:
        with _as_script(module, folder), _unchanged(), _streams():
            exec(code, vars(module))  # noqa: S102 - a problem file is a program of the user's
    finally:
        _started.extend(
            each for each in threading.enumerate() if each not in before and not each.daemon
        )


def threads() -> list[threading.Thread]:
    """Return the threads of problem files that still run and would keep the command from ending."""
    return [each for each in _started if each.is_alive()]


@contextmanager
def _as_script(module: ModuleType, folder: Path) -> Iterator[None]:
    """Let a file import its neighbours, and dataclasses in it find their module, as when Python
    runs it.
    """
    path = [*sys.path]
    sys.modules[module.__name__] = module
    sys.path.append(str(folder.resolve()))  # last: a neighbour such as json.py hides no package
    try:
        yield
    finally:
        sys.path[:] = path
        sys.modules.pop(module.__name__, None)


@contextmanager
def _unchanged() -> Iterator[None]:
    """Put back the directory, the warnings and the limits of this process: the file's were for
    itself.
    """
    import numpy as np

    here, depth = _directory(), sys.getrecursionlimit()
    with warnings.catch_warnings(), np.errstate():
        try:
            yield
        finally:
            sys.setrecursionlimit(depth)
            if here is not None:
                with contextlib.suppress(OSError):  # it may have been removed
                    os.chdir(here)


def _directory() -> str | None:
    try:
        return os.getcwd()  # noqa: PTH109 - the text that chdir takes
    except OSError:
        return None


@contextmanager
def _streams() -> Iterator[None]:
    """Send what the file prints to stderr, where messages go; streams that it closes or replaces
    are put back.
    """
    streams = {name: getattr(sys, name) for name in ("stdin", "stdout", "stderr")}
    kept = [(number, _duplicate(number)) for number in range(3)]
    _flush()
    out = _Borrowed(streams["stderr"])
    sys.stdout, sys.stderr = out, out  # as much of a stream as a script needs
    try:
        yield
    finally:
        for name, stream in streams.items():
            setattr(sys, name, stream)
        for number, copy in kept:
            if copy is not None:
                os.dup2(copy, number)
                os.close(copy)
        _flush()


def _duplicate(number: int) -> int | None:
    try:
        return os.dup(number)
    except OSError:  # closed by whoever started the command
        return None


def _flush() -> None:
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):  # closed, or none at all
            stream.flush()


class _Borrowed:
    """A stream on loan: it can be written, but closing it closes nothing."""

    def __init__(self, stream: object) -> None:
        self._stream = stream

    def __getattr__(self, name: str) -> object:
        return getattr(self._stream, name)

    def close(self) -> None:
        """Close nothing."""

    def detach(self) -> None:
        """Detach nothing."""


def _neighbours(path: Path) -> str:
    """Suggest the problem files beside a path that does not exist."""
    try:
        there = (
            sorted(each.name for each in path.parent.glob("*.py")) if path.parent.is_dir() else []
        )
    except (OSError, ValueError):
        return ""
    return suggest(path.name, there).replace("there", f"in {path.parent} there") if there else ""

"""Processes of their own, for work that may have to be ended at any time."""

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

_PARENT_ENDS = 1  # PR_SET_PDEATHSIG


@contextlib.contextmanager
def ended_after(
    command: Sequence[str], folder: Path | None = None, **streams: Any
) -> Iterator["subprocess.Popen[bytes]"]:
    """Start a process in a group of its own, in a folder, which is ended with the body; `streams`
    are those of `subprocess.Popen`.
    """
    process = subprocess.Popen(  # noqa: S603 - this Python with a module of this package
        command,
        start_new_session=True,
        cwd=folder,
        env=_environment(),
        **{"stdin": subprocess.DEVNULL, **streams},
    )
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _environment() -> dict[str, str]:
    """Return the environment for a process in any folder: with Python's search path as it is from
    here.
    """
    places = filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))
    absolute = os.pathsep.join(str(Path(place).absolute()) for place in places)
    return {**os.environ, **({"PYTHONPATH": absolute} if absolute else {})}


def end_with(parent: int) -> None:
    """Have this process ended with its parent, however that ends; elsewhere than on Linux others
    have to see to it.
    """
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PARENT_ENDS, signal.SIGKILL)
    if os.getppid() != parent:  # it has ended already
        sys.exit()

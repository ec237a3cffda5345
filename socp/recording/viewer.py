"""Rerun's native viewer: found, started and bound to this computer alone."""

import os
import shutil
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from socp.errors import SolveError

HOST, PORT = "127.0.0.1", 9876  # rerun's own port
PATIENCE = 20.0  # seconds for a viewer to open


def executable() -> str:
    """Return the path of the viewer beside this Python or on PATH; SolveError where there is none."""
    beside = Path(sys.executable).with_name("rerun")
    found = str(beside) if beside.exists() else shutil.which("rerun")
    if found is None:
        raise SolveError("there is no viewer 'rerun' beside this Python or on PATH; pip install rerun-sdk")
    return found


def show(path: Path) -> None:
    """Open a recording in the viewer and wait until it is closed; SolveError says why it did not open."""
    command = [executable(), "--bind", HOST, "--port", "0", str(path)]
    ended = subprocess.run(command, env=_silent(), check=False, capture_output=True, text=True)  # noqa: S603 - ours
    if ended.returncode != 0:
        raise SolveError(f"{path}: the viewer {_reason(ended.returncode, ended.stderr)}")


def ready(port: int = PORT, patience: float = PATIENCE) -> str:
    """Return the address of a viewer on this computer, started unless one listens there already.

    SolveError says why none could be started.
    """
    if not _listens(port):
        _start([executable(), "--bind", HOST, "--port", str(port)], port, patience)
    return f"rerun+http://{HOST}:{port}/proxy"


def _start(command: list[str], port: int, patience: float) -> None:
    with tempfile.TemporaryFile("w+") as said:  # a pipe would break under a viewer that outlives this process
        viewer = subprocess.Popen(  # noqa: S603 - ours
            command, env=_silent(), stdout=subprocess.DEVNULL, stderr=said, text=True, start_new_session=True
        )
        last = time.monotonic() + patience
        while not _listens(port):
            if viewer.poll() is not None:
                said.seek(0)
                raise SolveError(f"the viewer {_reason(viewer.returncode, said.read())}")
            if time.monotonic() > last:
                viewer.terminate()
                raise SolveError(f"the viewer did not open within {patience:g} seconds")
            time.sleep(0.05)


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        probe.settimeout(0.5)
        return probe.connect_ex((HOST, port)) == 0


def _silent() -> dict[str, str]:
    """Return the environment in which the viewer sends no statistics of its use and writes no settings for them."""
    return {**os.environ, "CI": "1"}


def _reason(code: int, said: str) -> str:
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    telling = [line for line in lines if "error" in line.lower()] or lines
    return f"ended with code {code}" + (f": {telling[-1]}" if telling else "")

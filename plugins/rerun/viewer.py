"""Rerun's native viewer: found, started and bound to this computer alone."""

import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from socp.errors import SolveError

HOST, PORT = "127.0.0.1", 9876  # rerun's own port
PATIENCE = 20.0  # seconds for a viewer to open
# Seconds after which a viewer without a window is gone: its port opens before its window does
_STAYS = 0.7
_GREETING = (
    b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + b"\x00\x00\x00\x04\x00\x00\x00\x00\x00"
)  # and empty settings
_SETTINGS = 4  # the kind of frame that answers it


def executable() -> str:
    """Return the path of the viewer beside this Python or on PATH; SolveError where there is
    none.
    """
    beside = Path(sys.executable).with_name("rerun")
    found = str(beside) if beside.exists() else shutil.which("rerun")
    if found is None:
        raise SolveError(
            "there is no viewer 'rerun' beside this Python or on PATH; pip install 'socp[record]'"
        )
    return found


def show(path: Path) -> None:
    """Open a recording in the viewer and wait until it is closed; SolveError says why it did not
    open.
    """
    command = [executable(), "--bind", HOST, "--port", "0", str(path)]
    _needs_display()
    # ours
    ended = subprocess.run(  # noqa: S603
        command, env=_silent(), check=False, capture_output=True, text=True
    )
    if ended.returncode != 0:
        raise SolveError(f"{path}: the viewer {_reason(ended.returncode, ended.stderr)}")


def ready(port: int = PORT, patience: float = PATIENCE) -> str:
    """Return the address of a viewer on this computer, started unless one listens there already.

    SolveError says why none could be started.
    """
    if not _listens(port):
        command = [executable(), "--bind", HOST, "--port", str(port)]
        _needs_display()
        _start(command, port, patience)
    elif not answers(port):
        raise SolveError(f"port {port} of this computer is taken by a program that is no viewer")
    return f"rerun+http://{HOST}:{port}/proxy"


def answers(port: int = PORT, patience: float = 3.0) -> bool:
    """Tell whether a viewer, or at least a program that speaks HTTP/2 as viewers do, answers at a
    port.
    """
    try:
        with socket.create_connection((HOST, port), timeout=patience) as probe:
            probe.sendall(_GREETING)
            return probe.recv(9)[3:4] == bytes([_SETTINGS])
    except OSError:
        return False


def _start(command: list[str], port: int, patience: float) -> None:
    with tempfile.TemporaryFile(
        "w+"
    ) as said:  # a pipe would break under a viewer that outlives this process
        viewer = subprocess.Popen(  # noqa: S603 - ours
            command,
            env=_silent(),
            stdout=subprocess.DEVNULL,
            stderr=said,
            text=True,
            start_new_session=True,
        )
        last, since = time.monotonic() + patience, None
        while since is None or time.monotonic() < since + _STAYS:
            if viewer.poll() is not None:
                said.seek(0)
                raise SolveError(f"the viewer {_reason(viewer.returncode, said.read())}")
            if since is None and _listens(port):
                since = time.monotonic()
            if since is None and time.monotonic() > last:
                _end(viewer)
                raise SolveError(f"the viewer did not open within {patience:g} seconds")
            time.sleep(0.05)


def _end(viewer: "subprocess.Popen[str]") -> None:
    """End a viewer with all that it started: its command may be a script that starts it."""
    if sys.platform == "win32":
        viewer.terminate()
    else:
        os.killpg(viewer.pid, signal.SIGTERM)


def _needs_display() -> None:
    """Raise SolveError where a window cannot be: on Linux and the like, what shows windows is named
    by a variable.
    """
    names = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
    if sys.platform.startswith("linux") and not any(os.environ.get(name) for name in names):
        raise SolveError(
            "there is no display for the viewer: neither DISPLAY nor WAYLAND_DISPLAY is set; "
            "without one: socp report RESULT writes a page for any browser"
        )


def _listens(port: int) -> bool:
    with socket.socket() as probe:
        probe.settimeout(0.5)
        return probe.connect_ex((HOST, port)) == 0


def _silent() -> dict[str, str]:
    """Return the environment in which the viewer sends no statistics of its use and writes no
    settings for them.
    """
    return {**os.environ, "CI": "1"}


def _reason(code: int, said: str) -> str:
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    telling = [line for line in lines if "error" in line.lower()] or lines
    shown = (
        re.sub(r"os error at \S+: ", "", telling[-1]) if telling else ""
    )  # without a place in the viewer's source
    return f"ended with code {code}" + (f": {shown}" if shown else "")

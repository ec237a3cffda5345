"""The command line: a thin door to the library."""

import atexit
import contextlib
import os
import sys
from collections.abc import Sequence

from socp.cli.streams import parted

_USUAL = 2  # the number of SIGINT, where a KeyboardInterrupt came without a signal


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code; what it needs is imported here, so that Ctrl-C
    is caught early.

    Without arguments it is the process's own command: standard output stays apart until the process
    has ended.
    """
    # the matrices here are small: threads of the linear algebra cost more than they bring, the more
    # so side by side
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault(
        "PYTHONSAFEPATH", "1"
    )  # processes started here import nothing from the current folder
    from socp.process import heard, listening

    with parted(for_good=arguments is None), listening(to_the_end=arguments is None):
        try:
            from socp.cli.app import run

            code = run(arguments)
        except KeyboardInterrupt:
            sys.stderr.write("interrupted\n")
            code = 128 + (heard() or _USUAL)
    if arguments is None:
        _end(code)
    return code


def _end(code: int) -> None:
    """End the process at once where threads of a problem file would keep it: what they do is not
    the command's.
    """
    executing = sys.modules.get("socp.registry.executing")
    if executing is None or not executing.threads():
        return
    # files that are open get flushed; there is no public way
    atexit._run_exitfuncs()  # noqa: SLF001
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            stream.flush()
    os._exit(code)

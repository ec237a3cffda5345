"""The command line: a thin door to the library."""

import os
import sys
from collections.abc import Sequence

_USUAL = 2  # the number of SIGINT, where a KeyboardInterrupt came without a signal


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code; what it needs is imported here, so that Ctrl-C is caught early."""
    # the matrices here are small: threads of the linear algebra cost more than they bring, the more so side by side
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("PYTHONSAFEPATH", "1")  # processes started here import nothing from the current folder
    from socp import interruption

    with interruption.listening(to_the_end=arguments is None):
        try:
            from socp.cli.app import run

            return run(arguments)
        except KeyboardInterrupt:
            sys.stderr.write("interrupted\n")
            return 128 + (interruption.heard() or _USUAL)

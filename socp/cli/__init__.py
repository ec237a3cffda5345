"""The command line: a thin door to the library."""

import os
import sys
from collections.abc import Sequence

from socp.cli.streams import parted


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code; what it needs is imported here, so that Ctrl-C is caught early.

    Without arguments it is the process's own command: standard output stays apart until the process has ended.
    """
    # the matrices here are small: threads of the linear algebra cost more than they bring, the more so side by side
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    with parted(for_good=arguments is None):
        try:
            from socp.cli.app import run

            return run(arguments)
        except KeyboardInterrupt:
            sys.stderr.write("interrupted\n")
            return 130

"""`python -m socp.cli` is the command `socp`."""

import sys

from socp.cli import main

if (
    not sys.flags.safe_path
):  # the current folder is first, where a file such as json.py would hide Python's own
    sys.path.append(sys.path.pop(0))


sys.exit(main())

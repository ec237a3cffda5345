"""`python -m socp.cli` is the command `socp`."""

import sys

from socp.cli import main

sys.exit(main())

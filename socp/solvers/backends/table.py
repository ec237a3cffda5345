"""The backends by name: another one is a file of its own and a row here."""

from collections.abc import Mapping
from typing import Any

from socp.solvers.backends.ipopt import Ipopt
from socp.solvers.backends.uno import Uno
from socp.solvers.contract import Backend

_ROWS: tuple[Any, ...] = (Ipopt, Uno)
BACKENDS: Mapping[str, Any] = {each.name: each for each in _ROWS}


def default_backend() -> Backend:
    """Return the backend of whoever is given none: the first of the table."""
    found: Backend = _ROWS[0]()
    return found

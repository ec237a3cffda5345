"""Optional packages: imported late, and what to install where one is missing."""

import os
import sys
from contextlib import suppress
from importlib import import_module
from typing import Any

from socp.errors import MethodError


def load(module: str, extra: str, what: str) -> Any:
    """Return an optional module; MethodError says which extra of socp brings the package that `what` needs."""
    try:
        return _matplotlib() if module == "matplotlib" else import_module(module)
    except ModuleNotFoundError as error:
        package = (error.name or module).partition(".")[0]
        text = f"{what} needs the package {package}, which is not installed; pip install 'socp[{extra}]'"
        raise MethodError(text) from error


def _matplotlib() -> Any:
    """Import matplotlib, which breaks off where MPLBACKEND names no backend; figures are drawn without one."""
    backend = None if "matplotlib" in sys.modules else os.environ.pop("MPLBACKEND", None)
    try:
        found = import_module("matplotlib")
    finally:
        if backend is not None:
            os.environ["MPLBACKEND"] = backend
    if backend:
        with suppress(ValueError):
            found.rcParams["backend"] = backend  # as it does itself
    return found

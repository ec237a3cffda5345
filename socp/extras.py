"""Optional packages: imported late, and what to install where one is missing."""

from importlib import import_module
from typing import Any

from socp.errors import MethodError


def load(module: str, extra: str, what: str) -> Any:
    """Return an optional module; MethodError says which extra of socp brings the package that `what` needs."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        package = (error.name or module).partition(".")[0]
        text = f"{what} needs the package {package}, which is not installed; pip install 'socp[{extra}]'"
        raise MethodError(text) from error

"""The errors that socp raises on purpose; anything else is a bug."""

import os
import sys
from contextlib import suppress
from importlib import import_module
from typing import Any


class SocpError(Exception):
    """Base of every error that socp raises on purpose; its text is written for the user."""


class ProblemError(SocpError):
    """A problem is not well posed as written, or could not be loaded."""


class MethodError(SocpError):
    """A method, an option or a plugin was asked for something it does not offer."""


class LateError(MethodError):
    """The time allowed was over before it was known whether something can be had."""


class SolveError(SocpError):
    """A solve could not be carried out, or a result could not be read or judged."""


class ContractError(SocpError):
    """A method broke the contract of methods: it raised, returned or told what none may; the text
    names it.
    """


class KeepingError(SocpError):
    """The machine gave out: a disk or the memory. The text says what is kept, and where."""


def load(module: str, extra: str, what: str) -> Any:
    """Return an optional module; MethodError says which extra of socp brings the package that
    `what` needs.
    """
    try:
        return _matplotlib() if module == "matplotlib" else import_module(module)
    except ModuleNotFoundError as error:
        package = (error.name or module).partition(".")[0]
        text = (
            f"{what} needs the package {package}, which is not installed; pip install "
            f"'socp[{extra}]'"
        )
        raise MethodError(text) from error


def _matplotlib() -> Any:
    """Import matplotlib, which breaks off where MPLBACKEND names no backend; figures are drawn
    without one.
    """
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

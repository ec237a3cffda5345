"""Entry points of installed packages as records, and what is said about the ones that are
broken.
"""

import ast
import difflib
import inspect
import re
import traceback
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, is_dataclass
from functools import cache
from importlib import metadata, util
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, final

import pluggy

from socp.errors import SocpError
from socp.process import first_paragraph, said, short

if TYPE_CHECKING:
    from socp.methods import Method

PLUGINS = "socp.plugins"  # each entry a module of hook implementations
PROBLEMS = "socp.problems"  # each entry `module:attribute`

Status = Literal["loaded", "partly", "failed", "off"]


@final
@dataclass(frozen=True, kw_only=True)
class Plugin:
    """An entry of the group `socp.plugins` and what became of it.

    `target` is the module; `package` the distribution with its version. `reason` says why it is
    failed, off, or loaded only in part; `methods` and `hooks` are what it adds; `error` is what was
    raised.
    """

    name: str
    target: str
    package: str
    status: Status = "loaded"
    reason: str = ""
    methods: tuple[str, ...] = ()
    hooks: tuple[str, ...] = ()
    error: BaseException | None = field(default=None, repr=False, compare=False)

    @property
    def who(self) -> str:
        """The plugin and its package, as the subject of a complaint."""
        return f"plugin '{self.name}' ({self.package})"


@final
@dataclass(frozen=True, kw_only=True)
class Entry:
    """A registered problem, known by its packaging alone; `reason` says why it is refused, where it
    is.
    """

    name: str
    target: str
    package: str
    reason: str = ""

    @property
    def about(self) -> str:
        """First paragraph of the module's docstring, read without importing it."""
        try:
            source = Path(origin(self.target)).read_text(encoding="utf-8")
            return first_paragraph(ast.get_docstring(ast.parse(source)))
        except (OSError, ValueError, SyntaxError):
            return ""


def points(group: str) -> list[metadata.EntryPoint]:
    """Return the entry points of a group, socp's own first, in an order that does not depend on the
    search path.
    """

    def rank(point: metadata.EntryPoint) -> tuple[bool, str, str]:
        """Order our own entries first, then by distribution and name."""
        distribution = _told(point.dist)[0].lower() if point.dist else ""
        return distribution != "socp", distribution, point.name

    return sorted(metadata.entry_points(group=group), key=rank)


def package(point: metadata.EntryPoint) -> str:
    """Return the distribution of an entry point with its version."""
    return " ".join(_told(point.dist)) if point.dist else "unknown"


@cache
def _told(distribution: metadata.Distribution) -> tuple[str, str]:
    """Return the name of a distribution and its version: both take reading all that it says."""
    told = distribution.metadata
    return told["Name"], told["Version"]


def origin(target: str) -> str:
    """Return the source file of an entry point's module, empty where it cannot be told."""
    try:
        spec = util.find_spec(target.partition(":")[0].strip())
    except Exception:  # noqa: BLE001
        # a parent package is imported here, and may raise whatever it likes
        return ""
    return spec.origin or "" if spec else ""


def suggest(name: str, names: Iterable[str]) -> str:
    """Return '; did you mean ...?' with the closest of the names, or what there is where none is
    close.
    """
    names = list(names)
    close = difflib.get_close_matches(name, names, n=1)
    if close:
        return f"; did you mean '{close[0]}'?"
    return (
        f"; there {'are' if len(names) > 1 else 'is'} {', '.join(names)}"
        if names
        else "; there are none"
    )


def line_of(error: BaseException, file: str) -> int | None:
    """Return the last line of a file that an exception passed through, or that its syntax error is
    on.
    """
    if isinstance(error, SyntaxError) and error.filename == file:
        return error.lineno
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(error.__traceback__)
        if frame.filename == file
    ]
    return lines[-1] if lines else None


def reason(error: BaseException) -> str:
    """Return an exception's kind and text on one line; the kind is left out where the text was
    written for the user.
    """
    text = short(str(error.msg)) if isinstance(error, SyntaxError) else said(error)
    if isinstance(error, SocpError):
        return str(error)
    from socp.model import hint_for  # late: it needs casadi, and lists do not

    hint = hint_for(text)
    kind = "" if isinstance(error, pluggy.PluginValidationError) else type(error).__name__
    return ": ".join(filter(None, (kind, text))) + (f"; {hint}" if hint else "")


def explain(error: BaseException, file: str) -> str:
    """Return one line on an exception: its kind, its text and, where it passed through the file,
    the line.

    A package is known by its `__init__.py`: there the last of all its files that it passed through
    counts.
    """
    passed, name = file, Path(file).name
    if name == "__init__.py":
        folder = Path(file).parent
        frames = [frame.filename for frame in traceback.extract_tb(error.__traceback__)]
        frames += [error.filename or ""] if isinstance(error, SyntaxError) else []
        passed = next((each for each in reversed(frames) if folder in Path(each).parents), file)
        if passed != file:
            name = str(Path(passed).relative_to(folder.parent))
    line = line_of(error, passed)
    return reason(error) + (f" ({name}, line {line})" if line else "")


def refusal(method: Any, methods: Mapping[str, "type[Method]"]) -> str:
    """Return why an object cannot be a method here, empty where it can."""
    from socp.methods import Method

    if not (inspect.isclass(method) and issubclass(method, Method)):
        return f"{method!r} is no subclass of socp.Method"
    return next(_faults(method, methods), "")


def _faults(method: Any, methods: Mapping[str, "type[Method]"]) -> Iterator[str]:
    name = getattr(method, "name", "")
    if not isinstance(name, str) or not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_-]*", name):
        yield f"{method.__name__}: name {name!r}; it should be letters, digits and hyphens"
    if inspect.isabstract(method):
        yield f"{method.__name__} does not define {', '.join(sorted(method.__abstractmethods__))}"
    if not is_dataclass(method) or not vars(method)["__dataclass_params__"].frozen:
        yield f"{method.__name__} is no frozen dataclass; put @dataclass(frozen=True) above it"
    if not isinstance(getattr(method, "source", None), str):
        yield f"{method.__name__} has no source: say which paper the method comes from"
    if name in methods:
        yield (
            f"there is a method '{name}' already, "
            f"{methods[name].__module__}.{methods[name].__name__}"
        )

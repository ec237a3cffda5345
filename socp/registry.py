"""The registry: methods, problems and listeners of installed packages; broken ones are kept apart with the reason."""

import inspect
import os
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, is_dataclass, replace
from importlib import metadata
from typing import TYPE_CHECKING, Any, Self, final

import pluggy

from socp import hookspecs
from socp.entries import PLUGINS, PROBLEMS, Entry, Plugin, Status, explain, origin, package, points, suggest
from socp.errors import MethodError, ProblemError

if TYPE_CHECKING:
    from socp.method import Method
    from socp.problem import Problem
    from socp.solution import Solution

VARIABLE = "SOCP_PLUGINS"
HOOKS = ("socp_methods", "socp_solved")


class PluginError(MethodError):
    """A method was asked for whose plugin could not be loaded."""


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Registry:
    """What is installed: `plugins` with their fates, `methods` by name, registered problems by name in `entries`.

    `refused` are problems whose name was taken; `warnings` are lines for the user.
    """

    plugins: tuple[Plugin, ...]
    methods: Mapping[str, "type[Method]"]
    entries: Mapping[str, Entry]
    refused: tuple[Entry, ...] = ()
    warnings: tuple[str, ...] = ()
    manager: pluggy.PluginManager

    @classmethod
    def load(cls, *, only: Collection[str] | None = None, without: Collection[str] = ()) -> Self:
        """Load the plugins of all installed packages, but only those named in `only` and none named in `without`.

        Where `only` is None the environment variable SOCP_PLUGINS decides: a comma list of names, empty for none, unset
        for all. Problems are not imported. A broken plugin raises nothing; MethodError names an unknown `without`.
        """
        found = points(PLUGINS)
        names = sorted({point.name for point in found})
        for name in without:
            if name not in names:
                raise MethodError(f"--no-plugin {name}: no such plugin{suggest(name, names)}")
        source = VARIABLE if only is None else "the caller"
        wanted = _environment() if only is None else only
        unknown = [name for name in wanted or () if name not in names]
        manager, plugins = _manager(), list[Plugin]()
        methods: dict[str, type[Method]] = {}
        for point in found:
            plugin = Plugin(name=point.name, target=point.value, package=package(point))
            if point.name in without:
                plugin = replace(plugin, status="off", reason="left out by --no-plugin")
            elif wanted is not None and point.name not in wanted:
                plugin = replace(plugin, status="off", reason=f"not named by {source}")
            elif any(other.name == point.name for other in plugins):
                plugin = replace(plugin, status="failed", reason=f"there is a plugin '{point.name}' already")
            else:
                plugin = _load(point, plugin, manager, methods)
            plugins.append(plugin)
        entries, refused = _entries()
        warnings = tuple(f"{source}: no plugin '{name}'{suggest(name, names)}" for name in unknown)
        return cls(
            plugins=tuple(plugins), methods=methods, entries=entries, refused=refused,
            warnings=warnings, manager=manager,
        )  # fmt: skip

    @property
    def problems(self) -> tuple[str, ...]:
        """Names of the registered problems, from the packages' metadata alone."""
        return tuple(self.entries)

    @property
    def failures(self) -> tuple[Plugin | Entry, ...]:
        """Plugins that failed, wholly or in part, and problems that were refused."""
        return (*(plugin for plugin in self.plugins if plugin.status in {"failed", "partly"}), *self.refused)

    def method(self, name: str) -> "type[Method]":
        """Return a method by name; MethodError suggests the closest one, PluginError says which plugin failed."""
        if name in self.methods:
            return self.methods[name]
        for plugin in self.plugins:
            if plugin.name.replace("_", "-") == name.replace("_", "-") and plugin.status != "loaded":
                kind = MethodError if plugin.status == "off" else PluginError
                raise kind(f"method '{name}': plugin '{plugin.name}' is {plugin.status}: {plugin.reason}")
        raise MethodError(f"unknown method '{name}'{suggest(name, self.methods)}")

    def problem(self, name: str) -> "Problem":
        """Import and return a registered problem; ProblemError says what is wrong with it, or which name is closest."""
        if name not in self.entries:
            raise ProblemError(f"unknown problem '{name}'{suggest(name, self.entries)}")
        entry = self.entries[name]
        where = f"problem '{name}' of {entry.package}"
        try:
            found = metadata.EntryPoint(name, entry.target, PROBLEMS).load()
        except (Exception, SystemExit) as error:
            raise ProblemError(f"{where}: {explain(error, origin(entry.target))}") from error
        return as_problem(found, f"{where}: {entry.target}")

    def owner(self, method: str) -> Plugin | None:
        """Return the plugin that a method comes from."""
        return next((plugin for plugin in self.plugins if method in plugin.methods), None)

    def solved(self, problem: "Problem", solution: "Solution") -> list[str]:
        """Call the listeners, each by itself; returns one line for each that raised."""
        complaints = []
        everyone = self.manager.get_plugins()
        for plugin in self.plugins:
            listener = self.manager.get_plugin(plugin.name)
            if "socp_solved" not in plugin.hooks or listener is None:
                continue
            call = self.manager.subset_hook_caller("socp_solved", everyone - {listener})
            try:
                call(problem=problem, solution=solution)
            except (Exception, SystemExit) as error:  # noqa: BLE001 - a listener's fault is not the solve's
                complaints.append(f"plugin '{plugin.name}': socp_solved: {explain(error, origin(plugin.target))}")
        return complaints


def as_problem(found: Any, where: str) -> "Problem":
    """Return an object that is a Problem as it is; ProblemError, starting with `where`, says what it is instead."""
    from socp.problem import Problem

    if not isinstance(found, Problem):
        kind = type(found).__name__
        raise ProblemError(f"{where} is {'an' if kind[0].lower() in 'aeiou' else 'a'} {kind}, not a Problem")
    return found


def _environment() -> Collection[str] | None:
    given = os.environ.get(VARIABLE)
    return None if given is None else [name.strip() for name in given.split(",") if name.strip()]


def _entries() -> tuple[dict[str, Entry], tuple[Entry, ...]]:
    entries: dict[str, Entry] = {}
    refused = []
    for point in points(PROBLEMS):
        entry = Entry(name=point.name, target=point.value, package=package(point))
        first = entries.setdefault(point.name, entry)
        if first is not entry:
            refused.append(replace(entry, reason=f"there is a problem '{point.name}' already, from {first.package}"))
    return entries, tuple(refused)


def _manager() -> pluggy.PluginManager:
    manager = pluggy.PluginManager("socp")
    manager.add_hookspecs(hookspecs)
    return manager


def _load(
    point: metadata.EntryPoint, plugin: Plugin, manager: pluggy.PluginManager, methods: "dict[str, type[Method]]"
) -> Plugin:
    """Load one plugin on trial, admit it to the manager, and return what became of it."""
    try:
        module = point.load()
        hooks, offered = _trial(module)
    except (Exception, SystemExit) as error:  # noqa: BLE001 - one broken plugin stops nothing
        return replace(plugin, status="failed", reason=explain(error, origin(point.value)), error=error)
    accepted, refusals = [], []
    for each in offered:
        refusal = _refusal(each, methods)
        if refusal:
            refusals.append(refusal)
        else:
            methods[each.name] = each
            accepted.append(each.name)
    useful = accepted or "socp_solved" in hooks
    status: Status = "loaded" if not refusals else "partly" if useful else "failed"
    if status != "failed":
        manager.register(module, name=point.name)
    return replace(plugin, status=status, reason="; ".join(refusals), methods=tuple(accepted), hooks=hooks)


def _trial(module: Any) -> tuple[tuple[str, ...], list[Any]]:
    """Return the hooks of a plugin and the methods it offers, tried in a manager of its own where it harms none."""
    trial = _manager()
    trial.register(module)
    hooks = tuple(caller.name for caller in trial.get_hookcallers(module) or ())
    try:
        trial.check_pending()
    except pluggy.PluginValidationError:
        unknown = next(name for name in hooks if name not in HOOKS)
        raise MethodError(f"unknown hook '{unknown}'{suggest(unknown, HOOKS)}") from None
    if not hooks:
        raise MethodError(f"implements no hook; mark {' or '.join(HOOKS)} with @hookimpl")
    offered: list[Any] = []
    for answer in trial.hook.socp_methods():
        if isinstance(answer, type) or not isinstance(answer, Iterable):
            raise MethodError("socp_methods should return a list of methods")
        offered += answer
    return hooks, offered


def _refusal(method: Any, methods: "Mapping[str, type[Method]]") -> str:
    """Return why an object cannot be a method here, empty where it can."""
    from socp.method import Method

    if not (inspect.isclass(method) and issubclass(method, Method)):
        return f"{method!r} is no subclass of socp.Method"
    return next(_faults(method, methods), "")


def _faults(method: Any, methods: "Mapping[str, type[Method]]") -> Iterator[str]:
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
        yield f"there is a method '{name}' already, {methods[name].__module__}.{methods[name].__name__}"

"""The registry: methods, problems and listeners of installed packages; broken ones are kept apart
with the reason.
"""

import os
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from importlib import metadata
from itertools import islice
from typing import TYPE_CHECKING, Any, Self, final

import pluggy

from socp.errors import MethodError, ProblemError, SocpError, SolveError
from socp.process import short
from socp.registry import hooks as hookspecs
from socp.registry.calls import invoke
from socp.registry.entries import (
    PLUGINS,
    PROBLEMS,
    Entry,
    Plugin,
    Status,
    explain,
    origin,
    package,
    points,
    refusal,
    suggest,
)

if TYPE_CHECKING:
    from pathlib import Path

    from socp.methods import Method
    from socp.model import Problem, Solution
    from socp.registry.recorder import Guarded
    from socp.registry.viewer import Screen

VARIABLE = "SOCP_PLUGINS"
LISTENERS = ("socp_solved", "socp_recorder", "socp_page", "socp_viewer")
HOOKS = ("socp_methods", *LISTENERS)
_MOST = 1000  # methods of one plugin: what offers more never ends


class PluginError(MethodError):
    """A method was asked for whose plugin could not be loaded."""


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Registry:
    """What is installed: `plugins` with their fates, `methods` by name, registered problems by name
    in `entries`.

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
        """Load the plugins of all installed packages, but only those named in `only` and none named
        in `without`.

        Where `only` is None the environment variable SOCP_PLUGINS decides: a comma list of names,
        empty for none, unset for all. Problems are not imported. A broken plugin raises nothing;
        MethodError names an unknown `without`.
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
                plugin = replace(
                    plugin, status="failed", reason=f"there is a plugin '{point.name}' already"
                )
            else:
                plugin = _load(point, plugin, manager, methods)
            plugins.append(plugin)
        entries, refused = _entries()
        warnings = tuple(f"{source}: no plugin '{name}'{suggest(name, names)}" for name in unknown)
        return cls(
            plugins=tuple(plugins),
            methods=methods,
            entries=entries,
            refused=refused,
            warnings=warnings,
            manager=manager,
        )

    @property
    def problems(self) -> tuple[str, ...]:
        """Names of the registered problems, from the packages' metadata alone."""
        return tuple(self.entries)

    @property
    def failures(self) -> tuple[Plugin | Entry, ...]:
        """Plugins that failed, wholly or in part, and problems that were refused."""
        return (
            *(plugin for plugin in self.plugins if plugin.status in {"failed", "partly"}),
            *self.refused,
        )

    def method(self, name: str) -> "type[Method]":
        """Return a method by name; MethodError suggests the closest one, PluginError says which
        plugin failed.
        """
        if name in self.methods:
            return self.methods[name]
        for plugin in self.plugins:
            if (
                plugin.name.replace("_", "-") == name.replace("_", "-")
                and plugin.status != "loaded"
            ):
                kind = MethodError if plugin.status == "off" else PluginError
                raise kind(
                    f"method '{name}': plugin '{plugin.name}' is {plugin.status}: {plugin.reason}"
                )
        left = [plugin.name for plugin in self.plugins if plugin.status in {"off", "failed"}]
        hint = f"; plugins that are not loaded: {', '.join(left)}" if left else ""
        raise MethodError(f"unknown method '{short(name)}'{suggest(name, self.methods)}{hint}")

    def problem(self, name: str) -> "Problem":
        """Import and return a registered problem; ProblemError says what is wrong with it, or which
        name is closest.
        """
        if name not in self.entries:
            raise ProblemError(f"unknown problem '{short(name)}'{suggest(name, self.entries)}")
        entry = self.entries[name]
        where = f"problem '{name}' of {entry.package}"
        try:
            found = metadata.EntryPoint(name, entry.target, PROBLEMS).load()
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise ProblemError(f"{where}: {explain(error, origin(entry.target))}") from error
        return as_problem(found, f"{where}: {entry.target}")

    def owner(self, method: str) -> Plugin | None:
        """Return the plugin that a method comes from."""
        return next((plugin for plugin in self.plugins if method in plugin.methods), None)

    def solved(self, problem: "Problem", solution: "Solution") -> list[str]:
        """Call the listeners, each by itself; returns one line for each that raised."""
        from socp.registry.recorder import read_only

        complaints = []
        for plugin, call in self._calls("socp_solved"):
            try:
                invoke(call, problem=problem, solution=read_only(solution))
            except Exception as error:  # noqa: BLE001 - a listener's fault is not the solve's
                complaints.append(
                    f"{plugin.who}: socp_solved: {explain(error, origin(plugin.target))}"
                )
        return complaints

    def recorder(
        self, problem: "Problem", path: "Path | None", live: str = "", runs: int = 1
    ) -> "Guarded":
        """Return the first recorder that a plugin offers, guarded: it raises nothing and complains
        in a line.

        MethodError says so where no plugin records.
        """
        from socp.registry.recorder import Guarded

        complaints = []
        for plugin, call in self._calls("socp_recorder"):
            explained = partial(_explained, plugin, "not recorded")
            try:
                answers = invoke(call, problem=problem, path=path, live=live, runs=runs)
            except Exception as error:  # noqa: BLE001 - a recorder's fault is not the solve's
                complaints.append(explained(error))
                continue
            if answers:
                return Guarded(answers[0], explained, complaints)
        if complaints:
            return Guarded(None, complaints=complaints)
        raise MethodError("--record, --live: no plugin records; see 'socp plugins list'")

    def record(self, path: "Path", name: str, page: Any) -> list[str]:
        """Write a recording that is no solve's, a `socp.view.Page`, by the first plugin that does;
        returns what went wrong, a line each, where none did.

        MethodError says so where no plugin writes such recordings.
        """
        complaints = []
        for plugin, call in self._calls("socp_page"):
            try:
                if invoke(call, path=path, name=name, page=page):
                    return []
            except Exception as error:  # noqa: BLE001 - a recorder's fault is not the branch's
                complaints.append(_explained(plugin, "not recorded", error))
        if complaints:
            return complaints
        raise MethodError("--record: no plugin records branches; see 'socp plugins list'")

    def viewer(self) -> "Screen":
        """Return the first viewer that a plugin offers, guarded: it raises SolveError alone.

        MethodError says so where no plugin offers one, SolveError why those that do cannot.
        """
        from socp.registry.viewer import Screen

        complaints = []
        for plugin, call in self._calls("socp_viewer"):
            explained = partial(_explained, plugin, "not shown")
            try:
                found = invoke(call)
            except Exception as error:  # noqa: BLE001 - the next plugin may have one
                complaints.append(explained(error))
                continue
            if found is not None:
                return Screen(found, explained)
        if complaints:
            raise SolveError("; ".join(complaints))
        raise MethodError(
            "no plugin offers a viewer, which 'socp view' and --live need; see 'socp plugins list'"
        )

    def _calls(self, hook: str) -> Iterator[tuple[Plugin, Any]]:
        """Yield every plugin that implements a hook, with a caller for it alone."""
        everyone = self.manager.get_plugins()
        for plugin in self.plugins:
            listener = self.manager.get_plugin(plugin.name)
            if hook in plugin.hooks and listener is not None:
                yield plugin, self.manager.subset_hook_caller(hook, everyone - {listener})


def _explained(plugin: Plugin, outcome: str, error: BaseException) -> str:
    if isinstance(error, SocpError):  # it says all there is to say
        return f"{plugin.who}: {error}"
    return f"{plugin.who}: {outcome}: {explain(error, origin(plugin.target))}"


def as_problem(value: Any, where: str) -> "Problem":
    """Return an object that is a Problem as it is; ProblemError, starting with `where`, says what
    it is instead.
    """
    from socp.model import Problem

    if not isinstance(value, Problem):
        kind = type(value).__name__
        raise ProblemError(
            f"{where} is {'an' if kind[0].lower() in 'aeiou' else 'a'} {kind}, not a Problem"
        )
    return value


def _environment() -> Collection[str] | None:
    given = os.environ.get(VARIABLE)
    return None if given is None else [name.strip() for name in given.split(",") if name.strip()]


def _entries() -> tuple[dict[str, Entry], tuple[Entry, ...]]:
    entries, refused = dict[str, Entry](), list[Entry]()
    for point in points(PROBLEMS):
        entry = Entry(name=point.name, target=point.value, package=package(point))
        first = entries.setdefault(point.name, entry)
        if first is not entry:
            refused.append(
                replace(
                    entry, reason=f"there is a problem '{point.name}' already, from {first.package}"
                )
            )
    return entries, tuple(refused)


def _manager() -> pluggy.PluginManager:
    (manager := pluggy.PluginManager("socp")).add_hookspecs(hookspecs)
    return manager


def _load(
    point: metadata.EntryPoint,
    plugin: Plugin,
    manager: pluggy.PluginManager,
    methods: "dict[str, type[Method]]",
) -> Plugin:
    """Load one plugin on trial, admit it to the manager, and return what became of it."""
    try:
        module, hooks, accepted, refusals = invoke(_tried, point, dict(methods))
    except Exception as error:  # noqa: BLE001 - one broken plugin stops nothing
        return replace(
            plugin, status="failed", reason=explain(error, origin(point.value)), error=error
        )
    methods |= accepted
    useful = accepted or set(LISTENERS) & set(hooks)
    status: Status = "loaded" if not refusals else "partly" if useful else "failed"
    if status != "failed":
        manager.register(module, name=point.name)
    return replace(
        plugin, status=status, reason="; ".join(refusals), methods=tuple(accepted), hooks=hooks
    )


def _tried(
    point: metadata.EntryPoint, methods: "dict[str, type[Method]]"
) -> "tuple[Any, tuple[str, ...], dict[str, type[Method]], list[str]]":
    """Import a plugin; returns its module, its hooks, its methods by name, and why others of them
    are refused.
    """
    module = point.load()
    hooks, offered = _trial(module)
    accepted, refusals = dict[str, Any](), list[str]()
    for each in offered:
        if fault := refusal(each, methods | accepted):
            refusals.append(fault)
        else:
            accepted[each.name] = each
    return module, hooks, accepted, refusals


def _trial(module: Any) -> tuple[tuple[str, ...], list[Any]]:
    """Return the hooks of a plugin and the methods it offers, tried in a manager of its own where
    it harms none.
    """
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
        offered += islice(answer, _MOST + 1)
        if len(offered) > _MOST:
            raise MethodError(f"socp_methods offers more than {_MOST} methods")
    return hooks, offered

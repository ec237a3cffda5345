"""`socp list`, `socp methods`, `socp plugins`."""

import inspect
from collections.abc import Iterable

import click
from rich.table import Table
from rich.text import Text

from socp.cli.session import Exit, Session, show, write_json
from socp.process import first_paragraph

_STATUS = {"loaded": "green", "partly": "yellow", "failed": "bold red", "off": "dim"}
_ADDS = {
    "socp_solved": "listener",
    "socp_recorder": "recorder",
    "socp_page": "recorder of branches",
    "socp_viewer": "viewer",
}
_JSON = click.option("--json", "as_json", is_flag=True, help="Write JSON.")


@click.command("list")
@_JSON
@click.pass_obj
def list_(session: Session, as_json: bool) -> int:
    """List the registered problems; none is imported."""
    registry = session.registry(plugins=False)
    for entry in registry.refused:
        session.warn(f"problem '{entry.name}' of {entry.package} is left out: {entry.reason}")
    entries = registry.entries.values()
    if as_json:
        write_json(
            [
                {"name": e.name, "about": e.about, "target": e.target, "package": e.package}
                for e in entries
            ]
        )
    else:
        _print(["problem", "about", "package"], ([e.name, e.about, e.package] for e in entries))
    return Exit.SOLVED


@click.command()
@_JSON
@click.pass_obj
def methods(session: Session, as_json: bool) -> int:
    """List the methods of all plugins."""
    registry = session.registry()
    session.complain(registry)
    found = []
    for name, method in sorted(registry.methods.items()):
        owner = registry.owner(name)
        about = first_paragraph(inspect.getdoc(method))
        found.append(
            {
                "name": name,
                "about": about,
                "source": method.source,
                "package": owner.package if owner else "",
            }
        )
    if as_json:
        write_json(found)
    else:
        _print(
            ["method", "about", "package"],
            ([row["name"], row["about"], row["package"]] for row in found),
        )
    return Exit.SOLVED


@click.group(invoke_without_command=True)
@click.pass_context
def plugins(context: click.Context) -> int:
    """Look at the plugins of installed packages."""
    if context.invoked_subcommand is None:
        context.invoke(plugins_list)
    return Exit.SOLVED


@plugins.command("list", short_help="List the plugins, broken ones with the reason.")
@_JSON
@click.pass_obj
def plugins_list(session: Session, as_json: bool = False) -> int:
    """List the plugins with what they add; a broken one is shown as failed, with the reason."""
    registry = session.registry()
    if as_json:
        keys = ("name", "target", "package", "status", "reason", "methods", "hooks")
        write_json([{key: getattr(plugin, key) for key in keys} for plugin in registry.plugins])
        return Exit.SOLVED
    rows: list[list[Text | str]] = []
    for plugin in registry.plugins:
        adds = [*plugin.methods, *(_ADDS[hook] for hook in plugin.hooks if hook in _ADDS)]
        status = Text(plugin.status, _STATUS[plugin.status])
        rows.append([plugin.name, status, plugin.reason or ", ".join(adds), plugin.package])
    _print(["plugin", "status", "adds, or reason", "package"], rows)
    return Exit.SOLVED


def _print(heads: list[str], rows: Iterable[list[Text | str]]) -> None:
    table = Table(header_style="bold", box=None, pad_edge=False, padding=(0, 3, 0, 0))
    for k, head in enumerate(heads):
        table.add_column(
            head, style="bold cyan" if k == 0 else None, no_wrap=k == 0, overflow="fold"
        )
    for row in rows:
        table.add_row(*(cell if isinstance(cell, Text) else Text(cell) for cell in row))
    show(table)

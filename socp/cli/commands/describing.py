"""`socp describe`: a method with its options, or a problem with its formula."""

import inspect
from collections.abc import Iterator, Sequence
from dataclasses import MISSING
from typing import TYPE_CHECKING, get_type_hints

import click
from rich.table import Table
from rich.text import Text

from socp.cli.commands.completing import problems
from socp.cli.options import backend_name, backends, has_options
from socp.cli.posing import load_posed, set_option
from socp.cli.session import Exit, Session, heading, show
from socp.errors import MethodError, ProblemError
from socp.process import first_paragraph, short
from socp.registry import suggest

if TYPE_CHECKING:
    from socp.methods import Method
    from socp.model import Problem
    from socp.registry import Registry

Line = tuple[str, str]

_READ = 600  # characters of a formula that somebody may read: five lines


@click.command()
@click.argument("name", metavar="NAME", shell_complete=problems)
@set_option
@click.option("--full", is_flag=True, help="Write formulas to their end, however long they are.")
@click.pass_obj
def describe(session: Session, name: str, changes: tuple[str, ...], full: bool) -> int:
    """Describe a method (its options, defaults and source) or a problem (its formula, bounds, laws
    and reference).

    A problem may be a path, path.py:name or a registered name. Formulas of many lines are cut;
    --full shows all.
    """
    registry = session.registry()
    if name in registry.methods:
        if changes:
            raise MethodError(f"--set: '{name}' is a method; only a problem has numbers to set")
        _method(registry.methods[name], registry)
    else:
        _problem(name, changes, registry, full=full)
    return Exit.SOLVED


def _method(method: "type[Method]", registry: "Registry") -> None:
    owner = registry.owner(method.name)
    table = Table(header_style="bold", box=None, pad_edge=False, padding=(0, 3, 0, 0))
    for head in ("option", "type", "default", "about"):
        table.add_column(head, overflow="fold")
    for cells in option_rows(method):
        table.add_row(*(Text(cell) for cell in cells))
    about = Text(f"{_flowing(inspect.getdoc(method))}\n")
    source = Text(f"source: {method.source}\n", "dim")
    show(
        heading(method.name, f"method of {owner.package if owner else 'unknown'}"),
        about,
        source,
        table,
    )


def _flowing(doc: str | None) -> str:
    """Return a docstring whose first paragraph is one line: the terminal breaks it where it must.

    What follows stays as it is: it may be a list or a formula.
    """
    _, gap, rest = (doc or "").strip().partition("\n\n")
    return f"{first_paragraph(doc)}{gap}{rest}"


def option_rows(method: "type[Method]") -> Iterator[tuple[str, str, str, str]]:
    """Yield (name, type, default, one line) of every option of a method."""
    from socp.methods import option_range, options

    hints = get_type_hints(method)
    for each in options(method):
        about, hint = each.metadata.get("doc", ""), hints[each.name]
        least, most = option_range(each, whole=False)
        kind = getattr(hint, "__name__", str(hint)).lower()
        if has_options(each):
            backend, any_of = backend_name(each), " or ".join(backends(each, hint))
            yield (
                each.name,
                kind,
                backend,
                f"{about}: {any_of}; {backend}.NAME=VALUE sets any of its own options",
            )
        else:
            default = "required" if each.default is MISSING else str(each.default) or "''"
            yield each.name, kind, default, about + _range(least, most)


def _range(least: float | None, most: float | None) -> str:
    parts = [] if least is None else [f"at least {least}"]
    parts += [] if most is None else [f"at most {most}"]
    return f"; {', '.join(parts)}" if parts else ""


def _problem(name: str, changes: Sequence[str], registry: "Registry", *, full: bool) -> None:
    try:
        problem = load_posed(name, changes, registry)
    except ProblemError:
        known = [*registry.methods, *registry.entries]
        if name in registry.entries or "/" in name or name.endswith(".py") or ".py:" in name:
            raise
        raise MethodError(f"no method or problem '{short(name)}'{suggest(name, known)}") from None
    grid = Table.grid(padding=(0, 2, 0, 0))
    grid.add_column(style="bold", no_wrap=True)
    grid.add_column(overflow="fold")
    last = ""
    for label, text in problem_lines(problem):
        grid.add_row("" if label == last else label, Text(text if full else _cut(text)))
        last = label
    source = Text(f"source: {problem.source or 'not given'}\n", "dim")
    show(heading(problem.name, problem.title), source, grid)


def _cut(text: str) -> str:
    """Return a text that is not too long to be read, its end left out where it is."""
    if len(text) <= _READ:
        return text
    return f"{text[:_READ]} ... ({len(text)} characters; --full shows all)"


def problem_lines(problem: "Problem") -> Iterator[Line]:
    """Yield (label, text) of all parts of a problem, in its own symbols, with the laws on its
    arcs.
    """
    from socp.laws import law_lines
    from socp.view import formula, notes, statement_rows

    yield from statement_rows(problem)
    yield from law_lines(problem, formula)
    yield from notes(problem)

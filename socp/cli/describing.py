"""`socp describe`: a method with its options, or a problem with its formula."""

import inspect
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING
from typing import TYPE_CHECKING, get_type_hints

import click
import numpy as np
from rich.table import Table
from rich.text import Text

from socp.cli.loading import load_problem
from socp.cli.options import backend_name, has_options
from socp.cli.session import Exit, Session, heading, show
from socp.entries import suggest
from socp.errors import MethodError, ProblemError

if TYPE_CHECKING:
    from socp.method import Method
    from socp.problem import Problem
    from socp.registry import Registry

Line = tuple[str, str]


@click.command(short_help="Describe a method or a problem.")
@click.argument("name", metavar="NAME")
@click.pass_obj
def describe(session: Session, name: str) -> int:
    """Describe a method (its options, defaults and source) or a problem (its formula, bounds, laws and reference).

    A problem may be a path, path.py:name or a registered name.
    """
    registry = session.registry()
    if name in registry.methods:
        _method(registry.methods[name], registry)
    else:
        _problem(name, registry)
    return Exit.SOLVED


def _method(method: "type[Method]", registry: "Registry") -> None:
    owner = registry.owner(method.name)
    table = Table(header_style="bold", box=None, pad_edge=False, padding=(0, 3, 0, 0))
    for head in ("option", "type", "default", "about"):
        table.add_column(head, overflow="fold")
    for cells in option_rows(method):
        table.add_row(*(Text(cell) for cell in cells))
    about = Text(f"{inspect.getdoc(method)}\n")
    source = Text(f"source: {method.source}\n", "dim")
    show(heading(method.name, f"method of {owner.package if owner else 'unknown'}"), about, source, table)


def option_rows(method: "type[Method]") -> Iterator[tuple[str, str, str, str]]:
    """Yield (name, type, default, one line) of every option of a method."""
    from socp.method import options

    hints = get_type_hints(method)
    for each in options(method):
        about, least = each.metadata.get("doc", ""), each.metadata.get("least")
        hint = hints[each.name]
        kind = getattr(hint, "__name__", str(hint)).lower()
        if has_options(each):
            backend = backend_name(each)
            yield each.name, kind, backend, f"{about}; {backend}.NAME=VALUE sets any of its own options"
        else:
            default = "required" if each.default is MISSING else str(each.default) or "''"
            yield each.name, kind, default, about + (f"; at least {least}" if least is not None else "")


def _problem(name: str, registry: "Registry") -> None:
    try:
        problem = load_problem(name, registry)
    except ProblemError:
        known = [*registry.methods, *registry.entries]
        if name in registry.entries or "/" in name or name.endswith(".py") or ".py:" in name:
            raise
        raise MethodError(f"no method or problem '{name}'{suggest(name, known)}") from None
    grid = Table.grid(padding=(0, 2, 0, 0))
    grid.add_column(style="bold", no_wrap=True)
    grid.add_column(overflow="fold")
    last = ""
    for label, text in problem_lines(problem):
        grid.add_row("" if label == last else label, Text(text))
        last = label
    source = Text(f"source: {problem.source or 'not given'}\n", "dim")
    show(heading(problem.name, problem.title), source, grid)


def problem_lines(problem: "Problem") -> Iterator[Line]:
    """Yield (label, text) of all parts of a problem, in its own symbols."""
    from socp.cli.formula import formula
    from socp.lawbook import law_lines

    terms = [formula(problem.minimise)] if problem.minimise is not None else []
    terms += [f"integral of {formula(problem.running)}"] if problem.running is not None else []
    yield "minimise", " + ".join(terms)
    yield from (("dynamics", f"{state}' = {formula(rate)}") for state, rate in problem.dynamics.items())
    yield from _intervals(problem)
    for label in ("target", "path"):
        yield from ((label, f"{name}: {formula(relation)}") for name, relation in getattr(problem, label).items())
    given = problem.singular.items()
    yield from (("given law", f"{control} = {formula(law)} where singular") for control, law in given)
    yield from _boundary(problem)
    yield from law_lines(problem, formula)
    yield from (("unit", f"{symbol}: {unit}") for symbol, unit in problem.units.items())
    yield from _reference(problem)


def _intervals(problem: "Problem") -> Iterator[Line]:
    boxes = (("control", problem.box), ("state", problem.state_box), ("parameter", problem.parameter_box))
    for kind, box in boxes:
        yield from ((kind, text) for text in _box(getattr(problem, f"{kind}_names"), box))
    for label, box in (("start", problem.start_box), ("end", problem.end_box)):
        yield label, ", ".join(_box(problem.state_names, box))
    times = np.array([problem.initial_time_box, problem.final_time_box]).T
    yield "time", ", ".join(_box(("t0", "tf"), times))


def _box(names: Sequence[str], box: np.ndarray) -> list[str]:
    """Return the intervals of names (n,) with bounds (2, n), those that are free together at the end."""
    bounded = np.isfinite(box).any(axis=0)
    free = ", ".join(name for name, its in zip(names, bounded, strict=True) if not its)
    pairs = zip(names, box.T, bounded, strict=True)
    return [_interval(name, *pair) for name, pair, its in pairs if its] + ([f"{free} free"] if free else [])


def _interval(name: str, low: float, high: float) -> str:
    from socp.cli.formula import number

    if low == high:
        return f"{name} = {number(low)}"
    left = "" if low == -float("inf") else f"{number(low)} <= "
    right = "" if high == float("inf") else f" <= {number(high)}"
    return f"{left}{name}{right}"


def _boundary(problem: "Problem") -> Iterator[Line]:
    from socp.cli.formula import formula

    for control, laws in problem.boundary.items():
        if isinstance(laws, Mapping):
            yield from (("given law", f"{control} = {formula(law)} on {name}") for name, law in laws.items())
        else:
            yield "given law", f"{control} = {formula(laws)} on the boundary"


def _reference(problem: "Problem") -> Iterator[Line]:
    reference = problem.reference
    if reference is None:
        return
    yield "reference", f"objective {reference.objective:.16g}"
    if reference.word:
        yield "reference", f"word {reference.word}"
    if reference.switches:
        yield "reference", "switching times " + "  ".join(f"{t:.13g}" for t in reference.switches)
    if reference.source:
        yield "reference", reference.source

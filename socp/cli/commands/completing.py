"""Completion by the shell: its script, names of problems, methods and their options, files."""

import io
from contextlib import redirect_stdout
from typing import Any

import click
from click.shell_completion import CompletionItem, shell_complete

from socp.cli.options import DEFAULT_METHOD
from socp.cli.streams import say


def completed(command: click.Command, variable: str, asked: str) -> None:
    """Answer a shell that asks so in a variable of the environment."""
    answer = io.BytesIO()
    with redirect_stdout(io.TextIOWrapper(answer, "utf-8", write_through=True)):
        shell_complete(command, {}, "socp", variable, asked)
        text = answer.getvalue().decode()
    say(text.removesuffix("\n"))


def problems(_context: click.Context, _parameter: Any, begun: str) -> list[CompletionItem]:
    """Return the registered problems that begin so, and files."""
    from socp.registry import Registry

    found = [CompletionItem(n) for n in Registry.load(only=()).problems if n.startswith(begun)]
    return [*found, CompletionItem(begun, type="file")]


def methods(_context: click.Context, _parameter: Any, begun: str) -> list[CompletionItem]:
    """Return the methods that begin so."""
    from socp.registry import Registry

    return [CompletionItem(name) for name in Registry.load().methods if name.startswith(begun)]


def files(_context: click.Context, _parameter: Any, begun: str) -> list[CompletionItem]:
    """Return that files are meant: the shell knows them."""
    return [CompletionItem(begun, type="file")]


def keys(context: click.Context, _parameter: Any, begun: str) -> list[CompletionItem]:
    """Return the options, `steps=`, of the method that is named before, that begin so."""
    from socp.methods import options
    from socp.registry import Registry

    known = Registry.load().methods
    method = known.get(context.params.get("method") or DEFAULT_METHOD)
    names = [each.name for each in options(method)] if method else []
    return [CompletionItem(f"{name}=") for name in names if name.startswith(begun)]

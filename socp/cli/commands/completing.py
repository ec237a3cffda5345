"""Completion by the shell: its script, and the names of problems and methods."""

import io
from contextlib import redirect_stdout
from typing import Any

import click
from click.shell_completion import CompletionItem, shell_complete

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

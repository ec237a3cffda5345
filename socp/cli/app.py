"""The command `socp`: its options, its commands, and what becomes of errors."""

import os
import shlex
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from typing import Any, final

import click

from socp.cli.machine import lacking, roomy
from socp.cli.session import Exit, Session, messages
from socp.cli.streams import Streams, kept_apart, parsing, parted
from socp.errors import ContractError, KeepingError, MethodError, ProblemError, SocpError
from socp.process import close, heard, listening, said, signals_held

EPILOG = """\b
Exit codes:
  0    an answer: certified, or a feasible point at the solver's tolerances; check: certified
  1    no answer: infeasible, at a limit, failed, or an extremal that is no minimum (the result is
       written); check: not certified, or no minimum
  2    usage: an unknown command, method or option, or a value not allowed
  3    the problem, or the plugin of the method, could not be loaded, or the plugin failed
  4    internal error
  5    the disk, the memory or standard output gave out; the message says what is kept
  130  interrupted by Ctrl-C; a solve that had begun writes its last iterate
  143  the same after SIGTERM, 129 after SIGHUP

\b
Examples:
  socp solve problems/auv.py
  socp solve auv -m lgr-multiphase -o points=20 -o ipopt.tol=1e-10
  socp check auv.socp.json
  socp plot auv.socp.json -o auv.pdf
  socp report auv.socp.json -o auv.html
  socp compare auv -m euler-ipopt -m trapezoidal -o steps=400
"""


COMPLETING = "_SOCP_COMPLETE"  # set by a shell: what it asks for

# By name: the module in `socp.cli.commands`, imported for that command alone, and a line of help
_COMMANDS: Mapping[str, tuple[str, str]] = {
    "solve": ("solving", "Solve a problem with one method and write the result file."),
    "check": ("checking", "Judge a saved result by Pontryagin's principle."),
    "sensitivity": ("deriving", "Derive a saved extremal by its data."),
    "prove": ("proving", "Prove that the extremal of a saved result exists."),
    "bound": ("proving", "Prove a lower bound of a problem's optimum."),
    "compare": ("comparing", "Solve a problem with several methods and print one table."),
    "census": ("surveying", "Find a problem's extremals from many starts, print a table."),
    "frontier": (
        "surveying",
        "Find the best objective for every number of switches, print a table.",
    ),
    "follow": ("following", "Follow an extremal over one number of its problem."),
    "sweep": ("sweeping", "Solve a problem at many values of its numbers, a row each."),
    "export": (
        "exporting",
        "Write a saved result, or a problem, in the format of another program.",
    ),
    "plot": ("plotting", "Draw a figure of a saved result."),
    "report": ("reporting", "Write a saved result as a page with plots that can be zoomed."),
    "record": ("recording", "Record a saved result for rerun's viewer."),
    "view": ("recording", "Open a recording or a saved result in rerun's viewer."),
    "describe": ("describing", "Describe a method or a problem."),
    "list": ("listing", "List the registered problems."),
    "methods": ("listing", "List the methods."),
    "plugins": ("listing", "Plugins and whether they loaded."),
}


@final
class Commands(click.Group):
    """The commands by their names, each imported when it is called."""

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002
        """Return the names."""
        return sorted(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command by its name; UsageError names the nearest where there is none."""
        if cmd_name in _COMMANDS:
            return _command(cmd_name)
        solve = f"; to solve a problem: socp solve {shlex.quote(cmd_name)}"
        near = solve if cmd_name.endswith(".py") else close(cmd_name, _COMMANDS)
        if near and not ctx.resilient_parsing:
            ctx.fail(f"No such command '{cmd_name}'{near}")
        return None

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write what the help says of the commands."""
        names = self.list_commands(ctx)
        with formatter.section("Commands"):
            formatter.write_dl([(name, _COMMANDS[name][1]) for name in names])


@cache
def _command(name: str) -> click.Command:
    module = import_module(f"socp.cli.commands.{_COMMANDS[name][0]}")
    command: click.Command = vars(module)["list_" if name == "list" else name]
    inner = command.commands.values() if isinstance(command, click.Group) else ()
    for each in (command, *inner):
        kept_apart(each)
    return command


@click.group(
    cls=Commands,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog=EPILOG,
    invoke_without_command=True,
)
@click.version_option(package_name="socp", prog_name="socp", message="%(prog)s %(version)s")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
@click.option(
    "--no-plugin",
    "without",
    multiple=True,
    metavar="NAME",
    help="Leave a plugin out; may be repeated.",
)
@click.pass_context
def socp(context: click.Context, debug: bool, without: tuple[str, ...]) -> int:
    """Singular optimal control problems: arcs, switching times and a verdict from one file and one
    command.

    The environment variable SOCP_PLUGINS, a comma list, names the only plugins to load.
    """
    context.obj.debug, context.obj.without = debug, without
    if context.invoked_subcommand is None:
        click.echo(context.get_help())
    return Exit.SOLVED


def run(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; every error becomes a message."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    session = Session(debug="--debug" in given)
    with parted() as streams, listening():
        code = _ran(session, given)
        with signals_held():
            code = _delivered(streams, session, code)
            asked = heard()
            return 128 + asked if asked and code != Exit.LACKING else code


def _ran(session: Session, given: Sequence[str]) -> int:
    try:
        roomy()
        with _one_line_warnings(session.warn), parsing():
            code = (
                Exit.SOLVED
                if _completed(os.environ.get(COMPLETING))
                else socp.main(
                    args=list(given), prog_name="socp", obj=session, standalone_mode=False
                )
            )
    except (KeyboardInterrupt, click.exceptions.Abort):
        return _interrupted(session)
    except SystemExit as error:
        _say(
            f"internal error: a plugin, or a package that it uses, called exit({error})",
            session,
            error,
        )
        return Exit.INTERNAL
    except (click.ClickException, SocpError) as error:
        return _expected(error, session)
    except BaseException as error:  # noqa: BLE001 - a bug is one line and a hint, not a traceback
        if (
            heard()
        ):  # what Ctrl-C breaks off while a package is imported fails in some other way later
            return _interrupted(session)
        return _internal(error, session, given)
    return code if isinstance(code, int) else Exit.SOLVED


def _completed(asked: str | None) -> bool:
    """Answer a shell that asks for completions; tell whether one does."""
    if not asked:
        return False
    from socp.cli.commands.completing import completed

    completed(socp, COMPLETING, asked)
    return True


def _interrupted(session: Session) -> int:
    with signals_held():
        _say("interrupted; nothing was written", session)
    return Exit.INTERRUPTED


def _delivered(streams: Streams, session: Session, code: int) -> int:
    """Write the report and return the exit code; what was written to files is named where the
    report is lost.
    """
    try:
        streams.deliver()
    except BrokenPipeError:
        return Exit.CLOSED
    except OSError as error:
        _say(
            f"the report cannot be written to standard output: {error.strerror or error}",
            session,
            error,
        )
        for path in session.written:
            messages().print(f"written: {path}", markup=False, soft_wrap=True)
        return Exit.LACKING if code in {Exit.SOLVED, Exit.UNSOLVED} else code
    return code


def _expected(error: click.ClickException | SocpError, session: Session) -> int:
    from socp.registry import PluginError

    text = error.format_message() if isinstance(error, click.ClickException) else str(error)
    _say(text, session, error)
    if isinstance(error, click.UsageError) and error.ctx is not None:
        messages().print(f"see '{error.ctx.command_path} --help'", markup=False)
    if isinstance(error, (ProblemError, PluginError, ContractError)):
        return Exit.LOADING
    if isinstance(error, KeepingError) or lacking(error):
        return Exit.LACKING
    return Exit.USAGE if isinstance(error, (click.ClickException, MethodError)) else Exit.UNSOLVED


def _internal(error: BaseException, session: Session, given: Sequence[str]) -> int:
    if lacking(error):
        _say(lacking(error), session, error)
        return Exit.LACKING
    _say(f"internal error: {type(error).__name__}: {said(error)}", session, error)
    if not session.debug:
        hint = f"this is a bug; see where with: socp --debug {shlex.join(given)}"
        messages().print(hint, markup=False, soft_wrap=True)
    return Exit.INTERNAL


def _say(text: str, session: Session, error: BaseException | None = None) -> None:
    from rich.text import Text

    if session.debug and error is not None:
        messages().print(Text("".join(traceback.format_exception(error))), soft_wrap=True)
    messages().print(Text.assemble(("error: " if error else "", "bold red"), text), soft_wrap=True)


@contextmanager
def _one_line_warnings(warn: Callable[[str], None]) -> Iterator[None]:
    """Show Python's warnings as one line each."""

    def show(message: Any, category: type[Warning], *_place: Any, **_more: Any) -> None:
        """Show a warning in one line, without its place in a file."""
        warn(f"{category.__name__}: {message}")

    with warnings.catch_warnings():
        warnings.showwarning = show
        yield

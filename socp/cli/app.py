"""The command `socp`: its options, its commands, and what becomes of errors."""

import shlex
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import click
from rich.text import Text

from socp import interruption
from socp.cli.checking import check
from socp.cli.comparing import compare
from socp.cli.describing import describe
from socp.cli.exporting import export
from socp.cli.listing import list_, methods, plugins
from socp.cli.machine import abandon_output, lacking, roomy
from socp.cli.plotting import plot
from socp.cli.recording import record, view
from socp.cli.session import Exit, Session, messages
from socp.cli.solving import solve
from socp.cli.surveying import census, frontier
from socp.errors import ContractError, KeepingError, MethodError, ProblemError, SocpError
from socp.registry import PluginError

EPILOG = """\b
Exit codes:
  0    solved: the solver met its tolerances; check: certified as an extremal
  1    ran, but found no acceptable solution (the result is still written); check: not certified
  2    usage: an unknown command, method or option, or a value not allowed
  3    the problem, or the plugin of the method, could not be loaded, or the plugin failed
  4    internal error
  5    the disk or the memory gave out; the message says what is kept, and where
  130  interrupted by Ctrl-C; a solve that had begun writes its last iterate
  143  the same after SIGTERM, 129 after SIGHUP

\b
Examples:
  socp solve problems/auv.py
  socp solve auv -m lgr-multiphase -o points=20 -o ipopt.tol=1e-10
  socp check auv.socp.json
  socp plot auv.socp.json -o auv.pdf
  socp compare auv -m euler-ipopt -m trapezoidal -o steps=400
"""


@click.group(context_settings={"help_option_names": ["-h", "--help"]}, epilog=EPILOG, invoke_without_command=True)
@click.version_option(package_name="socp", prog_name="socp", message="%(prog)s %(version)s")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
@click.option("--no-plugin", "without", multiple=True, metavar="NAME", help="Leave a plugin out; may be repeated.")
@click.pass_context
def socp(context: click.Context, debug: bool, without: tuple[str, ...]) -> int:
    """Singular optimal control problems: arcs, switching times and a verdict from one file and one command.

    The environment variable SOCP_PLUGINS, a comma list, names the only plugins to load.
    """
    context.obj.debug, context.obj.without = debug, without
    if context.invoked_subcommand is None:
        click.echo(context.get_help())
    return Exit.SOLVED


for _command in (
    solve, check, compare, census, frontier, export, plot, record,
    view, describe, list_, methods, plugins,
):
    socp.add_command(_command)


def run(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; every error becomes a message."""
    with interruption.listening():
        code = _run(list(sys.argv[1:] if arguments is None else arguments))
        with interruption.held():
            asked = interruption.heard()
            return 128 + asked if asked and code != Exit.LACKING else code


def _run(given: list[str]) -> int:
    session = Session(debug="--debug" in given)
    try:
        roomy()
        with _one_line_warnings(session.warn):
            code = socp.main(args=given, prog_name="socp", obj=session, standalone_mode=False)
        if sys.stdout is None:  # it was closed from the start
            code = Exit.CLOSED
        else:
            sys.stdout.flush()
    except (KeyboardInterrupt, click.exceptions.Abort):
        return _interrupted(session)
    except SystemExit:  # click's answer to a reader that has gone
        return Exit.CLOSED
    except (click.ClickException, SocpError) as error:
        return _expected(error, session)
    except Exception as error:  # noqa: BLE001 - a bug is one line and a hint, not a traceback
        if interruption.heard():  # what Ctrl-C breaks off while a package is imported fails in some other way later
            return _interrupted(session)
        return _internal(error, session, given)
    return code if isinstance(code, int) else Exit.SOLVED


def _interrupted(session: Session) -> int:
    with interruption.held():
        _say("interrupted; nothing was written", session)
    return Exit.INTERRUPTED


def _expected(error: click.ClickException | SocpError, session: Session) -> int:
    text = error.format_message() if isinstance(error, click.ClickException) else str(error)
    _say(text, session, error)
    _flushed()
    if isinstance(error, click.UsageError) and error.ctx is not None:
        messages().print(f"see '{error.ctx.command_path} --help'", markup=False)
    if isinstance(error, (ProblemError, PluginError, ContractError)):
        return Exit.LOADING
    if isinstance(error, KeepingError) or lacking(error):
        return Exit.LACKING
    return Exit.USAGE if isinstance(error, (click.ClickException, MethodError)) else Exit.UNSOLVED


def _internal(error: Exception, session: Session, given: Sequence[str]) -> int:
    if isinstance(error, BrokenPipeError):  # the reader has gone
        abandon_output()
        return Exit.CLOSED
    if lacking(error):
        _say(lacking(error), session, error)
        _flushed()
        return Exit.LACKING
    _say(f"internal error: {type(error).__name__}: {' '.join(str(error).split())}", session, error)
    if not session.debug:
        hint = f"this is a bug; see where with: socp --debug {shlex.join(given)}"
        messages().print(hint, markup=False, soft_wrap=True)
    return Exit.INTERNAL


def _say(text: str, session: Session, error: BaseException | None = None) -> None:
    if session.debug and error is not None:
        traceback.print_exception(error)
    messages().print(Text.assemble(("error: " if error else "", "bold red"), text), soft_wrap=True)


def _flushed() -> None:
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:  # it would be tried again, and fail, when Python closes
        abandon_output()


@contextmanager
def _one_line_warnings(warn: Callable[[str], None]) -> Iterator[None]:
    """Show Python's warnings as one line each."""

    def show(message: Any, category: type[Warning], *_place: Any, **_more: Any) -> None:
        warn(f"{category.__name__}: {message}")

    with warnings.catch_warnings():
        warnings.showwarning = show
        yield

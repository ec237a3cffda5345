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

from socp.cli.commands.checking import check
from socp.cli.commands.comparing import compare
from socp.cli.commands.deriving import sensitivity
from socp.cli.commands.describing import describe
from socp.cli.commands.exporting import export
from socp.cli.commands.listing import list_, methods, plugins, plugins_list
from socp.cli.commands.plotting import plot
from socp.cli.commands.recording import record, view
from socp.cli.commands.solving import solve
from socp.cli.commands.surveying import census, frontier
from socp.cli.machine import lacking, roomy
from socp.cli.session import Exit, Session, messages
from socp.cli.streams import Streams, kept_apart, parsing, parted
from socp.errors import ContractError, KeepingError, MethodError, ProblemError, SocpError
from socp.process import heard, listening, said, signals_held
from socp.registry import PluginError

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
  socp compare auv -m euler-ipopt -m trapezoidal -o steps=400
"""


@click.group(
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


for _command in (
    solve,
    check,
    sensitivity,
    compare,
    census,
    frontier,
    export,
    plot,
    record,
    view,
    describe,
    list_,
    methods,
    plugins,
):
    socp.add_command(kept_apart(_command))
kept_apart(plugins_list)


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
            code = socp.main(args=list(given), prog_name="socp", obj=session, standalone_mode=False)
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
            messages().print(Text(f"written: {path}"), soft_wrap=True)
        return Exit.LACKING if code in {Exit.SOLVED, Exit.UNSOLVED} else code
    return code


def _expected(error: click.ClickException | SocpError, session: Session) -> int:
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
    if session.debug and error is not None:
        messages().print(Text("".join(traceback.format_exception(error))), soft_wrap=True)
    messages().print(Text.assemble(("error: " if error else "", "bold red"), text), soft_wrap=True)


@contextmanager
def _one_line_warnings(warn: Callable[[str], None]) -> Iterator[None]:
    """Show Python's warnings as one line each."""

    def show(message: Any, category: type[Warning], *_place: Any, **_more: Any) -> None:
        warn(f"{category.__name__}: {message}")

    with warnings.catch_warnings():
        warnings.showwarning = show
        yield

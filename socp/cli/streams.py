"""Standard output belongs to the report: whatever else is printed, by Python or past it, goes to
standard error.
"""

import codecs
import contextlib
import errno
import io
import os
import select
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import wraps
from typing import Any, TextIO, final

import click

from socp.process import flush_library, flush_own, restore

_OUT, _ERR = 1, 2
_LOSSLESS = "socp-lossless"
_CURRENT: "list[Streams]" = []


@final
class Descriptor(io.RawIOBase):
    """A descriptor that may fail: the first failure is kept, what comes after it is dropped.
    Closing leaves it open.
    """

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number
        self.failure: OSError | None = None

    def fileno(self) -> int:
        """Return the descriptor."""
        return self.number

    def isatty(self) -> bool:
        """Tell whether it is a terminal."""
        return os.isatty(self.number)

    def writable(self) -> bool:
        """Tell that it may be written to."""
        return True

    def write(self, data: Any, /) -> int:
        """Write all of some bytes, waiting for a reader that is slow."""
        rest = memoryview(data).cast("B")
        while rest and self.failure is None:
            try:
                rest = rest[os.write(self.number, rest) :]
            except BlockingIOError:
                select.select([], [self.number], [])
            except OSError as error:
                self.failure = error
        return len(data)


@final
@dataclass
class Streams:
    """Where a run of the command line writes: `report` is None where standard output is closed.

    `said` is the report so far; it is written at the end, all at once. `foreign` is what other code
    finds in `sys.stdout`. `own` are the descriptors that were opened for these.
    """

    report: TextIO | None
    messages: TextIO
    foreign: TextIO
    said: io.StringIO = field(default_factory=io.StringIO)
    own: list[int] = field(default_factory=list)

    def deliver(self) -> None:
        """Write the report; OSError says why it cannot be written, BrokenPipeError that its reader
        has gone.
        """
        text = self.said.getvalue()
        self.said.seek(0)
        self.said.truncate()
        if not text:
            return
        if self.report is None:
            raise OSError(errno.EBADF, "it is closed")
        try:
            self.report.write(text)
            self.report.flush()
        except ValueError as error:  # a stream of Python's that was closed
            raise OSError(errno.EBADF, "it is closed") from error
        raw = getattr(getattr(self.report, "buffer", None), "raw", None)
        if isinstance(raw, Descriptor) and raw.failure is not None:
            raise raw.failure


def current() -> Streams | None:
    """Return the streams of the run under way, None outside of one."""
    return _CURRENT[-1] if _CURRENT else None


def say(text: str) -> None:
    """Add a line to the report."""
    streams = current()
    if streams is None:
        click.echo(text)
    else:
        streams.said.write(f"{text}\n")


@contextlib.contextmanager
def parted(*, for_good: bool = False) -> Iterator[Streams]:
    """Keep standard output for the report: descriptor 1 and `sys.stdout` lead to standard error in
    the body.

    `for_good`: they stay so after it, for what libraries print when the process ends. Inside
    another body: the same.
    """
    if _CURRENT:
        yield _CURRENT[-1]
        return
    codecs.register_error(_LOSSLESS, _lossless)
    before, closed = (sys.stdout, sys.stderr), _occupied()
    flush_own()
    flush_library()
    streams, kept = _opened(closed), os.dup(_OUT)
    os.dup2(_ERR, _OUT)
    sys.stdout = streams.foreign
    if sys.stderr is None or _is_on(sys.stderr, _ERR):
        sys.stderr = _text(_ERR, sys.stderr)
    _CURRENT.append(streams)
    try:
        yield streams
    finally:
        if not for_good:
            _CURRENT.pop()
            for stream in (sys.stdout, streams.foreign, streams.messages, before[0]):
                _flushed(stream)
            sys.stdout, sys.stderr = before
            restore(kept)
            for number in [*streams.own, *({_OUT} & closed)]:
                os.close(number)


@contextlib.contextmanager
def parsing() -> Iterator[None]:
    """Take what is printed to `sys.stdout` for the report: the help and the version, which click
    prints itself.
    """
    streams = current()
    with contextlib.nullcontext() if streams is None else contextlib.redirect_stdout(streams.said):
        yield


def kept_apart(command: click.Command) -> click.Command:
    """Have what is printed while a command runs be no part of the report; returns the command."""
    callback = command.callback
    if callback is None:
        return command

    @wraps(callback)
    def call(*given: Any, **named: Any) -> Any:
        """Call a function with what it prints kept apart."""
        streams = current()
        with (
            contextlib.nullcontext()
            if streams is None
            else contextlib.redirect_stdout(streams.foreign)
        ):
            return callback(*given, **named)

    command.callback = call
    return command


def _occupied() -> set[int]:
    """Open the null device on standard descriptors that are closed, lest a file gets their number;
    returns which.
    """
    closed = set()
    for number in (0, _OUT, _ERR):
        try:
            os.fstat(number)
        except OSError:
            closed.add(number)
            os.set_inheritable(
                os.open(os.devnull, os.O_RDWR), True
            )  # it gets the lowest number that is free
    return closed


def _opened(closed: set[int]) -> Streams:
    """Return the streams by what `sys.stdout` and `sys.stderr` are: the descriptors, or objects
    that stand for them.
    """
    report: TextIO | None = sys.stdout
    own = []
    if report is None or _is_on(report, _OUT):
        own.append(os.dup(_OUT))
        report = None if _OUT in closed else _text(own[-1], sys.stdout)
    if sys.stderr is not None and not _is_on(sys.stderr, _ERR):
        return Streams(report, sys.stderr, sys.stderr, own=own)
    own.append(os.dup(_ERR))
    return Streams(report, _text(own[-1], sys.stderr), _text(_OUT, sys.stderr), own=own)


def _is_on(stream: TextIO, number: int) -> bool:
    try:
        return stream.fileno() == number
    except (OSError, ValueError, AttributeError):
        return False


def _text(number: int, like: TextIO | None) -> TextIO:
    """Return a text stream on a descriptor, in the encoding of another; what that cannot write
    becomes an escape.
    """
    encoding = getattr(like, "encoding", None) or "utf-8"
    buffer = io.BufferedWriter(Descriptor(number))
    return io.TextIOWrapper(buffer, encoding, _LOSSLESS, line_buffering=True)


def _lossless(error: UnicodeError) -> tuple[str | bytes, int]:
    """Write bytes of a path that are no text as they are, and signs that the encoding lacks as
    escapes.
    """
    if not isinstance(error, UnicodeEncodeError):
        raise error
    sign = error.object[error.start]
    if "\udc80" <= sign <= "\udcff":
        return bytes([ord(sign) - 0xDC00]), error.start + 1
    return sign.encode("ascii", "backslashreplace").decode("ascii"), error.start + 1


def _flushed(stream: TextIO) -> None:
    with contextlib.suppress(OSError, ValueError, AttributeError):
        stream.flush()

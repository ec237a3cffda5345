"""Calls of plugins: each in a thread of its own and for so many seconds, with standard output kept
out of its reach.
"""

import contextvars
import io
import os
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, redirect_stdout, suppress
from typing import Any, TypeVar

from socp.errors import ContractError

T = TypeVar("T")
# Seconds: rerun's slowest call, that of closing a stream whose viewer is stuck, takes half of it
LIMIT = 60.0
_STREAMS = (1, 2)  # standard output and standard error


def invoke(act: Callable[..., T], *given: Any, **named: Any) -> T:
    """Return what a plugin's function returns; raises what it raises.

    Raises ContractError where it raises what no function may (SystemExit, KeyboardInterrupt and the
    like), where it closes standard output, and where it does not return within LIMIT seconds; then
    it is left behind in its thread, which ends with this process.
    """
    answer: list[T] = []
    raised: list[BaseException] = []

    def work() -> None:
        """Call, and keep what is returned or raised."""
        try:
            answer.append(act(*given, **named))
        except BaseException as error:  # noqa: BLE001 - the caller is told of it, whatever it is
            raised.append(error)

    thread = threading.Thread(target=contextvars.copy_context().run, args=(work,), daemon=True)
    with prints_aside():
        thread.start()
        thread.join(LIMIT)
    if thread.is_alive():
        raise ContractError(f"it did not return within {LIMIT:g} seconds and was left behind")
    if raised:
        raise civil(raised[0])
    return answer[0]


def civil(error: BaseException) -> Exception:
    """Return an error as one that ends nothing but the call that it came from."""
    if isinstance(error, Exception):
        return error
    text = ": ".join(filter(None, (type(error).__name__, str(error))))
    return ContractError(text).with_traceback(error.__traceback__)


@contextmanager
def prints_aside() -> Iterator[None]:
    """Have what Python prints go to standard error, and standard streams that were closed in the
    body opened again.

    Raises ContractError, after the body, where it closed one.
    """
    saved = {number: os.dup(number) for number in _STREAMS if _is_open(number)}
    try:
        with redirect_stdout(_Aside()):
            yield
        closed = [number for number in saved if not _is_open(number)]
        if closed:
            raise ContractError(f"it closed standard {'output' if 1 in closed else 'error'}")
    finally:
        for number, copy in saved.items():
            if not _is_open(number):
                os.dup2(copy, number)
            os.close(copy)


def _is_open(number: int) -> bool:
    try:
        os.fstat(number)
    except OSError:
        return False
    return True


class _Aside(io.TextIOBase):
    """Standard output as plugins find it: what is written goes to standard error, and nobody can
    close that.
    """

    def writable(self) -> bool:
        """Tell that it can be written to."""
        return True

    def write(self, text: str) -> int:
        """Write to standard error, while there is one."""
        with suppress(OSError, ValueError):
            sys.stderr.write(text)
        return len(text)

    def flush(self) -> None:
        """Flush standard error."""
        with suppress(OSError, ValueError):
            sys.stderr.flush()

    def close(self) -> None:
        """Stay open."""

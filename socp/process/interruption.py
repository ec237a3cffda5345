"""Ctrl-C and the signals that ask a program to end: heard once, acted upon where nothing is lost by
it.
"""

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from types import FrameType
from typing import final

ASKING = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)
_USUAL = (signal.SIG_DFL, signal.default_int_handler)
_BURST = (
    1.0  # seconds: what comes so soon after a signal that was acted upon is the same wish, repeated
)


@final
@dataclass(eq=False)
class _Heard:
    """What was heard while the command line listens: every signal, how deep it is held back, when
    one last acted.
    """

    on: bool = False
    signals: list[int] = field(default_factory=list)
    held: int = 0
    acted: float = -float("inf")

    def reset(self, *, on: bool) -> None:
        """Forget everything."""
        self.on, self.signals, self.held, self.acted = on, [], 0, -float("inf")

    def __call__(self, number: int, _frame: FrameType | None) -> None:
        """Take a signal in, and raise KeyboardInterrupt unless it is held back, repeated or acted
        upon already.
        """
        self.signals.append(number)
        if self.held or _unwinding() or time.monotonic() - self.acted < _BURST:
            return
        self.acted = time.monotonic()
        raise KeyboardInterrupt


_HEARD = _Heard()


@contextmanager
def listening(*, to_the_end: bool = False) -> Iterator[None]:
    """Turn the signals of ASKING into KeyboardInterrupt, one for a burst of them; those that are
    ignored stay ignored.

    With `to_the_end` they are ignored afterwards: what the program came to is decided, and Python
    closes in peace. Outside the main thread, where signals are not heard, nothing happens.
    """
    if threading.current_thread() is not threading.main_thread() or _HEARD.on:
        yield
        return
    before = {number: signal.getsignal(number) for number in ASKING}
    mine = {number: handler for number, handler in before.items() if handler in _USUAL}
    _HEARD.reset(on=True)
    for number in mine:
        signal.signal(number, _HEARD)
    try:
        yield
    finally:
        _HEARD.held += 1  # until the old handlers are back
        for number, handler in mine.items():
            signal.signal(number, signal.SIG_IGN if to_the_end else handler)
        _HEARD.reset(on=False)


@contextmanager
def signals_held() -> Iterator[None]:
    """Hold signals back: they are heard, and raise nothing here."""
    _HEARD.held += 1
    try:
        yield
    finally:
        _HEARD.held -= 1


@contextmanager
def breakable() -> Iterator[None]:
    """Let signals raise KeyboardInterrupt in what is otherwise held back."""
    before, _HEARD.held = _HEARD.held, 0
    try:
        yield
    finally:
        _HEARD.held = before


def heard() -> int:
    """Return the first signal that was heard while listening, 0 if there was none."""
    return _HEARD.signals[0] if _HEARD.signals else 0


@contextmanager
def requesting(stop: Callable[[], None]) -> Iterator[None]:
    """Turn signals into a request, for a solver that ends in good order by itself: Ctrl-C, and what
    is listened to.

    Raises KeyboardInterrupt at once where one was heard before, and was lost on the way here.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def request(number: int, _frame: FrameType | None) -> None:
        """Ask the solver to stop, and note the signal where signals are listened to."""
        stop()
        if _HEARD.on:
            _HEARD.signals.append(number)
            _HEARD.acted = time.monotonic()

    before = {number: signal.getsignal(number) for number in ASKING}
    for number, handler in before.items():
        if handler is _HEARD or (number == signal.SIGINT and callable(handler)):
            signal.signal(number, request)
    try:
        give_way()
        yield
    finally:
        for number, handler in before.items():
            if signal.getsignal(number) is request:
                signal.signal(number, handler)


def listens() -> bool:
    """Tell whether signals are turned into KeyboardInterrupt here."""
    return _HEARD.on


def give_way() -> None:
    """Raise KeyboardInterrupt where a signal was heard: before work that is begun for nothing
    then.
    """
    if _HEARD.signals:
        raise KeyboardInterrupt


def _unwinding() -> bool:
    """Tell whether a KeyboardInterrupt is being dealt with, in an `except` or a `finally`."""
    error = sys.exc_info()[1]
    while error is not None:
        if isinstance(error, KeyboardInterrupt):
            return True
        error = error.__context__
    return False

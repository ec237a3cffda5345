"""Threads of the linear algebra: one, while the small matrices here are worked on."""

from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any, final

from threadpoolctl import ThreadpoolController


@final
class _Held:
    """How many hold BLAS to one thread now, and the limit that they share."""

    def __init__(self) -> None:
        self.lock, self.count = Lock(), 0
        self.limit: Any = None


_HELD = _Held()


@contextmanager
def one_thread() -> Iterator[None]:
    """Hold BLAS to one thread inside; the setting that was found is back when the last one leaves.

    Matrices of some hundred rows take more time with threads than without, which spin while they
    wait, and the more so side by side. A setting is the whole process's: what runs in other threads
    meanwhile has one too. May be nested; decorates functions as well.
    """
    with _HELD.lock:
        if _HELD.count == 0:  # libraries are looked for anew: more may have been loaded since
            _HELD.limit = ThreadpoolController().limit(limits=1, user_api="blas")
        _HELD.count += 1
    try:
        yield
    finally:
        with _HELD.lock:
            _HELD.count -= 1
            if _HELD.count == 0 and _HELD.limit is not None:
                _HELD.limit.restore_original_limits()
                _HELD.limit = None

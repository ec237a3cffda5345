"""Jobs over worker processes: a worker that dies costs its job alone, and whoever waits can stop
them all.
"""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, TypeVar

from socp.model import Progress
from socp.solvers import end_with

T = TypeVar("T")
_MASKS = hasattr(signal, "pthread_sigmask")
_HERE: list[Any] = []  # in a worker: the event that asks it to stop


def results_of(
    task: Callable[[int], T], numbers: Sequence[int], jobs: int
) -> Iterator[tuple[int, T | None]]:
    """Yield every number with what the task makes of it in a process of its own, as it comes; None:
    its worker died.

    Where a worker dies, all that were under way are tried again, each alone; the one whose worker
    dies again is to blame. The task is pickled. Closing the iterator, or Ctrl-C, ends the workers:
    what they are at is lost, what they have finished is yielded before.
    """
    waiting = deque(numbers)
    while waiting:
        suspects = yield from _pooled(task, waiting, jobs)
        for number in suspects:
            if (yield from _pooled(task, deque([number]), 1)):
                yield number, None


def asked(_progress: Progress, /) -> bool:
    """Watch for the wish, seen in a worker, that it should stop."""
    return bool(_HERE) and bool(_HERE[0].is_set())


def _pooled(
    task: Callable[[int], T], waiting: deque[int], jobs: int
) -> Generator[tuple[int, T | None], None, list[int]]:
    """Work a queue off with one pool of processes; returns the numbers that were under way when a
    worker died.
    """
    context = multiprocessing.get_context("spawn")
    before = set(multiprocessing.active_children())
    running = dict[Future[T], int]()
    with _sheltered():  # the first event starts a process too, which tracks it
        stop = context.Event()
        pool = ProcessPoolExecutor(min(jobs, len(waiting)), context, _begin, (stop, os.getpid()))
    try:
        while waiting or running:
            while (
                waiting and len(running) < jobs
            ):  # no more than are worked on: the others are not under suspicion
                with _sheltered():
                    running[pool.submit(task, waiting[0])] = waiting[0]
                waiting.popleft()
            try:
                done, _ = wait(running, return_when=FIRST_COMPLETED)
            except KeyboardInterrupt:
                for future in [
                    each for each in running if each.done() and each.exception() is None
                ]:
                    yield running.pop(future), future.result()
                raise
            for future in [
                each for each in done if not isinstance(each.exception(), BrokenProcessPool)
            ]:
                yield running.pop(future), future.result()
            if any(isinstance(each.exception(), BrokenProcessPool) for each in done):
                break
    except BrokenProcessPool:  # it was found broken when the next job was handed in
        pass
    finally:
        stop.set()
        if running:  # interrupted, or broken: nobody wants what they are at
            for worker in set(multiprocessing.active_children()) - before:
                worker.kill()
        pool.shutdown(cancel_futures=True)
    return sorted(running.values())


@contextmanager
def _sheltered() -> Iterator[None]:
    """Start processes that Ctrl-C does not reach, not even at their start, and that import nothing
    from this folder.
    """
    safe = os.environ.get("PYTHONSAFEPATH")
    os.environ["PYTHONSAFEPATH"] = "1"
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}) if _MASKS else set()
    try:
        yield
    finally:
        if _MASKS:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        if safe is None:
            del os.environ["PYTHONSAFEPATH"]
        else:
            os.environ["PYTHONSAFEPATH"] = safe


def _begin(stop: Any, parent: int) -> None:
    """Prepare a worker: Ctrl-C is its parent's business, and it does not outlive that parent."""
    _HERE[:] = [stop]
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    end_with(parent)
    threading.Thread(target=_follow_parent, daemon=True).start()


def _follow_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)

"""Jobs over workers: processes of this machine, or any `concurrent.futures.Executor`; whoever waits
can stop them all.
"""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import cache
from typing import Any, TypeVar

from socp.model import Problem, Progress
from socp.process import end_with

J = TypeVar("J")
T = TypeVar("T")
_MASKS = hasattr(signal, "pthread_sigmask")
_HERE: list[Any] = []  # in a worker: the event that asks it to stop
_CLUSTER = "distributed"  # the package whose errors tell of workers that died


def results_of(
    task: Callable[[J], T], waiting: deque[J], workers: int | Executor
) -> Generator[tuple[J, T | None], None, None]:
    """Yield every job with what the task makes of it in a worker, as it comes; None: its worker
    died. Jobs may be added to the queue between two results.

    `workers`: a number of processes, or an executor, which is handed all that waits; it belongs to
    the caller, who shuts it down. Where a process dies, all that were under way are tried again,
    each alone; the one whose process dies again is to blame. An executor does that by itself, or
    not at all. Task and jobs are pickled. Closing the iterator, or Ctrl-C, ends the processes: what
    they are at is lost, what they have finished is yielded before.
    """
    if isinstance(workers, Executor):
        yield from _handed(task, waiting, workers)
        return
    while waiting:
        suspects = yield from _pooled(task, waiting, workers)
        for job in suspects:
            if (yield from _pooled(task, deque([job]), 1)):
                yield job, None


@contextmanager
def pool(count: int) -> Iterator[Executor]:
    """Yield so many processes of this machine, which are prepared as those of `results_of` are, and
    end with the block.
    """
    context = multiprocessing.get_context("spawn")
    before = set(multiprocessing.active_children())
    with _sheltered():
        stop = context.Event()
        found = ProcessPoolExecutor(count, context, _begin, (stop, os.getpid()))
        for _ in range(count):  # they start when they are needed, which is to be here
            found.submit(os.getpid)
    try:
        yield found
    finally:
        stop.set()
        found.shutdown(wait=False, cancel_futures=True)
        for worker in set(multiprocessing.active_children()) - before:
            worker.kill()


def asked(_progress: Progress | None = None, /) -> bool:
    """Watch for the wish, seen in a worker, that it should stop."""
    return bool(_HERE) and bool(_HERE[0].is_set())


def _handed(
    task: Callable[[J], T], waiting: deque[J], executor: Executor
) -> Iterator[tuple[J, T | None]]:
    """Work a queue off with an executor."""
    running = dict[Future[T], J]()
    try:
        while waiting or running:
            while waiting:
                job = waiting.popleft()
                running[executor.submit(task, job)] = job
            done, _ = wait(running, return_when=FIRST_COMPLETED)
            for future in done:
                yield running.pop(future), _outcome(future)
    finally:
        for future in running:
            future.cancel()


def _outcome(future: Future[T]) -> T | None:
    """Return what a job came to, None where its worker died."""
    try:
        return future.result()
    except (BrokenExecutor, CancelledError):
        return None
    except Exception as error:
        if type(error).__module__.partition(".")[0] != _CLUSTER:
            raise
        return None


def _pooled(
    task: Callable[[J], T], waiting: deque[J], count: int
) -> Generator[tuple[J, T | None], None, list[J]]:
    """Work a queue off with one pool of processes; returns the jobs that were under way when a
    worker died.
    """
    context = multiprocessing.get_context("spawn")
    before = set(multiprocessing.active_children())
    running = dict[Future[T], J]()
    with _sheltered():  # the first event starts a process too, which tracks it
        stop = context.Event()
        pool = ProcessPoolExecutor(count, context, _begin, (stop, os.getpid()))
    try:
        _begun(pool, task, count - len(waiting))
        while waiting or running:
            while (
                waiting and len(running) < count
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
    return list(running.values())


def _begun(pool: Executor, task: Callable[[J], T], idle: int) -> None:
    """Start so many processes that have no job yet, and import by then what the task is made of."""
    with _sheltered():
        for _ in range(idle):
            pool.submit(callable, task)


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


@cache
def loaded(load: Callable[[], Problem]) -> Problem:
    """Return the problem that a worker's jobs are about, loaded once."""
    return load()

"""Whose hands do the work: processes, an executor that is handed in, or a cluster of dask."""

from collections.abc import Iterator
from concurrent.futures import Executor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any, final

from socp import errors
from socp.errors import MethodError
from socp.process import short

LOCAL = "local"
_PATIENCE = 20  # seconds until a scheduler that does not answer is taken not to be there


@final
@dataclass(frozen=True, eq=False)
class Hands:
    """A number of processes, or an executor, and where the dashboard of dask is to be seen."""

    workers: int | Executor
    dashboard: str = ""


@contextmanager
def engine(workers: Any, count: int | None = None) -> Iterator[Hands]:
    """Yield what does the work: a number of processes; an executor, or a client of dask, which the
    caller ends; by the address of a scheduler, or `local`, with `count` processes, one of dask's.

    Raises MethodError for anything else, where dask is not installed, and where no scheduler
    answers.
    """
    if isinstance(workers, str):
        with ExitStack() as stack:
            client = _client(stack, workers, count)
            yield Hands(client.get_executor(), str(client.dashboard_link))
    elif isinstance(workers, Executor):
        yield Hands(workers)
    elif hasattr(workers, "get_executor"):
        yield Hands(workers.get_executor(), str(workers.dashboard_link))
    elif isinstance(workers, int) and workers >= 1:
        yield Hands(workers)
    else:
        raise MethodError(
            f"workers: {short(repr(workers))} where a number of processes, an executor, or the "
            "address of a dask scheduler is needed"
        )


def _client(stack: ExitStack, address: str, count: int | None) -> Any:
    """Return a client of dask, which ends with the stack, as does a cluster made for it."""
    distributed = errors.load("distributed", "dask", "workers of dask")
    if address == LOCAL:  # a thread a worker: what computes here holds the interpreter
        cluster = distributed.LocalCluster(n_workers=count, threads_per_worker=1)
        return stack.enter_context(distributed.Client(stack.enter_context(cluster)))
    try:
        return stack.enter_context(distributed.Client(address, timeout=_PATIENCE))
    except (OSError, ValueError) as error:
        raise MethodError(f"dask {short(address)}: no scheduler answers there: {error}") from error

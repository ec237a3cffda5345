"""What a solver or a search tells while it runs, and who listens."""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol, final

import numpy as np

from socp.model.result.solution import Solution


@final
@dataclass(frozen=True)
class Progress:
    """What a solver or a search tells while it runs.

    stage: what is being done; word, best, violation: of a search, the word it is at, its best
    objective so far and how far that one is from an extremal (nan where unknown). v (n,): the point
    of a programme; `iterate` lifts it to a solution, and costs something: call it only for what is
    shown.
    """

    stage: str
    iteration: int
    objective: float
    infeasibility: float
    word: str = ""
    best: float = float("nan")
    violation: float = float("nan")
    v: np.ndarray | None = field(default=None, compare=False, repr=False)
    iterate: Callable[[], Solution] | None = field(default=None, compare=False, repr=False)


class Watch(Protocol):
    """Called with the progress of every iteration; a true answer asks the solver to stop with its
    last iterate.
    """

    def __call__(self, progress: Progress, /) -> bool:
        """Look at the progress."""


def search_watch(watch: Watch, stage: str, word: str, best: Solution | None) -> Watch:
    """Return a watch that is told of the word a search is at and of its best solution so far too.

    A silent one stays silent: what nobody sees is not worked out.
    """
    if watch is silent:
        return silent
    verdict = best.verdict if best else None
    told = {
        "best": best.objective if best else float("nan"),
        "violation": verdict.residual if verdict else float("nan"),
    }
    return lambda now: watch(replace(now, stage=stage, word=word, **told))


def staged(watch: Watch, stage: str) -> Watch:
    """Return a watch that is told what a solver works for; a silent one stays silent."""
    if watch is silent:
        return silent
    return lambda now: watch(replace(now, stage=f"{stage}, {now.stage}"))


def silent(_progress: Progress, /) -> bool:
    """Watch nothing and never stop."""
    return False

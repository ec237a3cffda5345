"""Nonlinear programmes as frozen records, the points that solvers return, and the protocol of a backend."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar, final

import numpy as np

from socp.solution import Solution, Stop
from socp.symbols import Expr

Q = TypeVar("Q")
S = TypeVar("S")
T = TypeVar("T")


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class NLP:
    """Minimise f(v) subject to v_box[0] <= v <= v_box[1] and g_box[0] <= g(v) <= g_box[1].

    v (n, 1), f (1, 1) and g (m, 1) are casadi SX; v_box (2, n); g_box (2, m); binary (n,) flags what must be 0 or 1.
    """

    v: Expr
    f: Expr
    g: Expr
    v_box: np.ndarray
    g_box: np.ndarray
    binary: np.ndarray


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class NLPPoint:
    """A point v (n,) with its multipliers: the Lagrangian is f + lam_g . g + lam_v . v."""

    v: np.ndarray
    objective: float = float("nan")
    lam_v: np.ndarray | None = None
    lam_g: np.ndarray | None = None
    stop: Stop = Stop.FAILED
    message: str = ""
    iterations: int = 0
    trace: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    seconds: Mapping[str, float] = field(default_factory=dict)


@final
@dataclass(frozen=True)
class Progress:
    """What a solver or a search tells while it runs.

    stage: what is being done; word, best, violation: of a search, the word it is at, its best objective so far and how
    far that one is from an extremal (nan where unknown). v (n,): the point of a programme; `iterate` lifts it to a
    solution, and costs something: call it only for what is shown.
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
    """Called with the progress of every iteration; a true answer asks the solver to stop with its last iterate."""

    def __call__(self, progress: Progress, /) -> bool:
        """Look at the progress."""


def silent(_progress: Progress, /) -> bool:
    """Watch nothing and never stop."""
    return False


class Backend(Protocol):
    """Anything that solves an NLP from a guess."""

    def __call__(self, nlp: NLP, guess: NLPPoint, watch: Watch = silent) -> NLPPoint:
        """Solve; a failure is a point with its `stop`, not an exception."""


@final
@dataclass(frozen=True)
class Reduced(Generic[Q, S, T]):
    """A problem rewritten: `push` carries a guess down into it, `lift` carries a point back up."""

    problem: Q
    push: Callable[[S], T]
    lift: Callable[[T], S]

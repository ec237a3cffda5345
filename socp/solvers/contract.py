"""Nonlinear programmes as frozen records, the points that solvers return, and the protocol of a
backend.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Generic, Protocol, Self, TypeVar, final

import numpy as np

from socp.model import Expr, Stop, Watch, silent

Q = TypeVar("Q")
S = TypeVar("S")
T = TypeVar("T")


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Derivatives:
    """Derivatives of a programme as casadi functions that a solver is handed with `nlp` x, p -> f,
    g: `grad_f` x, p -> f, grad_f_x (n, 1); `jac_g` x, p -> g, jac_g_x (m, n); `hess_lag` x, p,
    lam_f, lam_g -> the upper triangle of the Lagrangian's Hessian (n, n). In `grad_f` and `jac_g` f
    and g are empty: casadi asks for their places, and reads neither there.
    """

    nlp: Any
    grad_f: Any
    jac_g: Any
    hess_lag: Any


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class NLP:
    """Minimise f(v) subject to v_box[0] <= v <= v_box[1] and g_box[0] <= g(v) <= g_box[1].

    `formula` writes v (n, 1), f (1, 1) and g (m, 1) as casadi SX, once they are asked for; v_box
    (2, n); g_box (2, m); binary (n,) flags what must be 0 or 1; `unit` is what f is measured in:
    the objective is unit * f. `derivatives` gives those of f and g where they are known, None where
    a solver has to find them, with no need of the formula; whoever replaces that replaces them too.
    """

    formula: Callable[[], tuple[Expr, Expr, Expr]]
    v_box: np.ndarray
    g_box: np.ndarray
    binary: np.ndarray
    unit: float = 1.0
    derivatives: Callable[[], Derivatives] | None = None

    @classmethod
    def of(cls, v: Expr, f: Expr, g: Expr, **known: Any) -> Self:
        """Return a programme that is written down, with all else."""
        return cls(formula=lambda: (v, f, g), **known)

    @property
    def v(self) -> Expr:
        """The variables (n, 1)."""
        return self._written[0]

    @property
    def f(self) -> Expr:
        """The objective (1, 1) over its unit."""
        return self._written[1]

    @property
    def g(self) -> Expr:
        """The rows (m, 1)."""
        return self._written[2]

    @cached_property
    def _written(self) -> tuple[Expr, Expr, Expr]:
        return self.formula()

    @property
    def count(self) -> int:
        """Number n of the variables."""
        return int(self.v_box.shape[1])

    @property
    def rows(self) -> int:
        """Number m of the rows."""
        return int(self.g_box.shape[1])


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

    @classmethod
    def of(cls, result: Mapping[str, Any], **known: Any) -> Self:
        """Return the point of what one of casadi's solvers gives back, with what else is known."""
        v, lam_v, lam_g = (np.array(result[k].full()).ravel() for k in ("x", "lam_x", "lam_g"))
        return cls(v=v, lam_v=lam_v, lam_g=lam_g, objective=float(result["f"]), **known)


class Solver(Protocol):
    """Anything that solves an NLP from a guess."""

    def __call__(self, nlp: NLP, guess: NLPPoint, watch: Watch = silent) -> NLPPoint:
        """Solve; a failure is a point with its `stop`, not an exception."""


class Backend(Solver, Protocol):
    """A solver that is chosen by its name, and told in these words what a search needs of it.

    `options` are its own, set by hand; each word is translated into them, and a tolerance set by
    hand stays.
    """

    @property
    def name(self) -> str:
        """Name on the command line, in front of its options as well."""

    @property
    def options(self) -> Mapping[str, Any]:
        """Options set by hand, by its own names."""

    def limited(self, iterations: int, lost: int | None = None, /) -> Self:
        """Return it with so many iterations at most, and `lost` in a row, where that is told, that
        seek the constraints and nothing else.
        """

    def within(self, tolerance: float) -> Self:
        """Return it with a tolerance on residuals and violations."""

    def scaled(self, factor: float) -> Self:
        """Return it with the objective multiplied while it solves; points come back unscaled."""

    def nearby(self) -> Self:
        """Return it for a guess that is near the solution, which it should not leave."""


@final
@dataclass(frozen=True)
class Reduced(Generic[Q, S, T]):
    """A problem rewritten: `push` carries a guess down into it, `lift` carries a point back up."""

    problem: Q
    push: Callable[[S], T]
    lift: Callable[[T], S]

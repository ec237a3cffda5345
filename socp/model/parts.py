"""Parts of a problem: named state constraints, named end conditions, known values to compare
with.
"""

from dataclasses import dataclass
from typing import final

from socp.model.symbols import Expr


@final
@dataclass(frozen=True, eq=False)
class Constraint:
    """A state constraint c(x, t, p) <= 0; a bound of state `v` is named `v.lower` or `v.upper`."""

    name: str
    expression: Expr


@final
@dataclass(frozen=True, eq=False)
class EndCondition:
    """An end condition psi = 0 (equation) or psi <= 0 on x(t0), x(tf), t0, tf and the
    parameters.
    """

    name: str
    expression: Expr
    equation: bool


@final
@dataclass(frozen=True, kw_only=True)
class Reference:
    """Known values to compare with; no method reads them."""

    objective: float
    switches: tuple[float, ...] = ()
    word: str = ""
    tolerance: float = 1e-9
    source: str = ""

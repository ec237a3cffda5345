"""Direct collocation on a uniform grid in one phase: a method is a scheme, a grid and a source.

`euler-ipopt` is implicit Euler on 1000 steps, `lgr` four Legendre-Gauss-Radau points on each of 40
intervals. Another one is a row of TABLE here and its scheme in `socp.transcription`.
"""

from collections.abc import Callable, Mapping
from dataclasses import Field, dataclass, make_dataclass
from typing import Any, final

from socp import (
    Backend,
    Method,
    Problem,
    Solution,
    Watch,
    hookimpl,
    option,
    silent,
    single_phase,
)
from socp.methods import solve_uniform
from socp.solvers import default_backend
from socp.transcription import Scheme, euler, hermite_simpson, lgr, trapezoid


@final
@dataclass(frozen=True)
class Row:
    """One method: its class, its name, its scheme, and what users read of it.

    `sizes` are its whole-number options with their defaults: the first is the number of intervals
    of the grid, the others are what the scheme takes.
    """

    kind: str
    name: str
    scheme: Callable[..., Scheme]
    sizes: Mapping[str, int]
    about: str
    source: str


TABLE = (
    Row(
        "EulerIpopt",
        "euler-ipopt",
        euler,
        {"steps": 1000},
        "Order 1, and the calmest grid: its controls seldom ring. A robust start for sharper "
        "methods.",
        "doi:10.3934/dcdsb.2019092, section 4 (AMPL + IPOPT)",
    ),
    Row(
        "Trapezoidal",
        "trapezoidal",
        trapezoid,
        {"steps": 400},
        "Order 2 with a control linear between the steps; on singular and boundary arcs that "
        "control rings.",
        "doi:10.3934/dcdsb.2019092, section 4 (ICLOCS); Betts, Practical Methods, 4.5",
    ),
    Row(
        "HermiteSimpson",
        "hermite-simpson",
        hermite_simpson,
        {"steps": 200},
        "Order 4 where the control is smooth; a control quadratic between the steps, which rings "
        "on singular arcs.",
        "Betts, Practical Methods for Optimal Control Using Nonlinear Programming, 4.6",
    ),
    Row(
        "Lgr",
        "lgr",
        lgr,
        {"intervals": 40, "points": 4},
        "Spectral order on smooth arcs; it does not know where the control jumps.",
        "Garg et al., Automatica 46 (2010), doi:10.1016/j.automatica.2010.06.048",
    ),
)

# What an option of a size says of itself, and the most it may be; None: as many as fit into memory
_SIZES: Mapping[str, tuple[str, int | None]] = {
    "steps": ("steps of equal length", None),
    "intervals": ("intervals of equal length", None),
    "points": ("collocation points an interval", 100),
}


def _method(row: Row) -> type[Method]:
    """Return the class that a row describes, its options in the order of the row."""

    def solve(self: Any, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
        """Solve on one phase."""
        count, *points = (getattr(self, size) for size in row.sizes)
        scheme, phased = row.scheme(*points), single_phase(problem)
        return solve_uniform(phased, scheme, count, self.backend, guess, watch)

    fields: list[tuple[str, type, Field[Any]]] = []
    for size, default in row.sizes.items():
        doc, most = _SIZES[size]
        fields.append((size, int, option(default, doc, least=1, most=most)))
    fields.append(
        ("backend", Backend, option(default_backend(), "solver of the nonlinear programme"))
    )
    texts = {"name": row.name, "source": row.source, "__doc__": row.about}
    body = {**texts, "solve": solve, "__module__": __name__}  # pickles ask the module for the class
    return final(make_dataclass(row.kind, fields, bases=(Method,), namespace=body, frozen=True))


_METHODS = {row.kind: _method(row) for row in TABLE}


def __getattr__(name: str) -> type[Method]:
    """Return the method of a class name, as imports and pickles ask for it."""
    if name in _METHODS:
        return _METHODS[name]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *_METHODS})


@hookimpl
def socp_methods() -> list[type[Method]]:
    """Register the methods."""
    return [*_METHODS.values()]

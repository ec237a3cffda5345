"""Sums of squares: polynomials, affine in unknown coefficients, that are to be at least zero on
regions, as a semidefinite programme.
"""

import time
import warnings
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from typing import Any, final

import numpy as np
from scipy import sparse

from socp.errors import SolveError, load
from socp.proof.bound.lifting import Polynomial, fraction
from socp.proof.bound.sets import Region

Exponents = tuple[int, ...]
Table = dict[Exponents, Any]

# A semidefinite block costs the sixth power of its size: one of 130 takes minutes
LARGEST = 130
# Seconds of a programme at all, and a multiplication of its factorisation, of which some thirty
# are made: what Clarabel takes on one core
_SETUP, _PACE = 0.2, 1.2e-8
# Of a subsolution: its derivatives along the motion have many times as many
MOST = 1000


def monomials(
    region: Region,
    caps: Mapping[int, int],
    degree: int,
    most: int = MOST,
    alone: Container[int] = (),
) -> list[Exponents]:
    """Return the monomials of coordinates up to a degree, each place up to its own; on a circle the
    sine stands at most once, and cosine and sine share the cosine's cap. Places that stand alone
    are multiplied with no other. SolveError where there are more than the most allowed.
    """
    places, pairs = sorted(caps), region.circles()
    top = {**caps, **{sine: min(caps.get(sine, 0), 1) for sine, _ in pairs}}
    found: list[dict[int, int]] = [{}]
    for place in places:
        longer = [
            {**its, place: power}
            for its in found
            for power in range(1, min(top[place], degree - sum(its.values())) + 1)
        ]
        found += [its for its in longer if _allowed(its, caps, pairs, alone)]
        if len(found) > most:
            raise SolveError(f"more than {most} monomials of degree {degree}")
    size = len(region.lift.names)
    every = [tuple(its.get(k, 0) for k in range(size)) for its in found]
    return sorted(every, key=lambda each: (sum(each), each))


def _allowed(
    its: Mapping[int, int],
    caps: Mapping[int, int],
    pairs: list[tuple[int, int]],
    alone: Container[int],
) -> bool:
    on_circle = all(its.get(s, 0) + its.get(c, 0) <= caps.get(c, 0) for s, c in pairs)
    return on_circle and (sum(its.values()) <= 1 or not any(k in alone for k in its))


def table(region: Region, given: Polynomial) -> Table:
    """Return a polynomial of coordinates as fractions by exponents, reduced on circles."""
    its = {tuple(map(int, e)): fraction(c) for e, c in given.to_dict().items()}
    return region.reduced(its)


@final
@dataclass(frozen=True, eq=False)
class Demand:
    """That constant + sum v_j parts_j, in coordinates of a region, is at least zero on it; with a
    margin in the constant, less than which has to be left of it.
    """

    name: str
    region: Region
    constant: Table
    parts: list[Table]
    margin: float = inf

    @property
    def empty(self) -> bool:
        """Whether nothing is demanded."""
        return not self.constant and not any(self.parts)

    def at(self, coefficients: Sequence[Any]) -> Table:
        """Return the polynomial with given coefficients, exactly."""
        found = dict(self.constant)
        for value, part in zip(coefficients, self.parts, strict=True):
            for exponents, its in part.items():
                found[exponents] = found.get(exponents, 0) + value * its
        return {exponents: value for exponents, value in found.items() if value}


@final
@dataclass(frozen=True, eq=False)
class Blocks:
    """The squares that a demand is to be a sum of: a basis (m,) to every guard, and the matrix from
    all Gram matrices (column by column) to coefficients of `rows`.
    """

    demand: Demand
    kinds: list[Any]
    bases: list[list[Exponents]]
    rows: list[Exponents]
    matrix: sparse.csr_matrix

    @classmethod
    def of(cls, demand: Demand) -> "Blocks":
        """Return the blocks of a demand; SolveError where one is too large."""
        region = demand.region
        present = {
            each
            for its in (demand.constant, *demand.parts)
            for each in its
            if all(region.wide(k) for k, power in enumerate(each) if power)
        }
        tops = _tops(region, present)
        half = (max(map(sum, present), default=0) + 1) // 2
        kinds, guards, bases = [], [], []
        for kind, guard in [("one", {(0,) * len(region.lift.names): 1}), *_guards(region, present)]:
            its, degree = _tops(region, guard), half - (max(map(sum, guard)) + 1) // 2
            if degree >= 0:
                caps = {
                    k: max((top + 1) // 2 - (its.get(k, 0) + 1) // 2, 0) for k, top in tops.items()
                }
                kinds.append(kind)
                guards.append(guard)
                bases.append(monomials(region, caps, degree, LARGEST))
        return cls(demand, kinds, bases, *_matched(region, present, guards, bases))

    def linear(self) -> tuple[np.ndarray, sparse.csr_matrix]:
        """Return the demand's coefficients in `rows`, (rows,) and (rows, n)."""
        at = {exponents: k for k, exponents in enumerate(self.rows)}
        constant = np.zeros(len(self.rows))
        for exponents, value in self.demand.constant.items():
            if exponents in at:
                constant[at[exponents]] = float(value)
        entries = [
            (at[exponents], j, float(value))
            for j, part in enumerate(self.demand.parts)
            for exponents, value in part.items()
            if exponents in at
        ]
        rows, columns, values = zip(*entries, strict=True) if entries else ((), (), ())
        shape = (len(self.rows), len(self.demand.parts))
        return constant, sparse.csr_matrix((values, (rows, columns)), shape=shape)


def _tops(region: Region, present: Any) -> dict[int, int]:
    """Return the largest exponent of every place that occurs; of a circle that of both together."""
    found: dict[int, int] = {}
    pairs = region.circles()
    for exponents in present:
        its = {k: power for k, power in enumerate(exponents) if power}
        for s, c in pairs:
            both = its.get(s, 0) + its.get(c, 0)
            its |= {s: both, c: both} if both else {}
        for k, power in its.items():
            found[k] = max(found.get(k, 0), power)
    return found


def _guards(region: Region, present: Any) -> Iterator[tuple[Any, Table]]:
    """Yield 1 - z^2 of every coordinate that occurs, and the region's own guards in coordinates,
    with what a certificate calls them.
    """
    used = {k for exponents in present for k, power in enumerate(exponents) if power}
    round_places = {place for pair in region.circles() for place in pair}
    zero = (0,) * len(region.lift.names)
    for k in sorted(used - round_places):
        if region.wide(k) and region.bounded(k):
            square = tuple(2 if i == k else 0 for i in range(len(zero)))
            yield ["box", k], {zero: 1, square: -1}
    for k, guard in enumerate(region.guards):
        its = table(region, region.scaled(guard))
        if its and {k for e in its for k, power in enumerate(e) if power} <= used:
            yield ["given", k], its


def _matched(
    region: Region, present: Any, guards: list[Table], bases: list[list[Exponents]]
) -> tuple[list[Exponents], sparse.csr_matrix]:
    rows: dict[Exponents, int] = {exponents: k for k, exponents in enumerate(sorted(present))}
    entries: list[tuple[int, int, float]] = []
    offset = 0
    for guard, basis in zip(guards, bases, strict=True):
        plain = {exponents: float(value) for exponents, value in guard.items()}
        for i, a in enumerate(basis):
            for j, b in enumerate(basis):
                both = tuple(map(int.__add__, a, b))
                raw: Table = {tuple(map(int.__add__, both, e)): value for e, value in plain.items()}
                for exponents, value in region.reduced(raw).items():
                    row = rows.setdefault(exponents, len(rows))
                    entries.append((row, offset + i * len(basis) + j, value))
        offset += len(basis) ** 2
    row_places, columns, values = zip(*entries, strict=True)
    matrix = sparse.csr_matrix((values, (row_places, columns)), shape=(len(rows), offset))
    return list(rows), matrix


@final
@dataclass(frozen=True, eq=False)
class Solved:
    """Coefficients (n,) and Gram matrices by demand, and the seconds that these took."""

    value: float
    coefficients: np.ndarray
    grams: list[list[np.ndarray]]
    seconds: float


def expense(blocks: Sequence[Blocks]) -> float:
    """Return the seconds that a programme takes, about: a block is a dense matrix of its entries'
    pairs.
    """
    sizes = [len(basis) * (len(basis) + 1) // 2 for each in blocks for basis in each.bases]
    rows = sum(len(each.rows) for each in blocks)
    return _SETUP + _PACE * (sum(float(size) ** 3 for size in sizes) + float(rows) ** 3) / 3


def solved(
    objective: np.ndarray,
    blocks: Sequence[Blocks],
    left: Callable[[], float],
    enough: float = inf,
) -> Solved:
    """Return the coefficients v (n,) with the largest objective . v, up to what is enough, that
    satisfy all demands.

    `left` returns the seconds that are left. Raises SolveError where the solver finds none.
    """
    cvxpy = load("cvxpy", "prove", "a lower bound")

    v = cvxpy.Variable(len(objective))
    conditions, grams = [], []
    for each in blocks:
        constant, linear = each.linear()
        its = [
            cvxpy.Variable((len(basis),) * 2, PSD=True)
            if len(basis) > 1
            else cvxpy.Variable((1, 1), nonneg=True)
            for basis in each.bases
        ]
        stacked = cvxpy.hstack([cvxpy.vec(gram, order="F") for gram in its])
        conditions.append(linear @ v + constant == each.matrix @ stacked)
        grams.append(its)
    if enough < inf:
        conditions.append(objective @ v <= enough)
    problem, began = cvxpy.Problem(cvxpy.Maximize(objective @ v), conditions), time.monotonic()
    try:
        with warnings.catch_warnings():  # how accurate it is shows when it is checked
            warnings.simplefilter("ignore")
            problem.solve(solver="CLARABEL", time_limit=max(left(), 1.0))
    except (cvxpy.error.SolverError, ValueError) as error:  # the latter of data out of range
        raise SolveError(f"the semidefinite solver: {error}") from error
    if v.value is None or problem.status not in {"optimal", "optimal_inaccurate"}:
        raise SolveError(f"the semidefinite programme is {problem.status}")
    return Solved(
        float(objective @ v.value),
        np.asarray(v.value),
        [[np.asarray(gram.value) for gram in its] for its in grams],
        time.monotonic() - began,
    )

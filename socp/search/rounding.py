"""Combinatorial integral approximation: the controls of a direct solution rounded to modes, with
few switches.

The integral of a control over time is what moves the states, so the rounded control has to be near
in the integral, not at every time: min over binary w of max over t of |integral of (relaxed -
rounded)| (Sager, Jung, Kirches, Mathematical Methods of Operations Research 73, 2011,
doi:10.1007/s00186-011-0355-4).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from socp.errors import SolveError
from socp.laws import law_values
from socp.model import TINY, Modes, Problem, Solution, parameters_of
from socp.search.candidate import Candidate, merged
from socp.verdict import constraint_values

_CLEAR = 1e-2  # of the box: a cell whose control is as near to a mode needs no finer cells
_FINER = 8  # cells in place of one that no mode fits, at most: a short arc hides there
_CELLS = 20  # such cells in all, about
# Of the range of a constraint or of a box: a coarse solution comes no nearer to a boundary arc
_NEAR = 2e-2
_POINTWISE = (
    0.05  # weight of the misfit itself beside its integral: settles what the integral leaves open
)
_GAP = 5e-3  # of the horizon times a box: the seed of a search need not be the best rounding
_NODES = 20  # of the solver's tree, likewise
# Of a switch, in the same units: a rounding as near with fewer switches is the better seed
_PRICE = 1e-3


@final
@dataclass(frozen=True, eq=False)
class Cells:
    """Relaxed controls on k cells of time, and what each of m modes would make of them there.

    edges (k + 1,); relaxed (nu, k) and offered (m, nu, k) controls as shares of their boxes;
    allowed (m, k).
    """

    edges: np.ndarray
    relaxed: np.ndarray
    offered: np.ndarray
    allowed: np.ndarray

    @property
    def lengths(self) -> np.ndarray:
        """Lengths of the cells (k,), relative to the horizon."""
        lengths: np.ndarray = np.diff(self.edges) / (self.edges[-1] - self.edges[0])
        return lengths

    @property
    def misfit(self) -> np.ndarray:
        """How far the controls of every mode are from the relaxed ones (m, k), infinite where it is
        not allowed.
        """
        off: np.ndarray = np.abs(self.offered - self.relaxed).max(axis=1)
        return np.where(self.allowed, off, np.inf)


@final
@dataclass(frozen=True, eq=False)
class Rounded:
    """The mode chosen on every cell (k,), as an index, and the deviation: what the rounding
    minimises.
    """

    chosen: np.ndarray
    deviation: float


def round_cells(given: Cells, switches: int, dwell: float = 0.0, price: float = _PRICE) -> Rounded:
    """Round relaxed controls to one mode a cell with at most so many switches, by a mixed-integer
    linear programme.

    `deviation` is the largest integral of the difference up to any time, over all controls, as
    shares of their boxes times the horizon. Arcs between two switches last `dwell` of the horizon
    at least. Raises SolveError where no choice satisfies that.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import block_array, csr_array, diags_array, eye_array, kron

    (nu, k), count = given.relaxed.shape, given.allowed.shape[0]
    # unknowns: is this the mode (count, k); deviations up to the end of a cell (nu, k); changes
    # (k - 1,); the worst deviation; and a one, beside which the relative gap is one of deviations
    sizes = (count * k, nu * k, k - 1, 1, 1)
    mode, off, change, worst, one = np.split(np.arange(sum(sizes)), np.cumsum(sizes)[:-1])
    of = eye_array(sum(sizes), format="csr")
    step = csr_array(np.diff(np.eye(k), axis=0, prepend=0.0))  # of a value over a cell
    made = [[diags_array(given.lengths * each[i]) for each in given.offered] for i in range(nu)]
    least = np.zeros(sum(sizes))
    most = np.full(sum(sizes), np.inf)
    least[off], least[one], most[one] = -np.inf, 1.0, 1.0
    most[mode] = given.allowed.astype(float).ravel()
    cost = np.zeros(sum(sizes))
    cost[worst], cost[change], cost[one] = 1.0, price, 1.0
    misfit = np.where(given.allowed, given.misfit, 0.0) * given.lengths
    cost[mode] = _POINTWISE * misfit.ravel()
    relaxed = (given.lengths * given.relaxed).ravel()
    constraints = [
        LinearConstraint(kron(np.ones((1, count)), eye_array(k)) @ of[mode], 1.0, 1.0),
        LinearConstraint(
            kron(eye_array(nu), step) @ of[off] + block_array(made) @ of[mode], relaxed, relaxed
        ),
        LinearConstraint(of[off] - of[worst.repeat(nu * k)], ub=0.0),
        LinearConstraint(of[off] + of[worst.repeat(nu * k)], lb=0.0),
        LinearConstraint(
            kron(eye_array(count), step[1:]) @ of[mode] - of[np.tile(change, count)], ub=0.0
        ),
        LinearConstraint(of[change].sum(axis=0), ub=switches),
        LinearConstraint(kron(eye_array(count), _dwelling(given.edges, dwell)) @ of[mode], ub=0.0),
    ]
    found = milp(
        cost,
        integrality=np.isin(np.arange(sum(sizes)), mode),
        bounds=Bounds(least, most),
        constraints=constraints,
        options={"mip_rel_gap": _GAP, "node_limit": _NODES},
    )
    if found.x is None:
        raise SolveError(
            f"rounding: no choice of modes has at most {switches} switches ({found.message})"
        )
    chosen = np.argmax(found.x[mode].reshape(count, k), axis=0)
    return Rounded(chosen, deviation(given, chosen))


def deviation(given: Cells, chosen: np.ndarray) -> float:
    """Return the largest |integral of (relaxed - rounded)| of any control for modes chosen on the
    cells (k,).
    """
    rounded = given.offered[chosen, :, np.arange(chosen.size)].T
    return float(
        np.abs(np.cumsum(given.lengths * (given.relaxed - rounded), axis=1)).max(initial=0.0)
    )


def _dwelling(edges: np.ndarray, dwell: float) -> Any:
    """Return the matrix (n, k) whose products with a mode's cells are at most zero where it is kept
    for a while once it has been entered.
    """
    from scipy.sparse import eye_array

    shortest, k = dwell * (edges[-1] - edges[0]), edges.size - 1
    last = np.searchsorted(edges, edges[:-1] + shortest * (1.0 - 1e-9)).clip(max=k)  # cut off there
    pairs = [(cell, later) for cell in range(1, k) for later in range(cell + 1, last[cell])]
    entered, later = np.array(pairs, dtype=int).reshape(-1, 2).T
    of = eye_array(k, format="csr")
    return of[entered] - of[entered - 1] - of[later]


# -- of a solution


def rounded_word(
    problem: Problem, solution: Solution, modes: Sequence[Modes], switches: int, dwell: float = 0.0
) -> Candidate:
    """Return the word of at most so many switches whose controls are nearest to a direct solution's
    in the integral.
    """
    laid = cells(problem, solution, modes)
    found = round_cells(laid, switches, dwell)
    arcs = tuple(modes[m] for m in found.chosen)
    return merged(Candidate(arcs, tuple(laid.edges.tolist()), solution))


def cells(problem: Problem, solution: Solution, modes: Sequence[Modes]) -> Cells:
    """Cut a direct solution into cells: long ones where one mode fits clearly, short ones where
    none does.
    """
    edges = _edges(solution)
    laid = _laid(problem, solution, modes, edges)
    best, clear = laid.misfit.argmin(axis=0), laid.misfit.min(axis=0) <= _CLEAR
    finer = int(np.clip(_CELLS // max(int((~clear).sum()), 1), 1, _FINER))
    parts = np.where(clear, 1, finer)
    inner = [
        np.linspace(a, b, n + 1)[:-1] for a, b, n in zip(edges[:-1], edges[1:], parts, strict=True)
    ]
    again = _laid(problem, solution, modes, np.append(np.concatenate(inner), edges[-1]))
    fine = Cells(again.edges, np.repeat(laid.relaxed, parts, axis=1), again.offered, again.allowed)
    return _joined(fine, np.where(np.repeat(clear, parts), np.repeat(best, parts), -1))


def _joined(fine: Cells, clear: np.ndarray) -> Cells:
    """Join neighbouring cells that have the same clear mode (k,), -1 for none."""
    first = np.flatnonzero((np.diff(clear, prepend=-2) != 0) | (clear == -1))
    size = np.add.reduceat(fine.lengths, first)

    def mean(values: np.ndarray) -> np.ndarray:
        averaged: np.ndarray = np.add.reduceat(values * fine.lengths, first, axis=-1) / size
        return averaged

    allowed = np.logical_and.reduceat(fine.allowed, first, axis=1)
    return Cells(
        np.append(fine.edges[first], fine.edges[-1]),
        mean(fine.relaxed),
        mean(fine.offered),
        allowed,
    )


def _edges(solution: Solution) -> np.ndarray:
    """Return the ends of the cells: midway between the collocated nodes of every interval."""
    found: list[float] = []
    for arc in solution.arcs:
        for k in range(len(arc.mesh) - 1):
            a, b = float(arc.t[arc.mesh[k]]), float(arc.t[arc.mesh[k + 1]])
            at = arc.t[arc.nodes(k, "u")]
            found += [a, *(0.5 * (at[1:] + at[:-1])).tolist()] if b > a else []
    return np.array([*found, solution.final_time])


def _laid(problem: Problem, solution: Solution, modes: Sequence[Modes], edges: np.ndarray) -> Cells:
    low, high = (row[:, None] for row in problem.box)
    t = 0.5 * (edges[1:] + edges[:-1])
    relaxed = (np.clip(solution.at(t, "u"), low, high) - low) / (high - low)
    given = solution.at(t), solution.at(t, "costate"), t, parameters_of(problem, solution)
    raw = np.array([(law_values(problem, each, *given) - low) / (high - low) for each in modes])
    inside = np.isfinite(raw) & (raw > -_NEAR) & (raw < 1.0 + _NEAR)
    near = {
        c.name: _near(constraint_values(problem, solution, c, t, solution.at(t)))
        for c in problem.constraints
    }
    allowed = inside.all(axis=1)
    for k, each in enumerate(modes):
        for mode in each:
            if mode.constraint:
                allowed[k] &= near[mode.constraint]
    return Cells(edges, relaxed, np.where(inside, raw, 0.0), allowed)


def _near(c: np.ndarray) -> np.ndarray:
    return np.array(c > -_NEAR * max(float(np.ptp(c)), TINY))

"""The mode-insertion gradient: what it is worth to put another mode into an arc, to first order in
its length.

Where a mode takes the place of an arc's own for a short time h, the objective of the fixed word
changes by h (H(mode) - H(own)), the Hamiltonians with the costate of the word's own programme
(Egerstedt, Wardi, Axelsson, IEEE Transactions on Automatic Control 51, 2006,
doi:10.1109/TAC.2005.861711; there for autonomous modes).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import final

import casadi
import numpy as np

from socp.laws import law_values
from socp.model import (
    OUTSIDE,
    TINY,
    Mode,
    Modes,
    Problem,
    Solution,
    column,
    evaluate,
    once,
    parameters_of,
    time,
)

_NODES = 24  # looks at an arc: its own nodes are few, and crowd at its ends
_ACTIVE = 1e-6  # of a constraint's range: nearer counts as on it
_TURN = 1e-9  # of a constraint's range over its arc: slower counts as along it


@final
@dataclass(frozen=True, eq=False)
class Insertion:
    """A mode put into an arc (an index) at a time: the objective changes by `slope` times its
    length.
    """

    modes: Modes
    arc: int
    t: float
    slope: float


def insertions(problem: Problem, solution: Solution, modes: Sequence[Modes]) -> list[Insertion]:
    """Return for every arc of a solution along a word and every other mode the best time to insert
    it, steepest first.

    The costates of the solution are taken as they stand: they should be those of the programme
    along its word, not the judge's. Where a mode is admissible at no node of an arc (its law
    outside the box, a state constraint violated by it, a boundary mode off its constraint) there is
    no insertion. Arcs without length have none either.
    """
    nodes = _nodes(problem, solution)
    found = (
        [each for offered in modes for each in _of(nodes, solution, offered)]
        if nodes.t.size
        else []
    )
    return sorted(found, key=lambda each: each.slope)


def magnitude(problem: Problem, solution: Solution) -> float:
    """Return the magnitude of the Hamiltonian's terms along a solution: max of |L| + sum of
    |lambda_i x'_i|.
    """
    x, u, costate = (solution.rows(which) for which in ("x", "u", "costate"))
    p = parameters_of(problem, solution)
    return float(np.max(evaluate(_terms(problem), x, u, np.nan_to_num(costate), solution.t, p)[0]))


@final
@dataclass(frozen=True, eq=False)
class _Nodes:
    """Where insertions are looked at: times t (n,), their arcs (n,), states, controls and costates,
    H of the own modes.

    c and its scale (nc, n): values of the state constraints; end (n,): first and last nodes of the
    arcs.
    """

    problem: Problem
    t: np.ndarray
    arc: np.ndarray
    x: np.ndarray
    u: np.ndarray
    costate: np.ndarray
    p: np.ndarray

    def energy(self, u: np.ndarray) -> np.ndarray:
        """Return the Hamiltonian (n,) under controls u (nu, n)."""
        return evaluate(_energy(self.problem), self.x, u, self.costate, self.t, self.p)[0].ravel()

    @property
    def ends(self) -> np.ndarray:
        """Mask (n,) of the first and last nodes of the arcs."""
        place = np.arange(self.t.size) % _NODES
        return np.isin(place, (0, _NODES - 1))

    def admits(self, modes: Modes, u: np.ndarray, own: Sequence[Modes]) -> np.ndarray:
        """Return where (n,) a mode with controls u (nu, n) may begin, in arcs of their own
        modes.
        """
        low, high = (row[:, None] for row in self.problem.box)
        margin = OUTSIDE * (high - low)
        allowed: np.ndarray = ((u >= low - margin) & (u <= high + margin)).all(axis=0)
        if not self.problem.constraints:
            return allowed
        path = evaluate(_path(self.problem), self.x, u, self.t, self.p)
        named = {mode.constraint for mode in modes if mode.constraint}
        horizon = self.t[-1] - self.t[0]
        for c, growth, constraint in zip(*path, self.problem.constraints, strict=True):
            size = max(float(np.ptp(c)), float(np.abs(growth).max()) * horizon, TINY)
            on = c > -_ACTIVE * size
            kept = np.array([Mode("boundary", constraint.name) in own[k] for k in self.arc])
            if constraint.name in named:
                allowed &= on | kept
            else:  # off a constraint that an arc keeps there is no way back to it within the arc
                allowed &= (~(on | kept) | (growth <= _TURN * size / horizon)) & (self.ends | ~kept)
        return allowed


def _nodes(problem: Problem, solution: Solution) -> _Nodes:
    share = 0.5 * (1.0 - np.cos(np.linspace(0.0, np.pi, _NODES)))
    at = [k for k, arc in enumerate(solution.arcs) if arc.t[-1] > arc.t[0]]
    times, rows = [], []
    for arc in (solution.arcs[k] for k in at):
        t = np.clip(
            arc.t[0] + (arc.t[-1] - arc.t[0]) * share, arc.t[0], np.nextafter(arc.t[-1], -np.inf)
        )
        times.append(t)
        rows.append([arc.at(t), arc.at(t, "u"), arc.at(t, "costate")])
    count = problem.x.numel(), problem.u.numel(), problem.x.numel()
    x, u, costate = (
        np.hstack([row[i] for row in rows]) if rows else np.empty((n, 0))
        for i, n in enumerate(count)
    )
    t = np.concatenate(times) if times else np.empty(0)
    p = parameters_of(problem, solution)
    return _Nodes(problem, t, np.repeat(at, _NODES), x, u, costate, p)


def _of(nodes: _Nodes, solution: Solution, modes: Modes) -> Iterator[Insertion]:
    own = [arc.modes for arc in solution.arcs]
    u = law_values(nodes.problem, modes, nodes.x, nodes.costate, nodes.t, nodes.p)
    slope = np.where(nodes.admits(modes, u, own), nodes.energy(u) - nodes.energy(nodes.u), np.inf)
    for k in np.unique(nodes.arc):
        here = np.flatnonzero(nodes.arc == k)
        best = here[np.argmin(slope[here])]
        if own[k] != modes and np.isfinite(slope[best]):
            yield Insertion(modes, int(k), float(nodes.t[best]), float(slope[best]))


@once
def _energy(problem: Problem) -> casadi.Function:
    symbols = [problem.x, problem.u, problem.costate, time, problem.p]
    return casadi.Function("energy", symbols, [problem.hamiltonian])


@once
def _terms(problem: Problem) -> casadi.Function:
    """Return the sum of the Hamiltonian's terms by absolute value, as a function."""
    symbols = [problem.x, problem.u, problem.costate, time, problem.p]
    of_costates = casadi.dot(casadi.fabs(problem.costate), casadi.fabs(problem.rate))
    return casadi.Function("terms", symbols, [casadi.fabs(problem.lagrangian) + of_costates])


@once
def _path(problem: Problem) -> casadi.Function:
    """Return the state constraints and their growth as a function."""
    c = column(each.expression for each in problem.constraints)
    growth = casadi.jtimes(c, problem.x, problem.rate) + casadi.jacobian(c, time)
    symbols = [problem.x, problem.u, time, problem.p]
    return casadi.Function("path", symbols, [casadi.densify(c), casadi.densify(growth)])

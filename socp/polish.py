"""Polish: Newton on the switching and boundary conditions of a word, and digits counted by comparing two meshes."""

from dataclasses import dataclass, replace
from typing import final

import casadi
import numpy as np

from socp.errors import MethodError
from socp.kinks import jointed, whole
from socp.phases import PhasedProblem, follow
from socp.problem import Problem
from socp.shooting import Shooting, ends
from socp.simulate import scales
from socp.solution import Agreement, Solution
from socp.word import Mode, Word

_FINE = 1e-13  # of the states: steps are doubled until the motion changes by no more; rounding leaves some hundred ulps
_STEPS = (2, 4, 8, 16, 32, 64)  # steps an interval; a motion that wants more is stiff, and none of this method's
_NEWTON = 8  # steps: from a collocated solution two or three do
_DONE = 1e-13  # of the variables' magnitudes: a step below it is rounding, which may keep it at some times as much
_ROUNDING = 100.0
_AWAY = 1e-4  # of the same: Newton that goes further than this goes to another solution
_RUIZ = 5  # rounds of scaling: each halves the decades between rows
_SOLVED = 1e-8  # what a linear system may leave of its right side; more is left by a singular one


def polished(problem: Problem, solution: Solution, points: int = 10) -> Solution | None:
    """Return a solution along a word with its conditions solved by Newton to rounding, or None where that fails.

    The first-order conditions of the shooting equations in arc lengths, free ends, parameters and multipliers are the
    boundary, transversality and switching conditions of the word: the multiplier of a joint is the costate of the rest
    of the horizon, and the slope in the length of an arc is the jump of the Hamiltonian. Its `agreement` is that of two
    meshes: with as many steps as the motion needs, and with twice as many.
    """
    posed = _posed(problem, solution, points)
    steps = None if posed is None else _steps(posed[0], posed[1])
    if posed is None or steps is None:
        return None
    phased, start, pieces = posed
    shooting, finer = Shooting(phased, start, steps), Shooting(phased, start, 2 * steps)
    settled = _newton(shooting, _sizes(shooting, scales(problem, solution)))
    if settled is None:
        return None
    conditions = _conditions(finer)
    moved, _ = settled.system.step(*(each.full().ravel() for each in conditions(settled.at, settled.held)[:2]))
    cost = float(conditions(settled.at + moved, settled.held)[2])
    agreement = Agreement(
        objective=abs(cost - settled.cost) / max(abs(cost), 1e-300),
        switches=float(np.abs(np.cumsum(moved[: 1 + len(phased.phases)])).max()),
    )
    return replace(whole(finer.lifted(settled.at + moved, cost), pieces), agreement=agreement)


def _posed(problem: Problem, solution: Solution, points: int) -> tuple[PhasedProblem, Solution, list[int]] | None:
    """Return the phased problem of a solution's word, cut at kinks, with its solution and the number of pieces an arc.

    None where there is no word, or an arc has no length.
    """
    try:
        arcs = tuple(tuple(Mode.parse(mode) for mode in arc.modes) for arc in solution.arcs)
        phased = follow(problem, Word(problem.control_names, arcs))
    except MethodError:
        return None
    if any(phase.free.numel() for phase in phased.phases) or min(a.t[-1] - a.t[0] for a in solution.arcs) <= 0:
        return None
    cut = jointed(phased, solution, points)
    return (phased, solution, [1] * len(phased.phases)) if cut is None else (cut[0], cut[1], cut[3])


def _steps(phased: PhasedProblem, start: Solution) -> int | None:
    """Return how many steps an interval takes: as many as leave the ends of all intervals alone when doubled."""
    before: list[np.ndarray] = []
    nx = phased.of.x.numel()
    for count in _STEPS:
        now = ends(phased, start, count)
        # what is carried along one arc is seen against its size there, states and cost against theirs on all of them
        shared = np.max([np.abs(each).max(axis=1)[[*range(nx), -1]] for each in now], axis=0)
        sizes = [np.concatenate([shared[:-1], np.abs(each[nx:-1]).max(axis=1), shared[-1:]]) for each in now]
        if before and all((abs(a - b) <= _FINE * c[:, None]).all() for a, b, c in zip(before, now, sizes, strict=True)):
            return count // 2
        before = now
    return None


@final
@dataclass(frozen=True, eq=False)
class _System:
    """The factors of the matrix of first-order conditions, scaled by the magnitudes of the variables (n,)."""

    matrix: np.ndarray
    size: np.ndarray

    def step(self, gradient: np.ndarray, equations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the Newton step in variables (n,) and multipliers (m,); nan where the matrix is singular."""
        right = -np.concatenate([gradient * self.size, equations])
        with np.errstate(all="ignore"):
            found = _solved(self.matrix, right)
        return self.size * found[: self.size.size], found[self.size.size :]


def _solved(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Solve a symmetric system, its rows and columns brought to one magnitude (Ruiz, RAL-TR-2001-034)."""
    d = np.ones(right.size)
    for _ in range(_RUIZ):
        d /= np.sqrt(np.maximum(np.abs(d[:, None] * matrix * d).max(axis=1), 1e-300))
    scaled, given = d[:, None] * matrix * d, d * right
    try:
        found = np.linalg.solve(scaled, given)
    except np.linalg.LinAlgError:
        return np.full_like(right, np.nan)
    left = np.abs(scaled @ found - given).max()
    return d * found if left <= _SOLVED * max(np.abs(given).max(), 1e-300) else np.full_like(right, np.nan)


@final
@dataclass(frozen=True, eq=False)
class _Settled:
    """Where Newton has settled: variables, multipliers, cost and the last matrix."""

    at: np.ndarray
    held: np.ndarray
    cost: float
    system: _System


def _conditions(shooting: Shooting) -> casadi.Function:
    """Return (w, multipliers) -> slope of the Lagrangian, equations, cost."""
    cost, equations, signs = shooting.laid
    held = casadi.MX.sym("l", signs.size)
    gradient = casadi.gradient(cost + casadi.dot(held, equations), shooting.w)
    return casadi.Function("first", [shooting.w, held], [gradient, equations, cost])


def _newton(shooting: Shooting, size: np.ndarray) -> _Settled | None:
    """Solve the first-order conditions; None where Newton does not settle nearby, or a limit would rather be left."""
    cost, equations, signs = shooting.laid
    w, multipliers = shooting.w, casadi.MX.sym("l", signs.size)
    hessian, gradient = casadi.hessian(cost + casadi.dot(multipliers, equations), w)
    slopes = casadi.Function("slopes", [w], [casadi.jacobian(equations, w), casadi.gradient(cost, w)])
    second = casadi.Function("second", [w, multipliers], [hessian, gradient, equations, cost])
    at, C, g = shooting.start, *(each.full() for each in slopes(shooting.start))
    held = np.linalg.lstsq((C * size).T, -g.ravel() * size, rcond=None)[0]  # the multipliers that fit best
    for _ in range(_NEWTON):
        H, slope, c = (each.full() for each in second(at, held)[:3])
        C = slopes(at)[0].full() * size
        system = _System(np.block([[H * size[:, None] * size, C.T], [C, np.zeros((c.size, c.size))]]), size)
        moved, change = system.step(slope.ravel(), c.ravel())
        at, held = at + moved, held + change
        if not np.abs((at - shooting.start) / size).max() <= _AWAY:
            return None
        if np.abs(moved / size).max() <= _DONE:
            break
    if np.abs(moved / size).max() > _ROUNDING * _DONE or (signs * held < -_DONE * np.abs(held).max()).any():
        return None
    return _Settled(at, held, float(second(at, held)[3]), system)


def _sizes(shooting: Shooting, scale: np.ndarray) -> np.ndarray:
    """Return the magnitudes of the variables (n,)."""
    horizon = shooting.solution.final_time - shooting.solution.initial_time
    p = np.abs(shooting.start[1 + len(shooting.pairs) :][: shooting.phased.of.p.numel()])
    rows: list[np.ndarray] = []
    for phase, arc in shooting.pairs:
        carried = np.abs(arc.costate[: phase.carried.numel()]).max(axis=1, initial=0.0)
        rows.append(np.tile(np.concatenate([scale, np.where(carried > 0, carried, 1.0)]), arc.mesh.size))
    times = np.full(1 + len(shooting.pairs), horizon)
    return np.concatenate([times, np.where(p > 0, p, 1.0), *rows])

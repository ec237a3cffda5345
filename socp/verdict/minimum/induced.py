"""The finite-dimensional problem that a word induces: its objective as a function of arc lengths,
times, parameters and free initial states alone.

The states at the ends of the intervals follow from these by the shooting equations, and go first:
what is left is a small symmetric matrix on the kernel of the end conditions.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import numpy as np

from socp.model import EXTREMAL, TINY, Curvature, Minimum, Problem, SecondOrder, Solution
from socp.transcription import PhasedProblem
from socp.verdict.accuracy import word_problem
from socp.verdict.newton import Conditions, settled

# Of the largest multiplier: that of an inequality which is less may be zero, and its limit no more
# than touched
WEAK = 1e-8
# Of the largest singular value of the end conditions: a smaller one is rounding
_RANK = 1e-10
# Of the terms of an entry: doubling the steps of the motion changes it by as much (`accuracy`)
_MOTION = 1e-13
# Times its error: an eigenvalue as large has its sign with a digit to spare
CLEAR = 10.0


@final
@dataclass(frozen=True, eq=False)
class Induced:
    """Derivatives of a word's objective at its extremal, in variables q: initial time, lengths,
    parameters, initial states, and what phases carry from their entry on.

    All variables are scaled by their magnitudes. `slopes` (m, n) are
    those of the equations, unscaled; `outer` (nq,) are the places of q; `lift` (n, nq)
    gives the change of all shooting variables; `hessian` (nq, nq) is that of the Lagrangian,
    `rounding` (nq, nq) what its terms add up to in absolute value; `rows` (r, nq) are the end
    conditions and entry conditions, `weak` (r,) marks inequalities whose multiplier may be zero.
    """

    conditions: Conditions
    at: np.ndarray
    held: np.ndarray
    slopes: np.ndarray
    outer: np.ndarray
    lift: np.ndarray
    hessian: np.ndarray
    rounding: np.ndarray
    rows: np.ndarray
    weak: np.ndarray

    @classmethod
    def of(cls, conditions: Conditions, at: np.ndarray, multipliers: np.ndarray) -> "Induced":
        """Eliminate the states at the inner ends of the intervals."""
        shooting, size = conditions.shooting, conditions.size
        C, H = conditions.derivatives(at, multipliers)
        slopes, C, H = C, C * size, H * size[:, None] * size
        inner, chain = shooting.chain
        outer = np.setdiff1d(np.arange(size.size), inner)
        lift = np.zeros((size.size, outer.size))
        lift[outer, np.arange(outer.size)] = 1.0
        lift[inner] = -np.linalg.solve(C[np.ix_(chain, inner)], C[np.ix_(chain, outer)])
        others = np.setdiff1d(np.arange(len(C)), chain)
        signs, held = shooting.signs[others], multipliers[others]
        weak = (signs != 0) & (np.abs(held) <= WEAK * np.abs(multipliers).max(initial=TINY))
        half = np.abs(lift)
        return cls(
            conditions,
            at,
            multipliers,
            slopes,
            outer,
            lift,
            lift.T @ H @ lift,
            half.T @ np.abs(H) @ half,
            C[others] @ lift,
            weak,
        )

    @cached_property
    def rougher(self) -> "Induced":
        """The same with a Hessian by steps twice as long along the same motion."""
        here, size = self.conditions.linearised(self.at), self.conditions.size
        H = here.hessian(self.held, 2) * size[:, None] * size
        return replace(self, hessian=self.lift.T @ H @ self.lift)

    @cached_property
    def worth(self) -> float:
        """What variables, changed by their magnitudes, change the objective by at most.

        Of this an objective is rounded: a curvature that is less changes it by nothing, as where a
        motion may as well begin later.
        """
        gradient = self.conditions.linearised(self.at).gradient
        return float(np.abs(gradient * self.conditions.size).max())

    @cached_property
    def regular(self) -> bool:
        """Whether the conditions at the ends are independent, so that multipliers are unique."""
        values = np.linalg.svd(self.rows, compute_uv=False)
        return bool((values > _RANK * values.max(initial=TINY)).all()) and (
            len(self.rows) <= self.rows.shape[1]
        )

    def kernel(self, *, weak: bool) -> np.ndarray:
        """Return an orthonormal basis (nq, k) of the directions that keep the conditions; `weak`
        ones are let go or kept as well.
        """
        rows = self.rows if weak else self.rows[~self.weak]
        if not len(rows):
            return np.eye(rows.shape[1])
        _, values, right = np.linalg.svd(rows)
        return np.array(right[int((values > _RANK * values.max(initial=TINY)).sum()) :].T)

    def spectrum(self, *, weak: bool) -> tuple[np.ndarray, np.ndarray, float]:
        """Return eigenvalues (k,) of the second variation, ascending, their directions (nq, k), and
        what rounding may have done to them.
        """
        kernel = self.kernel(weak=weak)
        if not kernel.shape[1]:
            return np.empty(0), kernel, 0.0
        reduced = kernel.T @ self.hessian @ kernel
        values, vectors = np.linalg.eigh(0.5 * (reduced + reduced.T))
        rounding = np.abs(kernel).T @ self.rounding @ np.abs(kernel)
        most = float(np.linalg.norm(rounding, 2)) + self.worth
        return values, kernel @ vectors, _MOTION * most


@final
@dataclass(frozen=True, eq=False)
class Pair:
    """A word's induced problem by as many steps as the motion needs. What half of them, along the
    same motion, leave of its curvature bounds what these do; `_MOTION` bounds what the motion does.
    """

    fine: Induced
    phased: PhasedProblem
    pieces: list[int]

    def curvature(self, *, weak: bool) -> Curvature:
        """Return the least eigenvalue with its error: what rounding does, and half of the steps."""
        values, _, rounding = self.fine.spectrum(weak=weak)
        if not values.size:
            return Curvature(least=np.inf, error=0.0, free=0)
        before = self.fine.rougher.spectrum(weak=weak)[0]
        apart = float(np.abs(values - before).max())
        return Curvature(least=float(values[0]), error=CLEAR * (apart + rounding), free=values.size)


def induced(problem: Problem, solution: Solution, points: int = 10) -> Pair | SecondOrder:
    """Return the problem that a certified solution's word induces, or what is known where it
    cannot be laid out.
    """
    known = word_problem(problem, solution, points)
    if known is None:
        return _untested("controls without laws, or an arc without length: no word to vary")
    if known.steps is None:
        why = "it is stiff, unstable, or not smooth"
        return _untested(f"no number of explicit steps settles on the motion: {why}")
    conditions = known.conditions()
    there = settled(conditions)
    if there is None:
        return _unsettled(conditions)
    return Pair(Induced.of(conditions, there.at, there.held), known.phased, known.pieces)


def _untested(why: str) -> SecondOrder:
    return SecondOrder(kind=Minimum.UNTESTED, limits=(why,))


def _unsettled(conditions: Conditions) -> SecondOrder:
    """Return what is known where Newton does not settle: whether a flat direction is the reason.

    The solution's own values are known to the judge's tolerance, and so is the matrix there.
    """
    at = conditions.shooting.start
    found = Induced.of(conditions, at, conditions.multipliers(at))
    values = found.spectrum(weak=True)[0]
    error = EXTREMAL * float(np.linalg.norm(found.rounding, 2))
    if not values.size or not np.abs(values).min() <= error:
        return _untested("Newton does not settle on the conditions of the word")
    flat = Curvature(least=float(values[0]), error=error, free=values.size)
    why = "the conditions of the word leave a direction open"
    return SecondOrder(kind=Minimum.DEGENERATE, word=flat, limits=(why,))

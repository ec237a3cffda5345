"""Newton on the first-order conditions of a word: the symmetric system of shooting equations and
multipliers.
"""

from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, Self, final

import numpy as np

from socp.model import TINY, cached, lately, scales
from socp.transcription import Linearised, Shooting, residuals

_RUIZ = 5  # rounds of scaling: each halves the decades between rows
_SOLVED = 1e-8  # what a linear system may leave of its right side; more is left by a singular one
# of the largest eigenvalue of the scaled matrix: what is smaller is rounding, and its direction
# left open
_RANK = 1e-13
# Of a direction that is left open, with largest entry 1: what moves less along it is determined
_MOVES = 1e-6
# Units in the last place of its terms: equations that are further apart contradict each other
_CONTRADICTS = 64.0
# Of the terms of a condition: rounding of every one, 4 units in its last place
ULPS = 4.0 * float(np.finfo(float).eps)
# Of the largest on the diagonal of a triangle: rows with less depend on one another, to rounding
_DEPENDENT = 1e-10
_NEWTON = 8  # steps: from a collocated solution two or three do
_FAR = 16  # the same from the solution of another problem: five to ten do
# Of the variables' magnitudes: after a step below it the same matrix gains four digits with the
# next, which takes a third of the time of another matrix
_CHORD = 1e-4
# Of the step before it: a step that is longer was made with a matrix from too far away
_BROUGHT = 0.05
# Of the variables' magnitudes: a step below it is rounding, which may keep it at some times as much
_DONE = 1e-13
_ROUNDING = 100.0
# Of the variables' magnitudes: Newton that goes further than this goes to another solution
AWAY = 1e-4


@final
@dataclass(frozen=True, eq=False)
class Conditions:
    """The first-order conditions of shooting equations as functions of variables (n,) and
    multipliers (m,).
    """

    shooting: Shooting

    def linearised(self, at: np.ndarray) -> Linearised:
        """Return equations and cost with their slopes at variables (n,): worked out once for as
        long as they stay.
        """
        key, make = (at.tobytes(),), partial(Linearised.of, self.shooting, at)
        return lately(self, Conditions.linearised, key, make)

    def known(self, here: Linearised) -> None:
        """Take note of what conditions that differ in the ends' levels alone are somewhere."""
        key = (here.at.tobytes(),)
        lately(self, Conditions.linearised, key, partial(here.under, self.shooting))

    def cost(self, at: np.ndarray) -> float:
        """Return the cost at variables (n,)."""
        here = cached(self, Conditions.linearised).get((at.tobytes(),))
        return residuals(self.shooting, at)[1] if here is None else here.cost

    @property
    def rows(self) -> tuple[Any, ...]:
        """What tells conditions of one form: steps, intervals, and what holds at the ends."""
        ends = ((row.name, row.sign) for row in self.shooting.ends)
        return *self.shooting.steps, *(a.mesh.size for _, a in self.shooting.pairs), *ends

    @cached_property
    def size(self) -> np.ndarray:
        """Magnitudes of the variables (n,)."""
        shooting = self.shooting
        horizon = shooting.solution.final_time - shooting.solution.initial_time
        scale = scales(shooting.phased.of, shooting.solution)
        p = np.abs(shooting.start[1 + len(shooting.pairs) :][: shooting.phased.of.p.numel()])
        rows: list[np.ndarray] = []
        for phase, arc in shooting.pairs:
            carried = np.abs(arc.costate[: phase.carried.numel()]).max(axis=1, initial=0.0)
            rows.append(
                np.tile(np.concatenate([scale, np.where(carried > 0, carried, 1.0)]), arc.mesh.size)
            )
        times = np.full(1 + len(shooting.pairs), horizon)
        return np.concatenate([times, np.where(p > 0, p, 1.0), *rows])

    def multipliers(self, at: np.ndarray) -> np.ndarray:
        """Return the multipliers (m,) that fit best at variables (n,)."""
        make = partial(self._multipliers, at)
        return lately(self, Conditions.multipliers, (at.tobytes(),), make)

    def _multipliers(self, at: np.ndarray) -> np.ndarray:
        here = self.linearised(at)
        slopes, gradient = here.slopes * self.size, here.gradient * self.size
        basis, triangle = np.linalg.qr(slopes.T)
        across = np.abs(np.diag(triangle))
        if across.size == len(slopes) and across.min() > _DEPENDENT * across.max():
            return np.linalg.solve(triangle, -(basis.T @ gradient))
        held: np.ndarray = np.linalg.lstsq(slopes.T, -gradient, rcond=None)[0]
        return held

    def system(self, at: np.ndarray, held: np.ndarray) -> "System":
        """Return the linear system at variables (n,) and multipliers (m,)."""
        key, make = (at.tobytes(), held.tobytes()), partial(self._system, at, held)
        return lately(self, Conditions.system, key, make)

    def _system(self, at: np.ndarray, held: np.ndarray) -> "System":
        C, H = self.derivatives(at, held)
        n, C = at.size, C * self.size
        matrix = np.zeros((n + held.size, n + held.size))
        matrix[:n, :n], matrix[:n, n:], matrix[n:, :n] = H * self.size[:, None] * self.size, C.T, C
        return System.of(matrix, self.size, held)

    def derivatives(self, at: np.ndarray, held: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the slopes of the equations (m, n) and the Hessian (n, n) of the Lagrangian."""
        here, key = self.linearised(at), (at.tobytes(), held.tobytes())
        make = partial(here.hessian, held)
        bent = lately(self, Conditions.derivatives, key, make)
        return here.slopes, bent

    def values(self, at: np.ndarray, held: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Return slope of the Lagrangian (n,), equations (m,) and cost."""
        here = self.linearised(at)
        return here.gradient + held @ here.slopes, here.equations, here.cost


@final
@dataclass(frozen=True, eq=False)
class System:
    """The matrix of first-order conditions at multipliers `held` (m,), its variables scaled by
    `size` (n,), brought to one magnitude by `d` (n + m,).
    """

    matrix: np.ndarray
    size: np.ndarray
    held: np.ndarray
    d: np.ndarray

    @classmethod
    def of(cls, matrix: np.ndarray, size: np.ndarray, held: np.ndarray) -> Self:
        """Bring rows and columns of a symmetric matrix to one magnitude (Ruiz, RAL-TR-2001-034)."""
        sizes, d = np.abs(matrix), np.ones(len(matrix))
        for _ in range(_RUIZ):
            d /= np.sqrt(np.maximum(d * (sizes * d).max(axis=1), TINY))
        return cls(d[:, None] * matrix * d, size, held, d)

    def step(self, gradient: np.ndarray, equations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the Newton step in variables (n,) and multipliers (m,), nan where there is none.

        Where the matrix leaves directions open, it is the shortest one. Equations that say the same
        twice, as where two controls switch at one time, leave multipliers open alone.
        """
        given = -self.d * np.concatenate([gradient * self.size, equations])
        found = self.d * self._solved(given)
        return self.size * found[: self.size.size], found[self.size.size :]

    def _solved(self, given: np.ndarray) -> np.ndarray:
        if not np.isfinite(self.matrix).all():
            return np.full_like(given, np.nan)
        # the inverse serves one right side after the other; what it leaves is solved for once more
        found = self._inverse(given)
        found = found + self._inverse(given - self.matrix @ found)
        allowed: np.ndarray | float = _SOLVED * max(np.abs(given).max(), TINY)
        if (
            self.deficient
        ):  # what rounding leaves of equations that say the same is no contradiction
            # in one row, along an open direction, is left what all rows have of it
            ulps, left = _CONTRADICTS * np.finfo(float).eps, np.abs(self._left_open)
            rounding = np.abs(self.matrix) @ self._sizes
            allowed = np.maximum(allowed, ulps * (rounding + left @ (left.T @ rounding)))
        return (
            found
            if (np.abs(self.matrix @ found - given) <= allowed).all()
            else np.full_like(given, np.nan)
        )

    def _inverse(self, given: np.ndarray) -> np.ndarray:
        """Return solutions (k, n + m) of right sides (k, n + m) or (n + m,), the shortest ones."""
        if self._regular is not None:
            return np.array(given @ self._regular)
        vectors = self._spectrum[1]
        return np.array((given @ vectors * self._inverted) @ vectors.T)

    @cached_property
    def _regular(self) -> np.ndarray | None:
        """The inverse, None where an eigenvalue may be rounding: then the spectrum tells."""
        return inverse(self.matrix, _RANK)

    @cached_property
    def _spectrum(self) -> tuple[np.ndarray, np.ndarray]:
        values, vectors = np.linalg.eigh(self.matrix)
        return values, vectors

    @cached_property
    def _inverted(self) -> np.ndarray:
        values = self._spectrum[0]
        kept = np.abs(values) > _RANK * np.abs(values).max()
        return np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)

    @property
    def deficient(self) -> bool:
        """Whether the conditions leave a direction of variables or multipliers open."""
        return self._regular is None and bool((self._inverted == 0.0).any())

    def open(self, rows: np.ndarray) -> np.ndarray:
        """Return a mask (k,) of the linear functions `rows` (k, n) of the variables that the
        conditions leave open.
        """
        n = self.size.size
        if self._regular is not None:
            return np.zeros(len(rows), dtype=bool)
        directions = self.d[:, None] * self._left_open
        directions = directions / np.maximum(np.abs(directions).max(axis=0, initial=0.0), TINY)
        moved = np.abs(rows * self.size @ directions[:n])
        return np.array(
            (moved > _MOVES * np.abs(rows * self.size).max(axis=1)[:, None]).any(axis=1)
        )

    @property
    def _left_open(self) -> np.ndarray:
        """Directions (n + m, k) that the conditions leave open, as the matrix takes them."""
        found: np.ndarray = self._spectrum[1][:, self._inverted == 0.0]
        return found

    @property
    def _sizes(self) -> np.ndarray:
        """Magnitudes (n + m,) of the unknowns as the matrix takes them."""
        found: np.ndarray = np.concatenate([np.ones(self.size.size), np.abs(self.held)]) / self.d
        return found

    def rounding(self, rows: np.ndarray) -> np.ndarray:
        """Return how far rounding may move linear functions `rows` (k, n) of the variables: (k,).

        Every entry of a condition is off by some units in its last place, independently of the
        others.
        """
        count, sizes = len(rows), self._sizes
        off = ULPS * np.sqrt((self.matrix * sizes) ** 2 @ np.ones(sizes.size))
        asked = np.hstack([rows * self.size, np.zeros((count, self.held.size))]) * self.d
        found: np.ndarray = np.sqrt((self._inverse(asked) * off) ** 2 @ np.ones(off.size))
        return found


def inverse(matrix: np.ndarray, rank: float) -> np.ndarray | None:
    """Return the inverse of a matrix (k, k), None where its least singular value may be less than
    `rank` times the largest: by the norms of Frobenius, which bound their ratio.
    """
    try:
        found: np.ndarray = np.linalg.inv(matrix)
    except np.linalg.LinAlgError:
        return None
    apart = float(np.linalg.norm(matrix)) * float(np.linalg.norm(found))
    return found if apart * rank < 1.0 else None


@final
@dataclass(frozen=True, eq=False)
class Settled:
    """Where Newton has settled: variables (n,), multipliers (m,), cost and the last matrix, from
    within `_CHORD` of there: derivatives by it would be off by as much.
    """

    at: np.ndarray
    held: np.ndarray
    cost: float
    system: System


def settled(
    conditions: Conditions,
    *,
    far: bool = False,
    start: np.ndarray | None = None,
    near: Settled | None = None,
) -> Settled | None:
    """Solve the first-order conditions; None where Newton does not settle, or not nearby unless it
    may go `far`, or where a limit would rather be left. It begins with the solution's own variables
    unless others (n,) are given, and with the multipliers and the matrix of where it has settled on
    conditions `near` by, for as long as that matrix brings it on.
    """
    start = conditions.shooting.start if start is None else start
    signs, size = conditions.shooting.signs, conditions.size
    at, held = start, conditions.multipliers(start) if near is None else near.held
    system, own, long = None if near is None else near.system, False, np.inf
    for _ in range(_FAR if far else _NEWTON):
        if system is None:
            system, own = conditions.system(at, held), True
        moved, change = system.step(*conditions.values(at, held)[:2])
        before, long = long, np.abs(moved / size).max()
        brought = long <= _BROUGHT * before
        if long <= _DONE or (long <= _ROUNDING * _DONE and not brought):
            break
        at, held = at + moved, held + change
        if long <= _ROUNDING * _DONE and long * long <= _DONE * before:
            break  # the next step would be rounding
        if not np.abs((at - start) / size).max() <= (np.finfo(float).max if far else AWAY):
            return None
        if not brought or (own and long > _CHORD):
            system = None
    if (
        system is None
        or not long <= _ROUNDING * _DONE
        or (signs * held < -_DONE * np.abs(held).max()).any()
    ):
        return None
    return Settled(at, held, conditions.cost(at), system)

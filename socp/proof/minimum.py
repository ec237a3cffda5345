"""That an extremal is a strict local minimum among the controls of its word: the Hessian of the
Lagrangian of the word's problem is positive definite on the kernel of its conditions.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from scipy.linalg import eigh, qr

from socp.errors import SolveError
from socp.model import Problem, Solution, scales
from socp.proof.balls import Ball, Matrix, finite, flint, negative, positive
from socp.proof.flow import ORDER, SLOPES
from socp.proof.induced import Induced
from socp.proof.krawczyk import Proved, Shot
from socp.proof.linear import floats, identity

# Of the conditions' largest: one with less beside the others follows from them, and is left out,
# which leaves more directions to show the sign on
_RANK = 1e-10
# Of the least curvature: as far below it, and as far as is needed, is what is shown of it
_SHY = tuple(2.0**k for k in range(-40, 1))


@final
@dataclass(frozen=True, eq=False)
class Curved:
    """How many directions the conditions of a word leave free, and what the least curvature on them
    is at least, in units of the objective for changes of norm 1.

    Lengths are measured in horizons, initial states in their magnitudes, carried costates in ones;
    where no direction is free there is none.
    """

    free: int
    least: Ball


def curved(problem: Problem, solution: Solution, shot: Shot, proved: Proved) -> Curved:
    """Show that the curvature is positive; SolveError where it is not shown, or is negative."""
    for order in (SLOPES, ORDER):  # the second has more digits, and takes twice as long
        induced = Induced(shot, proved, order)
        size = _sizes(problem, solution, induced)
        kernel = _kernel(induced.rows, size)
        if not kernel.ncols():
            return Curved(0, flint().arb("inf"))
        curvature = induced.curvature(kernel)
        if not finite(curvature.entries()):
            raise SolveError("the Hessian of the word's problem has no finite enclosure")
        units = flint().arb_mat(size.size, size.size)
        for i, its in enumerate(size):
            units[i, i] = 1 / flint().arb(float(its))
        scaled = units * kernel
        found = _least(curvature, scaled.transpose() * scaled)
        if found is not None:
            return Curved(kernel.ncols(), found)
    raise SolveError("the least curvature is not shown to be positive")


def _sizes(problem: Problem, solution: Solution, induced: Induced) -> np.ndarray:
    """Return what the variables are measured in."""
    chain = induced.chain
    found = np.ones(induced.variables)
    found[: len(chain.free)] = scales(problem, solution)[chain.free]
    lengths = slice(len(chain.free), len(chain.free) + len(chain.pieces))
    found[lengths] = solution.final_time - solution.initial_time
    return found


def _least(curvature: Matrix, norm: Matrix) -> Ball | None:
    """Return what the curvature (k, k) is at least for changes whose norm (k, k) is 1, None where
    it is not shown to be positive; SolveError where it is negative.
    """
    values, vectors = eigh(floats(curvature), floats(norm))
    lowest, arb = float(values[0]), flint().arb
    for shy in _SHY if lowest > 0 else ():
        bound = arb(lowest * (1 - shy))
        if definite(curvature - norm * bound):
            return bound
    way = flint().arb_mat(len(values), 1, [float(each) for each in vectors[:, 0]])
    along, by = ((way.transpose() * each * way)[0, 0] for each in (curvature, norm))
    if negative(along):
        told = (along / by).upper().str(5, radius=False)
        raise SolveError(f"it is none: the curvature along a direction is at most {told}")
    return None


def definite(matrix: Matrix) -> bool:
    """Tell whether a symmetric matrix is positive definite, by the pivots of L D L'."""
    rows, n = matrix.tolist(), matrix.nrows()
    for k in range(n):
        pivot = rows[k][k]
        if not positive(pivot):
            return False
        for i in range(k + 1, n):
            share = rows[i][k] / pivot
            rows[i] = [a - share * b for a, b in zip(rows[i], rows[k], strict=True)]
    return True


def _kernel(rows: Sequence[Matrix], size: np.ndarray) -> Matrix:
    """Return a basis (n, k) of the directions that keep independent ones of the conditions."""
    module, n = flint(), size.size
    every = [row for block in rows for row in block.tolist()]
    if not every:
        return identity(n)
    near = floats(module.arb_mat(every)) * size
    near /= np.maximum(np.abs(near).max(axis=1, keepdims=True), np.finfo(float).tiny)
    _, triangle, order = qr(near.T, pivoting=True, mode="economic")
    rank = int((np.abs(np.diag(triangle)) > _RANK * np.abs(triangle[0, 0])).sum())
    chosen = order[:rank]
    columns = qr(near[chosen], pivoting=True, mode="economic")[2]
    solved, others = columns[:rank], columns[rank:]

    def part(places: np.ndarray) -> Matrix:
        entries = [every[i][j] for i in chosen for j in places]
        return module.arb_mat(rank, len(places), entries)

    found = module.arb_mat(n, len(others))
    for j, place in enumerate(others):
        found[int(place), j] = 1
    if len(others) == 0:
        part(solved).inv()
        return found
    answers = part(solved).solve(part(others))
    for i, place in enumerate(solved):
        for j in range(len(others)):
            found[int(place), j] = -answers[i, j]
    return found

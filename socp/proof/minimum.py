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
from socp.proof.balls import Ball, Matrix, flint, negative, positive
from socp.proof.induced import Induced
from socp.proof.krawczyk import Proved, Shot

# Of the conditions' largest: one with less beside the others follows from them, and is left out,
# which leaves more directions to show the sign on
_RANK = 1e-10
# Of the least curvature: as far below it, and as far as is needed, is what is shown of it
_SHY = (1e-12, *(10.0**-k for k in range(9, 0, -1)), 1.0)


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
    induced = Induced(shot, proved)
    first = shot.chain.free
    size = np.ones(induced.variables)
    size[: len(first)] = scales(problem, solution)[first]
    lengths = slice(len(first), len(first) + len(shot.chain.pieces))
    size[lengths] = solution.final_time - solution.initial_time
    return least(induced, size)


def least(induced: Induced, size: np.ndarray) -> Curved:
    """Show that the least curvature is positive, for variables of sizes (n,)."""
    kernel = _kernel(induced.rows, size)
    free = kernel.ncols()
    if not free:
        return Curved(0, flint().arb("inf"))
    curvature = induced.curvature(kernel)
    if not all(each.is_finite() for each in curvature.entries()):
        raise SolveError("the Hessian of the word's problem has no finite enclosure")
    units = flint().arb_mat(size.size, 1, [1 / flint().arb(float(each)) for each in size])
    scaled = flint().arb_mat(
        size.size,
        free,
        [kernel[i, j] * units[i, 0] for i in range(size.size) for j in range(free)],
    )
    norm = scaled.transpose() * scaled
    values, vectors = eigh(_floats(curvature), _floats(norm))
    lowest = float(values[0])
    if lowest > 0:
        for shy in _SHY:
            bound = flint().arb(lowest * (1 - shy))
            if definite(curvature - norm * bound):
                return Curved(free, bound)
    way = flint().arb_mat(free, 1, [float(each) for each in vectors[:, 0]])
    along = (way.transpose() * curvature * way)[0, 0]
    if negative(along):
        over = along / (way.transpose() * norm * way)[0, 0]
        raise SolveError(f"the curvature is {over.str(5)} along a direction: it is no minimum")
    raise SolveError(f"the least curvature, about {lowest:.3g}, is not shown to be positive")


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
        return module.arb_mat(n, n, [int(i == j) for i in range(n) for j in range(n)])
    floats = np.array([[float(each.mid()) for each in row] for row in every]) * size
    floats /= np.maximum(np.abs(floats).max(axis=1, keepdims=True), np.finfo(float).tiny)
    _, triangle, order = qr(floats.T, pivoting=True, mode="economic")
    rank = int((np.abs(np.diag(triangle)) > _RANK * np.abs(triangle[0, 0])).sum())
    chosen = order[:rank]
    columns = qr(floats[chosen], pivoting=True, mode="economic")[2]
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


def _floats(matrix: Matrix) -> np.ndarray:
    return np.array([[float(each.mid()) for each in row] for row in matrix.tolist()])

"""Kinks: where |x|, sign, min, max or a case distinction of the dynamics switches, an arc gets a
joint of its own.
"""

from dataclasses import replace
from itertools import accumulate, pairwise

import casadi
import numpy as np
from scipy.optimize import brentq

from socp.model import (
    SAME_TIME,
    Arc,
    Expr,
    Problem,
    Solution,
    column,
    evaluate,
    fold,
    join,
    parameters_of,
    time,
)
from socp.transcription.mesh import Mesh, table, uniform
from socp.transcription.phases import Phase, PhasedProblem
from socp.transcription.schemes import lgr

_BINARY = {casadi.OP_FMIN, casadi.OP_FMAX, casadi.OP_LT, casadi.OP_LE}
_UNARY = {casadi.OP_FABS, casadi.OP_SIGN}
# Points looked at between two nodes of a mesh: a crossing and back within one of them does not
# count
_LOOKS = 8
_SLIVER = 1e-3  # of a piece: a shorter interval beside a joint is not worth its nodes
# Random points at which expressions are compared: in more dimensions chance makes none parallel
_DRAWS = 6
_ALIKE = (
    1e-14  # by which two rows of values, of length 1, differ where they are parallel up to rounding
)
_CROWD = 8  # joints in one arc at most: what crosses more often is no kink but noise


def kinks(expression: Expr, given: Expr) -> Expr:
    """Return the expressions (k, 1) of symbols `given` at whose zeros an expression (m, n) is not
    smooth.

    |a| and sign a give a; min(a, b), max(a, b) and comparisons of a and b give a - b. Constants are
    left out, and so is what is a multiple of another, such as -a beside a: it vanishes where that
    does.
    """
    found: list[Expr] = []

    def built(operation: int, *arguments: Expr) -> Expr:
        if operation in _BINARY | _UNARY:
            found.append(arguments[0] - arguments[1] if operation in _BINARY else arguments[0])
        build = casadi.SX.binary if len(arguments) == 2 else casadi.SX.unary
        return build(operation, *arguments)

    fold(casadi.vec(expression), given, given.__getitem__, casadi.SX, built)
    distinct: list[Expr] = []
    for each in found:
        if not each.is_constant() and not any(
            casadi.is_equal(each, other, 50) for other in distinct
        ):
            distinct.append(each)
    return column(_apart(distinct, given))


def _apart(expressions: list[Expr], given: Expr) -> list[Expr]:
    """Return expressions without those that are multiples of one before them, as their values at
    random points tell.
    """
    at = np.random.default_rng(0).uniform(0.5, 1.5, (given.numel(), _DRAWS))
    rows = (
        casadi.Function("rows", [given], [casadi.densify(column(expressions))])
        .map(_DRAWS)(at)
        .full()
    )
    size = np.linalg.norm(rows, axis=1, keepdims=True)
    unit = rows / np.where(size > 0, size, 1.0)
    kept: list[int] = []
    for k in range(len(expressions)):  # where values are not finite nothing is alike
        if not any(
            min(np.abs(unit[k] - unit[j]).max(), np.abs(unit[k] + unit[j]).max()) <= _ALIKE
            for j in kept
        ):
            kept.append(k)
    return [expressions[k] for k in kept]


def cut_at_kinks(
    phased: PhasedProblem, solution: Solution, points: int
) -> tuple[PhasedProblem, Solution, list[Mesh], list[int]] | None:
    """Return a phased problem with arcs cut where the dynamics have a kink; None where there is
    none.

    With it come its solution so far, meshes of Radau `points` an interval, and the number of pieces
    of every arc. The kink vanishes at the joint, which so finds its place along with the switching
    times. Arcs with collocated controls or carried costates stay whole.
    """
    phases: list[Phase] = []
    arcs: list[Arc] = []
    meshes: list[Mesh] = []
    pieces: list[int] = []
    for phase, arc in zip(phased.phases, solution.arcs, strict=True):
        cuts = _crossings(phased, phase, arc, solution)
        parts = [
            phase,
            *(replace(phase, entry=(kink,), length=(0.0, np.inf)) for _, kink in cuts),
        ]
        phases += [*(replace(part, exit=()) for part in parts[:-1]), parts[-1]]
        edges = [float(arc.t[0]), *(t for t, _ in cuts), float(arc.t[-1])]
        for a, b in pairwise(edges):
            meshes.append(_between(arc, (a, b), points))
            arcs.append(_piece(arc, (a, b), meshes[-1]))
        pieces.append(len(cuts) + 1)
    if len(arcs) == len(solution.arcs):
        return None
    return (
        PhasedProblem(phased.of, tuple(phases)),
        replace(solution, arcs=tuple(arcs)),
        meshes,
        pieces,
    )


def smooth(problem: Problem, solution: Solution) -> bool:
    """Tell whether dynamics and running cost have no kink anywhere where a solution goes."""
    given = [problem.x, problem.u, time, problem.p]
    found = kinks(casadi.vertcat(problem.rate, problem.lagrangian), casadi.vertcat(*given))
    if not found.numel():
        return True
    function = casadi.Function("kinks", given, [casadi.densify(found)])
    p = parameters_of(problem, solution)
    values = evaluate(function, solution.rows("x"), solution.rows("u"), solution.t, p)[0]
    return bool((values.min(axis=1) * values.max(axis=1) > 0.0).all())


def rejoin(solution: Solution, pieces: list[int]) -> Solution:
    """Return a solution with so many pieces of every arc joined again."""
    ends = list(accumulate(pieces, initial=0))
    return replace(solution, arcs=tuple(join(solution.arcs[a:b]) for a, b in pairwise(ends)))


def _between(arc: Arc, span: tuple[float, float], points: int) -> Mesh:
    """Return the intervals of an arc's mesh between two times; slivers are left to their
    neighbours.
    """
    corners = arc.t[arc.mesh]
    if np.diff(corners).min() <= 4 * np.spacing(
        np.abs(corners).max()
    ):  # an arc that has shrunk to a point
        return uniform(lgr(points), 1)
    apart = _SLIVER * (span[1] - span[0])
    inside = corners[(corners > span[0] + apart) & (corners < span[1] - apart)]
    return [(float(share), lgr(points)) for share in np.diff([span[0], *inside, span[1]])]


def _piece(arc: Arc, span: tuple[float, float], mesh: Mesh) -> Arc:
    """Return the piece of an arc between two times, on a mesh of its own."""
    on = table(mesh)
    t = span[0] + (span[1] - span[0]) * on.tau
    x, u, costate = arc.at(t), arc.at(t, "u"), arc.at(t, "costate")
    return Arc(t=t, x=x, u=u, costate=costate, mesh=on.mesh, side=on.side, modes=arc.modes)


def _crossings(
    phased: PhasedProblem, phase: Phase, arc: Arc, solution: Solution
) -> list[tuple[float, Expr]]:
    """Return the times inside an arc at which a kink changes sign, in order, with the kink."""
    problem = phased.of
    length = arc.t[-1] - arc.t[0]
    if (
        phase.free.numel()
        or phase.carried.numel()
        or length <= SAME_TIME * (solution.final_time - solution.initial_time)
    ):
        return []
    given = casadi.vertcat(problem.x, time, problem.p)
    found = kinks(casadi.vertcat(*phase.flow(problem)), given)
    if not found.numel():
        return []
    p = parameters_of(problem, solution)
    values = casadi.Function("kinks", [given], [found])

    def at(t: np.ndarray) -> np.ndarray:
        points = np.vstack([arc.at(t), t[None, :], np.repeat(p[:, None], t.size, axis=1)])
        return np.array(values.map(t.size)(points).full())

    grid = np.unique(
        np.concatenate([np.linspace(a, b, _LOOKS + 1) for a, b in pairwise(arc.t[arc.mesh])])
    )
    sampled, crossings = at(grid), []
    for i in range(found.numel()):
        known = np.flatnonzero(
            sampled[i]
        )  # a zero that falls on a point is found between its neighbours
        row, times = sampled[i, known], grid[known]
        for k in np.flatnonzero(row[:-1] * row[1:] < 0.0):
            t = brentq(lambda t, i=i: at(np.array([t]))[i, 0], times[k], times[k + 1])
            crossings.append((float(t), found[i]))
    apart = SAME_TIME * length  # a crossing at an end of the arc is the end
    inside = [each for each in crossings if arc.t[0] + apart < each[0] < arc.t[-1] - apart]
    inside.sort(key=lambda each: each[0])
    # two kinks at one time, such as those of p and p v, need one joint
    single = [each for k, each in enumerate(inside) if k == 0 or each[0] - inside[k - 1][0] > apart]
    return single if len(single) <= _CROWD else []

"""Cuts: an arc gets a joint of its own where its dynamics have a kink, and where it touches a state
constraint.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import accumulate, pairwise
from typing import final

import casadi
import numpy as np

from socp.model import (
    ROUNDED,
    SAME_TIME,
    Arc,
    Constraint,
    Expr,
    Problem,
    Solution,
    column,
    constraint_function,
    evaluate,
    function_of,
    identity,
    in_arcs,
    join,
    lately,
    numbers,
    of_motion,
    once,
    parameters_of,
    time,
)
from socp.transcription.kinks import crossing
from socp.transcription.mesh import Mesh, nodes_of, uniform
from socp.transcription.motion import motion_of
from socp.transcription.phases import Phase, PhasedProblem, once_along
from socp.transcription.schemes import lgr

# Points looked at between two nodes of a mesh: a crossing and back within one of them does not
# count
_LOOKS = 8
_SLIVER = 1e-3  # of a piece: a shorter interval beside a joint is not worth its nodes
_CROWD = 8  # zeros of one expression in one arc at most: what has more is no kink but noise
_ARCS = 32  # arcs of a problem whose joints are kept: those of a few words, solved and judged
_MOST = 100  # cuts of one arc at most, of a table with as many knots
# Of the range of a constraint's values on an arc: a solver leaves as much at a node where it is
# active, and between the nodes beside it the constraint is violated
_TOUCHES = 1e-6
# Of the same range: a parabola's peak is missed by less, by looks an eighth of an arc apart
_BLUNT = 0.05
_ULPS = 8.0  # of the latest time: nodes that are as near are the same but for rounding


@final
@dataclass(frozen=True, eq=False)
class Cut:
    """A phased problem whose arcs are cut, with its solution so far, its meshes, and the number of
    `pieces` of every arc.
    """

    phased: PhasedProblem
    solution: Solution
    meshes: list[Mesh]
    pieces: list[int]


@final
@dataclass(frozen=True, eq=False)
class _Joint:
    """A time inside an arc, what vanishes there, and the constraints that this keeps at zero."""

    t: float
    held: tuple[Expr, ...]
    touched: frozenset[str] = frozenset()


def cut_arcs(phased: PhasedProblem, solution: Solution, points: int) -> Cut:
    """Return a phased problem with arcs cut where their dynamics have a kink, or where they touch a
    state constraint; as it is where they do neither.

    Its meshes have Radau `points` an interval. A kink vanishes at its joint, a constraint that is
    touched does so with its derivative: so the joints find their places along with the switching
    times. Without one a touch would fall between two nodes, and the constraint be violated beside
    them. Arcs with collocated controls or carried costates stay whole.
    """
    phases: list[Phase] = []
    arcs: list[Arc] = []
    meshes: list[Mesh] = []
    pieces: list[int] = []
    grid = _Grid(phased.of, solution)
    for k, (phase, arc) in enumerate(zip(phased.phases, solution.arcs, strict=True)):
        joints = _joints(_Looks(phase, grid, k))
        parts = [
            phase,
            *(
                replace(phase, entry=at.held, touched=at.touched, length=(0.0, np.inf))
                for at in joints
            ),
        ]
        phases += [*(replace(each, exit=()) for each in parts[:-1]), parts[-1]]
        edges = [float(arc.t[0]), *(at.t for at in joints), float(arc.t[-1])]
        for a, b in pairwise(edges):
            meshes.append(between(arc, (a, b), points))
            arcs.append(part(arc, (a, b), meshes[-1]))
        pieces.append(len(joints) + 1)
    if len(arcs) == len(solution.arcs):
        return Cut(phased, solution, meshes, pieces)
    cut = replace(phased, phases=tuple(phases))
    return Cut(cut, replace(solution, arcs=tuple(arcs)), meshes, pieces)


def rejoin(solution: Solution, pieces: list[int]) -> Solution:
    """Return a solution with so many pieces of every arc joined again."""
    ends = list(accumulate(pieces, initial=0))
    return replace(solution, arcs=tuple(join(solution.arcs[a:b]) for a, b in pairwise(ends)))


def between(arc: Arc, span: tuple[float, float], points: int) -> Mesh:
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


def resampled(solution: Solution, meshes: Sequence[Mesh]) -> Solution:
    """Return a solution on other meshes, one an arc."""
    arcs = (
        part(arc, (float(arc.t[0]), float(arc.t[-1])), mesh)
        for arc, mesh in zip(solution.arcs, meshes, strict=True)
    )
    return replace(solution, arcs=tuple(arcs))


def part(arc: Arc, span: tuple[float, float], mesh: Mesh) -> Arc:
    """Return the piece of an arc between two times, on a mesh of its own."""
    tau, corners = nodes_of(mesh)
    t, side = span[0] + (span[1] - span[0]) * tau, mesh[0][1].side
    alike = side == arc.side and np.array_equal(corners, arc.mesh)
    if alike and (np.abs(t - arc.t) <= _ULPS * np.spacing(np.abs(t).max())).all():
        return replace(arc, multipliers={})  # these are its own nodes
    x, u, costate = arc.at(t), arc.at(t, "u"), arc.at(t, "costate")
    return Arc(t=t, x=x, u=u, costate=costate, mesh=corners, side=side, modes=arc.modes)


def _joints(looks: "_Looks") -> tuple[_Joint, ...]:
    """Return the joints inside an arc, in order: looked for once for the same motion along the same
    law.
    """
    problem, phase, arc, solution = looks.problem, looks.phase, looks.arc, looks.grid.solution
    length, horizon = arc.t[-1] - arc.t[0], solution.final_time - solution.initial_time
    if phase.free.numel() or phase.carried.numel() or length <= SAME_TIME * horizon:
        return ()
    values = (each.tobytes() for each in (arc.t, arc.x, arc.mesh, looks.grid.p))
    # with what is kept the law stays, by whose places in memory it is told apart
    key = phase.modes, phase.when, phase.kept, *values, *identity(phase.control)
    return lately(problem, _joints, key, lambda: (phase.control, _looked_for(looks)), _ARCS)[1]


def _looked_for(looks: "_Looks") -> tuple[_Joint, ...]:
    found, (first, last) = [*_crossings(looks), *_touches(looks)], looks.inside
    apart = first - looks.arc.t[0]
    inside = sorted((each for each in found if first < each.t < last), key=lambda each: each.t)
    # two kinks at one time, such as those of p and p v, need one joint
    single = [each for k, each in enumerate(inside) if k == 0 or each.t - inside[k - 1].t > apart]
    return tuple(single) if len(single) <= _MOST else ()


@of_motion
def _crossings(looks: "_Looks") -> Iterator[_Joint]:
    """Yield where a kink of the dynamics changes sign."""
    problem, phase = looks.problem, looks.phase
    # on a fixed horizon those of time alone are knots
    boxes = problem.initial_time_box, problem.final_time_box
    fixed = all(first == last for first, last in boxes)
    found = once_along(
        problem, phase, _crossings, partial(_kinks, problem, phase, fixed=fixed), fixed
    )
    if found.numel():
        zeros = looks.zeros(found)
        for i, times in enumerate(zeros):
            yield from (_Joint(t, (found[i],)) for t, _ in times if len(times) <= _CROWD)


def _kinks(problem: Problem, phase: Phase, *, fixed: bool) -> Expr:
    """Return what vanishes (k, 1) at kinks along a phase, those of time alone left out or not."""
    found = motion_of(problem, phase).kinks
    if not fixed:
        return found
    others = casadi.vertcat(problem.x, problem.p)
    return column(each for each in casadi.vertsplit(found) if casadi.depends_on(each, others))


@of_motion
def _touches(looks: "_Looks") -> Iterator[_Joint]:
    """Yield where a state constraint that the law does not keep has a maximum of zero, or more,
    and is clearly negative before it and after it.
    """
    problem, phase = looks.problem, looks.phase
    for constraint in problem.constraints:
        if constraint.name in phase.kept:
            continue
        row = looks.grid.along(constraint)[looks.k]
        if not _peaks(row):
            continue
        c, times = constraint.expression, looks.times
        slope = once_along(
            problem, phase, _touches, partial(_slope, problem, phase, c), constraint.name
        )
        (peaks,), values = looks.zeros(slope), looks.values(c)
        least = -max(_TOUCHES * float(np.ptp(row)), ROUNDED * looks.size(constraint))
        for t, rises in peaks if len(peaks) <= _CROWD else ():
            beside = row[times < t].min(initial=0.0), row[times > t].min(initial=0.0)
            if not rises and values(np.array([t]))[0, 0] >= least > max(beside):
                yield _Joint(t, (c, slope), frozenset({constraint.name}))


def _slope(problem: Problem, phase: Phase, expression: Expr) -> Expr:
    """Return the derivative in time of an expression (1, 1) along a phase's law."""
    along = casadi.jtimes(expression, problem.x, phase.flow(problem)[0])
    return along + casadi.jacobian(expression, time)


@of_motion
@once
def _slopes(problem: Problem, constraint: Constraint) -> casadi.Function:
    """Return the slopes (1, nx) of a state constraint as a function of x, t, p."""
    slopes = casadi.densify(casadi.jacobian(constraint.expression, problem.x))
    return casadi.Function("slopes", [problem.x, time, problem.p], [slopes])


def _peaks(row: np.ndarray) -> bool:
    """Tell whether values (n,) along an arc may have a maximum of zero between its ends."""
    inner = row[1:-1]
    high = (inner >= row[:-2]) & (inner >= row[2:]) & (inner >= -_BLUNT * np.ptp(row))
    return bool(high.any())


@final
@dataclass(frozen=True, eq=False)
class _Grid:
    """Where the arcs of a solution are looked at, all of them at once."""

    problem: Problem
    solution: Solution

    @cached_property
    def p(self) -> np.ndarray:
        """Parameters (np,)."""
        return parameters_of(self.problem, self.solution)

    @cached_property
    def times(self) -> list[np.ndarray]:
        """Times (n,) of every arc: some between any two nodes of the mesh."""
        shares, found = np.arange(_LOOKS) / _LOOKS, []
        for arc in self.solution.arcs:
            ends = arc.t[arc.mesh]
            inner = ends[:-1, None] + np.diff(ends)[:, None] * shares
            found.append(np.unique(np.append(inner, ends[-1])))
        return found

    @cached_property
    def states(self) -> list[np.ndarray]:
        """States (nx, n) at these times."""
        return in_arcs(self.solution.arcs, "x", self.times)

    @once
    def along(self, constraint: Constraint) -> list[np.ndarray]:
        """Return the values (n,) of a constraint at these times."""
        function, x = constraint_function(self.problem, constraint), np.hstack(self.states)
        (values,) = evaluate(function, x, np.concatenate(self.times), self.p)
        return np.split(values[0], np.cumsum([t.size for t in self.times])[:-1])


@final
@dataclass(frozen=True, eq=False)
class _Looks:
    """Looks at expressions of x, t, p along arc k of a solution, on which a phase's law holds."""

    phase: Phase
    grid: _Grid
    k: int

    @property
    def problem(self) -> Problem:
        """What the solution is one of."""
        return self.grid.problem

    @property
    def arc(self) -> Arc:
        """The arc."""
        return self.grid.solution.arcs[self.k]

    @property
    def times(self) -> np.ndarray:
        """Times (n,) looked at."""
        return self.grid.times[self.k]

    @property
    def x(self) -> np.ndarray:
        """States (nx, n) at these times."""
        return self.grid.states[self.k]

    @cached_property
    def inside(self) -> tuple[float, float]:
        """Between which times joints are looked for: a crossing at an end of the arc is the end."""
        t = self.arc.t
        apart = SAME_TIME * (t[-1] - t[0])
        return float(t[0] + apart), float(t[-1] - apart)

    def size(self, constraint: Constraint) -> float:
        """Return how much a constraint changes at most when every state changes by its own largest
        value on the arc.
        """
        t, largest = self.times, np.abs(self.arc.x).max(axis=1)
        (slopes,) = evaluate(_slopes(self.problem, constraint), self.x, t, self.grid.p)
        return float((np.abs(slopes.reshape(t.size, -1)) @ largest).max())

    def values(self, expression: Expr) -> Callable[[np.ndarray], np.ndarray]:
        """Return an expression (k, 1) as a function of times (n,) that gives (k, n)."""
        problem, p = self.problem, self.grid.p
        function = function_of(problem, [problem.x, time, problem.p], expression)

        def at(t: np.ndarray) -> np.ndarray:
            x = self.x if t is self.times else self.arc.at(t)
            return numbers(function, x, t, p)[0]

        return at

    def zeros(self, expression: Expr) -> list[list[tuple[float, bool]]]:
        """Return for every entry of an expression (k, 1) the times at which it changes sign, and
        whether it rises there.
        """
        values, times = self.values(expression), self.times
        found: list[list[tuple[float, bool]]] = []
        for i, row in enumerate(values(times)):
            # a zero that falls on a point is found between its neighbours
            known = np.flatnonzero(row)
            signs, at = np.sign(row[known]), times[known]
            ends = np.flatnonzero(signs[:-1] != signs[1:])
            zeros = [(self._zero(values, i, at[k], at[k + 1]), bool(signs[k] < 0)) for k in ends]
            found.append([(t, rises) for t, rises in zeros if t is not None])
        return found

    def _zero(
        self, values: Callable[[np.ndarray], np.ndarray], i: int, first: float, last: float
    ) -> float | None:
        """Return where a row of values is zero between two times, None where it is of one sign, but
        for the arc's ends: one that is rounding, there or all along, has another sign whenever it
        is worked out.
        """
        first, last = max(first, self.inside[0]), min(last, self.inside[1])
        before, after = values(np.array([first, last]))[i]
        return crossing(lambda t: values(t)[i], first, last) if before * after < 0.0 else None

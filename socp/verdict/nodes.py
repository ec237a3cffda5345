"""The judge's nodes along a solution: intervals cut where anything jumps, touches or has a kink,
and values there.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import casadi
import numpy as np

from socp.model import (
    ACTIVE,
    SAME_TIME,
    Arc,
    Expr,
    Problem,
    Solution,
    column,
    evaluate,
    legendre_coefficients,
    of_motion,
    once,
    parameters_of,
    time,
)
from socp.transcription import knot_times, lgr
from socp.verdict.structure import constraint_values, nearness

# collocation points an interval: order 19, so that the judge's own error stays below what it judges
POINTS = 10
# intervals of the judge's mesh in one arc at most; finer meshes are joined in groups
_INTERVALS = 16
# switches and touches that get a joint of their own; more than that is ringing, which a uniform
# mesh shows as well
_CUTS = 64
# of an interval: how far inside it stands what an end of it takes where something jumps there; a
# solver places a kink to some 1e-11 of the horizon, and the shortest intervals are a thousandth of
# that
_INSIDE = 1e-8
# of the largest value along the solution: what is no jump changes by less over so little of an
# interval
_JUMPS = 1e-6
_BY_NODE = {"fx", "G", "cx", "fp", "cp"}  # whose first axis is the node; the others have it last
# passes that halve what is not smooth, the intervals they stop at, and the last Legendre
# coefficients that are smooth
_HALVINGS, _MOST, _SMOOTH = 5, 100, 1e-6


@final
@dataclass(frozen=True, eq=False)
class Samples:
    """The judge's nodes: k intervals of d + 1 nodes in time order, so that joints stand twice, once
    from either side.

    t (n,); x (nx, n); u (nu, n); arc (n,) index of the arc of the solution; edges (k + 1,); values
    of the problem there: f (nx, n), L (n,), fx (n, nx, nx), Lx (nx, n), G (n, nx, nu), L1 (nu, n),
    ft (nx, n), Lt (n,), c (nc, n), cx (n, nc, nx), ct (nc, n), fp (n, nx, np), Lp (np, n), cp
    (n, nc, np).
    """

    problem: Problem
    edges: np.ndarray
    t: np.ndarray
    x: np.ndarray
    u: np.ndarray
    arc: np.ndarray
    p: np.ndarray

    @property
    def intervals(self) -> int:
        """Number of intervals k."""
        return len(self.edges) - 1

    @property
    def width(self) -> int:
        """Nodes of one interval, d + 1."""
        return POINTS + 1

    def on_knot(self, t: np.ndarray) -> np.ndarray:
        """Tell which times (n,) are knots of the problem, at which its functions may jump."""
        apart = SAME_TIME * (self.edges[-1] - self.edges[0])
        known = np.array(knot_times(self.problem))
        near: np.ndarray = (np.abs(t[:, None] - known[None, :]) <= apart).any(axis=1)
        return near

    @cached_property
    def values(self) -> dict[str, np.ndarray]:
        """The problem's functions and slopes at the nodes, by the names of the class's docstring.

        At an end of an interval they are those of its inside: on a kink, of a state or of time,
        either side has slopes of its own, and the point itself those of neither. Where nothing
        jumps the node itself is taken.
        """
        found = values_at(self.problem, (self.x, self.u, self.t, self.p))
        first = np.arange(self.intervals) * self.width
        ends = np.concatenate([first, first + self.width - 1])
        step = _INSIDE * np.concatenate([np.diff(self.edges), -np.diff(self.edges)])
        with np.errstate(invalid="ignore"):
            x = self.x[:, ends] + found["f"][:, ends] * step
        inside = values_at(self.problem, (x, self.u[:, ends], self.t[ends] + step, self.p))
        for name, values in found.items():
            axis = 0 if name in _BY_NODE else -1
            at, its = np.moveaxis(values, axis, -1), np.moveaxis(inside[name], axis, -1)
            with np.errstate(invalid="ignore"):
                jumps = np.abs(its - at[..., ends]) > _JUMPS * np.abs(at).max(initial=0.0)
            at[..., ends] = np.where(
                jumps, its, at[..., ends]
            )  # a view: this writes into what is found
        return found


def values_at(
    problem: Problem, at: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return the functions and slopes of a problem at points: states (nx, n), controls (nu, n),
    times (n,), p (np,).
    """
    n, found = at[2].size, {}
    named = _named(problem)
    results = evaluate(_functions(problem), *at)
    for (name, expression), result in zip(named.items(), results, strict=True):
        rows, columns = expression.shape
        block = result.reshape(rows, n, columns) if columns else np.empty((rows, n, 0))
        found[name] = (
            block.transpose(1, 0, 2)
            if name in _BY_NODE
            else block[:, :, 0]
            if columns == 1
            else block.reshape(rows, n)
        )
    found["L"], found["Lt"] = found["L"][0], found["Lt"][0]
    return found


@of_motion
@once
def _functions(problem: Problem) -> casadi.Function:
    symbols = [problem.x, problem.u, time, problem.p]
    dense = [casadi.densify(expression) for expression in _named(problem).values()]
    return casadi.Function("along", symbols, dense)


@of_motion
@once
def _named(problem: Problem) -> dict[str, Expr]:
    x, u, p = problem.x, problem.u, problem.p
    c = column(constraint.expression for constraint in problem.constraints)
    f, L = problem.rate, problem.lagrangian
    return {
        "f": f,
        "L": L,
        "fx": casadi.jacobian(f, x),
        "Lx": casadi.jacobian(L, x).T,
        "G": problem.fields,
        "L1": casadi.jacobian(L, u).T,
        "ft": casadi.jacobian(f, time),
        "Lt": casadi.jacobian(L, time),
        "c": c,
        "cx": casadi.jacobian(c, x),
        "ct": casadi.jacobian(c, time),
        "fp": casadi.jacobian(f, p),
        "cp": casadi.jacobian(c, p),
        "Lp": casadi.jacobian(L, p).T,
    }


def sample(problem: Problem, solution: Solution) -> Samples:
    """Lay the judge's nodes over a solution: along its arcs, cut where controls switch and where
    constraints touch.
    """
    cuts = np.array([*solution.switches, *_touches(problem, solution)])
    cuts = np.append(cuts if cuts.size <= _CUTS else np.empty(0), knot_times(problem))
    samples = _laid(problem, solution, cuts)
    for _ in range(_HALVINGS):
        more = _rough(samples, solution)
        if not more.size or samples.intervals + more.size > _MOST:
            break
        cuts = np.append(cuts, more)
        samples = _laid(problem, solution, cuts)
    return samples


def _rough(samples: Samples, solution: Solution) -> np.ndarray:
    """Return the middles of the intervals on which the slopes of the dynamics are no polynomials,
    on arcs with laws.

    So a kink, as that of u |u|, comes to lie in a short interval: there the adjoint is of low
    order.
    """
    half = 0.5 * np.diff(samples.edges)
    fx = samples.values["fx"].reshape(samples.intervals, samples.width, -1) * half[:, None, None]
    by_node = np.moveaxis(fx, 1, 0)
    last = legendre_coefficients(lgr(POINTS).nodes, by_node, (-1.0, 1.0))[-2:]
    tail = np.abs(last).max(axis=(0, 2))
    lawful = np.array([solution.arcs[k].lawful for k in samples.arc[:: samples.width]])
    rough = lawful & (tail > _SMOOTH)
    return np.array((0.5 * (samples.edges[1:] + samples.edges[:-1]))[rough])


def _laid(problem: Problem, solution: Solution, cuts: np.ndarray) -> Samples:
    shortest = SAME_TIME * (
        solution.final_time - solution.initial_time
    )  # shorter arcs are points: their nodes differ by rounding alone
    tau = (lgr(POINTS).nodes + 1.0) / 2.0
    edges, ts, xs, us, arcs = [solution.initial_time], [], [], [], []
    for index, arc in enumerate(solution.arcs):
        if arc.t[-1] - arc.t[0] <= shortest:
            continue
        a, b = np.array(_intervals(arc, cuts)).T[:, :, None]
        t = a + (b - a) * tau
        t[:, -1:] = b
        # a node on a joint belongs to this side of it, and the control may jump there
        hair = 1e-12 * (b - a)
        ts.append(t.ravel())
        xs.append(arc.at(ts[-1]))
        us.append(arc.at(np.clip(t, a + hair, b - hair).ravel(), "u"))
        arcs.append(np.full(t.size, index))
        edges += b.ravel().tolist()
    if not ts:
        raise ValueError("the solution has no length in time")
    p = parameters_of(problem, solution)
    return Samples(
        problem,
        np.array(edges),
        np.concatenate(ts),
        np.hstack(xs),
        np.hstack(us),
        np.concatenate(arcs),
        p,
    )


def _intervals(arc: Arc, cuts: np.ndarray) -> list[tuple[float, float]]:
    """Return the judge's intervals on an arc: its own, joined in groups where many, halved where
    long, cut as given.
    """
    ends = _halved(arc)
    step = -(-(len(ends) - 1) // _INTERVALS)
    kept = np.append(ends[:-1:step], ends[-1])
    apart = SAME_TIME * (
        ends[-1] - ends[0]
    )  # cuts nearer to an end than this are that end, up to rounding
    inside = cuts[(cuts > ends[0] + apart) & (cuts < ends[-1] - apart)]
    points = np.unique(np.concatenate([kept, inside]))
    near = np.diff(points) <= apart
    points = np.delete(points, np.flatnonzero(near) + 1) if near.any() else points
    points[-1] = ends[-1]
    return list(zip(points[:-1].tolist(), points[1:].tolist(), strict=True))


def _halved(arc: Arc) -> np.ndarray:
    """Return the ends of an arc's intervals, those with more nodes than the judge's cut into equal
    parts.

    The costate is about as smooth as the states, so it needs as many nodes.
    """
    ends = arc.t[arc.mesh]
    parts = [1 if n <= POINTS + 2 else -(-n // POINTS) for n in np.diff(arc.mesh)]
    inner = [
        np.linspace(a, b, k + 1)[:-1] for a, b, k in zip(ends[:-1], ends[1:], parts, strict=True)
    ]
    return np.append(np.concatenate(inner), ends[-1])


def _touches(problem: Problem, solution: Solution) -> list[float]:
    """Return the times at which a state constraint that is inactive around them comes to zero."""
    found: list[float] = []
    grids = [  # an arc that was cut where it touches has a node there
        np.union1d(
            np.linspace(arc.t[0], arc.t[-1], 20 * min(len(arc.mesh), 50) + 1), arc.t[arc.mesh]
        )
        for arc in solution.arcs
    ]
    states = [arc.at(t) for t, arc in zip(grids, solution.arcs, strict=True)]
    for level, constraint in zip(-nearness(solution, problem), problem.constraints, strict=True):
        values = [
            constraint_values(problem, solution, constraint, t, x)
            for t, x in zip(grids, states, strict=True)
        ]
        for t, c in zip(grids, values, strict=True):
            near = c > level
            runs = np.split(np.arange(t.size), np.flatnonzero(np.diff(near.astype(int))) + 1)
            # a parabola is within ACTIVE of its peak for 2 sqrt(ACTIVE) of its span; a boundary arc
            # stays longer
            longest = 5.0 * np.sqrt(ACTIVE) * (t[-1] - t[0])
            short = [run for run in runs if near[run[0]] and np.ptp(t[run]) < longest]
            found += [
                float(t[run[np.argmax(c[run])]])
                for run in short
                if run[0] > 0 and run[-1] < t.size - 1
            ]
    return found

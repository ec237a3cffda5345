"""The judge's nodes along a solution: intervals cut where anything jumps, touches or has a kink,
and values there.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, cached_property
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
    in_arcs,
    lagrange,
    legendre_coefficients,
    of_motion,
    on_intervals,
    once,
    parameters_of,
    time,
)
from socp.transcription import knot_times, lgr
from socp.verdict.structure import constraints_function, nearness

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
# Radians over half an interval by which the costate may turn: of e^(i z tau) the last Legendre
# coefficients are some 1e-4 then, and what collocation leaves at the nodes below their square; and
# the intervals that it is cut into at most
_TURN, _TURNS = 3.0, 1000
_LOOKS = 5  # from one node to the next: between two of them a switching function may change sign


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

    def amid(self, *values: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return times (m,) between the nodes and values (r, m) there of those at the nodes
        (r, n).
        """
        shares, weights = _amid()
        t = self.edges[:-1, None] + np.diff(self.edges)[:, None] * shares
        found = [each.reshape(len(each), self.intervals, -1) @ weights for each in values]
        return t.ravel(), [each.reshape(len(each), -1) for each in found]

    @property
    def intervals(self) -> int:
        """Number of intervals k."""
        return len(self.edges) - 1

    @property
    def width(self) -> int:
        """Nodes of one interval, d + 1."""
        return POINTS + 1

    @cached_property
    def middles(self) -> tuple[float, ...]:
        """Middles of the intervals (k,)."""
        return tuple((0.5 * (self.edges[1:] + self.edges[:-1])).tolist())

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
        (found,) = evaluate(_functions(self.problem), self.x, self.u, self.t, self.p)
        first = np.arange(self.intervals) * self.width
        ends = np.concatenate([first, first + self.width - 1])
        step = _INSIDE * np.concatenate([np.diff(self.edges), -np.diff(self.edges)])
        with np.errstate(invalid="ignore"):
            x = self.x[:, ends] + found[: len(self.x), ends] * step  # the rates stand first
            inside = x, self.u[:, ends], self.t[ends] + step
            (its,) = evaluate(_functions(self.problem), *inside, self.p)
            parts = [part for part, _ in _rows(self.problem).values() if part.stop > part.start]
            largest = np.abs(found).max(axis=1)
            largest = np.maximum.reduceat(largest, [part.start for part in parts])
            most = _JUMPS * np.repeat(largest, [part.stop - part.start for part in parts])
            jumps = np.abs(its - found[:, ends]) > most[:, None]
        found[:, ends] = np.where(jumps, its, found[:, ends])
        return _by_name(self.problem, found)


def values_at(
    problem: Problem, at: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
) -> dict[str, np.ndarray]:
    """Return the functions and slopes of a problem at points: states (nx, n), controls (nu, n),
    times (n,), p (np,).
    """
    return _by_name(problem, evaluate(_functions(problem), *at)[0])


def _by_name(problem: Problem, found: np.ndarray) -> dict[str, np.ndarray]:
    """Return the values (rows, n) of functions and slopes at n points as `Samples` has them."""
    values = {}
    for name, (part, (rows, columns)) in _rows(problem).items():
        block = found[part]
        if name in _BY_NODE:
            block = block.reshape(columns, rows, found.shape[1]).transpose(2, 1, 0)
            block = np.ascontiguousarray(block)
        values[name] = block
    return {**values, "L": values["L"][0], "Lt": values["Lt"][0]}


@of_motion
@once
def _rows(problem: Problem) -> dict[str, tuple[slice, tuple[int, int]]]:
    """Return which of all rows are those of a function, and its shape."""
    found, last = {}, 0
    for name, expression in _named(problem).items():
        first, last = last, last + expression.numel()
        found[name] = slice(first, last), expression.shape
    return found


@of_motion
@once
def _functions(problem: Problem) -> casadi.Function:
    symbols = [problem.x, problem.u, time, problem.p]
    everything = casadi.veccat(*_named(problem).values())
    return casadi.Function("along", symbols, [casadi.densify(everything)])


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


def sample(problem: Problem, solution: Solution, seen: Sequence[float] = ()) -> Samples:
    """Lay the judge's nodes over a solution: along its arcs, cut where controls switch, where
    constraints touch, and at times that something was `seen` at.
    """
    cuts = np.array([*solution.switches, *_touches(problem, solution)])
    cuts = np.append(cuts if cuts.size <= _CUTS else np.empty(0), knot_times(problem))
    cuts = np.append(cuts, seen)
    samples = _laid(problem, solution, cuts)
    if (turns := _turning(samples)).size:
        cuts = np.append(cuts, turns)
        samples = _laid(problem, solution, cuts)
    for _ in range(_HALVINGS):
        more = _rough(samples, solution)
        if not more.size or samples.intervals + more.size > _MOST:
            break
        cuts = np.append(cuts, more)
        samples = _laid(problem, solution, cuts)
    return samples


def _turning(samples: Samples) -> np.ndarray:
    """Return where to cut the intervals over which the costate turns too far to be followed: along
    states at rest a solver needs few, and what is left of the costate then shows no sign of a
    switching function as it is.

    It turns by the imaginary parts of the eigenvalues of the dynamics' slopes.
    """
    half = 0.5 * np.diff(samples.edges)
    looks = samples.width * np.arange(samples.intervals)[:, None] + np.array(
        [0, samples.width // 2, samples.width - 1]
    )
    fx = samples.values["fx"][looks]
    most = np.linalg.norm(fx, axis=(2, 3)).max(axis=1)  # no eigenvalue is larger
    with np.errstate(invalid="ignore"):
        fast = np.flatnonzero(np.isfinite(most) & (most * half > _TURN))
    if not fast.size:
        return np.empty(0)
    speeds = np.abs(np.linalg.eigvals(fx[fast]).imag).max(axis=(1, 2))
    parts = np.ceil(speeds * half[fast] / _TURN).astype(int)
    parts = np.minimum(parts, max(_TURNS // fast.size, 1))
    starts, lengths = samples.edges[fast], 2.0 * half[fast]
    inner = [a + h * np.arange(1, k) / k for a, h, k in zip(starts, lengths, parts, strict=True)]
    return np.concatenate(inner)


def _rough(samples: Samples, solution: Solution) -> np.ndarray:
    """Return the middles of the intervals on which the slopes of the dynamics are no polynomials,
    on arcs with laws.

    So a kink, as that of u |u|, comes to lie in a short interval: there the adjoint is of low
    order.
    """
    half = 0.5 * np.diff(samples.edges)
    fx = samples.values["fx"].reshape(samples.intervals, samples.width, -1)
    tail = np.abs(_last_terms() @ fx).max(axis=(1, 2)) * half
    lawful = np.array([solution.arcs[k].lawful for k in samples.arc[:: samples.width]])
    rough = lawful & (tail > _SMOOTH)
    return np.array((0.5 * (samples.edges[1:] + samples.edges[:-1]))[rough])


@cache
def _amid() -> tuple[np.ndarray, np.ndarray]:
    """Return shares (m,) of an interval between its nodes, and what makes the values there (nodes,
    m) of those at the nodes.
    """
    tau = (lgr(POINTS).nodes + 1.0) / 2.0
    steps = np.arange(1, _LOOKS) / _LOOKS
    shares = (tau[:-1, None] + np.diff(tau)[:, None] * steps).ravel()
    return shares, lagrange(tau, np.eye(tau.size), shares)


@cache
def _last_terms() -> np.ndarray:
    """Return what makes the last two Legendre coefficients (2, nodes) of values at nodes."""
    nodes = lgr(POINTS).nodes
    return np.array(legendre_coefficients(nodes, np.eye(nodes.size), (-1.0, 1.0))[-2:])


def _laid(problem: Problem, solution: Solution, cuts: np.ndarray) -> Samples:
    shortest = SAME_TIME * (
        solution.final_time - solution.initial_time
    )  # shorter arcs are points: their nodes differ by rounding alone
    tau = (lgr(POINTS).nodes + 1.0) / 2.0
    edges, times, on, arcs, before = [np.array([solution.initial_time])], [], [], [], 0
    for index, arc in enumerate(solution.arcs):
        if arc.t[-1] - arc.t[0] > shortest:
            a, b = _intervals(arc, cuts)[:, :, None]
            t = a + (b - a) * tau
            t[:, -1:] = b
            # a node on a joint belongs to this side of it, and the control may jump there
            hair = 1e-12 * (b - a)
            inside = np.clip(t, a + hair, b - hair)
            on.append(before + arc.t[arc.mesh[1:-1]].searchsorted(inside.ravel(), side="right"))
            edges.append(b.ravel())
            times.append((t.ravel(), inside.ravel()))
            arcs.append(np.full(t.size, index))
        before += arc.mesh.size - 1
    if not times:
        raise ValueError("the solution has no length in time")
    (t, inside), interval = np.hstack(times), np.concatenate(on)
    return Samples(
        problem,
        np.concatenate(edges),
        t,
        on_intervals(solution.arcs, "x", t, interval),
        on_intervals(solution.arcs, "u", inside, interval),
        np.concatenate(arcs),
        parameters_of(problem, solution),
    )


def _intervals(arc: Arc, cuts: np.ndarray) -> np.ndarray:
    """Return where the judge's intervals on an arc begin and end (2, k): its own, joined in groups
    where many, halved where long, cut as given.
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
    return np.array([points[:-1], points[1:]])


def _halved(arc: Arc) -> np.ndarray:
    """Return the ends of an arc's intervals, those with more nodes than the judge's cut into equal
    parts.

    The costate is about as smooth as the states, so it needs as many nodes.
    """
    counts = np.diff(arc.mesh)
    ends: np.ndarray = arc.t[arc.mesh]
    if counts.max() <= POINTS + 2:
        return ends
    parts = [1 if n <= POINTS + 2 else -(-n // POINTS) for n in counts]
    inner = [
        np.linspace(a, b, k + 1)[:-1] for a, b, k in zip(ends[:-1], ends[1:], parts, strict=True)
    ]
    return np.append(np.concatenate(inner), ends[-1])


def _touches(problem: Problem, solution: Solution) -> list[float]:
    """Return the times at which a state constraint that is inactive around them comes to zero."""
    if not problem.constraints:
        return []
    # an arc that was cut where it touches has a node there
    grids = [
        np.union1d(
            np.linspace(arc.t[0], arc.t[-1], 20 * min(len(arc.mesh), 50) + 1), arc.t[arc.mesh]
        )
        for arc in solution.arcs
    ]
    states = np.hstack(in_arcs(solution.arcs, "x", grids))
    p, whole = parameters_of(problem, solution), np.concatenate(grids)
    values = evaluate(constraints_function(problem), states, whole, p)[0]
    ends = np.cumsum([t.size for t in grids])[:-1]
    near = values > -nearness(solution, problem)[:, None]
    found: list[float] = []
    for row, close in zip(values, near, strict=True):
        if close.any():
            parts = zip(grids, np.split(row, ends), np.split(close, ends), strict=True)
            found += [at for part in parts if part[2].any() for at in _peaks(*part)]
    return found


def _peaks(t: np.ndarray, c: np.ndarray, near: np.ndarray) -> list[float]:
    """Return the times of the largest values (n,) of a constraint in stretches of an arc at times
    (n,) that are `near` zero (n,), and short.
    """
    runs = np.split(np.arange(t.size), np.flatnonzero(np.diff(near.astype(int))) + 1)
    # a parabola is within ACTIVE of its peak for 2 sqrt(ACTIVE) of its span; a boundary arc stays
    # longer
    longest = 5.0 * np.sqrt(ACTIVE) * (t[-1] - t[0])
    short = [run for run in runs if near[run[0]] and np.ptp(t[run]) < longest]
    return [
        float(t[run[np.argmax(c[run])]]) for run in short if run[0] > 0 and run[-1] < t.size - 1
    ]

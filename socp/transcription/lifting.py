"""The two ways of a transcription: a guess pushed down into its variables, a point lifted up to a
solution.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import final

import casadi
import numpy as np

from socp.errors import MethodError
from socp.laws import at_length
from socp.model import Arc, Effort, Expr, Problem, Solution, numbers, of_motion, time
from socp.solvers import NLPPoint
from socp.transcription.mesh import Table
from socp.transcription.phases import Phase, PhasedProblem, once_alike

# Of a phase: which side of a jump a node is on, well above rounding and below any interval
_NUDGE = 1e-9


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Layout:
    """Where everything stands: slices into v and g, nodes at which the phases begin, and the last
    node; magnitudes of all variables (n,), `rows` (m,) and the objective, in which a programme
    measures them.
    """

    phased: PhasedProblem
    tables: list[Table]
    sizes: np.ndarray
    rows: np.ndarray
    cost: float
    first: list[int]
    lengths: slice
    parameters: slice
    states: slice
    free: list[slice]
    carried: list[slice]
    binaries: list[slice]
    defects: list[slice]
    path: dict[str, tuple[np.ndarray, slice]]

    def nodes(self, k: int) -> slice:
        """Return the nodes of a phase."""
        return slice(self.first[k], self.first[k + 1] + 1)

    def restored(self, point: NLPPoint) -> NLPPoint:
        """Return a point in the problem's units, its multipliers in the objective's over these."""
        told = np.asarray(point.trace.get("objective", ())) * self.cost
        trace = {**point.trace, "objective": tuple(told.tolist())} if point.trace else point.trace
        return replace(
            point,
            v=point.v * self.sizes,
            objective=point.objective * self.cost,
            lam_v=None if point.lam_v is None else point.lam_v * self.cost / self.sizes,
            lam_g=None if point.lam_g is None else point.lam_g * self.cost / self.rows,
            trace=trace,
        )


def push(layout: Layout, guess: Solution) -> NLPPoint:
    """Sample a guess at the nodes; with as many arcs as there are phases it brings the phases'
    lengths too.

    Raises MethodError where the guess is of other states or controls.
    """
    problem, count = layout.phased.of, len(layout.tables)
    for kind, ours, its in (
        ("states", problem.state_names, guess.state_names),
        ("controls", problem.control_names, guess.control_names),
    ):
        if its != ours:
            wanted, seen = (", ".join(names) or "none" for names in (ours, its))
            raise MethodError(
                f"guess: it has {kind} {seen}, but problem '{problem.name}' has {wanted}"
            )
    fitting = len(guess.arcs) == count
    corners = np.linspace(guess.initial_time, guess.final_time, count + 1)
    if fitting:
        corners = np.array([guess.initial_time, *(arc.t[-1] for arc in guess.arcs)])
    X, V, Y, Z = [], [], [], []
    for k in range(count):
        source = guess.arcs[k] if fitting else guess
        x, free = _sampled(
            source,
            layout.phased.phases[k],
            layout.tables[k],
            (corners[k], corners[k + 1] - corners[k]),
        )
        X.append(x[:, : None if k == count - 1 else -1])
        V.append(free.T.ravel())
        at = corners[k] + (corners[k + 1] - corners[k]) * layout.tables[k].tau
        Y.append(_carried(problem, source, layout.phased.phases[k], at))
        Z.append(_binaries(layout.phased.phases[k], source, corners[k : k + 2]))
    p = [guess.parameters.get(name, 0.0) for name in problem.parameter_names]
    return NLPPoint(
        v=np.concatenate([corners[:1], np.diff(corners), p, np.hstack(X).T.ravel(), *V, *Y, *Z])
        / layout.sizes
    )


def _binaries(phase: Phase, source: Arc | Solution, span: np.ndarray) -> np.ndarray:
    """Return the binaries (nz,) of a phase for the modes that the guess has in its middle."""
    if phase.choice is None:
        return np.empty(0)
    if isinstance(source, Solution):
        source = source.arcs[int(np.searchsorted(source.junctions, span.mean(), side="right"))]
    return phase.choice.values(source.modes)


def _carried(problem: Problem, source: Arc | Solution, phase: Phase, t: np.ndarray) -> np.ndarray:
    """Return guessed costates (nx * n,) at times t (n,) where a phase carries them, of the length
    that its law gives them; 1 where the guess knows none.
    """
    if not phase.carried.numel():
        return np.empty(0)
    return at_length(problem, np.nan_to_num(source.at(t, "costate"), nan=1.0)).T.ravel()


def _sampled(
    source: Arc | Solution, phase: Phase, t: Table, span: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Return states at all nodes and free controls at the collocated ones, one by one where the
    nodes are the same.
    """
    start, length = span
    chosen = [i for i, mode in enumerate(phase.modes) if mode.kind == "free"]
    at = start + length * t.tau
    rounding = 4.0 * np.spacing(
        np.abs(at).max()
    )  # more than the nodes of a very short phase are apart in time
    alike = (
        isinstance(source, Arc) and source.side == t.side and np.array_equal(source.mesh, t.mesh)
    )
    if (
        isinstance(source, Arc)
        and alike
        and np.abs(source.t - at).max() <= rounding + _NUDGE * length
    ):
        return source.x, source.u[chosen][:, t.collocated]
    inward = {"left": _NUDGE, "right": -_NUDGE, "both": 0.0}[t.side]
    seen = at + inward * length
    return source.at(at), source.at(at[t.collocated], "u", seen[t.collocated])[chosen]


def lift(layout: Layout, point: NLPPoint) -> Solution:
    """Return a point as a solution, with costates by the covector map and densities of the
    constraints' multipliers.
    """
    problem, point = layout.phased.of, layout.restored(point)
    p = point.v[layout.parameters]
    arcs = tuple(_arc(layout, point, k) for k in range(len(layout.tables)))
    return Solution(
        problem=problem.name,
        arcs=arcs,
        objective=point.objective,
        stop=point.stop,
        message=point.message,
        state_names=problem.state_names,
        control_names=problem.control_names,
        parameters=dict(zip(problem.parameter_names, p.tolist(), strict=True)),
        effort=Effort(iterations=point.iterations, seconds=point.seconds, trace=point.trace),
    )


def prolonged(coarse: Layout, fine: Layout, point: NLPPoint, solution: Solution) -> NLPPoint:
    """Return the point of a grid of equal intervals, and the solution that it was lifted to, on
    another one of the same scheme: a guess with its multipliers. Both grids are of one phase of
    free controls.

    Multipliers of defects are costates, whatever the length of an interval; those of what holds at
    a node are densities times that length, but for the states at the ends of the horizon.
    """
    start, told = push(fine, solution), coarse.restored(point)
    if told.lam_v is None or told.lam_g is None:
        return start
    lam_v, lam_g = told.lam_v, told.lam_g
    (c,), (f,), count = coarse.tables, fine.tables, int(coarse.tables[0].mesh[1])
    shorter, carrying = (c.mesh.size - 1) / (f.mesh.size - 1), [t.tau[t.collocated] for t in (c, f)]
    middles = [np.repeat((t.tau[t.mesh[1:]] + t.tau[t.mesh[:-1]]) / 2, count) for t in (c, f)]
    x = _spread(lam_v[coarse.states], (c.tau, f.tau), count, ends=True) * shorter
    nx = x.size // f.tau.size
    x[:nx], x[-nx:] = lam_v[coarse.states][:nx], lam_v[coarse.states][-nx:]
    free = _spread(lam_v[coarse.free[0]], carrying, count) * shorter
    rows = [_spread(lam_g[coarse.defects[0]], middles, count)]
    stop = coarse.defects[0].stop
    for _, at in coarse.path.values():
        rows.append(_spread(lam_g[at], (c.tau, f.tau), count) * shorter)
        stop = at.stop
    # what is asked for once, before the states and after all that is asked for along the way
    v = np.concatenate([lam_v[: coarse.states.start], x, free])
    g = np.concatenate([*rows, lam_g[stop:]])
    return replace(start, lam_v=v / fine.cost * fine.sizes, lam_g=g / fine.cost * fine.rows)


def _spread(
    values: np.ndarray, times: Sequence[np.ndarray], count: int, *, ends: bool = False
) -> np.ndarray:
    """Return values (n r,), r at each of the first times (n,), at the second times (m,), on
    straight lines through those of one place within all intervals, which have `count` each; with
    `ends` all but the first and the last values.
    """
    before, after = times
    rows = values.reshape(before.size, -1)
    found = np.empty((after.size, rows.shape[1]))
    for k in range(count):
        inner = slice(k + count * ends, before.size - count * ends, count)
        lines = [np.interp(after[k::count], before[inner], row) for row in rows[inner].T]
        found[k::count] = np.transpose(lines)
    return found.ravel()


def _arc(layout: Layout, point: NLPPoint, k: int) -> Arc:
    problem, phase, t = layout.phased.of, layout.phased.phases[k], layout.tables[k]
    lengths, v = point.v[layout.lengths], point.v
    corners = v[0] + np.append(0.0, np.cumsum(lengths))
    x = v[layout.states].reshape(-1, problem.x.numel()).T[:, layout.nodes(k)].copy()
    times = corners[k] + lengths[k] * t.tau
    times[-1] = corners[k + 1]
    free = _everywhere(v[layout.free[k]].reshape(t.collocated.size, -1).T, t, times)
    carried = v[layout.carried[k]].reshape(t.tau.size, -1).T
    z = v[layout.binaries[k]]
    given = [x, free, carried, times, v[layout.parameters], z]
    control, constants = _control(problem, phase)
    (u,) = numbers(control, constants, *given)
    return Arc(
        t=times,
        x=x,
        u=u,
        mesh=t.mesh,
        side=t.side,
        costate=carried if phase.carried.numel() else _costate(layout, point, k, given),
        modes=phase.choice.read(z) if phase.choice else phase.modes,
        multipliers=_multipliers(layout, point, k),
    )


def _everywhere(values: np.ndarray, t: Table, times: np.ndarray) -> np.ndarray:
    """Extend controls (nv, collocated) to all nodes by the polynomial of the interval where one is
    not collocated.
    """
    out = np.full((values.shape[0], t.tau.size), np.nan)
    out[:, t.collocated] = values
    if t.tau.size > t.collocated.size and values.shape[0]:
        end, missing, nearest = (len(t.mesh) - 2, -1, -2) if t.side == "left" else (0, 0, 1)
        arc = Arc(t=times, x=out, u=out, costate=out, mesh=t.mesh, side=t.side, modes=())
        nodes = arc.nodes(end, "u")
        distinct = np.ptp(times[nodes]) > 0
        out[:, missing] = arc.at(times[[missing]], "u")[:, 0] if distinct else out[:, nearest]
    return out


@of_motion
def _control(problem: Problem, phase: Phase) -> tuple[casadi.Function, np.ndarray]:
    """Return a phase's controls as a function of constants in it, x, v, y, t, p and z, and these
    constants (nc,).
    """
    whole, constants, values = phase.opened(problem)
    given = [constants, *_given(problem, phase)]
    make = partial(casadi.Function, "control", given, [whole.control])
    return once_alike(problem, whole, _control, make), np.array(values)


@of_motion
def _slope(problem: Problem, phase: Phase) -> tuple[casadi.Function, np.ndarray]:
    """Return the gradient of the Hamiltonian along a phase's law, which carries no costate, as a
    function of constants in it, the costate, x, v, y, t, p and z, and these constants (nc,).
    """
    whole, constants, values = phase.opened(problem)

    def made() -> casadi.Function:
        rate, running = whole.flow(problem)
        gradient = casadi.gradient(running + casadi.dot(problem.costate, rate), problem.x)
        given = [constants, problem.costate, *_given(problem, phase)]
        return casadi.Function("slope", given, [gradient])

    return once_alike(problem, whole, _slope, made), np.array(values)


def _given(problem: Problem, phase: Phase) -> list[Expr]:
    return [problem.x, phase.free, phase.carried, time, problem.p, phase.z]


def _costate(layout: Layout, point: NLPPoint, k: int, given: list[np.ndarray]) -> np.ndarray:
    """Return the costate (nx, n) of a phase, nan where the point has no multipliers; `given`: its
    x, v, y, t, p, z.
    """
    problem, t, nx = layout.phased.of, layout.tables[k], given[0].shape[0]
    costate = np.full((nx, t.tau.size), np.nan)
    if point.lam_g is None:
        return costate
    multipliers = point.lam_g[layout.defects[k]].reshape(-1, nx)
    costate[:, t.collocated] = (
        -t.B.transposed(multipliers).T[:, t.collocated] / t.weights[t.collocated]
    )
    gradient, constants = _slope(problem, layout.phased.phases[k])
    length, slope = point.v[layout.lengths][k], partial(numbers, gradient, constants)
    begins, ends = (_edge(t, multipliers, (length, slope, given), last) for last in (0, 1))
    inner = {
        "left": begins[:, 1:],
        "right": ends[:, :-1],
        "both": (begins[:, 1:] + ends[:, :-1]) / 2.0,
    }[t.side]
    costate[:, t.mesh] = np.hstack([begins[:, :1], inner, ends[:, -1:]])
    return costate


def _edge(
    t: Table,
    multipliers: np.ndarray,
    flow: tuple[float, Callable[..., list[np.ndarray]], list[np.ndarray]],
    last: int,
) -> np.ndarray:
    """Return the costates (nx, k) at the first (last = 0) or last (1) nodes of all intervals.

    They are the sensitivity of the rest of the Lagrangian to the state there, which has the order
    of the scheme; the stages' own costates have that of the stages: 2 for Hermite-Simpson, n for n
    Radau points.
    """
    length, gradient, given = flow
    outer, inner = t.at_edges[last]
    sensitivity: np.ndarray = outer.transposed(multipliers).T
    weights = t.edges[last]
    if (weights > 0).all():
        stage = -inner.transposed(multipliers).T / weights
        nodes = t.mesh[last : t.mesh.size - 1 + last]
        at = [*(a[:, nodes] for a in given[:3]), given[3][nodes], *given[4:]]
        (slope,) = gradient(stage, *at)
        sensitivity = sensitivity + length * weights * slope
    return sensitivity if last == 0 else -sensitivity


def _multipliers(layout: Layout, point: NLPPoint, k: int) -> dict[str, np.ndarray]:
    """Return the densities of the state constraints' multipliers at a phase's nodes: multiplier /
    (weight * length).
    """
    if point.lam_v is None or point.lam_g is None:
        return {}
    lengths = point.v[layout.lengths]
    mass = np.zeros(layout.first[-1] + 1)
    for j, t in enumerate(layout.tables):
        mass[layout.nodes(j)] += lengths[j] * t.weights
    own, here = lengths[k] * layout.tables[k].weights, layout.nodes(k)
    with np.errstate(divide="ignore", invalid="ignore"):
        return {
            constraint.name: np.where(
                own > 0, (_raw(layout, point, constraint.name) / mass)[here], np.nan
            )
            for constraint in layout.phased.of.constraints
        }


def _raw(layout: Layout, point: NLPPoint, name: str) -> np.ndarray:
    """Return the multiplier of one state constraint at every node (nodes,).

    A start or end value that is at least as tight as the bound carries the multiplier there: the
    bound's own is zero.
    """
    # the caller has looked
    assert point.lam_v is not None and point.lam_g is not None  # noqa: S101, PT018
    problem, raw = layout.phased.of, np.zeros(layout.first[-1] + 1)
    if name in layout.path:
        at, rows = layout.path[name]
        raw[at] = point.lam_g[rows]
        return raw
    state, side = name.rsplit(".", 1)
    i, row, sign = (
        problem.state_names.index(state),
        int(side == "upper"),
        1.0 if side == "upper" else -1.0,
    )
    raw = np.maximum(sign * point.lam_v[layout.states].reshape(-1, problem.x.numel())[:, i], 0.0)
    for node, ends in ((0, problem.start_box), (-1, problem.end_box)):
        if sign * ends[row, i] <= sign * problem.state_box[row, i]:
            raw[node] = 0.0
    return raw

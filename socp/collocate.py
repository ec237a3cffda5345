"""The one transcription: a phased problem on a mesh becomes a nonlinear programme, and its points solutions."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import final

import casadi
import numpy as np
from scipy import sparse

from socp.nlp import NLP, NLPPoint, Reduced
from socp.phases import Phase, PhasedProblem
from socp.problem import Problem
from socp.schemes import Scheme, Side
from socp.solution import Arc, Solution
from socp.symbols import Expr, column, final_time, initial_time, time

Mesh = Sequence[tuple[float, Scheme]]  # intervals of one phase: (share of its length, scheme)


def uniform(scheme: Scheme, intervals: int) -> Mesh:
    """Return a mesh of equal intervals."""
    return [(1.0 / intervals, scheme)] * intervals


@final
@dataclass(frozen=True, eq=False)
class Table:
    """The schemes of a mesh put together on [0, 1]: defects A X - length * B F = 0 over all n nodes of a phase.

    tau (n,); A and B (m, n) sparse; weights (n,) sum to 1; mesh (k + 1,) node indices of the interval ends.
    """

    tau: np.ndarray
    A: sparse.csr_matrix
    B: sparse.csr_matrix
    weights: np.ndarray
    mesh: np.ndarray
    side: Side

    @cached_property
    def collocated(self) -> np.ndarray:
        """Indices of the nodes that carry a control."""
        return np.flatnonzero(self.weights > 0)


def table(mesh: Mesh) -> Table:
    """Join the intervals of a mesh; neighbours share the node between them."""
    shares = np.array([share for share, _ in mesh]) / sum(share for share, _ in mesh)
    ends = np.append(0.0, np.cumsum(shares))
    corners = np.array(list(accumulate((s.nodes.size - 1 for _, s in mesh), initial=0)))
    tau, weights = np.zeros(corners[-1] + 1), np.zeros(corners[-1] + 1)
    entries: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
    for k, (_, scheme) in enumerate(mesh):
        here = slice(corners[k], corners[k + 1] + 1)
        tau[here] = ends[k] + shares[k] * (scheme.nodes + 1.0) / 2.0
        weights[here] += shares[k] / 2.0 * scheme.weights
        rows, columns = np.indices(scheme.A.shape)
        entries.append(((rows + corners[k]).ravel(), (columns + corners[k]).ravel(), scheme.A.ravel(), shares[k] / 2.0 * scheme.B.ravel()))
    tau[-1] = 1.0
    rows, columns, a, b = (np.concatenate(part) for part in zip(*entries, strict=True))
    A, B = (sparse.csr_matrix((data[data != 0], (rows[data != 0], columns[data != 0])), (corners[-1], tau.size)) for data in (a, b))
    return Table(tau, A, B, weights, corners, mesh[0][1].side)


@final
@dataclass(frozen=True, eq=False)
class _Model:
    """The casadi functions of one phase: rate and running cost, control, gradient of the Hamiltonian along the law."""

    rate: casadi.Function  # (x, v, t, p) -> (f, L)
    control: casadi.Function  # (x, v, t, p) -> u
    slope: casadi.Function  # (x, v, t, p, costate) -> dH/dx, laws included

    @staticmethod
    def of(problem: Problem, phase: Phase) -> "_Model":
        given = [problem.x, phase.free, time, problem.p]
        f, cost = (casadi.substitute(e, problem.u, phase.control) for e in (problem.rate, problem.lagrangian))
        H = cost + casadi.dot(problem.costate, f)
        return _Model(
            casadi.Function("rate", given, [f, cost]),
            casadi.Function("control", given, [phase.control]),
            casadi.Function("slope", [*given, problem.costate], [casadi.gradient(H, problem.x)]),
        )


class _Rows:
    """Collects constraint blocks with their bounds and remembers where each one stands."""

    def __init__(self) -> None:
        self.blocks: list[Expr] = []
        self.low: list[np.ndarray] = []
        self.high: list[np.ndarray] = []
        self.size = 0

    def add(self, block: Expr, low: float, high: float) -> slice:
        block = casadi.vec(block)
        count = block.numel()
        self.blocks.append(block)
        self.low.append(np.full(count, low))
        self.high.append(np.full(count, high))
        self.size += count
        return slice(self.size - count, self.size)


@final
@dataclass(frozen=True, eq=False)
class _Places:
    """Where everything stands: slices into v, slices into g, first nodes of the phases."""

    first: list[int]
    lengths: slice
    parameters: slice
    states: slice
    free: list[slice]
    defects: list[slice]
    path: dict[str, tuple[np.ndarray, slice]]


def collocate(phased: PhasedProblem, meshes: Sequence[Mesh]) -> Reduced[NLP, Solution, NLPPoint]:
    """Transcribe a phased problem on one mesh a phase.

    Variables: initial time, phase lengths, parameters, states at all nodes (shared between neighbours), free controls at the
    collocated nodes. `lift` gives costates by the covector map: -(B' multipliers) / weights at collocated nodes, the
    sensitivity of the phase's Lagrangian at its two ends (second order for the trapezoid, where the former is of first).
    """
    problem = phased.of
    tables = [table(mesh) for mesh in meshes]
    models = [_Model.of(problem, phase) for phase in phased.phases]
    first = list(accumulate((t.tau.size - 1 for t in tables), initial=0))
    nodes, nx, np_ = first[-1] + 1, problem.x.numel(), problem.p.numel()

    t0, lengths = casadi.SX.sym("t0"), casadi.SX.sym("h", len(tables))
    p, X = casadi.SX.sym("p", np_), casadi.SX.sym("X", nx, nodes)
    V = [casadi.SX.sym("V", phase.free.numel(), t.collocated.size) for phase, t in zip(phased.phases, tables, strict=True)]
    starts = [t0, *(t0 + casadi.sum1(lengths[: k + 1]) for k in range(len(tables)))]
    T = casadi.horzcat(*(starts[k] + lengths[k] * casadi.DM(t.tau[:-1]).T for k, t in enumerate(tables)), starts[-1])

    rows, cost, defects = _Rows(), casadi.SX(0), []
    for k, (t, model) in enumerate(zip(tables, models, strict=True)):
        here = first[k] + t.collocated
        F, L = _map(model.rate, [X[:, here.tolist()], V[k], starts[k] + lengths[k] * casadi.DM(t.tau[t.collocated]).T, p])
        cost += lengths[k] * casadi.dot(L.T, casadi.DM(t.weights[t.collocated]))
        left = casadi.mtimes(X[:, first[k] : first[k + 1] + 1], casadi.DM(t.A).T)
        defects.append(rows.add(left - lengths[k] * casadi.mtimes(F, casadi.DM(t.B[:, t.collocated]).T), 0.0, 0.0))
    path = _path(problem, phased.phases, first, (X, T, p), rows)
    _conditions(problem, phased.phases, (X, first, starts, p), rows)

    v = casadi.vertcat(t0, lengths, p, casadi.vec(X), *(casadi.vec(each) for each in V))
    f = cost + casadi.substitute(
        problem.mayer, casadi.vertcat(problem.x, problem.x0, problem.p, initial_time, final_time), casadi.vertcat(X[:, -1], X[:, 0], p, t0, starts[-1])
    )
    places = _places(first, len(tables), np_, nx * nodes, [each.numel() for each in V], defects, path)
    nlp = NLP(
        v=v, f=f, g=casadi.vertcat(*rows.blocks), v_box=_box(phased, tables, first, places),
        g_box=np.array([np.concatenate(rows.low), np.concatenate(rows.high)]), binary=np.zeros(v.numel(), dtype=bool),
    )  # fmt: skip
    return Reduced(nlp, lambda guess: _push(phased, tables, places, guess), lambda point: _lift(phased, tables, models, places, point))


def _map(function: casadi.Function, arguments: list[Expr]) -> list[Expr]:
    """Evaluate a function column by column; arguments of one column are repeated."""
    count = arguments[0].shape[1]
    outputs = function.map(count)(*(a if a.shape[1] == count else casadi.repmat(a, 1, count) for a in arguments))
    return list(outputs) if isinstance(outputs, (list, tuple)) else [outputs]


def _closed(phases: Sequence[Phase], first: list[int], name: str) -> np.ndarray:
    """Return a mask (nodes,) of the closed arcs whose law keeps a state constraint."""
    mask = np.zeros(first[-1] + 1, dtype=bool)
    for k, phase in enumerate(phases):
        if name in phase.kept:
            mask[first[k] : first[k + 1] + 1] = True
    return mask


def _path(problem: Problem, phases: Sequence[Phase], first: list[int], at: tuple[Expr, Expr, Expr], rows: _Rows) -> dict[str, tuple[np.ndarray, slice]]:
    X, T, p = at
    found = {}
    for constraint in problem.constraints:
        if constraint.name not in problem.path:
            continue  # bounds of states are bounds of variables
        open_nodes = np.flatnonzero(~_closed(phases, first, constraint.name))
        function = casadi.Function("c", [problem.x, time, problem.p], [constraint.expression])
        (values,) = _map(function, [X[:, open_nodes.tolist()], T[open_nodes.tolist()], p])
        found[constraint.name] = (open_nodes, rows.add(values, -np.inf, 0.0))
    return found


def _conditions(problem: Problem, phases: Sequence[Phase], at: tuple[Expr, list[int], list[Expr], Expr], rows: _Rows) -> None:
    X, first, starts, p = at
    for k, phase in enumerate(phases):
        if phase.entry:
            entry = casadi.Function("entry", [problem.x, time, problem.p], [column(phase.entry)])
            rows.add(entry(X[:, first[k]], starts[k], p), 0.0, 0.0)
    symbols = casadi.vertcat(problem.x, problem.x0, problem.p, initial_time, final_time)
    for condition in problem.conditions:
        value = casadi.substitute(condition.expression, symbols, casadi.vertcat(X[:, -1], X[:, 0], p, starts[0], starts[-1]))
        rows.add(value, 0.0 if condition.equation else -np.inf, 0.0)
    if np.isfinite(problem.final_time_box).any():
        rows.add(starts[-1], *problem.final_time_box)


def _places(
    first: list[int], phases: int, np_: int, states: int, free: list[int], defects: list[slice], path: dict[str, tuple[np.ndarray, slice]]
) -> _Places:  # fmt: skip
    cut = list(accumulate([1, phases, np_, states, *free]))
    slices = [slice(a, b) for a, b in zip(cut[:-1], cut[1:], strict=True)]
    return _Places(first, slices[0], slices[1], slices[2], slices[3:], defects, path)


def _box(phased: PhasedProblem, tables: list[Table], first: list[int], places: _Places) -> np.ndarray:
    problem = phased.of
    nodes = first[-1] + 1
    low, high = (np.repeat(row[:, None], nodes, axis=1) for row in problem.state_box)
    for i, name in enumerate(problem.state_names):
        low[i, _closed(phased.phases, first, f"{name}.lower")] = -np.inf
        high[i, _closed(phased.phases, first, f"{name}.upper")] = np.inf
    for node, ends in ((0, problem.start_box), (-1, problem.end_box)):
        low[:, node], high[:, node] = np.maximum(low[:, node], ends[0]), np.minimum(high[:, node], ends[1])
    free = [np.repeat(phase.box[:, None, :], t.collocated.size, axis=1).reshape(2, -1) for phase, t in zip(phased.phases, tables, strict=True)]
    lengths = np.array([[0.0], [np.inf]]).repeat(len(tables), axis=1)
    times = np.array(problem.initial_time_box)[:, None]
    return np.hstack([times, lengths, problem.parameter_box, np.array([low.T.ravel(), high.T.ravel()]), *free])


def _push(phased: PhasedProblem, tables: list[Table], places: _Places, guess: Solution) -> NLPPoint:
    problem = phased.of
    fitting = len(guess.arcs) == len(tables)
    corners = np.append(guess.initial_time, [arc.t[-1] for arc in guess.arcs]) if fitting else np.linspace(guess.initial_time, guess.final_time, len(tables) + 1)
    lengths = np.diff(corners)
    X, V = [], []
    for k, (phase, t) in enumerate(zip(phased.phases, tables, strict=True)):
        source = guess.arcs[k] if fitting else guess
        at = corners[k] + lengths[k] * t.tau
        X.append(source.at(at)[:, : None if k == len(tables) - 1 else -1])
        chosen = [i for i, mode in enumerate(phase.modes) if mode.kind == "free"]
        V.append(source.at(at[t.collocated], "u")[chosen].T.ravel())
    p = [guess.parameters.get(name, 0.0) for name in problem.parameter_names]
    return NLPPoint(v=np.concatenate([[corners[0]], lengths, p, np.hstack(X).T.ravel(), *V]))


def _lift(phased: PhasedProblem, tables: list[Table], models: list[_Model], places: _Places, point: NLPPoint) -> Solution:
    problem = phased.of
    v, nx = point.v, problem.x.numel()
    X = v[places.states].reshape(-1, nx).T
    lengths, p = v[places.lengths], v[places.parameters]
    corners = v[0] + np.append(0.0, np.cumsum(lengths))
    arcs = []
    for k, (phase, t, model) in enumerate(zip(phased.phases, tables, models, strict=True)):
        here = slice(places.first[k], places.first[k + 1] + 1)
        times = corners[k] + lengths[k] * t.tau
        times[-1] = corners[k + 1]
        V = _everywhere(v[places.free[k]].reshape(t.collocated.size, -1).T, t, times)
        arguments = [X[:, here], V, times[None, :], p[:, None]]
        costate = _costate(point, places.defects[k], t, lengths[k], model, arguments)
        arcs.append(
            Arc(
                t=times, x=X[:, here].copy(), u=_columns(model.control, arguments), costate=costate, mesh=t.mesh, side=t.side,
                modes=tuple(str(mode) for mode in phase.modes), multipliers=_multipliers(problem, places, point, here, t.weights * lengths[k]),
            )  # fmt: skip
        )
    return Solution(
        problem=problem.name, method="", arcs=tuple(arcs), objective=point.objective, stop=point.stop, message=point.message,
        state_names=problem.state_names, control_names=problem.control_names,
        parameters=dict(zip(problem.parameter_names, p.tolist(), strict=True)), iterations=point.iterations, seconds=point.seconds, trace=point.trace,
    )  # fmt: skip


def _everywhere(values: np.ndarray, t: Table, times: np.ndarray) -> np.ndarray:
    """Extend controls (nv, collocated) to all nodes by the polynomial of the interval where a node is not collocated."""
    out = np.full((values.shape[0], t.tau.size), np.nan)
    out[:, t.collocated] = values
    if t.tau.size > t.collocated.size and values.shape[0]:
        end = len(t.mesh) - 2 if t.side == "left" else 0
        arc = Arc(t=times, x=out, u=out, costate=out, mesh=t.mesh, side=t.side, modes=())
        missing = -1 if t.side == "left" else 0
        nodes = arc.nodes(end, "u")
        distinct = np.ptp(times) > 0
        out[:, missing] = arc.at(times[[missing]], "u")[:, 0] if distinct else out[:, nodes][:, missing]
    return out


def _columns(function: casadi.Function, arguments: list[np.ndarray]) -> np.ndarray:
    """Evaluate a function of one output on numbers, column by column."""
    (values,) = _map(function, [casadi.DM(a) for a in arguments])
    return np.array(values.full())


def _costate(point: NLPPoint, defects: slice, t: Table, length: float, model: _Model, arguments: list[np.ndarray]) -> np.ndarray:
    nx = arguments[0].shape[0]
    if point.lam_g is None:
        return np.full((nx, t.tau.size), np.nan)
    multipliers = point.lam_g[defects].reshape(-1, nx)
    pulled = (t.B.T @ multipliers).T
    costate = np.full((nx, t.tau.size), np.nan)
    costate[:, t.collocated] = -pulled[:, t.collocated] / t.weights[t.collocated]
    inner = (t.A.T @ multipliers).T
    for node, sign in ((0, 1.0), (-1, -1.0)):
        slope = 0.0
        if t.weights[node] > 0:
            state, free, times, p = (a[:, [0 if a.shape[1] == 1 else node]] for a in arguments)
            slope = length * t.weights[node] * model.slope(state, free, times, p, costate[:, node]).full()[:, 0]
        costate[:, node] = sign * (inner[:, node] + slope)
    return costate


def _multipliers(problem: Problem, places: _Places, point: NLPPoint, here: slice, mass: np.ndarray) -> dict[str, np.ndarray]:
    """Return the density of every state constraint's multiplier at the nodes of a phase: multiplier / (weight * length)."""
    if point.lam_v is None or point.lam_g is None:
        return {}
    bounds = point.lam_v[places.states].reshape(-1, problem.x.numel()).T
    nodes = places.first[-1] + 1
    found = {}
    for constraint in problem.constraints:
        raw = np.zeros(nodes)
        if constraint.name in places.path:
            at, rows = places.path[constraint.name]
            raw[at] = point.lam_g[rows]
        else:
            name, side = constraint.name.rsplit(".", 1)
            row = bounds[problem.state_names.index(name)]
            raw = np.maximum(row if side == "upper" else -row, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            found[constraint.name] = np.where(mass > 0, raw[here] / mass, np.nan)
    return found

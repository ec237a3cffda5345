"""The one transcription: a phased problem on a mesh becomes a nonlinear programme, and its points
solutions.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import accumulate, pairwise
from typing import final

import casadi
import numpy as np

from socp.errors import MethodError
from socp.model import (
    Expr,
    Solution,
    column,
    condition_slopes,
    constraint_function,
    end_symbols,
    time,
)
from socp.solvers import NLP, NLPPoint, Reduced
from socp.transcription.knots import knot_times
from socp.transcription.lifting import Layout, lift, mapped, push
from socp.transcription.mesh import Mesh, Table, table, uniform
from socp.transcription.phases import PhasedProblem
from socp.transcription.scaling import Scale

# Of a phase: more than the rounding of its times, and nothing beside the error of a grid
_HAIR = 1e-10

__all__ = ["Mesh", "Table", "collocate", "table", "uniform"]


def collocate(
    phased: PhasedProblem, meshes: Sequence[Mesh], near: Solution | None = None
) -> Reduced[NLP, Solution, NLPPoint]:
    """Transcribe a phased problem on one mesh a phase.

    Variables: initial time, phase lengths, parameters, states at all nodes (shared between
    neighbours), free controls at the collocated nodes, carried quantities, binaries a phase. Near a
    solution or guess each is measured in its own magnitude there, every row in what changes it and
    the objective in its own, so that nothing depends on the units of a problem; without one all
    are in these. Guesses and points are in the problem's units either way. `lift`
    gives costates by the covector map: -(B' multipliers) / weights at collocated nodes within an
    interval, and where intervals meet the sensitivity of the Lagrangian, which has the order of the
    scheme (on the side of the jump that is collocated). Raises MethodError where the meshes do not
    fit the phases.
    """
    if len(meshes) != len(phased.phases):
        raise MethodError(
            f"{len(meshes)} meshes for {len(phased.phases)} phases; give one mesh a phase"
        )
    grid = _grid(phased, [table(mesh) for mesh in meshes], Scale.of(phased.of, near))
    rows = _Rows([], [], [], [])
    cost, defects = _dynamics(grid, rows)
    path = _path(grid, rows)
    _conditions(grid, rows)
    layout = _layout(grid, rows, defects, path)
    mayer = casadi.substitute(
        phased.of.mayer, casadi.vertcat(*end_symbols(phased.of)), _end_values(grid)
    )
    binaries = sum(phase.z.numel() for phase in phased.phases)
    nlp = NLP(
        v=grid.v,
        f=(cost + mayer) / grid.scale.cost,
        g=casadi.vertcat(casadi.SX(0, 1), *rows.blocks),
        v_box=_box(layout) / layout.sizes,
        g_box=np.hstack(
            [
                np.zeros((2, 0)),
                *([low, high] for low, high in zip(rows.low, rows.high, strict=True)),
            ]
        ),
        binary=np.arange(grid.v.numel()) >= grid.v.numel() - binaries,
        unit=grid.scale.cost,
    )
    return Reduced(nlp, partial(push, layout), partial(lift, layout))


@final
@dataclass(frozen=True, eq=False)
class _Grid:
    """The symbols of a transcription, in the problem's units.

    v (n, 1): all variables, each in its own magnitude, sizes (n,); first: first node of every phase
    and the last node; lengths (phases, 1); p (np, 1); X (nx, nodes); V: free controls (nv,
    collocated) a phase; Y: carried quantities (ny, its nodes) a phase; starts: times at which the
    phases begin, and the final time.
    """

    phased: PhasedProblem
    tables: list[Table]
    scale: Scale
    v: Expr
    sizes: np.ndarray
    first: list[int]
    lengths: Expr
    p: Expr
    X: Expr
    V: list[Expr]
    Y: list[Expr]
    starts: list[Expr]

    def times(self, k: int) -> Expr:
        """Return the times of all nodes of a phase, as a row.

        Where the problem has knots a free control's intervals end a hair before them: at a knot
        itself its functions are those of what follows.
        """
        tau = self.tables[k].tau.copy()
        if self.phased.phases[k].free.numel() and knot_times(self.phased.of):
            tau[self.tables[k].mesh[1:]] -= _HAIR
        return self.starts[k] + self.lengths[k] * casadi.DM(tau).T


def _grid(phased: PhasedProblem, tables: list[Table], scale: Scale) -> _Grid:
    first = list(accumulate((t.tau.size - 1 for t in tables), initial=0))
    raw = [casadi.SX.sym("t0"), casadi.SX.sym("h", len(tables))]
    raw += [casadi.SX.sym("p", phased.of.p.numel())]
    raw += [casadi.SX.sym("X", phased.of.x.numel(), first[-1] + 1)]
    pairs = list(zip(phased.phases, tables, strict=True))
    raw += [casadi.SX.sym("V", f.free.numel(), t.collocated.size) for f, t in pairs]
    raw += [casadi.SX.sym("Y", f.carried.numel(), t.tau.size) for f, t in pairs]
    sizes = [np.full(1, scale.time), np.full(len(tables), scale.time), scale.p, scale.x]
    sizes += [scale.control(f) for f in phased.phases]
    sizes += [scale.costate[: f.carried.numel()] for f in phased.phases]
    columns = [np.tile(size, each.shape[1]) for size, each in zip(sizes, raw, strict=True)]
    t0, lengths, p, X, *rest = (
        each * casadi.DM(size.reshape(each.shape, order="F"))
        for each, size in zip(raw, columns, strict=True)
    )
    z = casadi.vertcat(casadi.SX(0, 1), *(phase.z for phase in phased.phases))
    return _Grid(
        phased=phased,
        tables=tables,
        scale=scale,
        v=casadi.vertcat(*(casadi.vec(each) for each in raw), z),
        sizes=np.concatenate([*columns, np.ones(z.numel())]),
        first=first,
        lengths=lengths,
        p=p,
        X=X,
        V=rest[: len(tables)],
        Y=rest[len(tables) :],
        starts=[t0, *(t0 + casadi.sum1(lengths[: k + 1]) for k in range(len(tables)))],
    )


@final
@dataclass(frozen=True, eq=False)
class _Rows:
    """Collects constraint blocks with their bounds and sizes, and tells where each one stands."""

    blocks: list[Expr]
    low: list[np.ndarray]
    high: list[np.ndarray]
    sizes: list[np.ndarray]

    def add(self, block: Expr, low: float, high: float, size: np.ndarray | float = 1.0) -> slice:
        """Add low <= block <= high, column after column, each row measured by its size (rows,);
        returns its rows in g.
        """
        before, count = sum(each.size for each in self.low), block.numel()
        sizes = np.tile(size, count // np.size(size)) if count else np.empty(0)
        self.blocks.append(casadi.vec(block) / casadi.DM(sizes))
        self.low.append(np.full(count, low) / sizes)
        self.high.append(np.full(count, high) / sizes)
        self.sizes.append(sizes)
        return slice(before, before + count)


def _dynamics(grid: _Grid, rows: _Rows) -> tuple[Expr, list[slice]]:
    """Add the defects of every phase and the boxes of its laws; returns running cost and the rows
    of the defects.
    """
    problem, cost, defects, laws = grid.phased.of, casadi.SX(0), [], []
    for k, (t, phase) in enumerate(zip(grid.tables, grid.phased.phases, strict=True)):
        given = [problem.x, phase.free, phase.carried, time, problem.p, phase.z]
        rate, running = phase.flow(problem)
        at, length = t.collocated.tolist(), grid.lengths[k]
        X = grid.X[:, grid.first[k] : grid.first[k + 1] + 1]
        along = [X[:, at], grid.V[k], grid.Y[k][:, at], grid.times(k)[:, at], grid.p, phase.z]
        function = casadi.Function(
            "rate", given, [casadi.vertcat(rate, phase.carried_rate), running]
        )
        F, L = mapped(function, along)
        for i in [
            i
            for i, mode in enumerate(phase.modes)
            if phase.boxed and mode.kind in {"singular", "boundary"}
        ]:
            if not phase.control[i].is_constant():
                (values,) = mapped(casadi.Function("law", given, [phase.control[i]]), along)
                laws.append((values, *problem.box[:, i], grid.scale.law(problem, i)))
        for row, low, high in phase.choice.along if phase.choice else ():
            laws.append((*mapped(casadi.Function("row", given, [row]), along), low, high, 1.0))
        cost += length * casadi.dot(L.T, casadi.DM(t.weights[at]))
        left = casadi.mtimes(casadi.vertcat(X, grid.Y[k]), casadi.DM(t.A).T)
        size = np.append(grid.scale.x, grid.scale.costate[: phase.carried.numel()])
        defects.append(
            rows.add(left - length * casadi.mtimes(F, casadi.DM(t.B[:, at]).T), 0.0, 0.0, size)
        )
    for values, low, high, width in laws:
        rows.add(values, low, high, width)
    return cost, defects


def _closed(phased: PhasedProblem, first: list[int], name: str) -> np.ndarray:
    """Return a mask (nodes,) of where a state constraint is kept anyway: on the closed arcs whose
    law keeps it, and where an arc begins at a touch.
    """
    mask = np.zeros(first[-1] + 1, dtype=bool)
    for k, phase in enumerate(phased.phases):
        if name in phase.kept:
            mask[first[k] : first[k + 1] + 1] = True
        if name in phase.touched:
            mask[first[k]] = True
    return mask


def _path(grid: _Grid, rows: _Rows) -> dict[str, tuple[np.ndarray, slice]]:
    """Add the path constraints where no law keeps them; bounds of states are bounds of
    variables.
    """
    problem, found = grid.phased.of, {}
    T = casadi.horzcat(*(grid.times(k)[:, :-1] for k in range(len(grid.tables))), grid.starts[-1])
    for constraint in problem.constraints:
        if constraint.name in problem.path:
            nodes = np.flatnonzero(~_closed(grid.phased, grid.first, constraint.name))
            function = constraint_function(problem, constraint)
            (values,) = mapped(function, [grid.X[:, nodes.tolist()], T[nodes.tolist()], grid.p])
            size = grid.scale.path(problem, constraint.expression)
            found[constraint.name] = (nodes, rows.add(values, -np.inf, 0.0, size))
    return found


def _conditions(grid: _Grid, rows: _Rows) -> None:
    """Add what holds at single times: entries and exits of arcs, end conditions, the final time."""
    phased, problem = grid.phased, grid.phased.of
    for k, phase in enumerate(phased.phases):
        for held, last in ((phase.entry, 0), (phase.exit, 1)):
            if held:
                given = [problem.x, phase.carried, time, problem.p]
                at = grid.X[:, grid.first[k + last]], grid.Y[k][:, -last], grid.starts[k + last]
                size = np.array([grid.scale.joint(problem, phase, each) for each in held])
                equations = casadi.Function("held", given, [column(held)])
                rows.add(equations(*at, grid.p), 0.0, 0.0, size)
        for row, low, high in phase.choice.entry if phase.choice else ():
            entry = casadi.Function(
                "entry", [problem.x, phase.carried, time, problem.p, phase.z], [row]
            )
            rows.add(
                entry(grid.X[:, grid.first[k]], grid.Y[k][:, 0], grid.starts[k], grid.p, phase.z),
                low,
                high,
            )
    for row, low, high in phased.rules:
        rows.add(row, low, high)
    for condition in problem.conditions:
        symbols = casadi.vertcat(*end_symbols(problem))
        value = casadi.substitute(condition.expression, symbols, _end_values(grid))
        change = grid.scale.condition(problem, condition_slopes(problem, condition))
        rows.add(value, 0.0 if condition.equation else -np.inf, 0.0, change)
    if np.isfinite(problem.final_time_box).any():
        rows.add(grid.starts[-1], *problem.final_time_box, grid.scale.time)


def _end_values(grid: _Grid) -> Expr:
    return casadi.vertcat(grid.X[:, -1], grid.X[:, 0], grid.p, grid.starts[0], grid.starts[-1])


def _layout(
    grid: _Grid, rows: _Rows, defects: list[slice], path: dict[str, tuple[np.ndarray, slice]]
) -> Layout:
    sizes = [1, len(grid.tables), grid.p.numel(), grid.X.numel()]
    sizes += [
        each.numel() for each in (*grid.V, *grid.Y, *(phase.z for phase in grid.phased.phases))
    ]
    _, lengths, parameters, states, *rest = (
        slice(a, b) for a, b in pairwise(accumulate(sizes, initial=0))
    )
    free, carried, binaries = (rest[k * len(grid.V) : (k + 1) * len(grid.V)] for k in range(3))
    return Layout(
        phased=grid.phased,
        tables=grid.tables,
        sizes=grid.sizes,
        rows=np.concatenate([np.empty(0), *rows.sizes]),
        cost=grid.scale.cost,
        first=grid.first,
        lengths=lengths,
        parameters=parameters,
        states=states,
        free=free,
        carried=carried,
        binaries=binaries,
        defects=defects,
        path=path,
    )


def _box(layout: Layout) -> np.ndarray:
    """Return the bounds of the variables (2, n)."""
    problem, phased, first = layout.phased.of, layout.phased, layout.first
    low, high = (np.repeat(row[:, None], first[-1] + 1, axis=1) for row in problem.state_box)
    for i, name in enumerate(problem.state_names):
        low[i, _closed(phased, first, f"{name}.lower")] = -np.inf
        high[i, _closed(phased, first, f"{name}.upper")] = np.inf
    for k, phase in enumerate(phased.phases):
        # bounds on every node of a state that stays as it is would be dependent: one is enough
        rest = [
            i for i, rate in enumerate(casadi.vertsplit(phase.flow(problem)[0])) if rate.is_zero()
        ]
        low[rest, first[k] + 1 : first[k + 1] + 1] = -np.inf
        high[rest, first[k] + 1 : first[k + 1] + 1] = np.inf
    for node, ends in ((0, problem.start_box), (-1, problem.end_box)):
        low[:, node], high[:, node] = (
            np.maximum(low[:, node], ends[0]),
            np.minimum(high[:, node], ends[1]),
        )
    lengths = np.array([phase.length for phase in layout.phased.phases]).T
    times = np.array(problem.initial_time_box)[:, None]
    free = [
        np.tile(phase.box, t.collocated.size)
        for phase, t in zip(phased.phases, layout.tables, strict=True)
    ]
    carried = sum(each.stop - each.start for each in layout.carried)
    unbounded = np.repeat([[-np.inf], [np.inf]], carried, axis=1)
    unit = np.repeat(
        [[0.0], [1.0]], sum(each.stop - each.start for each in layout.binaries), axis=1
    )
    return np.hstack(
        [
            times,
            lengths,
            problem.parameter_box,
            [low.T.ravel(), high.T.ravel()],
            *free,
            unbounded,
            unit,
        ]
    )

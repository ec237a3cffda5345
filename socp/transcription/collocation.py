"""The one transcription: a phased problem on a mesh becomes a nonlinear programme, and its points
solutions.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import accumulate
from typing import final

import casadi
import numpy as np

from socp.errors import MethodError
from socp.model import (
    Constraint,
    Expr,
    Problem,
    Solution,
    column,
    condition_slopes,
    end_symbols,
    of_motion,
    once,
    time,
)
from socp.solvers import NLP, NLPPoint, Reduced
from socp.transcription.assembly import Point
from socp.transcription.grid import Given, Grid, Moments, Terms
from socp.transcription.lifting import Layout, lift, push
from socp.transcription.mesh import Mesh, Table, table, uniform
from socp.transcription.phases import Phase, PhasedProblem, once_alike
from socp.transcription.scaling import Scale

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
    nlp, layout = laid_out(phased, meshes, near)
    return Reduced(nlp, partial(push, layout), partial(lift, layout))


def laid_out(
    phased: PhasedProblem, meshes: Sequence[Mesh], near: Solution | None = None
) -> tuple[NLP, Layout]:
    """Return the programme of `collocate`, and where everything stands in it."""
    if len(meshes) != len(phased.phases):
        raise MethodError(
            f"{len(meshes)} meshes for {len(phased.phases)} phases; give one mesh a phase"
        )
    grid = Grid.of(phased, [table(mesh) for mesh in meshes], Scale.of(phased.of, near))
    rows, terms = _Rows([], [], [], []), Terms(grid, {})
    defects = [_defects(grid, rows, k) for k in range(len(phased.phases))]
    for k, at in enumerate(defects):
        _dynamics(grid, rows, terms, k, at)
        _hold(grid, rows, k)
    path = _path(grid, rows, terms)
    _conditions(grid, rows, terms)
    layout = _layout(grid, rows, defects, path)
    programme, binaries = terms.programme(rows.count, rows.linear), grid.z.numel()

    def written() -> tuple[Expr, Expr, Expr]:
        v = casadi.vertcat(casadi.SX.sym("v", grid.count - binaries), grid.z)
        return v, *programme.values(v)

    nlp = NLP(
        formula=cache(written),
        v_box=_box(layout) / layout.sizes,
        g_box=np.array([np.concatenate([[], *rows.low]), np.concatenate([[], *rows.high])]),
        binary=np.arange(grid.count) >= grid.count - binaries,
        unit=grid.scale.cost,
        derivatives=lambda: programme.derivatives,
    )
    return nlp, layout


@final
@dataclass(frozen=True, eq=False)
class _Rows:
    """Collects the bounds and sizes of the rows, and the entries of what enters them linearly."""

    low: list[np.ndarray]
    high: list[np.ndarray]
    sizes: list[np.ndarray]
    linear: list[tuple[np.ndarray, np.ndarray, np.ndarray]]

    @property
    def count(self) -> int:
        """Number of the rows so far."""
        return sum(each.size for each in self.low)

    def add(self, count: int, low: float, high: float, size: np.ndarray | float = 1.0) -> slice:
        """Add so many rows between bounds, measured by their sizes (k,), over and over; returns
        where they stand in g.
        """
        before = self.count
        sizes = np.tile(size, count // np.size(size)) if count else np.empty(0)
        self.low.append(np.full(count, low) / sizes)
        self.high.append(np.full(count, high) / sizes)
        self.sizes.append(sizes)
        return slice(before, before + count)

    def each(self, at: slice, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the entries by which values at `places` enter the rows of the last slice added,
        one each.
        """
        return np.arange(at.start, at.stop), places, 1.0 / self.sizes[-1]


def _defects(grid: Grid, rows: _Rows, k: int) -> slice:
    """Add the rows of a phase's defects, A X - h B F, and what is linear in them; returns them."""
    t, phase = grid.tables[k], grid.phased.phases[k]
    places = np.vstack([grid.X[:, grid.first[k] : grid.first[k + 1] + 1], grid.Y[k]])
    size = np.append(grid.scale.x, grid.scale.costate[: phase.carried.numel()])
    at = rows.add(size.size * t.A.shape[0], 0.0, 0.0, size)
    A, of = t.A, np.arange(size.size)[:, None]
    row = at.start + size.size * A.rows[None, :] + of
    rows.linear.append(
        (row.ravel(), places[:, A.columns].ravel(), (A.values[None, :] / size[:, None]).ravel())
    )
    return at


def _dynamics(grid: Grid, rows: _Rows, terms: Terms, k: int, defects: slice) -> None:
    """Add the motion of a phase, its running cost, and the boxes of its laws."""
    problem, t, phase = grid.phased.of, grid.tables[k], grid.phased.phases[k]
    at, nz = t.collocated, phase.carried.numel() + problem.x.numel()
    laws = _laws(grid, k)
    point, constants = _motion(problem, phase, [row for row, *_ in laws])
    ny, K = point.y.numel(), at.size
    B, of = t.B.chosen(t.weights[t.B.columns] > 0), np.arange(nz)[:, None]
    row = defects.start + nz * B.rows[None, :] + of
    point_of = np.searchsorted(at, B.columns)
    size = np.append(grid.scale.x, grid.scale.costate[: phase.carried.numel()])
    entries = [
        (
            row.ravel(),
            (ny * point_of[None, :] + of).ravel(),
            (-B.values[None, :] / size[:, None]).ravel(),
        )
    ]
    for i, (_, low, high, width) in enumerate(laws):
        kept = rows.add(K, low, high, width)
        entries.append(rows.each(kept, ny * np.arange(K) + nz + 1 + i))
    cost = np.zeros((K, ny))
    if not point.y[nz].is_zero():  # else the objective is one of the ends alone
        cost[:, nz] = t.weights[at] / grid.scale.cost
    X, times = grid.X[:, grid.first[k] : grid.first[k + 1] + 1], grid.times(k)
    given: list[Given] = [
        X[:, at],
        grid.V[k],
        grid.Y[k][:, at],
        Moments(times.k[at], times.tau[at]),
    ]
    given += [grid.p[:, None], grid.Z[k][:, None], grid.lengths[k : k + 1, None]]
    rows_, places, factors = (np.concatenate(each) for each in zip(*entries, strict=True))
    terms.add(point, given, (rows_, places, factors), cost.ravel(), constants)


def _hold(grid: Grid, rows: _Rows, k: int) -> None:
    """Add that the free controls of a phase are constant over every interval, where they are
    held.
    """
    t, phase = grid.tables[k], grid.phased.phases[k]
    if not phase.held:
        return
    ends = t.mesh[1:] if t.side == "right" else t.mesh[1:] - 1  # the last collocated ones
    interval = np.searchsorted(ends, t.collocated)
    pairs = np.flatnonzero(np.diff(interval) == 0)
    V, size = grid.V[k].T, grid.scale.control(phase)
    at = rows.add(pairs.size * size.size, 0.0, 0.0, size)
    row, factor = np.arange(at.start, at.stop), 1.0 / rows.sizes[-1]
    rows.linear.append((row, V[pairs + 1].ravel(), factor))
    rows.linear.append((row, V[pairs].ravel(), -factor))


def _laws(grid: Grid, k: int) -> list[tuple[Expr, float, float, float]]:
    """Return what has to keep to bounds at every collocated node of a phase, with its size: the
    laws of controls where they are boxed, and the rows of a choice.
    """
    phase, problem = grid.phased.phases[k], grid.phased.of
    found = [
        (phase.control[i], *problem.box[:, i].tolist(), grid.scale.law(problem, i))
        for i, mode in enumerate(phase.modes)
        if phase.boxed
        and mode.kind in {"singular", "boundary"}
        and not phase.control[i].is_constant()
    ]
    return [*found, *((*row, 1.0) for row in (phase.choice.along if phase.choice else ()))]


@of_motion
def _motion(problem: Problem, phase: Phase, laws: Sequence[Expr]) -> tuple[Point, list[float]]:
    """Return a phase's rates and running cost, each times its length, and its laws as a function
    of x, free, carried, t, p, z and the length, with the constants among its controls: phases that
    differ in these alone share it.
    """
    whole, constants, values = phase.opened(problem)

    def made() -> Point:
        rate, running = whole.flow(problem)
        h = casadi.SX.sym("h")
        w = casadi.vertcat(problem.x, phase.free, phase.carried, time, problem.p, phase.z, h)
        y = casadi.vertcat(h * rate, h * phase.carried_rate, h * running, *laws)
        return Point(w, y, constants)

    return once_alike(problem, whole, _motion, made, laws), values


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


def _path(grid: Grid, rows: _Rows, terms: Terms) -> dict[str, tuple[np.ndarray, slice]]:
    """Add the path constraints where no law keeps them; bounds of states are bounds of
    variables.
    """
    problem, found = grid.phased.of, {}
    times = [grid.times(k) for k in range(len(grid.tables))]
    k = np.concatenate([*(each.k[:-1] for each in times), grid.end.k])
    tau = np.concatenate([*(each.tau[:-1] for each in times), grid.end.tau])
    for constraint in problem.constraints:
        if constraint.name in problem.path:
            nodes = np.flatnonzero(~_closed(grid.phased, grid.first, constraint.name))
            size = grid.scale.path(problem, constraint.expression)
            at = rows.add(nodes.size, -np.inf, 0.0, size)
            given: list[Given] = [grid.X[:, nodes], Moments(k[nodes], tau[nodes]), grid.p[:, None]]
            terms.add(_constraint(problem, constraint), given, rows.each(at, np.arange(nodes.size)))
            found[constraint.name] = (nodes, at)
    return found


@once
def _constraint(problem: Problem, constraint: Constraint) -> Point:
    """Return a state constraint as a function of x, t, p."""
    return Point(casadi.vertcat(problem.x, time, problem.p), constraint.expression)


def _conditions(grid: Grid, rows: _Rows, terms: Terms) -> None:
    """Add what holds at single times: entries and exits of arcs, end conditions, the final time."""
    phased, problem = grid.phased, grid.phased.of
    for k, phase in enumerate(phased.phases):
        for held, last in ((phase.entry, 0), (phase.exit, 1)):
            if held:
                size = np.array([grid.scale.joint(problem, phase, each) for each in held])
                at = rows.add(len(held), 0.0, 0.0, size)
                _joint(grid, terms, (k, last), column(held), rows.each(at, np.arange(len(held))))
        for row, low, high in phase.choice.entry if phase.choice else ():
            at = rows.add(1, low, high)
            _joint(grid, terms, (k, 0), casadi.SX(row), rows.each(at, np.arange(1)))
    binaries = np.concatenate([np.empty(0, dtype=int), *grid.Z])[:, None]
    for row, low, high in phased.rules:
        at = rows.add(1, low, high)
        terms.add(Point(grid.z, casadi.SX(row)), [binaries], rows.each(at, np.arange(1)))
    _ends(grid, rows, terms)


def _joint(
    grid: Grid,
    terms: Terms,
    where: tuple[int, int],
    held: Expr,
    out: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> None:
    """Add expressions of x, carried, t, p, z where a phase begins (k, 0) or ends (k, 1)."""
    (k, last), problem = where, grid.phased.of
    phase, node = grid.phased.phases[k], grid.first[k + last]
    w = casadi.vertcat(problem.x, phase.carried, time, problem.p, phase.z)
    moment = Moments(np.array([k]), np.array([float(last)]))
    given: list[Given] = [grid.X[:, node : node + 1], grid.Y[k][:, [-last]], moment]
    terms.add(Point(w, held), [*given, grid.p[:, None], grid.Z[k][:, None]], out)


def _ends(grid: Grid, rows: _Rows, terms: Terms) -> None:
    """Add the Mayer term, the end conditions and the bounds of the final time."""
    problem = grid.phased.of
    entries = []
    for i, condition in enumerate(problem.conditions):
        change = grid.scale.condition(problem, condition_slopes(problem, condition))
        at = rows.add(1, 0.0 if condition.equation else -np.inf, 0.0, change)
        entries.append(rows.each(at, np.array([1 + i])))
    if np.isfinite(problem.final_time_box).any() and grid.phased.length is None:
        at = rows.add(1, *problem.final_time_box, grid.scale.time)
        places = np.append(0, grid.lengths)
        factors = np.full(places.size, 1.0 / grid.scale.time)
        rows.linear.append((np.full(places.size, at.start), places, factors))
    point, begin = _end_values(problem), Moments(np.zeros(1, dtype=int), np.zeros(1))
    given: list[Given] = [grid.X[:, -1:], grid.X[:, :1], grid.p[:, None], begin, grid.end]
    none = (np.empty(0, dtype=int), np.empty(0, dtype=int), np.empty(0))
    out = tuple(np.concatenate(each) for each in zip(none, *entries, strict=True))
    cost = np.append(1.0 / grid.scale.cost, np.zeros(len(problem.conditions)))
    terms.add(point, given, (out[0], out[1], out[2]), cost)


@once
def _end_values(problem: Problem) -> Point:
    """Return the Mayer term and the end conditions as a function of the symbols of the ends."""
    conditions = (condition.expression for condition in problem.conditions)
    return Point(casadi.vertcat(*end_symbols(problem)), casadi.vertcat(problem.mayer, *conditions))


def _layout(
    grid: Grid, rows: _Rows, defects: list[slice], path: dict[str, tuple[np.ndarray, slice]]
) -> Layout:
    def at(places: np.ndarray, before: int) -> slice:
        return slice(before, before + places.size)

    parts = [grid.lengths, grid.p, grid.X, *grid.V, *grid.Y, *grid.Z]
    begin = accumulate((each.size for each in parts), initial=1)
    lengths, parameters, states, *rest = map(at, parts, begin)
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
    bounded = np.flatnonzero(np.isfinite(problem.state_box).any(axis=0)).tolist()
    for k, phase in enumerate(phased.phases):
        # bounds on every node of a state that stays as it is would be dependent: one is enough
        rest = phase.at_rest(problem, bounded)
        low[rest, first[k] + 1 : first[k + 1] + 1] = -np.inf
        high[rest, first[k] + 1 : first[k + 1] + 1] = np.inf
    for node, ends in ((0, problem.start_box), (-1, problem.end_box)):
        low[:, node], high[:, node] = (
            np.maximum(low[:, node], ends[0]),
            np.minimum(high[:, node], ends[1]),
        )
    known = phased.length
    bounds = [phase.length for phase in phased.phases] if known is None else [(known, known)]
    lengths = np.array(bounds).T
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

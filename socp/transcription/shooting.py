"""Multiple shooting along a word: explicit Runge-Kutta steps of order 8 in place of collocation.

It shares neither nodes nor arithmetic with the collocated programmes, so that agreement with them
means something.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import casadi
import numpy as np

from socp.model import (
    SAME_TIME,
    TINY,
    Arc,
    Expr,
    Problem,
    Solution,
    column,
    condition_function,
    condition_slopes,
    end_values,
    evaluate,
    lately,
    mayer_function,
    numbers,
    of_motion,
    parameters_of,
    rate_function,
    scales,
    time,
)
from socp.transcription.motion import Motion, motion_of
from socp.transcription.phases import Phase, PhasedProblem

# Of sizes: an inequality at an end as near as this to its limit is taken for an equation
_ACTIVE = 1e-7
# Of a state's size over the horizon: what moves slower next to its bound decays towards it
_RUNS = 1e-3
_ON = " on "  # before the name of a bound
_KEPT = 4  # shapes of a problem whose functions are kept: a search goes to and fro between two


@final
@dataclass(frozen=True, eq=False)
class EndRow:
    """What has a `level` at the ends of the horizon, by its name: `start.x`, `end.x`, a
    parameter's, `initial_time`, `final_time`, or `target.` and a condition's, whose level is 0; a
    bound's own name comes after that of its state. Of an active inequality, sign times multiplier
    must not be negative; an equation's is 0.
    """

    name: str
    level: float
    sign: float


@final
@dataclass(frozen=True, eq=False)
class Block:
    """Places of a phase's values among the variables (n + 1, nz) and of what its n intervals leave
    among the equations (n, nz), and the `shares` (n + 1,) of its length where these begin and end.

    `columns` (n, v) are the variables that z, t, h and p depend on where an interval begins, and
    `change` (n, nz + 2 + np, v) tells how.
    """

    variables: np.ndarray
    equations: np.ndarray
    shares: np.ndarray
    columns: np.ndarray
    change: np.ndarray


@final
@dataclass(frozen=True, eq=False)
class Shooting:
    """A phased problem without free controls as equations for Newton, around a solution with an arc
    a phase.

    The variables w are the initial time, the phases' lengths, the parameters, and for every phase
    the states (with what it carries) at the ends of the intervals of its arc's mesh; over each of
    these the motion is integrated in `steps` steps, so many a phase, by the formula of order 8 of
    Dormand and Prince (Hairer, Norsett, Wanner, Solving ODEs I, II.5). Inequalities at the ends
    that are within `near` of their limits, relative to the sizes of the states, are taken for
    equations; so are those of the `active` rows, by name and sign, however far they are.
    """

    phased: PhasedProblem
    solution: Solution
    steps: tuple[int, ...]
    near: float = _ACTIVE
    active: frozenset[tuple[str, float]] = frozenset()

    def in_steps(self, steps: tuple[int, ...]) -> "Shooting":
        """Return the same equations with so many steps an interval, on which nothing that they are
        made of depends: both have that.
        """
        found = replace(self, steps=steps)
        # what takes the longest is there before it is shared
        assert self.joined and self.blocks  # noqa: S101, PT018
        vars(found).update(vars(self) | {"steps": steps})
        return found

    @cached_property
    def pairs(self) -> list[tuple[Phase, Arc]]:
        """Every phase with its arc."""
        return list(zip(self.phased.phases, self.solution.arcs, strict=True))

    @cached_property
    def start(self) -> np.ndarray:
        """The solution's own values of the variables (n,)."""
        rows = [
            np.vstack([a.x, a.costate[: f.carried.numel()]])[:, a.mesh].T.ravel()
            for f, a in self.pairs
        ]
        lengths = [a.t[-1] - a.t[0] for _, a in self.pairs]
        p = parameters_of(self.phased.of, self.solution)
        return np.concatenate([[self.solution.initial_time], lengths, p, *rows])

    @cached_property
    def w(self) -> Expr:
        """Variables (n, 1)."""
        return casadi.SX.sym("w", self.start.size)

    @cached_property
    def parts(self) -> tuple[Expr, Expr, Expr, list[Expr]]:
        """Initial time, lengths (phases, 1), parameters (np, 1), and of every phase its values (nz,
        k + 1).
        """
        rows = self.phased.of.x.numel()
        sizes = [(rows + f.carried.numel()) * a.mesh.size for f, a in self.pairs]
        places = np.cumsum([0, 1, len(sizes), self.phased.of.p.numel(), *sizes]).tolist()
        t0, lengths, p, *z = casadi.vertsplit(self.w, places)
        return (
            t0,
            lengths,
            p,
            [casadi.reshape(e, -1, a.mesh.size) for e, (_, a) in zip(z, self.pairs, strict=True)],
        )

    @cached_property
    def motions(self) -> list[Motion]:
        """The motion along the law of every phase."""
        return [motion_of(self.phased.of, phase) for phase in self.phased.phases]

    @cached_property
    def blocks(self) -> list[Block]:
        """Where the intervals of every phase stand among variables and equations."""
        nx, row, at = self.phased.of.x.numel(), 0, 1 + len(self.pairs) + self.phased.of.p.numel()
        found = []
        for k, (phase, arc) in enumerate(self.pairs):
            rows, count = nx + phase.carried.numel(), arc.mesh.size
            shares = (arc.t[arc.mesh] - arc.t[0]) / (arc.t[-1] - arc.t[0])
            variables = at + np.arange(rows * count).reshape(count, rows)
            equations = row + np.arange(rows * (count - 1)).reshape(count - 1, rows)
            found.append(Block(variables, equations, shares, *self._laid(k, variables, shares)))
            row += equations.size + (nx if k else 0) + self.counts[k]
            at += variables.size
        return found

    def _laid(
        self, k: int, variables: np.ndarray, shares: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the columns of a block and the change of what its intervals begin with."""
        (n, nz), count = variables[1:].shape, self.phased.of.p.numel()
        others = [*range(2 + k), *(1 + len(self.pairs) + np.arange(count))]
        columns = np.hstack([variables[:-1], np.tile(others, (n, 1))]).astype(int)
        change = np.zeros((n, nz + 2 + count, columns.shape[1]))
        change[:, :nz, :nz] = np.eye(nz)
        change[:, nz, nz : nz + 1 + k] = 1.0
        change[:, nz, nz + 1 + k] = shares[:-1]
        change[:, nz + 1, nz + 1 + k] = np.diff(shares)
        change[:, nz + 2 :, nz + 2 + k :] = np.eye(count)
        return columns, change

    @cached_property
    def signs(self) -> np.ndarray:
        """Signs of the equations (m,), not 0 for active inequalities: sign times multiplier must
        not be negative there.
        """
        count = self.others.size + sum(each.equations.size for each in self.blocks)
        return np.append(np.zeros(count - len(self.ends)), [row.sign for row in self.ends])

    @cached_property
    def others(self) -> np.ndarray:
        """Places of the equations that are none of the motion: where phases meet, begin and end,
        and at the ends of the horizon.
        """
        nx, found, row = self.phased.of.x.numel(), [], 0
        for k, block in enumerate(self.blocks):
            row += block.equations.size
            more = (nx if k else 0) + self.counts[k]
            found.append(row + np.arange(more))
            row += more
        return np.concatenate([*found, row + np.arange(len(self.ends))]).astype(int)

    @cached_property
    def joined(self) -> tuple[casadi.Function, casadi.Function]:
        """Functions of what is none of the motion: w -> equations, but for the levels of those of
        the ends, Mayer term and their slopes, and (w, multipliers) -> the Hessian of both. What
        differs in values alone shares them.
        """
        phases = self.phased.phases
        held = [e.element_hash() for f in phases for e in column((*f.entry, *f.exit)).elements()]
        shape = [(len(f.entry), len(f.exit), f.carried.numel(), a.mesh.size) for f, a in self.pairs]
        key = (*held, *shape, *(row.name for row in self.ends))
        # with the phases their expressions stay, by whose places in memory they are told apart
        return lately(self.phased.of, _joined, key, lambda: (phases, _joined(self)), _KEPT)[1]

    @cached_property
    def levels(self) -> np.ndarray:
        """What the values of `joined` have to be (k,): the levels of the ends, zero elsewhere."""
        count = self.others.size - len(self.ends)
        return np.append(np.zeros(count), [row.level for row in self.ends])

    @cached_property
    def counts(self) -> list[int]:
        """Of every phase how many expressions vanish where it begins and where it ends."""
        return [column((*f.entry, *f.exit)).numel() for f in self.phased.phases]

    @cached_property
    def held(self) -> list[Expr]:
        """Of every phase the expressions (k, 1) that vanish where it begins and where it ends."""
        problem, (t0, lengths, p, z), found = self.phased.of, self.parts, []
        for k, phase in enumerate(self.phased.phases):
            given = casadi.vertcat(problem.x, phase.carried, time, problem.p)
            rows, begin = list[Expr](), t0 + casadi.sum1(lengths[:k])
            for held, at in ((phase.entry, 0), (phase.exit, -1)):
                if held:
                    moment = begin + lengths[k] if at else begin
                    values = casadi.vertcat(z[k][:, at], moment, p)
                    rows.append(casadi.substitute(column(held), given, values))
            found.append(casadi.vertcat(*rows))
        return found

    @cached_property
    def chain(self) -> tuple[np.ndarray, np.ndarray]:
        """Places of the variables that follow from the others, and of the equations that say so:
        the states where intervals end, and where phases meet.
        """
        nx = self.phased.of.x.numel()
        variables: list[int] = []
        equations: list[int] = []
        for k, block in enumerate(self.blocks):
            after = block.equations.size + block.equations[0, 0]
            joined = nx if k else 0
            variables += [*block.variables[0, :joined], *block.variables[1:].ravel()]
            equations += [*block.equations.ravel(), *range(after, after + joined)]
        return np.array(variables, dtype=int), np.array(equations, dtype=int)

    @cached_property
    def at_ends(self) -> Expr:
        """The values (k, 1) of the rows of the ends."""
        problem, (t0, lengths, p, z) = self.phased.of, self.parts
        nx, tf = problem.x.numel(), t0 + casadi.sum1(lengths)
        x0, xf = z[0][:nx, 0], z[-1][:nx, -1]
        given = casadi.vertsplit(casadi.vertcat(x0, xf, p, t0, tf))
        values = dict(zip(_end_names(problem), given, strict=True))
        values |= {
            f"target.{each.name}": condition_function(problem, each)(xf, x0, p, t0, tf)
            for each in problem.conditions
        }
        return casadi.vertcat(*(values[row.name.partition(_ON)[0]] for row in self.ends))

    @cached_property
    def ends(self) -> list[EndRow]:
        """The last rows of the equations: what is fixed at the ends, limits there, conditions."""
        problem, solution = self.phased.of, self.solution
        values = end_values(problem, solution)
        last, first, parameters, *times = values
        scale, horizon = scales(problem, solution), times[1] - times[0]
        near = [scale, scale, np.maximum(np.abs(parameters), TINY), [horizon, horizon]]
        boxes = [problem.start_box, problem.end_box, problem.parameter_box]
        boxes += [np.array([problem.initial_time_box, problem.final_time_box]).T]
        given = np.concatenate([first, last, parameters, times]), np.hstack(boxes)
        rows = list(self._rows(*given, self.near * np.concatenate(near)))
        held = {row.name for row in rows}
        rows += self._on_bounds(held, self.near * scale) if problem.constraints else []
        for condition in problem.conditions:
            psi = condition_function(problem, condition)
            slopes = numbers(condition_slopes(problem, condition), *values)
            size = sum(float(np.abs(each[0]) @ scale) for each in slopes[:2])
            name, sign = f"target.{condition.name}", 0.0 if condition.equation else 1.0
            met = float(numbers(psi, *values)[0][0, 0]) >= -self.near * (size or 1.0)
            if condition.equation or met or (name, sign) in self.active:
                rows.append(EndRow(name, 0.0, sign))
        return rows

    def _rows(self, value: np.ndarray, box: np.ndarray, near: np.ndarray) -> Iterator[EndRow]:
        """Yield which values (n,) at the ends are fixed, or near a limit of their box (2, n)."""
        for name, v, (low, high), size in zip(
            _end_names(self.phased.of), value, box.T, near, strict=True
        ):
            if low == high:
                yield EndRow(name, low, 0.0)
            elif v <= low + size or (name, -1.0) in self.active:
                yield EndRow(name, low, -1.0)
            elif v >= high - size or (name, 1.0) in self.active:
                yield EndRow(name, high, 1.0)

    def _on_bounds(self, held: set[str], near: np.ndarray) -> Iterator[EndRow]:
        """Yield the bounds of states, `near` (nx,) at an end where not `held`, that the motion has
        run into, there or before: what decays towards a bound is not held by it.
        """
        problem, box, solution = self.phased.of, self.phased.of.state_box[:, :, None], self.solution
        p, slow = parameters_of(problem, solution), _RUNS * near / self.near / np.ptp(solution.t)
        x, u, t = solution.rows("x"), solution.rows("u"), solution.t
        rate, off = evaluate(rate_function(problem), x, u, t, p)[0], np.abs(x - box) > near[:, None]
        asked = casadi.vertcat(*(each.expression for each in problem.conditions))
        for end, k, z in (("start", 1, problem.x0), ("end", -1, problem.x)):
            kept = self.phased.phases[min(k, 0)].kept
            count = off[:, :, ::k].argmax(axis=2)  # nodes in a row, seen from the end
            came = np.take_along_axis(rate[None, :, ::k], count[:, :, None] - 1, axis=2)[:, :, 0]
            for (j, i), on in np.ndenumerate((count > 0) & (np.abs(came) >= slow)):
                name = f"{(state := problem.state_names[i])}.{('lower', 'upper')[j]}"
                row = EndRow(f"{end}.{state}{_ON}{name}", box[j, i, 0], 2.0 * j - 1.0)
                if not (on or (row.name, row.sign) in self.active):
                    continue
                if f"{end}.{state}" in held or name in kept or casadi.depends_on(asked, z[i]):
                    continue
                yield row

    def split(self, w: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[np.ndarray]]:
        """Return the times (phases + 1,) between the phases, the parameters (np,) and the values
        (nz, k + 1) of every phase that variables w (n,) are.
        """
        count = 1 + len(self.pairs)
        corners = w[0] + np.append(0.0, np.cumsum(w[1:count]))
        p = w[count : count + self.phased.of.p.numel()]
        return corners, p, [w[block.variables].T for block in self.blocks]

    def lifted(self, w: np.ndarray, objective: float) -> Solution:
        """Return the motion of variables w (n,) at the nodes of the solution's meshes."""
        corners, p, z = self.split(w)
        arcs = tuple(
            self._arc(k, (corners[k], corners[k + 1]), p, z[k]) for k in range(len(self.pairs))
        )
        known = dict(zip(self.phased.of.parameter_names, p.tolist(), strict=True))
        return replace(self.solution, arcs=arcs, objective=objective, parameters=known)

    def _arc(self, k: int, span: tuple[float, float], p: np.ndarray, z: np.ndarray) -> Arc:
        problem, (phase, arc) = self.phased.of, self.pairs[k]
        nx = problem.x.numel()
        t = span[0] + (span[1] - span[0]) * (arc.t - arc.t[0]) / (arc.t[-1] - arc.t[0])
        t[-1] = span[1]
        found, counts = np.empty((len(z), t.size)), np.diff(arc.mesh)
        found[:, arc.mesh] = z
        for count in np.unique(counts[counts > 1]):  # from node to node, in steps as long as others
            some = np.flatnonzero(counts == count)
            nodes = arc.mesh[some, None] + np.arange(count + 1)
            share = np.diff(arc.t[nodes])[:, :-1] / np.ptp(arc.t[nodes], axis=1)[:, None]
            steps = np.ceil(share.max(axis=0) * self.steps[k] - SAME_TIME)
            parts = np.maximum(steps, 1.0).astype(int)
            h = np.repeat(np.diff(t[nodes])[:, :-1].T / parts[:, None], parts, axis=0)
            ways = self.motions[k].through(z[:, some], t[nodes[:, 0]], h, p)
            found[:, nodes[:, 1:-1]] = ways[np.cumsum(parts), :-2].transpose(1, 2, 0)
        (u,) = numbers(self.motions[k].control, found[:nx], found[nx:], t, p)
        costate = found[nx:] if phase.carried.numel() else arc.costate
        return replace(arc, t=t, x=found[:nx], u=u, costate=costate)


@of_motion
def _joined(shooting: Shooting) -> tuple[casadi.Function, casadi.Function]:
    nx, (t0, lengths, p, z) = shooting.phased.of.x.numel(), shooting.parts
    rows: list[Expr] = []
    for k, held in enumerate(shooting.held):
        rows += [*([z[k][:nx, 0] - z[k - 1][:nx, -1]] if k else []), held]
    equations = casadi.vertcat(*rows, shooting.at_ends)
    ends = [z[-1][:nx, -1], z[0][:nx, 0], p, t0, t0 + casadi.sum1(lengths)]
    w, by = shooting.w, casadi.SX.sym("l", shooting.others.size)
    cost = mayer_function(shooting.phased.of)(*ends)
    slopes = [casadi.jacobian(equations, w), casadi.gradient(cost, w)]
    hessian = casadi.hessian(cost + casadi.dot(by, equations), w)[0]
    return (
        casadi.Function("joined", [w], [equations, cost, *slopes]),
        casadi.Function("bent", [w, by], [hessian]),
    )


def _end_names(problem: Problem) -> list[str]:
    """Return the names of the values at the ends: of states at both, of parameters and times."""
    states = [f"{end}.{name}" for end in ("start", "end") for name in problem.state_names]
    return [*states, *problem.parameter_names, "initial_time", "final_time"]

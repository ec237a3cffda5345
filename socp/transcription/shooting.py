"""Multiple shooting along a word: explicit Runge-Kutta steps of order 8 in place of collocation.

It shares neither nodes nor arithmetic with the collocated programmes, so that agreement with them
means something.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import casadi
import numpy as np

from socp.model import (
    TINY,
    Arc,
    Expr,
    Solution,
    column,
    condition_function,
    condition_slopes,
    end_values,
    mayer_function,
    numbers,
    parameters_of,
    scales,
    time,
)
from socp.transcription.motion import Motion, motion_of
from socp.transcription.phases import Phase, PhasedProblem

_ACTIVE = (
    1e-7  # of sizes: an inequality at an end as near as this to its limit is taken for an equation
)


@final
@dataclass(frozen=True, eq=False)
class EndRow:
    """An expression that vanishes at the ends of the horizon: a value less the one that it is held
    at, by the name of the value, `start.x`, `end.x`, a parameter's, `initial_time`, `final_time`,
    or `target.` and a condition's.

    Of an active inequality, sign times multiplier must not be negative; the sign of an equation is
    0.
    """

    name: str
    expression: Expr
    sign: float


@final
@dataclass(frozen=True, eq=False)
class Block:
    """Places of a phase's values among the variables (n + 1, nz) and of what its n intervals leave
    among the equations (n, nz), and the `shares` (n + 1,) of its length where these begin and end.
    """

    variables: np.ndarray
    equations: np.ndarray
    shares: np.ndarray


@final
@dataclass(frozen=True, eq=False)
class Shooting:
    """A phased problem without free controls as equations for Newton, around a solution with an arc
    a phase.

    The variables w are the initial time, the phases' lengths, the parameters, and for every phase
    the states (with what it carries) at the ends of the intervals of its arc's mesh; over each of
    these the motion is integrated in `steps` steps by the formula of order 8 of Dormand and Prince
    (Hairer, Norsett, Wanner, Solving ODEs I, II.5). Inequalities at the ends that are within `near`
    of their limits, relative to the sizes of the states, are taken for equations; so are those of
    the `active` rows, by name and sign, however far they are.
    """

    phased: PhasedProblem
    solution: Solution
    steps: int
    near: float = _ACTIVE
    active: frozenset[tuple[str, float]] = frozenset()

    def in_steps(self, steps: int) -> "Shooting":
        """Return the same equations with so many steps an interval, on which nothing that they are
        made of depends: both have that.
        """
        found = replace(self, steps=steps)
        assert self.joined  # noqa: S101 - what takes the longest is there before it is shared
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
        return casadi.MX.sym("w", self.start.size)

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
            found.append(Block(variables, equations, shares))
            row += equations.size + (nx if k else 0) + self.held[k].numel()
            at += variables.size
        return found

    @cached_property
    def signs(self) -> np.ndarray:
        """Signs of the equations (m,), not 0 for active inequalities: sign times multiplier must
        not be negative there.
        """
        count = self.others.size + sum(each.equations.size for each in self.blocks)
        found = np.zeros(count)
        if self.ends:
            found[-len(self.ends) :] = [row.sign for row in self.ends]
        return found

    @cached_property
    def others(self) -> np.ndarray:
        """Places of the equations that are none of the motion: where phases meet, begin and end,
        and at the ends of the horizon.
        """
        nx, found, row = self.phased.of.x.numel(), [], 0
        for k, block in enumerate(self.blocks):
            row += block.equations.size
            more = (nx if k else 0) + self.held[k].numel()
            found.append(row + np.arange(more))
            row += more
        return np.concatenate([*found, row + np.arange(len(self.ends))]).astype(int)

    @cached_property
    def joined(self) -> tuple[casadi.Function, casadi.Function]:
        """Functions of what is none of the motion: w -> equations, Mayer term and their slopes, and
        (w, multipliers) -> the Hessian of both.
        """
        nx, (t0, lengths, p, z) = self.phased.of.x.numel(), self.parts
        rows: list[Expr] = []
        for k, held in enumerate(self.held):
            rows += [z[k][:nx, 0] - z[k - 1][:nx, -1]] if k else []
            rows.append(held)
        equations = casadi.vertcat(*rows, *(row.expression for row in self.ends))
        ends = [z[-1][:nx, -1], z[0][:nx, 0], p, t0, t0 + casadi.sum1(lengths)]
        cost, by = mayer_function(self.phased.of)(*ends), casadi.MX.sym("l", self.others.size)
        slopes = [casadi.jacobian(equations, self.w), casadi.gradient(cost, self.w)]
        hessian = casadi.hessian(cost + casadi.dot(by, equations), self.w)[0]
        return (
            casadi.Function("joined", [self.w], [equations, cost, *slopes]),
            casadi.Function("bent", [self.w, by], [hessian]),
        )

    @cached_property
    def held(self) -> list[Expr]:
        """Of every phase the expressions (k, 1) that vanish where it begins and where it ends."""
        problem, (t0, lengths, p, z) = self.phased.of, self.parts
        nx, found = problem.x.numel(), []
        for k, phase in enumerate(self.phased.phases):
            given = [problem.x, phase.carried, time, problem.p]
            rows, begin = [], t0 + casadi.sum1(lengths[:k])
            for held, at in ((phase.entry, 0), (phase.exit, -1)):
                if not held:
                    continue
                function = casadi.Function("held", given, [column(held)])
                moment = begin + lengths[k] if at else begin
                rows.append(function(z[k][:nx, at], z[k][nx:, at], moment, p))
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
    def ends(self) -> list[EndRow]:
        """What holds at the ends of the horizon, the last rows of the equations: fixed values,
        active limits, conditions.
        """
        problem, solution, (t0, lengths, p, z) = self.phased.of, self.solution, self.parts
        tf = t0 + casadi.sum1(lengths)
        x0, xf = z[0][: problem.x.numel(), 0], z[-1][: problem.x.numel(), -1]
        values = end_values(problem, solution)
        last, first, parameters, *times = values
        scale, horizon = scales(problem, solution), np.array([times[1] - times[0]])
        boxes = [np.array([box]).T for box in (problem.initial_time_box, problem.final_time_box)]
        near = self.near * np.maximum(np.abs(parameters), TINY)
        starts, stops = (
            tuple(f"{end}.{name}" for name in problem.state_names) for end in ("start", "end")
        )
        rows = [
            *self._rows(x0, first, problem.start_box, self.near * scale, starts),
            *self._rows(xf, last, problem.end_box, self.near * scale, stops),
            *self._rows(p, parameters, problem.parameter_box, near, problem.parameter_names),
            *self._rows(t0, np.array(times[:1]), boxes[0], self.near * horizon, ("initial_time",)),
            *self._rows(tf, np.array(times[1:]), boxes[1], self.near * horizon, ("final_time",)),
        ]
        for condition in problem.conditions:
            psi = condition_function(problem, condition)
            slopes = numbers(condition_slopes(problem, condition), *values)
            size = sum(float(np.abs(each[0]) @ scale) for each in slopes[:2])
            name, sign = f"target.{condition.name}", 0.0 if condition.equation else 1.0
            met = float(psi(*values)) >= -self.near * (size or 1.0)
            if condition.equation or met or (name, sign) in self.active:
                rows.append(EndRow(name, psi(xf, x0, p, t0, tf), sign))
        return rows

    def _rows(
        self,
        expression: Expr,
        value: np.ndarray,
        box: np.ndarray,
        near: np.ndarray,
        names: Sequence[str],
    ) -> list[EndRow]:
        """Return the entries of an expression that are fixed, or near a limit of their box
        (2, n).
        """
        found = []
        for i, (low, high) in enumerate(box.T):
            if low == high:
                found.append(EndRow(names[i], expression[i] - low, 0.0))
            elif value[i] <= low + near[i] or (names[i], -1.0) in self.active:
                found.append(EndRow(names[i], expression[i] - low, -1.0))
            elif value[i] >= high - near[i] or (names[i], 1.0) in self.active:
                found.append(EndRow(names[i], expression[i] - high, 1.0))
        return found

    def lifted(self, w: np.ndarray, objective: float) -> Solution:
        """Return the motion of variables w (n,) at the nodes of the solution's meshes."""
        t0, lengths, p, z = self.parts
        values = numbers(casadi.Function("parts", [self.w], [t0, lengths, p, *z]), w)
        corners = values[0][0, 0] + np.append(0.0, np.cumsum(values[1]))
        arcs = tuple(
            self._arc(k, (corners[k], corners[k + 1]), values[2][:, 0], values[3 + k])
            for k in range(len(self.pairs))
        )
        known = dict(zip(self.phased.of.parameter_names, values[2][:, 0].tolist(), strict=True))
        return replace(self.solution, arcs=arcs, objective=objective, parameters=known)

    def _arc(self, k: int, span: tuple[float, float], p: np.ndarray, z: np.ndarray) -> Arc:
        problem, (phase, arc) = self.phased.of, self.pairs[k]
        nx = problem.x.numel()
        t = span[0] + (span[1] - span[0]) * (arc.t - arc.t[0]) / (arc.t[-1] - arc.t[0])
        t[-1] = span[1]
        interval = np.clip(
            np.searchsorted(arc.mesh, np.arange(t.size), side="right") - 1, 0, arc.mesh.size - 2
        )
        begin = t[arc.mesh[interval]]
        found = self.motions[k].moved(z[:, interval], begin, t - begin, p, self.steps)[-1][:-2]
        found[:, arc.mesh] = z
        (u,) = numbers(self.motions[k].control, found[:nx], found[nx:], t, p)
        costate = found[nx:] if phase.carried.numel() else arc.costate
        return replace(arc, t=t, x=found[:nx], u=u, costate=costate)


def interval_ends(phased: PhasedProblem, start: Solution, steps: int) -> list[np.ndarray]:
    """Return, a phase at a time, states, what is carried and running cost (nz + 1, k) in which its
    intervals end.
    """
    p, found = parameters_of(phased.of, start), []
    for phase, arc in zip(phased.phases, start.arcs, strict=True):
        t = arc.t[arc.mesh]
        z = np.vstack([arc.x, arc.costate[: phase.carried.numel()]])[:, arc.mesh[:-1]]
        motion = motion_of(phased.of, phase)
        found.append(motion.moved(z, t[:-1], np.diff(t), p, steps)[-1][:-1])
    return found

"""The ends of the horizon as the judge sees them: slopes of Mayer term and end conditions, unknown multipliers."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

import casadi
import numpy as np

from socp.adjoint import Samples, Unknowns
from socp.problem import Problem
from socp.simulate import scales
from socp.solution import Solution
from socp.structure import ACTIVE
from socp.symbols import Expr, final_time, initial_time


@final
@dataclass(frozen=True, eq=False)
class Ends:
    """The Mayer term's slopes at the ends and those of the end conditions: cost (nx,), conditions (k, nx), and so on.

    `signs` (k,): 0 for equations, 1 for an inequality whose multiplier must not be negative. Fixed final states and
    active ends of intervals are conditions too, with unit slopes; sign -1 belongs to a lower end.
    `values` (k,) are those of the conditions, zero where they are met exactly.
    """

    slope_final: np.ndarray
    slope_initial: np.ndarray
    slope_tf: float
    slope_t0: float
    slope_p: np.ndarray
    psi_final: np.ndarray
    psi_initial: np.ndarray
    psi_tf: np.ndarray
    psi_t0: np.ndarray
    psi_p: np.ndarray
    signs: np.ndarray
    names: list[str]
    values: np.ndarray

    @staticmethod
    def of(problem: Problem, solution: Solution, samples: Samples) -> "Ends":
        """Work out the slopes at the ends of a solution."""
        x0, xf, p = solution.arcs[0].x[:, 0], solution.arcs[-1].x[:, -1], samples.p
        values = [xf, x0, p, solution.initial_time, solution.final_time]
        symbols = [problem.x, problem.x0, problem.p, initial_time, final_time]
        scale = scales(problem, solution)

        def slopes(expression: Expr) -> list[np.ndarray]:
            function = casadi.Function(
                "slopes", symbols, [casadi.densify(casadi.jacobian(expression, s)) for s in symbols]
            )
            return [each.full().ravel() for each in function(*values)]

        cost = slopes(problem.mayer)
        found: list[tuple[list[np.ndarray], int, str, float]] = []
        for condition in problem.conditions:
            value = float(casadi.Function("psi", symbols, [condition.expression])(*values))
            slope = slopes(condition.expression)
            size = float(np.abs(slope[0]) @ scale + np.abs(slope[1]) @ scale) or 1.0
            if condition.equation or value > -ACTIVE * size:
                found.append((slope, 0 if condition.equation else 1, f"target '{condition.name}'", value))
        found += list(_end_values(problem, xf, scale, [each.size for each in cost]))
        stacked = [np.array([row[0][i] for row in found]).reshape(len(found), cost[i].size) for i in range(5)]
        return Ends(
            cost[0], cost[1], float(cost[4][0]), float(cost[3][0]), cost[2], stacked[0], stacked[1], stacked[4][:, 0],
            stacked[3][:, 0], stacked[2], np.array([row[1] for row in found], dtype=int), [row[2] for row in found],
            np.array([row[3] for row in found]),
        )  # fmt: skip


def _end_values(
    problem: Problem, xf: np.ndarray, scale: np.ndarray, sizes: list[int]
) -> Iterator[tuple[list[np.ndarray], int, str, float]]:
    """Yield fixed final states and active ends of final intervals as conditions with unit slopes."""
    low, high = problem.end_box
    for i, name in enumerate(problem.state_names):
        near = ACTIVE * scale[i]
        sign = 0 if low[i] == high[i] else 1 if xf[i] > high[i] - near else -1 if xf[i] < low[i] + near else None
        if sign is not None:
            slope = [np.zeros(size) for size in sizes]
            slope[0][i] = 1.0
            yield slope, sign, f"final {name}", float(xf[i] - (low[i] if sign < 0 else high[i]))


def unknowns_of(problem: Problem, samples: Samples, ends: Ends) -> Unknowns:
    """Choose the unknowns: end conditions, densities on active intervals, jumps at their ends and at touches."""
    c, width = samples.values["c"], samples.width
    blocks: list[tuple[int, int]] = []
    jumps: list[tuple[int, int]] = []
    for j in range(len(problem.constraints)):
        near = ACTIVE * max(float(np.ptp(c[j])), 1e-300)
        at = c[j].reshape(-1, width) > -near
        active = at.all(axis=1)
        blocks += [(j, int(k)) for k in np.flatnonzero(active)]
        inner = np.arange(1, samples.intervals)
        met = at[inner - 1, -1] & at[inner, 0] & ~(active[inner - 1] & active[inner])
        jumps += [(j, int(k)) for k in inner[met]]
        held = np.flatnonzero(samples.values["cx"][-1, j])
        fixed = problem.end_box[0] == problem.end_box[1]
        if at[-1, -1] and not fixed[held].all():
            jumps.append((j, samples.intervals))
    return Unknowns(ends.psi_final.T, blocks, jumps)

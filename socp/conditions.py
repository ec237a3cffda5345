"""The conditions of Pontryagin's principle along a solution, every one affine in the unknown multipliers.

Conventions (docs/conventions.md): H = L + lambda . f is minimised, lambda' = -H_x - mu c_x, lambda(tf) = d(Mayer + nu psi)/dx(tf).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

import casadi
import numpy as np

from socp.adjoint import ACTIVE, POINTS, Costates, Samples, Unknowns
from socp.problem import Problem
from socp.schemes import lgr
from socp.simulate import scales
from socp.solution import Solution
from socp.structure import AT_BOUND
from socp.symbols import Expr, final_time, initial_time

_WEIGHTS = lgr(POINTS).weights
SCALE = "Hamiltonian at the"  # begins the names of the rows that tie the multipliers to the cost of a free time


@final
@dataclass(frozen=True, eq=False)
class Rows:
    """Conditions of one kind in units of the Hamiltonian: offset (m,) + matrix (m, nz) z is zero, or at most zero.

    `decisive` rows enter the least squares; the others (signs) are looked at afterwards. Rows that are not `pointwise` hold
    at every node of whole intervals.
    """

    name: str
    matrix: np.ndarray
    offset: np.ndarray
    t: np.ndarray
    where: list[str]
    equation: bool = True
    decisive: bool = True
    pointwise: bool = True

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """Return the violations (m,) at multipliers z (nz,)."""
        value = self.offset + self.matrix @ z
        return np.abs(value) if self.equation else np.maximum(value, 0.0)


@final
@dataclass(frozen=True, eq=False)
class Ends:
    """The Mayer term's slopes at the ends and those of the end conditions: cost (nx,), conditions (k, nx), and so on.

    `signs` (k,): 0 for equations, 1 for an inequality whose multiplier must not be negative. Fixed final states and active
    ends of intervals are conditions too, with unit slopes; sign -1 belongs to a lower end.
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

    @staticmethod
    def of(problem: Problem, solution: Solution, samples: Samples) -> "Ends":
        x0, xf, p = solution.arcs[0].x[:, 0], solution.arcs[-1].x[:, -1], samples.p
        values = [xf, x0, p, solution.initial_time, solution.final_time]
        symbols = [problem.x, problem.x0, problem.p, initial_time, final_time]
        scale = scales(problem, solution)

        def slopes(expression: Expr) -> list[np.ndarray]:
            function = casadi.Function("slopes", symbols, [casadi.densify(casadi.jacobian(expression, s)) for s in symbols])
            return [each.full().ravel() for each in function(*values)]

        cost = slopes(problem.mayer)
        found: list[tuple[list[np.ndarray], int, str]] = []
        for condition in problem.conditions:
            value = float(casadi.Function("psi", symbols, [condition.expression])(*values))
            slope = slopes(condition.expression)
            size = float(np.abs(slope[0]) @ scale + np.abs(slope[1]) @ scale) or 1.0
            if condition.equation or value > -ACTIVE * size:
                found.append((slope, 0 if condition.equation else 1, f"target '{condition.name}'"))
        found += list(_end_values(problem, xf, scale, [each.size for each in cost]))
        stacked = [np.array([row[0][i] for row in found]).reshape(len(found), cost[i].size) for i in range(5)]
        return Ends(
            cost[0], cost[1], float(cost[4][0]), float(cost[3][0]), cost[2], stacked[0], stacked[1], stacked[4][:, 0], stacked[3][:, 0],
            stacked[2], np.array([row[1] for row in found], dtype=int), [row[2] for row in found],
        )  # fmt: skip


def _end_values(problem: Problem, xf: np.ndarray, scale: np.ndarray, sizes: list[int]) -> Iterator[tuple[list[np.ndarray], int, str]]:
    """Yield fixed final states and active ends of final intervals as conditions with unit slopes."""
    low, high = problem.end_box
    for i, name in enumerate(problem.state_names):
        near = ACTIVE * scale[i]
        sign = 0 if low[i] == high[i] else 1 if xf[i] > high[i] - near else -1 if xf[i] < low[i] + near else None
        if sign is not None:
            slope = [np.zeros(size) for size in sizes]
            slope[0][i] = 1.0
            yield slope, sign, f"final {name}"


def unknowns_of(problem: Problem, samples: Samples, ends: Ends) -> Unknowns:
    """Choose the unknown multipliers: end conditions, densities on active intervals, jumps where a constraint begins, ends or touches."""
    c, width = samples.values["c"], samples.width
    blocks, jumps, labels = [], [], [f"multiplier of {name}" for name in ends.names]
    for j, constraint in enumerate(problem.constraints):
        near = ACTIVE * max(float(np.ptp(c[j])), 1e-300)
        at = c[j].reshape(-1, width) > -near
        active = at.all(axis=1)
        blocks += [(j, int(k)) for k in np.flatnonzero(active)]
        for k in range(1, samples.intervals):
            if at[k - 1, -1] and at[k, 0] and not (active[k - 1] and active[k]):
                jumps.append((j, k))
        held = np.flatnonzero(samples.values["cx"][-1, j])
        fixed = problem.end_box[0] == problem.end_box[1]
        if at[-1, -1] and not fixed[held].all():
            jumps.append((j, samples.intervals))
    labels += [f"jump of {problem.constraints[j].name}" for j, _ in jumps]
    return Unknowns(ends.psi_final.T, blocks, jumps, labels)


# -- the conditions


def conditions(
    problem: Problem, solution: Solution, samples: Samples, unknowns: Unknowns, costates: Costates, ends: Ends
) -> Iterator[Rows]:  # fmt: skip
    horizon = solution.final_time - solution.initial_time
    yield from _switching(problem, solution, samples, costates)
    yield from _hamiltonian(problem, samples, unknowns, costates, ends)
    yield from _transversality(problem, solution, samples, unknowns, costates, ends, horizon)
    yield from _signs(problem, solution, samples, unknowns, ends, horizon)


def mode_at(solution: Solution, control: str, t: float) -> tuple[str, int]:
    """Return the mode of a control at a time and the number of its stretch, from 1."""
    row = solution.structure[control]
    k = int(np.searchsorted([end for _, _, end in row[:-1]], t, side="right"))
    return row[k][0], k + 1


def sigma(samples: Samples, costates: Costates) -> tuple[np.ndarray, np.ndarray]:
    """Return the switching functions as offset (nu, n) and matrix (nu, n, nz)."""
    v = samples.values
    offset = v["L1"] + np.einsum("njk,nj->kn", v["G"], costates.offset)
    return offset, np.einsum("njk,njz->knz", v["G"], costates.maps)


def _switching(problem: Problem, solution: Solution, samples: Samples, costates: Costates) -> Iterator[Rows]:
    """Yield the minimum condition: sigma = 0 where a control is inside its box and where it switches, its sign at a bound.

    The residual is the Hamiltonian that the best admissible value of this control would gain, sigma times the distance to it.
    """
    offset, matrix = sigma(samples, costates)
    low, high = problem.box
    middle = 0.5 * (samples.edges[1:] + samples.edges[:-1])
    for i, name in enumerate(problem.control_names):
        width = high[i] - low[i]
        stretches = [mode_at(solution, name, float(t)) for t in middle]
        where = [f"{name}, stretch {number} ({mode})" for mode, number in stretches for _ in range(samples.width)]
        inside = np.repeat([mode[0] in "sb*" for mode, _ in stretches], samples.width)
        for title, share, chosen in (
            ("switching function sign", samples.u[i] - low[i], ~inside),
            ("switching function sign", samples.u[i] - high[i], ~inside),
            ("switching function zero inside the box", np.full_like(samples.t, width), inside),
        ):
            at = np.flatnonzero(chosen)
            equation = title.endswith("box")
            yield Rows(
                title, share[at, None] * matrix[i, at], share[at] * offset[i, at], samples.t[at], [where[k] for k in at], equation, equation,
                pointwise=False,
            )  # fmt: skip
        joints = _switch_nodes(samples, i, AT_BOUND * width)
        yield Rows(
            "switching function zero at a switch", width * matrix[i, joints], width * offset[i, joints], samples.t[joints],
            [where[k] for k in joints],
        )  # fmt: skip


def _switch_nodes(samples: Samples, i: int, jump: float) -> np.ndarray:
    """Return the nodes on both sides of the joints at which control i jumps."""
    last = np.arange(1, samples.intervals) * samples.width - 1
    jumps = last[np.abs(samples.u[i, last + 1] - samples.u[i, last]) > jump]
    return np.sort(np.concatenate([jumps, jumps + 1]))


def _hamiltonian(problem: Problem, samples: Samples, unknowns: Unknowns, costates: Costates, ends: Ends) -> Iterator[Rows]:
    """Yield the Hamiltonian's end values where a time is free, and dH/dt = H_t from node to node.

    The latter follows from the others on every arc; it is kept as an independent check and does not enter the least squares.
    """
    v, count = samples.values, ends.signs.size
    offset = v["L"] + np.einsum("jn,nj->n", v["f"], costates.offset)
    matrix = np.einsum("jn,njz->nz", v["f"], costates.maps)
    nu = np.zeros((2, unknowns.size))
    nu[0, :count], nu[1, :count] = ends.psi_tf, ends.psi_t0
    for box, node, sign, slope, row, title in (
        (problem.final_time_box, -1, 1.0, ends.slope_tf, nu[0], "Hamiltonian at the final time"),
        (problem.initial_time_box, 0, -1.0, ends.slope_t0, nu[1], "Hamiltonian at the initial time"),
    ):
        if box[0] == box[1]:
            continue
        t = samples.t[[node]]
        tight = [edge for edge in box if abs(edge - t[0]) <= ACTIVE * (samples.t[-1] - samples.t[0])]
        outward = -1.0 if tight and tight[0] == box[0] else 1.0
        yield Rows(
            title, outward * (sign * matrix[[node]] + row), outward * (sign * offset[[node]] + slope), t, ["the horizon's end"], not tight
        )
    yield _constant(samples, unknowns, costates, offset, matrix)


def _constant(samples: Samples, unknowns: Unknowns, costates: Costates, H: np.ndarray, H_matrix: np.ndarray) -> Rows:
    """Return H(t) = H(tf) - integral of H_t - jumps c_t, at both ends of every interval.

    It follows from the others where they all hold; it is kept as an independent check and does not enter the least squares.
    """
    v, shape = samples.values, (samples.intervals, samples.width)
    rate = v["Lt"] + np.einsum("jn,nj->n", v["ft"], costates.offset)
    rate_matrix = np.einsum("jn,njz->nz", v["ft"], costates.maps) + np.einsum("jn,njz->nz", v["ct"], costates.mu)
    half = 0.5 * np.diff(samples.edges)
    grown = half * (rate.reshape(shape) @ _WEIGHTS)
    grown_matrix = half[:, None] * np.einsum("kdz,d->kz", rate_matrix.reshape(*shape, -1), _WEIGHTS)
    leaps = np.zeros((samples.intervals + 1, unknowns.size))
    for jump, (constraint, joint) in enumerate(unknowns.jumps):
        leaps[joint, unknowns.jump_column(jump)] += v["ct"][constraint, joint * samples.width - 1]
    first = np.arange(samples.intervals) * samples.width
    last = first + samples.width - 1
    left, left_matrix = _backwards(grown), _backwards(grown_matrix + leaps[1:])
    right, right_matrix = left - grown, left_matrix - grown_matrix
    at = np.concatenate([first, last])
    back, back_matrix = np.concatenate([left, right]), np.vstack([left_matrix, right_matrix])
    where = [f"arc {samples.arc[k] + 1}" for k in at]
    return Rows(
        "Hamiltonian constant but for explicit time", H_matrix[at] - H_matrix[-1] + back_matrix, H[at] - H[-1] + back, samples.t[at], where,
        decisive=False,
    )  # fmt: skip


def _backwards(values: np.ndarray) -> np.ndarray:
    """Return the sums of values (k, ..) from every row to the last."""
    return np.array(np.cumsum(values[::-1], axis=0)[::-1])


def _transversality(
    problem: Problem, solution: Solution, samples: Samples, unknowns: Unknowns, costates: Costates, ends: Ends, horizon: float
) -> Iterator[Rows]:  # fmt: skip
    """Yield the conditions at the initial time, lambda(t0) = -d(Mayer + nu psi)/dx(t0) where x(t0) is free, and on parameters."""
    scale, count = scales(problem, solution) / horizon, ends.signs.size
    x0, v = samples.x[:, 0], samples.values
    for i, name in enumerate(problem.state_names):
        low, high = problem.start_box[:, i]
        if low == high:
            continue
        near = ACTIVE * scale[i] * horizon
        side = 1.0 if x0[i] > high - near else -1.0 if x0[i] < low + near else 0.0
        row = costates.maps[0, i].copy()
        row[:count] += ends.psi_initial[:, i]
        offset = costates.offset[0, i] + ends.slope_initial[i]
        factor = scale[i] * (side or 1.0)
        yield Rows("transversality at the start", factor * row[None, :], np.array([factor * offset]), samples.t[:1], [name], side == 0.0)
    mass = np.repeat(0.5 * np.diff(samples.edges), samples.width) * np.tile(_WEIGHTS, samples.intervals)
    for i, name in enumerate(problem.parameter_names):
        low, high = problem.parameter_box[:, i]
        size = max(abs(samples.p[i]), *(abs(b) for b in (low, high) if np.isfinite(b)), 1e-300)
        side = 1.0 if samples.p[i] > high - ACTIVE * size else -1.0 if samples.p[i] < low + ACTIVE * size else 0.0
        row = np.einsum("n,nj,njz->z", mass, v["fp"][:, :, i], costates.maps)
        row[:count] += ends.psi_p[:, i]
        offset = mass @ (v["Lp"][i] + np.einsum("nj,nj->n", v["fp"][:, :, i], costates.offset)) + ends.slope_p[i]
        factor = size / horizon * (side or 1.0)
        yield Rows("stationarity of a parameter", factor * row[None, :], np.array([factor * offset]), samples.t[:1], [name], side == 0.0)


def _signs(problem: Problem, solution: Solution, samples: Samples, unknowns: Unknowns, ends: Ends, horizon: float) -> Iterator[Rows]:
    """Yield the signs: multipliers of inequalities, of state constraints and of their jumps are not negative."""
    nz, v = unknowns.size, samples.values
    scale = scales(problem, solution)
    for k in np.flatnonzero(ends.signs):
        row = np.zeros((1, nz))
        row[0, k] = -ends.signs[k] * float(np.abs(ends.psi_final[k]) @ scale) / horizon
        yield Rows("sign of an end multiplier", row, np.zeros(1), samples.t[-1:], [ends.names[k]], equation=False)
    names = [constraint.name for constraint in problem.constraints]
    size = [float(np.max(np.abs(v["cx"][:, j]) @ scale)) for j in range(len(names))]
    for block, (constraint, interval) in enumerate(unknowns.mu):
        rows = np.zeros((POINTS, nz))
        rows[np.arange(POINTS), np.arange(POINTS) + unknowns.mu_columns(block).start] = -size[constraint]
        at = slice(interval * samples.width, interval * samples.width + POINTS)
        yield Rows("sign of a constraint's multiplier", rows, np.zeros(POINTS), samples.t[at], [names[constraint]] * POINTS, equation=False, pointwise=False)
    for jump, (constraint, joint) in enumerate(unknowns.jumps):
        row = np.zeros((1, nz))
        row[0, unknowns.jump_column(jump)] = -size[constraint] / horizon
        yield Rows("sign of a jump", row, np.zeros(1), samples.edges[[joint]], [names[constraint]], equation=False)

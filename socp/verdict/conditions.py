"""The conditions of Pontryagin's principle along a solution, every one affine in the unknown
multipliers.

Conventions (docs/conventions.md): H = L + lambda . f is minimised, lambda' = -H_x - mu c_x, and
lambda(tf) = d(Mayer + nu psi)/dx(tf).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np

from socp.model import ACTIVE, AT_BOUND, NOWHERE, TINY, Condition, Mode, Place, Solution, once
from socp.transcription import lgr
from socp.verdict.adjoint import AdjointSystem
from socp.verdict.nodes import POINTS, Samples

_WEIGHTS = lgr(POINTS).weights
_LOWER, _UPPER = Mode("lower"), Mode("upper")


@final
@dataclass(frozen=True, eq=False)
class Rows:
    """Conditions of one kind in units of the Hamiltonian: offset (m,) + matrix (m, nz) z is zero,
    or at most zero.

    `decisive` rows enter the least squares; the others (signs) are looked at afterwards. Rows that
    are not `pointwise` hold at every node of whole intervals. `slack` is how far from being met is
    what counts as active, in units of time: the value of the row times it is what that is worth in
    the objective.
    """

    kind: Condition
    matrix: np.ndarray
    offset: np.ndarray
    t: np.ndarray
    where: Sequence[Place]
    equation: bool = True
    decisive: bool = True
    pointwise: bool = True
    slack: float = 0.0

    def residuals(self, z: np.ndarray) -> np.ndarray:
        """Return the violations (m,) at multipliers z (nz,)."""
        value = self.offset + self.matrix @ z
        return np.array(np.abs(value) if self.equation else np.maximum(value, 0.0))

    def wants(self, k: int, z: np.ndarray) -> Mode | None:
        """Return the mode that the switching function asks for at row k, None if the row is about
        something else.
        """
        if not self.kind.of_switching:
            return None
        if not self.equation:
            return _LOWER if self.where[k].mode == _UPPER else _UPPER
        return _LOWER if self.offset[k] + self.matrix[k] @ z > 0 else _UPPER


def conditions(along: AdjointSystem) -> Iterator[Rows]:
    """Yield every condition of the principle as rows in the unknown multipliers."""
    yield from _switching(along)
    yield from _end_times(along)
    yield _constant(along)
    yield from _transversality(along)
    yield from _parameters(along)
    yield from _signs(along)


@once
def stretches(solution: Solution, control: str, times: tuple[float, ...]) -> list[Place]:
    """Return the stretches that a control is on at times."""
    row = solution.structure[control]
    on = np.searchsorted([end for _, _, end in row[:-1]], times, side="right").tolist()
    places = [
        Place(control=control, stretch=k, mode=Mode.parse(mode))
        for k, (mode, _, _) in enumerate(row, start=1)
    ]
    return [places[k] for k in on]


def _switching(along: AdjointSystem) -> Iterator[Rows]:
    """Yield the minimum condition: sigma = 0 inside the box and where a control switches, its sign
    at a bound.

    The residual is the Hamiltonian that the best admissible value of this control would gain: sigma
    times the distance to it.
    """
    samples, (offset, matrix) = along.samples, along.sigma
    low, high = along.problem.box
    for i, name in enumerate(along.problem.control_names):
        width = high[i] - low[i]
        own = stretches(along.solution, name, samples.middles)
        where = [place for place in own for _ in range(samples.width)]
        inside = np.repeat([place.mode not in {_LOWER, _UPPER} for place in own], samples.width)
        distances = [
            (samples.u[i] - low[i], False),
            (samples.u[i] - high[i], False),
            (np.full_like(samples.t, width), True),
        ]
        for share, zero in distances:
            at = np.flatnonzero(inside == zero)
            lines, values = share[at, None] * matrix[i, at], share[at] * offset[i, at]
            yield Rows(
                Condition.INSIDE if zero else Condition.SIGN,
                lines,
                values,
                samples.t[at],
                [where[k] for k in at],
                zero,
                zero,
                pointwise=False,
            )
        at = _switch_nodes(samples, i, AT_BOUND * width)
        at = at[~samples.on_knot(samples.t[at])]  # where sigma may jump, its signs say it all
        lines, values = width * matrix[i, at], width * offset[i, at]
        yield Rows(
            Condition.SWITCH,
            lines,
            values,
            samples.t[at],
            [where[k] for k in at],
        )


def _switch_nodes(samples: Samples, i: int, jump: float) -> np.ndarray:
    """Return the nodes on both sides of the joints at which control i jumps."""
    last = np.arange(1, samples.intervals) * samples.width - 1
    jumps = last[np.abs(samples.u[i, last + 1] - samples.u[i, last]) > jump]
    return np.sort(np.concatenate([jumps, jumps + 1]))


def _end_times(along: AdjointSystem) -> Iterator[Rows]:
    """Yield H(tf) + d(Mayer + nu psi)/dtf = 0 where the final time is free, H(t0) = d(Mayer + nu
    psi)/dt0 likewise.

    At an end of the interval that a time is allowed, the sign remains.
    """
    problem, ends, (offset, matrix) = along.problem, along.ends, along.hamiltonian
    rows = np.zeros((2, along.unknowns.size))
    rows[0, : ends.signs.size], rows[1, : ends.signs.size] = ends.psi_tf, ends.psi_t0
    for kind, box, node, sign, slope, row in (
        (Condition.FINAL_TIME, problem.final_time_box, -1, 1.0, ends.slope_tf, rows[0]),
        (Condition.INITIAL_TIME, problem.initial_time_box, 0, -1.0, ends.slope_t0, rows[1]),
    ):
        if box[0] == box[1]:
            continue
        t = along.samples.t[[node]]
        tight = [edge for edge in box if abs(edge - t[0]) <= ACTIVE * along.horizon]
        outward = -1.0 if tight and tight[0] == box[0] else 1.0
        line, value = (
            outward * (sign * matrix[[node]] + row),
            outward * (sign * offset[[node]] + slope),
        )
        slack = abs(tight[0] - t[0]) if tight else 0.0
        yield Rows(kind, line, value, t, [NOWHERE], not tight, slack=slack)


def _constant(along: AdjointSystem) -> Rows:
    """Return H(t) = H(tf) - integral of H_t - jumps c_t, at both ends of every interval.

    It follows from the others where they all hold; it is kept as an independent check and does not
    enter the least squares.
    """
    samples, unknowns, v, (H, H_matrix) = (
        along.samples,
        along.unknowns,
        along.samples.values,
        along.hamiltonian,
    )
    shape = (samples.intervals, samples.width)
    first = np.arange(samples.intervals) * samples.width
    after = first[1:][samples.on_knot(samples.t[first[1:]])]
    rate = v["Lt"] + np.einsum("jn,nj->n", v["ft"], along.costates.offset)
    rate_matrix = np.einsum("jn,njz->nz", v["ft"], along.costates.maps)
    rate_matrix = rate_matrix + np.einsum("jn,njz->nz", v["ct"], along.costates.mu)
    half = 0.5 * np.diff(samples.edges)
    grown = half * (rate.reshape(shape) @ _WEIGHTS)
    grown_matrix = half[:, None] * np.einsum("kdz,d->kz", rate_matrix.reshape(*shape, -1), _WEIGHTS)
    leaps, own = np.zeros((samples.intervals + 1, unknowns.size)), np.zeros(samples.intervals + 1)
    # at a knot H jumps as the problem does, by what only the other conditions tell
    own[after // samples.width] = H[after] - H[after - 1]
    leaps[after // samples.width] = H_matrix[after] - H_matrix[after - 1]
    for jump, (constraint, joint) in enumerate(unknowns.jumps):
        leaps[joint, unknowns.jump_column(jump)] += v["ct"][constraint, joint * samples.width - 1]
    left, left_matrix = _backwards(grown + own[1:]), _backwards(grown_matrix + leaps[1:])
    at = np.concatenate([first, first + samples.width - 1])
    values = H[at] - H[-1] + np.concatenate([left, left - grown])
    lines = H_matrix[at] - H_matrix[-1] + np.vstack([left_matrix, left_matrix - grown_matrix])
    where = [Place(arc=int(samples.arc[k]) + 1) for k in at]
    return Rows(
        Condition.CONSTANT,
        lines,
        values,
        samples.t[at],
        where,
        decisive=False,
    )


def _backwards(values: np.ndarray) -> np.ndarray:
    """Return the sums of values (k, ..) from every row to the last."""
    return np.array(np.cumsum(values[::-1], axis=0)[::-1])


def _transversality(along: AdjointSystem) -> Iterator[Rows]:
    """Yield lambda(t0) = -d(Mayer + nu psi)/dx(t0) for initial states that are free; the sign at an
    interval's end.
    """
    samples, ends, count = along.samples, along.ends, along.ends.signs.size
    for i, name in enumerate(along.problem.state_names):
        low, high = along.problem.start_box[:, i]
        if low == high:
            continue
        side = _side(samples.x[i, 0], low, high, along.scale[i])
        line = along.costates.maps[0, i].copy()
        line[:count] += ends.psi_initial[:, i]
        value = along.costates.offset[0, i] + ends.slope_initial[i]
        factor = along.scale[i] / along.horizon * (side or 1.0)
        yield Rows(
            Condition.START,
            factor * line[None, :],
            np.array([factor * value]),
            samples.t[:1],
            [Place(of=name)],
            side == 0.0,
            slack=_slack(samples.x[i, 0], low, high, side) / along.scale[i] * along.horizon,
        )


def _parameters(along: AdjointSystem) -> Iterator[Rows]:
    """Yield that the objective does not change with a free parameter: integral of H_p + mu c_p,
    jumps c_p and d(Mayer + nu psi)/dp add up to 0.
    """
    samples, ends, v, count = along.samples, along.ends, along.samples.values, along.ends.signs.size
    unknowns = along.unknowns
    mass = np.repeat(0.5 * np.diff(samples.edges), samples.width) * np.tile(
        _WEIGHTS, samples.intervals
    )
    for i, name in enumerate(along.problem.parameter_names):
        low, high = along.problem.parameter_box[:, i]
        if low == high:  # it is held, whatever the objective makes of it
            continue
        size = max(abs(samples.p[i]), *(abs(b) for b in (low, high) if np.isfinite(b)), TINY)
        side = _side(samples.p[i], low, high, size)
        line = np.einsum("n,nj,njz->z", mass, v["fp"][:, :, i], along.costates.maps)
        line += np.einsum("n,nj,njz->z", mass, v["cp"][:, :, i], along.costates.mu)
        line[:count] += ends.psi_p[:, i]
        for jump, (constraint, joint) in enumerate(unknowns.jumps):
            slope = v["cp"][joint * samples.width - 1, constraint, i]
            line[unknowns.jump_column(jump)] += slope
        value = (
            mass @ (v["Lp"][i] + np.einsum("nj,nj->n", v["fp"][:, :, i], along.costates.offset))
            + ends.slope_p[i]
        )
        factor = size / along.horizon * (side or 1.0)
        yield Rows(
            Condition.PARAMETER,
            factor * line[None, :],
            np.array([factor * value]),
            samples.t[:1],
            [Place(of=name)],
            side == 0.0,
            slack=_slack(samples.p[i], low, high, side) / size * along.horizon,
        )


def _side(value: float, low: float, high: float, size: float) -> float:
    """Return 1 at the upper end of an interval, -1 at the lower, 0 inside."""
    near = ACTIVE * size
    return 1.0 if value > high - near else -1.0 if value < low + near else 0.0


def _slack(value: float, low: float, high: float, side: float) -> float:
    """Return how far a value is from the end of its interval that it counts as being at."""
    return abs(value - (high if side > 0 else low)) if side else 0.0


def _signs(along: AdjointSystem) -> Iterator[Rows]:
    """Yield the signs: multipliers of inequalities, of state constraints and of their jumps are not
    negative.
    """
    samples, unknowns, ends, nz = along.samples, along.unknowns, along.ends, along.unknowns.size
    for k in np.flatnonzero(ends.signs):
        line = np.zeros((1, nz))
        weight = float(np.abs(ends.psi_final[k]) @ along.scale) / along.horizon
        line[0, k] = -ends.signs[k] * weight
        slack = abs(float(ends.values[k])) / weight if weight else 0.0
        where = [Place(of=ends.names[k])]
        yield Rows(
            Condition.END_SIGN,
            line,
            np.zeros(1),
            samples.t[-1:],
            where,
            equation=False,
            slack=slack,
        )
    names = [constraint.name for constraint in along.problem.constraints]
    size = [
        float(np.max(np.abs(samples.values["cx"][:, j]) @ along.scale)) for j in range(len(names))
    ]
    for block, (constraint, interval) in enumerate(unknowns.mu):
        lines = np.zeros((POINTS, nz))
        lines[np.arange(POINTS), np.arange(POINTS) + unknowns.mu_columns(block).start] = -size[
            constraint
        ]
        t = samples.t[interval * samples.width :][:POINTS]
        where = [Place(of=names[constraint])] * POINTS
        yield Rows(
            Condition.CONSTRAINT_SIGN,
            lines,
            np.zeros(POINTS),
            t,
            where,
            equation=False,
            pointwise=False,
        )
    for jump, (constraint, joint) in enumerate(unknowns.jumps):
        line = np.zeros((1, nz))
        line[0, unknowns.jump_column(jump)] = -size[constraint] / along.horizon
        yield Rows(
            Condition.JUMP_SIGN,
            line,
            np.zeros(1),
            samples.edges[[joint]],
            [Place(of=names[constraint])],
            equation=False,
        )

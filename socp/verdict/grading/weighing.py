"""The multipliers under which a solution has the least to gain, by a linear programme.

Any multipliers of the right signs tell how far the objective may be from that of an extremal
(`socp.verdict.grading.grade`); those that tell the least are looked for.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from scipy.sparse import coo_array, csr_array, diags_array, eye_array, hstack, vstack

from socp.verdict.grading.unknowns import Form, Free, Unknowns

_SECONDS = 10.0  # for the programme: that of a thousand pieces along a boundary takes a few
# nodes of a piece at which the programme looks: over the step of a grid a gain hardly bends
_LOOKS = (1, 3)
# over which it sums gains, and between which it follows costates by the adjoint equation: a costate
# bends over the horizon, not over a step of a grid of thousands
STRETCHES = 1000


@final
@dataclass(frozen=True, eq=False)
class Weights:
    """Multipliers: costate (n, d + 1, nx) at the nodes of the pieces, density (n, nc) of the state
    constraints on them, jump (n + 1, nc) at their ends, one of every tie; and the `gain` that is
    left in what is free.
    """

    costate: np.ndarray
    density: np.ndarray
    jump: np.ndarray
    tie: np.ndarray
    gain: float


def weights(unknowns: Unknowns, size: float) -> Weights | None:
    """Return the multipliers of least gain, None where no programme finds them.

    The gain is the integral of H(u) - min H over the box of the controls, plus that of what is
    free; every multiplier counts with the distance of its condition from being met. `size` is the
    objective's.
    """
    unit = unknowns.unit * size
    count = unknowns.pieces.count
    starts = np.unique(np.linspace(0, count, STRETCHES + 1, dtype=int)[:-1])
    chained, frees = Chained.over(unknowns, starts), list(unknowns.free())
    programme = _programme(chained, starts, unit, [*frees, *unknowns.tied()], size)
    found = _least(programme)
    if found is None:
        return None
    y = found[: chained.spread.shape[1]] * chained.mean(unit)
    return _weights(unknowns, chained.whole(y), frees)


@final
@dataclass(frozen=True, eq=False)
class Chained:
    """The unknowns of stretches: costates at their ends, a density of a state constraint on each
    and jumps between them. `spread` (unknowns, few) makes all unknowns of them, but for the
    costates inside, which follow by the adjoint equation: with A = I - N there, N nilpotent, the
    inverse is (I + N) (I + N^2) (I + N^4) ..., as sparse as a stretch is long.
    """

    unknowns: Unknowns
    adjoint: Form
    inside: np.ndarray  # (unknowns,)
    spread: csr_array

    @classmethod
    def over(cls, unknowns: Unknowns, starts: np.ndarray) -> "Chained":
        """Return the unknowns for stretches that begin with pieces `starts`."""
        ends, density, jump, count = unknowns.first
        last = np.zeros(unknowns.pieces.count, dtype=bool)
        last[starts - 1] = True  # the last of all is before the first
        inside = np.zeros(count, dtype=bool)
        inside[:ends] = np.repeat(~last, unknowns.scale.size)
        (at, which), (joint, _) = unknowns.active
        stretch = np.searchsorted(starts, at, side="right")
        keys = np.arange(count)
        keys[density:jump] = count + np.unique((stretch, which), axis=1, return_inverse=True)[1]
        between = (joint == 0) | last[joint - 1]
        kept = np.flatnonzero(~inside & np.append(np.ones(jump, dtype=bool), between))
        columns = np.unique(keys[kept], return_inverse=True)[1]
        shape = count, int(columns.max()) + 1
        spread = coo_array((np.ones(kept.size), (kept, columns)), shape=shape).tocsr()
        return cls(unknowns, unknowns.adjoint(), inside, spread)

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the means (few,) of values (unknowns,) over what is made of one."""
        found = self.spread.T @ np.column_stack([values, np.ones(values.size)])
        return np.array(found[:, 0] / found[:, 1])

    @cached_property
    def _inner(self) -> Form:
        """The adjoint equations inside."""
        rows = self.inside[: self.adjoint.offset.size]
        return Form(self.adjoint.offset[rows], self.adjoint.matrix[rows])

    @cached_property
    def _powers(self) -> list[csr_array]:
        """N, N^2, N^4, ... as long as they do not vanish."""
        own = self._inner.matrix[:, self.inside]
        power, found = (eye_array(own.shape[0]) - own).tocsr(), []
        power.eliminate_zeros()
        while power.nnz:
            found.append(power)
            power = power @ power
        return found

    def form(self, form: Form) -> Form:
        """Return a form in all unknowns as one in those of stretches."""
        through = form.matrix[:, self.inside]
        for power in self._powers:
            through = through + through @ power
        matrix = (form.matrix - through @ self._inner.matrix) @ self.spread
        return Form(form.offset - through @ self._inner.offset, matrix)

    def equations(self) -> Form:
        """Return the adjoint equations from stretch to stretch."""
        between = ~self.inside[: self.adjoint.offset.size]
        return self.form(Form(self.adjoint.offset[between], self.adjoint.matrix[between]))

    def whole(self, y: np.ndarray) -> np.ndarray:
        """Return all unknowns for those of stretches."""
        z: np.ndarray = self.spread @ y
        inside = -self._inner.at(z)
        for power in self._powers:
            inside += power @ inside
        z[self.inside] = inside
        return z


def _weights(unknowns: Unknowns, z: np.ndarray, frees: list[Free]) -> Weights:
    """Lay unknowns out on the mesh."""
    pieces, nx, (ends, density, jump, _) = unknowns.pieces, unknowns.scale.size, unknowns.first
    densities = np.zeros_like(unknowns.joints["c"][1:])
    densities[tuple(unknowns.active[0])] = z[density:jump]
    jumps = np.zeros_like(unknowns.joints["c"])
    jumps[tuple(unknowns.active[1])] = z[jump:]
    maps = pieces.maps
    costate = (
        np.einsum("kdxy,ky->kdx", maps[..., :nx], z[:ends].reshape(-1, nx))
        + maps[..., nx]
        + np.einsum("kdxj,kj->kdx", maps[..., nx + 1 :], densities)
    )
    return Weights(costate, densities, jumps, z[ends:density], sum(f.gain(z) for f in frees))


@final
@dataclass(frozen=True, eq=False)
class _Programme:
    """Minimise cost . y where lines y <= right, equations y = given and low <= y."""

    cost: np.ndarray
    lines: csr_array
    right: np.ndarray
    equations: csr_array
    given: np.ndarray
    low: np.ndarray


def _programme(
    chained: Chained, starts: np.ndarray, unit: np.ndarray, frees: list[Free], size: float
) -> _Programme:
    """Return the programme in the unknowns over their unit and in the gains, in the objective's:
    those of every control on every stretch, by the switching functions in its middle, then those
    of what is free.
    """
    unknowns, pieces = chained.unknowns, chained.unknowns.pieces
    columns, (low, high) = diags_array(chained.mean(unit)), unknowns.problem.box
    middle = (starts + np.append(starts[1:], pieces.count)) // 2
    sigma, adjoint = chained.form(unknowns.switching(_LOOKS, middle)), chained.equations()
    length = np.diff(pieces.edges)[:, None, None] / len(_LOOKS)
    u = pieces.u[:, list(_LOOKS)]
    off = [np.add.reduceat(length * (u - bound), starts).ravel() for bound in (low, high)]
    scaled = [(sigma, each / size, 0) for each in off]
    for k, each in enumerate(frees, start=sigma.offset.size):
        slope = chained.form(each.slope)
        scaled += [(slope, np.array([far / size]), k) for far in (each.down, -each.up)]
    gains, lines, right = sigma.offset.size + len(frees), [], []
    for form, factor, first in scaled:
        gain = -eye_array(factor.size, gains, k=first)
        lines.append(hstack([diags_array(factor) @ form.matrix @ columns, gain]))
        right.append(-factor * form.offset)
    rows = np.tile(unknowns.scale / size, starts.size)
    equations = diags_array(rows) @ adjoint.matrix @ columns
    ends, density, _, count = unknowns.first
    either = np.zeros(count, dtype=bool)
    either[:density] = True
    either[ends:density] = [not tie.signed for tie in unknowns.ties]
    # of these the lines count the distance, with either sign
    distance = np.where(either, 0.0, unknowns.distance)
    return _Programme(
        cost=np.append(chained.spread.T @ (distance * unit) / size, np.ones(gains)),
        lines=vstack(lines).tocsr(),
        right=np.concatenate(right),
        equations=hstack([equations, csr_array((rows.size, gains))]).tocsr(),
        given=-rows * adjoint.offset,
        low=np.append(np.where(chained.mean(either) > 0, -np.inf, 0.0), np.zeros(gains)),
    )


def _least(programme: _Programme) -> np.ndarray | None:
    """Solve the programme; the simplex method is the faster, the inner point the sturdier one."""
    from scipy.optimize import linprog

    bounds = np.column_stack([programme.low, np.full(programme.low.size, np.inf)])
    for method in ("highs-ds", "highs-ipm"):
        found = linprog(
            programme.cost,
            programme.lines,
            programme.right,
            programme.equations,
            programme.given,
            bounds,
            method,
            options={"time_limit": _SECONDS},
        )
        if found.x is not None:
            return np.array(found.x)
    return None

"""The multipliers under which a solution has the least to gain, by a linear programme.

Any multipliers of the right signs tell how far the objective may be from that of an extremal
(`socp.verdict.grading.grade`); those that tell the least are looked for.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from scipy.sparse import csr_array, diags_array, eye_array, hstack, vstack

from socp.verdict.grading.unknowns import Free, Unknowns

_SECONDS = 10.0  # for the programme: that of a thousand pieces along a boundary takes a few
# nodes of a piece at which the programme looks: over the step of a grid a gain hardly bends
_LOOKS = (1, 3)
# over which it sums gains: a costate bends over the horizon, not over a step of a grid of thousands
_STRETCHES = 1000


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
    frees = list(unknowns.free())
    found = _least(_programme(unknowns, unit, [*frees, *unknowns.tied()], size))
    return None if found is None else _weights(unknowns, found[: unit.size] * unit, frees)


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


def _programme(unknowns: Unknowns, unit: np.ndarray, frees: list[Free], size: float) -> _Programme:
    """Return the programme in the unknowns over their unit and in the gains, in the objective's:
    those of every control on every stretch, by the switching functions in its middle, then those
    of what is free.
    """
    pieces, columns, (low, high) = unknowns.pieces, diags_array(unit), unknowns.problem.box
    starts = np.unique(np.linspace(0, pieces.count, _STRETCHES + 1, dtype=int)[:-1])
    middle = (starts + np.append(starts[1:], pieces.count)) // 2
    sigma, adjoint = unknowns.switching(_LOOKS, middle), unknowns.adjoint()
    length = np.diff(pieces.edges)[:, None, None] / len(_LOOKS)
    u = pieces.u[:, list(_LOOKS)]
    off = [np.add.reduceat(length * (u - bound), starts).ravel() for bound in (low, high)]
    scaled = [(sigma, each / size, 0) for each in off]
    for k, each in enumerate(frees, start=sigma.offset.size):
        scaled += [(each.slope, np.array([far / size]), k) for far in (each.down, -each.up)]
    gains, lines, right = sigma.offset.size + len(frees), [], []
    for form, factor, first in scaled:
        gain = -eye_array(factor.size, gains, k=first)
        lines.append(hstack([diags_array(factor) @ form.matrix @ columns, gain]))
        right.append(-factor * form.offset)
    rows = np.tile(unknowns.scale / size, pieces.count)
    equations = diags_array(rows) @ adjoint.matrix @ columns
    ends, density, _, count = unknowns.first
    either = np.ones(density, dtype=bool)
    either[ends:] = [not tie.signed for tie in unknowns.ties]
    bound = np.zeros(count + gains)
    bound[:density][either] = -np.inf
    distance = unknowns.distance.copy()
    distance[:density][either] = 0.0  # of these the lines count it, with either sign
    return _Programme(
        cost=np.append(distance * unit / size, np.ones(gains)),
        lines=vstack(lines).tocsr(),
        right=np.concatenate(right),
        equations=hstack([equations, csr_array((rows.size, gains))]).tocsr(),
        given=-rows * adjoint.offset,
        low=bound,
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

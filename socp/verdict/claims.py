"""What a solution says of itself, held against what it contains: its motion, its objective, the
modes of its arcs.

Pontryagin's principle takes the states, the controls and the word as they stand. Whether the states
are those of the controls, the objective theirs, and every arc what it calls itself, has to be asked
first.
"""

from collections.abc import Iterator

import numpy as np

from socp import laws
from socp.model import (
    ACTIVE,
    ROUNDED,
    TINY,
    Condition,
    Finding,
    Mode,
    Modes,
    Place,
    Problem,
    Solution,
    end_values,
    mayer_function,
    numbers,
    once,
)
from socp.transcription import lgr
from socp.verdict.adjoint import AdjointSystem
from socp.verdict.motion import magnitude_along
from socp.verdict.nodes import POINTS, Samples
from socp.verdict.structure import nearness

_SCHEME = lgr(POINTS)
# between the ends of its intervals collocation is of lower order than at them: a digit is granted
# there
_BETWEEN = 0.1


def claims(along: AdjointSystem, density: np.ndarray, size: float) -> Iterator[Finding]:
    """Yield what a solution claims with the worst deviation, from multipliers' densities (nc, n),
    magnitude `size`.
    """
    yield _motion(along)
    yield _objective(along)
    yield from _modes(along, density, size)
    yield from _parameters(along)


@once
def cost(samples: Samples, solution: Solution) -> tuple[float, float]:
    """Return the objective by the judge's own quadrature, and the magnitude of its terms."""
    problem = samples.problem
    half = 0.5 * np.diff(samples.edges)
    weights = half[:, None] * _SCHEME.weights[:-1]
    L = samples.values["L"].reshape(samples.intervals, samples.width)[:, :-1]
    mayer = float(numbers(mayer_function(problem), *end_values(problem, solution))[0][0, 0])
    return float((weights * L).sum()) + mayer, float((weights * np.abs(L)).sum()) + abs(mayer)


@once
def running_magnitude(along: AdjointSystem) -> np.ndarray:
    """Return the magnitude (n,) of the running cost at the judge's nodes."""
    samples = along.samples
    motion = samples.t, samples.x, samples.u
    return magnitude_along(along.problem, motion, samples.p, along.scale)


def _motion(along: AdjointSystem) -> Finding:
    """Find how far the states are from those of the controls: over every interval, where arcs meet,
    at the start.
    """
    samples, scale = along.samples, along.scale
    shape = (-1, samples.intervals, samples.width)
    x, f = samples.x.reshape(shape), samples.values["f"].reshape(shape)[:, :, :-1]
    half = 0.5 * np.diff(samples.edges)
    # backwards from the end of the interval, as the states of a Radau collocation are given by the
    # slopes
    slopes = half[None, :, None] * f - _SCHEME.A[:, -1] * x[:, :, -1:]
    moved = np.einsum("jd,ikd->ikj", np.linalg.inv(_SCHEME.A[:, :-1]), slopes)
    missed = moved - x[:, :, :-1]
    off = _BETWEEN * np.abs(missed).max(axis=2) / scale[:, None]
    first = np.flatnonzero(np.diff(samples.arc[:: samples.width], prepend=-1))
    whole = np.abs(np.add.reduceat(missed[:, :, 0], first, axis=1)) / scale[:, None]
    off[:, first] = np.maximum(off[:, first], whole)
    inner = slice(samples.width, None, samples.width)
    leaps = (
        np.abs(samples.x[:, inner] - samples.x[:, samples.width - 1 : -1 : samples.width])
        / scale[:, None]
    )
    off[:, 1:] = np.maximum(off[:, 1:], leaps)
    start = samples.x[:, 0]
    low, high = along.problem.start_box
    off[:, 0] = np.maximum(off[:, 0], np.maximum(low - start, start - high) / scale)
    i, k = np.unravel_index(int(np.argmax(off)), off.shape)
    place = Place(of=along.problem.state_names[i], arc=int(samples.arc[k * samples.width]) + 1)
    return Finding(
        kind=Condition.MOTION,
        residual=float(off[i, k]),
        place=place,
        t=float(samples.edges[k]),
    )


def _objective(along: AdjointSystem) -> Finding:
    value, size = cost(along.samples, along.solution)
    most = along.horizon * float(running_magnitude(along).max())
    size = size if size > ROUNDED * most else most
    off = abs(along.solution.objective - value) / max(size, TINY)
    return Finding(
        kind=Condition.OBJECTIVE,
        residual=np.inf if np.isnan(off) else off,
    )


def _modes(along: AdjointSystem, density: np.ndarray, size: float) -> Iterator[Finding]:
    """Yield how far arcs are from the modes they name: at the bound, on the constraint, held by
    none if singular.
    """
    problem, samples = along.problem, along.samples
    low, high = problem.box
    for index, arc in enumerate(along.solution.arcs):
        inside = samples.arc == index
        if not inside.any():
            continue
        near = nearness(along.solution, problem)[:, None]
        active = np.array((samples.values["c"][:, inside] > -near).all(axis=1))
        for i, (name, mode) in enumerate(zip(problem.control_names, arc.modes, strict=True)):
            off = 0.0
            if mode.kind in {"lower", "upper"}:
                bound = low[i] if mode.kind == "lower" else high[i]
                off = float(np.abs(samples.u[i, inside] - bound).max()) / (high[i] - low[i])
            elif mode.kind == "boundary":
                off = 0.0 if _followed(problem, i, mode, active) else 1.0
            elif mode.kind == "singular":
                off = 1.0 if _held(along, arc.modes, i, active, density[:, inside], size) else 0.0
            if mode.kind != "free":
                yield Finding(
                    kind=Condition.MODE,
                    residual=off,
                    place=Place(control=name, arc=index + 1, mode=mode),
                    t=float(arc.t[0]),
                )


def _followed(problem: Problem, i: int, mode: Mode, active: np.ndarray) -> bool:
    """Tell whether a control's boundary arc lies on a constraint that the control acts on, the
    named one if any.
    """
    acting = {constraint.name for constraint in laws.controlled_constraints(problem, i)}
    names = [
        c.name for c, on in zip(problem.constraints, active, strict=True) if on and c.name in acting
    ]
    return any(mode.constraint in {None, name} for name in names)


def _held(
    along: AdjointSystem,
    modes: Modes,
    i: int,
    active: np.ndarray,
    density: np.ndarray,
    size: float,
) -> bool:
    """Tell whether a constraint pushes a control that calls itself singular, while no control
    follows it.
    """
    acting = {constraint.name for constraint in laws.controlled_constraints(along.problem, i)}
    for j, constraint in enumerate(along.problem.constraints):
        slope = float(np.max(np.abs(along.samples.values["cx"][:, j]) @ along.scale))
        pushes = float(np.abs(density[j]).max()) * slope * along.horizon > ACTIVE * size
        if (
            active[j]
            and constraint.name in acting
            and pushes
            and not {Mode("boundary"), Mode("boundary", constraint.name)} & set(modes)
        ):
            return True
    return False


def _parameters(along: AdjointSystem) -> Iterator[Finding]:
    low, high = along.problem.parameter_box
    for i, name in enumerate(along.problem.parameter_names):
        value = float(along.samples.p[i])
        off = max(low[i] - value, value - high[i], 0.0) / max(abs(value), TINY)
        yield Finding(kind=Condition.PARAMETER_RANGE, residual=off, place=Place(of=name))

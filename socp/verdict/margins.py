"""What a verdict says beyond residuals: strictness, ringing, the Legendre-Clebsch condition."""

from collections.abc import Iterator, Sequence
from time import monotonic

import numpy as np

from socp import laws
from socp.errors import MethodError
from socp.model import (
    LAWS,
    SAME_TIME,
    TINY,
    Arc,
    Mode,
    Modes,
    Place,
    Problem,
    Solution,
    evaluate,
    function_of,
    piecewise,
    time,
)
from socp.process import time_limit
from socp.verdict.conditions import stretches
from socp.verdict.lessons import left_open
from socp.verdict.nodes import Samples

# Of the Hamiltonian's magnitude: what rounding leaves of a switching function that is zero
_VANISHES = 1e-11
# Of the largest entry along an arc: less may be what rounding leaves of a matrix that is singular
_DEFINITE = 1e-6


def strictness(
    problem: Problem, solution: Solution, samples: Samples, sigma: np.ndarray, size: float
) -> dict[Place, float]:
    """Return, for every bang stretch, how far its switching function comes to the right side of
    zero.

    sigma (nu, n) at the judge's nodes; the figure is sigma times the width of the box over the
    Hamiltonian's magnitude. One that is not positive belongs to an arc that the principle does not
    ask for.
    """
    found = {}
    width = np.diff(problem.box, axis=0)[0]
    for i, name in enumerate(problem.control_names):
        for number, (mode, start, end) in enumerate(solution.structure[name], start=1):
            inside = (samples.t >= start) & (samples.t <= end)
            if mode in {"+", "-"} and inside.any() and end > start:
                sign = 1.0 if mode == "-" else -1.0
                place = Place(control=name, stretch=number, mode=Mode.parse(mode))
                found[place] = float((sign * sigma[i, inside]).max() * width[i] / size)
    return found


def indifferent(
    problem: Problem, solution: Solution, samples: Samples, sigma: np.ndarray, size: float
) -> list[Place]:
    """Return the bang stretches along which the switching function vanishes throughout, of controls
    that the principle leaves open there.

    sigma (nu, n) at the judge's nodes. Where a control has a singular law, another control takes
    its switching function off zero; where it has none, as while a price is flat or a vehicle turns
    with its engine off, every control of the same effect does as well, and a bang is as good an
    extremal as any.
    """
    found = []
    width = np.diff(problem.box, axis=0)[0]
    horizon = solution.final_time - solution.initial_time
    # a joint's node belongs to its own side: at a knot the switching function may jump
    middle = np.repeat(0.5 * (samples.edges[1:] + samples.edges[:-1]), samples.width)
    for i, name in enumerate(problem.control_names):
        for number, (mode, start, end) in enumerate(solution.structure[name], start=1):
            inside = (middle > start) & (middle < end)
            if mode not in {"+", "-"} or not inside.any() or end - start <= SAME_TIME * horizon:
                continue
            if np.abs(sigma[i, inside]).max() * width[i] > _VANISHES * size:
                continue
            place = Place(control=name, stretch=number, mode=Mode.parse(mode))
            arcs = (arc for arc, _ in _joint_arcs(problem, solution, samples) if arc[i] == place)
            if all(left_open(problem, i, _modes(arc)) for arc in arcs):
                found.append(place)
    return found


def signs(problem: Problem, solution: Solution, samples: Samples) -> np.ndarray:
    """Return, for every bang stretch, weights (stretches, nu, n) that make sigma its mean margin in
    energy.
    """
    found = []
    width = np.diff(problem.box, axis=0)[0]
    for i, name in enumerate(problem.control_names):
        for mode, start, end in solution.structure[name]:
            inside = (samples.t >= start) & (samples.t <= end)
            if mode in {"+", "-"} and inside.any() and end > start:
                found.append(np.zeros((len(width), samples.t.size)))
                found[-1][i, inside] = (1.0 if mode == "-" else -1.0) * width[i] / inside.sum()
    return np.array(found).reshape(len(found), len(width), samples.t.size)


def ringing(problem: Problem, solution: Solution) -> dict[str, float]:
    """Return every control's total variation over that of its running mean (1, 2, 1) / 4: 1 if it
    does not ring.

    The mean leaves nothing of a zigzag from value to value, and all of a jump between longer
    levels. What is less than a thousandth of the width of the box counts as no variation.
    """
    found = {}
    for i, name in enumerate(problem.control_names):
        values = np.concatenate([_once(arc)[i] for arc in solution.arcs])
        least = 1e-3 * float(problem.box[1, i] - problem.box[0, i])
        calm = np.convolve(np.pad(values, 1, mode="edge"), [0.25, 0.5, 0.25], mode="valid")
        found[name] = float(
            (np.abs(np.diff(values)).sum() + least) / (np.abs(np.diff(calm)).sum() + least)
        )
    return found


def legendre_clebsch(
    problem: Problem, solution: Solution, samples: Samples, costate: np.ndarray
) -> tuple[dict[str, float], list[str]]:
    """Return the generalised Legendre-Clebsch expression on every arc with singular controls, and
    why not elsewhere.

    The least eigenvalue of the matrix (-1)^q d/du d^(2q) sigma / dt^(2q) along the arc over its
    largest entry there, to be non-negative (Kelley, Kopp, Moyer, Topics in Optimization, 1967,
    chapter 3).
    """
    found: dict[str, float] = {}
    unknown: list[str] = []
    began = monotonic()
    for arc, inside in _joint_arcs(problem, solution, samples):
        modes = _modes(arc)
        singular = [i for i, mode in enumerate(modes) if mode.kind == "singular"]
        if not singular:
            continue
        label = ", ".join(str(arc[i]) for i in singular)
        u = samples.u[:, inside]  # a copy
        for i, mode in enumerate(modes):
            if mode.kind in {"lower", "upper"}:
                u[i] = problem.box[int(mode.kind == "upper"), i]
        others = (each[..., inside] for each in (costate, samples.t))
        try:
            with time_limit(LAWS - (monotonic() - began)):  # for all arcs together
                least = _least(problem, modes, [samples.x[:, inside], u, *others, samples.p])
        except MethodError as error:
            unknown.append(f"the Legendre-Clebsch condition on {label} is unknown: {error}")
            continue
        found[label] = min(found.get(label, np.inf), least)
    return found, unknown


def _least(problem: Problem, modes: Modes, at: Sequence[np.ndarray]) -> float:
    """Return the least eigenvalue of an arc's Legendre-Clebsch matrix over its largest entry, as
    `definite` does, of whatever sign. Raises MethodError without a law.
    """
    found = definite(problem, modes, at)
    if found is None:
        found = _eigenvalue(_matrices(problem, laws.extremal_arc(problem, modes), at))
    return found


def definite(problem: Problem, modes: Modes, at: Sequence[np.ndarray]) -> float | None:
    """Return the least eigenvalue of the Legendre-Clebsch matrix over its largest entry, at states,
    controls, costates, times and parameters along an arc, where it is clearly positive with the
    bang controls of the arc left open; None elsewhere.

    Then the singular controls follow from the law that was found so, all along the arc: no other
    has to be looked for with the values of the bounds.
    """
    general = laws.at_any_bounds(problem, modes)
    if general is None:
        return None
    matrices = _matrices(problem, general, at)
    found = _eigenvalue(matrices) if np.isfinite(matrices).all() else 0.0
    return found if found > _DEFINITE else None


def _matrices(problem: Problem, law: laws.ArcPrinciple, at: Sequence[np.ndarray]) -> np.ndarray:
    symbols = [problem.x, problem.u, problem.costate, time, problem.p]
    (values,) = evaluate(function_of(problem, symbols, law.legendre_clebsch), *at)
    return values.reshape(len(values), -1, len(values)).transpose(1, 0, 2)


def _eigenvalue(matrices: np.ndarray) -> float:
    size = max(float(np.abs(matrices).max()), TINY)
    return float(np.linalg.eigvalsh((matrices + matrices.transpose(0, 2, 1)) / 2.0).min()) / size


def _joint_arcs(
    problem: Problem, solution: Solution, samples: Samples
) -> Iterator[tuple[tuple[Place, ...], np.ndarray]]:
    """Yield (stretch of every control, mask (n,) of nodes) for every arc of all controls
    together.
    """
    rows = [stretches(solution, name, samples.middles) for name in problem.control_names]
    joint = list(zip(*rows, strict=True))
    for arc in dict.fromkeys(joint):
        yield arc, np.repeat([each == arc for each in joint], samples.width)


def _modes(arc: tuple[Place, ...]) -> Modes:
    return tuple(place.mode for place in arc if place.mode is not None)


def _once(arc: Arc) -> np.ndarray:
    """Return the controls (nu, n) at the collocated nodes of an arc, every node once."""
    return np.array(arc.u[:, (arc.side == "right") : arc.t.size - (arc.side == "left")])


def on_arcs(
    samples: Samples, times: Sequence[tuple[int, np.ndarray]], values: np.ndarray
) -> list[np.ndarray]:
    """Carry values (rows, n) from the judge's nodes to arcs, of each its number and its times (k,),
    as (rows, k) each; arcs without length take the neighbouring value.
    """
    if not times:
        return []
    arc_of = samples.arc[:: samples.width]
    at, on = [], []
    for index, t in times:
        mine = np.flatnonzero(arc_of == index)
        if mine.size:
            at.append(t)
            on.append(mine[np.searchsorted(samples.edges[mine[1:]], t, side="right")])
        else:
            nearest = int(np.argmin(np.abs(samples.t - t[0])))
            at.append(np.full(t.size, samples.t[nearest]))
            on.append(np.full(t.size, nearest // samples.width))
    shape = samples.intervals, samples.width
    rows = values.reshape(len(values), *shape)
    found = piecewise(samples.t.reshape(shape), rows, np.concatenate(at), np.concatenate(on))
    return np.split(found, np.cumsum([t.size for _, t in times])[:-1], axis=1)

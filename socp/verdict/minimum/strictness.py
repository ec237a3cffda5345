"""What strict minima ask of switching functions beyond their signs: no zeros but the switches, a
slope there, and no control that the principle leaves open.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import final

import casadi
import numpy as np

from socp.model import (
    ACTIVE,
    EXTREMAL,
    TINY,
    Arc,
    Mode,
    Place,
    Problem,
    Solution,
    constraint_function,
    evaluate,
    parameters_of,
    time,
)
from socp.verdict.conditions import stretches
from socp.verdict.lessons import left_open
from socp.verdict.margins import definite

# Points looked at in every interval: the least value of a touch stands out between two of them
_LOOKS = 20
# Over the Hamiltonian's magnitude: values are known to `EXTREMAL`, with a digit to spare
_ZERO = 10.0 * EXTREMAL
# The same over the horizon: a parabola of unit curvature that comes to `EXTREMAL` has this slope
_FLAT = EXTREMAL**0.5
_BESIDE = 1e-2  # of a stretch: as near to a switch its slope tells, not its value


@final
@dataclass(frozen=True, eq=False)
class Switching:
    """Switching functions of a judged solution, whose costates are the principle's own."""

    problem: Problem
    solution: Solution

    @cached_property
    def _function(self) -> casadi.Function:
        """(x, u, costate, t, p) -> sigma (nu,), its slope along the motion (nu,), terms of H."""
        problem, H = self.problem, self._hamiltonian
        sigma = casadi.gradient(H, problem.u)
        slope = casadi.jtimes(sigma, problem.x, problem.rate)
        slope += casadi.jtimes(sigma, problem.costate, -casadi.gradient(H, problem.x))
        slope += casadi.jacobian(sigma, time)
        terms = casadi.fabs(problem.lagrangian) + casadi.sum1(
            casadi.fabs(problem.costate * problem.rate)
        )
        given = [problem.x, problem.u, problem.costate, time, problem.p]
        return casadi.Function("sigma", given, [sigma, slope, terms])

    @property
    def _hamiltonian(self) -> casadi.SX:
        problem = self.problem
        return problem.lagrangian + casadi.dot(problem.costate, problem.rate)

    def _at(self, arc: Arc, t: np.ndarray) -> list[np.ndarray]:
        p = parameters_of(self.problem, self.solution)
        values = (arc.at(t), arc.at(t, "u"), arc.at(t, "costate"))
        return evaluate(self._function, *values, t, p)

    @cached_property
    def looked(self) -> list[tuple[np.ndarray, list[np.ndarray]]]:
        """Times on every arc, with values, slopes and terms there."""
        found = []
        for arc in self.solution.arcs:
            pieces = [np.linspace(a, b, _LOOKS + 1) for a, b in pairwise(arc.t[arc.mesh])]
            t = np.unique(np.concatenate(pieces))
            found.append((t, self._at(arc, t)))
        return found

    @cached_property
    def size(self) -> float:
        """Magnitude of the Hamiltonian."""
        return max(*(float(terms.max()) for _, (_, _, terms) in self.looked), TINY)

    def bang_conditions(self) -> list[tuple[str, float]]:
        """Return what stands against strict signs on the bang stretches and slopes at the switches
        between them, in words, each with how many times over what is told from zero it is met: more
        than once where it holds.
        """
        horizon = self.solution.final_time - self.solution.initial_time
        width = np.diff(self.problem.box, axis=0)[0] / self.size
        found: list[tuple[str, float]] = []
        for i, name in enumerate(self.problem.control_names):
            row = self.solution.structure[name]
            for k, (mode, start, end) in enumerate(row):
                sign = {"+": -1.0, "-": 1.0}.get(mode)
                if sign is None:
                    continue
                t, sigma = self._inside(i, start, end)
                beside = _BESIDE * (end - start)
                far = (t >= start + beside * (k > 0)) & (t <= end - beside * (k < len(row) - 1))
                least = float((sign * sigma[far]).min(initial=np.inf)) * width[i]
                what = f"the switching function of {name} vanishes on stretch {k + 1}"
                found.append((what, least / _ZERO))
                if k < len(row) - 1 and row[k + 1][0] in {"+", "-"}:
                    rising = -sign * self._slope(i, end) * width[i] * horizon
                    what = f"the switching function of {name} is flat at t = {end:.6g}"
                    found.append((what, rising / _FLAT))
        return found

    def _inside(self, i: int, start: float, end: float) -> tuple[np.ndarray, np.ndarray]:
        t = np.concatenate([t for t, _ in self.looked])
        sigma = np.concatenate([values[0][i] for _, values in self.looked])
        inside = (t >= start) & (t <= end)
        return t[inside], sigma[inside]

    def _slope(self, i: int, at: float) -> float:
        """Return the lesser of the slopes on both sides of a switch: they are equal where it alone
        switches.
        """
        joints = self.solution.junctions
        k = int(np.argmin(np.abs(joints - at)))
        sides = ((self.solution.arcs[k], -1), (self.solution.arcs[k + 1], 0))
        slopes = [float(self._at(arc, arc.t[[end]])[1][i, 0]) for arc, end in sides]
        return min(slopes, key=abs)


def met(problem: Problem, solution: Solution) -> list[str]:
    """Return the state constraints that a solution meets anywhere, by name."""
    p, found = parameters_of(problem, solution), []
    for constraint in problem.constraints:
        function = constraint_function(problem, constraint)
        values = evaluate(function, solution.rows("x"), solution.t, p)[0]
        if values.max() >= -ACTIVE * max(float(np.ptp(values)), TINY):
            found.append(constraint.name)
    return found


def left_to_choose(problem: Problem, solution: Solution) -> list[str]:
    """Return the stretches of a judged solution on which other controls of the word do as well, by
    name: those that the principle leaves open, but for bangs from end to end, which have no switch
    to move.
    """
    verdict, middles = solution.verdict, tuple(float(a.t[[0, -1]].mean()) for a in solution.arcs)
    rows = [stretches(solution, name, middles) for name in problem.control_names]
    found: dict[Place, list[bool]] = {}
    for arc, places in zip(solution.arcs, zip(*rows, strict=True), strict=True):
        along = arc.x, arc.u, arc.costate, arc.t, parameters_of(problem, solution)
        for i, place in enumerate(places):
            kind, strict = arc.modes[i].kind, {} if verdict is None else verdict.margins
            alone = len(solution.structure[problem.control_names[i]]) == 1
            if kind == "singular" or not (kind == "boundary" or place in strict or alone):
                told = kind == "singular" and definite(problem, arc.modes, along) is not None
                found.setdefault(place, []).append(not told and left_open(problem, i, arc.modes))
    singular = Mode("singular")
    return [
        str(place)
        for place, is_open in found.items()
        if (any(is_open) if place.mode == singular else all(is_open))
    ]


def joint_switches(solution: Solution) -> list[float]:
    """Return the times at which more than one control changes its mode."""
    return [
        float(b.t[0])
        for a, b in pairwise(solution.arcs)
        if sum(one != other for one, other in zip(a.modes, b.modes, strict=True)) > 1
    ]

"""The second variation along the phases of a word, with singular controls free after Goh's
transformation.

In y = (x, t, r, p), where r stretches a phase in time (1 along the extremal), and with variations v
of the singular controls, the linearised motion is eta' = A eta + B v and the integrand 1/2 eta' Q
eta + v' N eta, from the Hamiltonian r (L + lambda' f). With w the integral of v and eta = xi + B w,

    xi' = A xi + B1 w,  B1 = A B - B',
    integrand 1/2 xi' Q xi + w' M xi + 1/2 w' R w,
    M = B' Q - N' - N A,  R = B' Q B - N B1 - (N B1)' - (N B)',

and w' N xi + 1/2 w' N B w at the end (Goh, SIAM J. Control 4, 1966; Aronna, Bonnans, Dmitruk,
Lotito, Numer. Algebra Control Optim. 2(3), 2012, section 3). A prime after a name in a product is
the transpose, elsewhere the derivative along the extremal. With several singular controls that
takes N B to be symmetric, which is Goh's condition: else v enters the form beside w.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import casadi
import numpy as np

from socp.model import Expr, Problem, numbers, of_motion, once, parameters_of, time
from socp.transcription import Phase, Shooting, once_along
from socp.verdict.minimum.induced import Induced


@final
@dataclass(frozen=True, eq=False)
class Reference:
    """An extremal at chosen times of a phase: t (n,), x (nx, n), u (nu, n), costate (nx, n)."""

    t: np.ndarray
    x: np.ndarray
    u: np.ndarray
    costate: np.ndarray


def reference(known: Induced, k: int, nodes: np.ndarray) -> Reference:
    """Return the extremal at nodes (s,), in order and between 0 and 1, of every interval of phase
    k, one interval after the other.

    The costate is that of the induced problem: the multiplier of the interval's end, carried back
    by the slopes of the motion. Both go from node to node, with steps as long as those of the word.
    """
    shooting = known.conditions.shooting
    problem, nx = shooting.phased.of, shooting.phased.of.x.numel()
    (begins, z), p = _corners(known, k), parameters_of(problem, shooting.solution)
    t = begins[:-1] + nodes[:, None] * np.diff(begins)
    gaps = np.diff(np.vstack([begins[:-1], t, begins[1:]]), axis=0)
    steps = int(np.ceil(np.diff([0.0, *nodes, 1.0]).max() * shooting.steps[k]))
    motion, h = shooting.motions[k], np.repeat(gaps / steps, steps, axis=0)
    way = motion.through(z[:, :-1], begins[:-1], h, p)
    at = _joined(way[steps:-1:steps, :-2])
    count = z.shape[1] - 1
    ended = known.held[shooting.blocks[k].equations].T
    held = np.vstack([ended, np.ones(count), np.zeros(count)])
    costates = motion.returned(held, way[steps:-1], h[steps:], p)[:-1:steps, :nx]
    times = t.T.ravel()
    (u,) = numbers(motion.control, at[:nx], at[nx:], times, p)
    return Reference(times, at[:nx], u, _joined(costates))


def _joined(values: np.ndarray) -> np.ndarray:
    """Return values (nodes, rows, m) of m intervals as (rows, m nodes), an interval after the
    other.
    """
    return values.transpose(1, 2, 0).reshape(values.shape[1], -1)


@once
def _corners(known: Induced, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the times (m + 1,) between the intervals of a phase, and the values (nz, m + 1)
    there.
    """
    shooting = known.conditions.shooting
    corners, _, z = shooting.split(known.at)
    return corners[k] + known.at[1 + k] * shooting.blocks[k].shares, z[k]


NAMES = ("A", "Q", "B", "B1", "M", "R", "N", "NB")


@final
@dataclass(frozen=True, eq=False)
class Quadratic:
    """The coefficients of the second variation of a phase as a function of its reference; `free`
    are the places of the singular controls.
    """

    problem: Problem
    phase: Phase
    free: tuple[int, ...]

    def at(self, along: Reference, p: np.ndarray) -> dict[str, np.ndarray]:
        """Return the coefficients by name, each (n, rows, columns)."""
        v, count = along.u[list(self.free)], along.t.size
        found = numbers(self._function, along.x, v, along.costate, along.t[None, :], p)
        names = NAMES if self.free else NAMES[:2]
        return {
            name: each.reshape(each.shape[0], count, -1).transpose(1, 0, 2)
            for name, each in zip(names, found, strict=True)
        }

    @cached_property
    def _function(self) -> casadi.Function:
        problem, phase = self.problem, self.phase
        r = casadi.SX.sym("r")
        rate, running = phase.flow(problem)
        H = running + casadi.dot(problem.costate, rate)
        y = casadi.vertcat(problem.x, time, r, problem.p)
        motion = casadi.vertcat(r * rate, r, casadi.SX.zeros(1 + problem.p.numel()))

        def derivative(expression: Expr) -> Expr:
            """Along the extremal; what is differentiated does not depend on the control."""
            entries = casadi.vec(expression)
            found = (
                casadi.jtimes(entries, problem.x, rate)
                - casadi.jtimes(entries, problem.costate, casadi.gradient(H, problem.x))
                + casadi.jtimes(entries, time, casadi.SX(1))
            )
            return casadi.reshape(found, *expression.shape)

        A = casadi.jacobian(motion, y)
        Q = casadi.hessian(r * H, y)[0]
        found = [A, Q]
        if self.free:
            B = casadi.jacobian(motion, phase.free)
            N = casadi.jacobian(casadi.gradient(r * H, phase.free), y)
            NB = casadi.mtimes(N, B)
            B1 = casadi.mtimes(A, B) - derivative(B)
            M = casadi.mtimes(B.T, Q) - derivative(N) - casadi.mtimes(N, A)
            bent = casadi.mtimes(N, B1)
            R = casadi.mtimes([B.T, Q, B]) - bent - bent.T - derivative(NB)
            found += [B, B1, M, R, N, NB]
        at = [casadi.densify(casadi.substitute(each, r, 1)) for each in found]
        given = [problem.x, phase.free, problem.costate, time, problem.p]
        return casadi.Function("quadratic", given, at)


@of_motion
def quadratic(problem: Problem, phase: Phase, free: tuple[int, ...]) -> Quadratic:
    """Return the coefficients of a phase, built once for all arcs of its modes."""
    return once_along(problem, phase, quadratic, lambda: Quadratic(problem, phase, free), free)


def singular_places(shooting: Shooting) -> list[tuple[int, ...]]:
    """Return, phase by phase, the places of the singular controls."""
    return [
        tuple(i for i, mode in enumerate(phase.modes) if mode.kind == "singular")
        for phase in shooting.phased.phases
    ]

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

from socp.model import Problem, numbers, of_motion, parameters_of, time
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
    """Return the extremal at nodes (s,) between 0 and 1 of every interval of phase k, one interval
    after the other.

    The costate is that of the induced problem: the multiplier of the interval's end, carried back
    by the slopes of the motion. Both begin where the steps do that the word's conditions take.
    """
    shooting = known.conditions.shooting
    problem, nx = shooting.phased.of, shooting.phased.of.x.numel()
    sweep = known.conditions.linearised(known.at).sweeps[k]
    y, multipliers = sweep.between(known.held[shooting.blocks[k].equations].T, nodes)
    given = y[:nx], y[nx:-2], y[-1], parameters_of(problem, shooting.solution)
    (u,) = numbers(shooting.motions[k].control, *given)
    return Reference(y[-1], y[:nx], u, multipliers[:nx])


NAMES = ("A", "Q", "B", "B1", "M", "R", "N", "NB")


@final
@dataclass(frozen=True, eq=False)
class Quadratic:
    """The coefficients of the second variation of a phase as a function of its reference; `free`
    are the places of the controls that may be singular, those that its law leaves free.
    """

    problem: Problem
    phase: Phase
    free: tuple[int, ...]

    def at(self, along: Reference, p: np.ndarray, places: tuple[int, ...]) -> dict[str, np.ndarray]:
        """Return the coefficients by name, each (n, rows, columns), for singular controls at
        `places`.
        """
        which = [self.free.index(place) for place in places]
        count, found = along.t.size, dict[str, np.ndarray]()
        given = along.x, along.u, along.costate, along.t[None, :], p
        for name, each in zip(NAMES, numbers(self._function, *given), strict=True):
            columns = self._function.size2_out(NAMES.index(name))
            at = each.reshape(len(each), count, columns).transpose(1, 0, 2)
            at = at[:, which] if name in {"M", "R", "N", "NB"} else at
            found[name] = at[:, :, which] if name in {"B", "B1", "R", "NB"} else at
        return found

    @cached_property
    def _function(self) -> casadi.Function:
        problem, phase = self.problem, self.phase
        r = casadi.SX.sym("r")
        rate, running = phase.flow(problem)
        H = running + casadi.dot(problem.costate, rate)
        y = casadi.vertcat(problem.x, time, r, problem.p)
        motion = casadi.vertcat(r * rate, r, casadi.SX.zeros(1 + problem.p.numel()))
        A = casadi.jacobian(motion, y)
        Q = casadi.hessian(r * H, y)[0]
        B = casadi.jacobian(motion, phase.free)
        N = casadi.jacobian(casadi.gradient(r * H, phase.free), y)
        # along the extremal; neither depends on a control
        along = casadi.vertcat(problem.x, time, problem.costate)
        by = casadi.vertcat(rate, 1, -casadi.gradient(H, problem.x))
        both = casadi.jtimes(casadi.vec(casadi.horzcat(B, N.T)), along, by)
        both = casadi.reshape(both, B.size1(), 2 * B.size2())
        B_, N_ = both[:, : B.size2()], both[:, B.size2() :].T
        NB = casadi.mtimes(N, B)
        B1 = casadi.mtimes(A, B) - B_
        M = casadi.mtimes(B.T, Q) - N_ - casadi.mtimes(N, A)
        bent, NB_ = casadi.mtimes(N, B1), casadi.mtimes(N_, B) + casadi.mtimes(N, B_)
        R = casadi.mtimes([B.T, Q, B]) - bent - bent.T - NB_
        found = casadi.substitute([A, Q, B, B1, M, R, N, NB], [r], [casadi.SX(1)])
        given = [problem.x, problem.u, problem.costate, time, problem.p]
        return casadi.Function("quadratic", given, [casadi.densify(each) for each in found])


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

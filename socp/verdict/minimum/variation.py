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
from socp.verdict.minimum.stages import hermite

# Ends of steps that the extremal between them is taken from, with its slopes there: to order 10
_AROUND = 5


@final
@dataclass(frozen=True, eq=False)
class Reference:
    """An extremal at chosen times of a phase: t (n,), x (nx, n), u (nu, n), costate (nx, n)."""

    t: np.ndarray
    x: np.ndarray
    u: np.ndarray
    costate: np.ndarray


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
        `places`: the Hessian of r H by y, v and costate holds A, B, Q and N.
        """
        found, (nx, n), m = self._values(along, p), along.x.shape, len(self.free)
        size = len(found) - m + 1
        ny, r = size - m - nx, nx + 1
        own, rows = (np.delete(np.arange(count), r) for count in (size, size + m))
        bent = np.zeros((n, size + m, size))
        bent[:, rows[:, None], own] = found[:, :, 1:].swapaxes(0, 1)
        bent[:, rows, r] = found[:, :, 0].T
        bent[:, r, own] = bent[:, own, r]
        which = [self.free.index(place) for place in places]
        at, turned = (start + np.array(which, dtype=int) for start in (ny, size))
        A, (B, B_) = np.zeros((n, ny, ny)), np.zeros((2, n, ny, len(places)))
        A[:, :nx], A[:, nx, r] = bent[:, size - nx : size, :ny], 1.0
        B[:, :nx], B_[:, :nx] = (bent[:, each, size - nx :].swapaxes(1, 2) for each in (at, turned))
        Q, N, N_ = (bent[:, each, :ny] for each in (slice(ny), at, turned))
        B1 = A @ B - B_
        M = B.swapaxes(1, 2) @ Q - N_ - N @ A
        R = M @ B - (N @ B1).swapaxes(1, 2)
        return {"A": A, "Q": Q, "B": B, "B1": B1, "M": M, "R": R, "N": N, "NB": N @ B}

    def rates(self, along: Reference, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rates of the states and of the costate, (nx, n) each."""
        slopes, nx, m = self._values(along, p)[:, :, 0], len(along.x), len(self.free)
        return slopes[len(slopes) - m - nx : len(slopes) - m], -slopes[:nx]

    def _values(self, along: Reference, p: np.ndarray) -> np.ndarray:
        """Return what the function is (rows, n, columns) at n points."""
        given = along.x, along.u, along.costate, along.t[None, :], p
        (found,) = numbers(self._function, *given)
        return found.reshape(len(found), along.t.size, -1)

    @cached_property
    def _function(self) -> casadi.Function:
        """Slopes (k, 1) and Hessian (k, k) of H by x, t, p, v and costate, side by side, and below
        them how the rows of v turn along the extremal, as functions of x, u, costate, t, p.
        """
        problem, free = self.problem, self.phase.free
        (rate, running), nx = self.phase.flow(problem), problem.x.numel()
        H = running + casadi.dot(problem.costate, rate)
        every = casadi.vertcat(problem.x, time, problem.p, free, problem.costate)
        bent, by = casadi.hessian(H, every)
        found, last = casadi.horzcat(by, bent), every.numel() - nx
        # along the extremal; neither depends on a control
        along = casadi.vertcat(problem.x, time, problem.costate)
        turn = casadi.vertcat(rate, 1, -by[:nx])
        turned = casadi.jtimes(found[last - free.numel() : last, :], along, turn)
        given = [problem.x, problem.u, problem.costate, time, problem.p]
        return casadi.Function("quadratic", given, [casadi.vertcat(found, turned)])


def reference(known: Induced, k: int, of: Quadratic, nodes: np.ndarray) -> Reference:
    """Return the extremal at nodes (s,) between 0 and 1 of every interval of phase k, one interval
    after the other: the polynomials through the ends of the steps next to them, by what is known
    there and the rates `of` the phase.

    The costate is that of the induced problem: the multiplier of the interval's end, carried back
    by the slopes of the motion. How a law moves its singular control adds nothing to its rate:
    along an extremal the Hamiltonian does not depend on that control.
    """
    shooting = known.conditions.shooting
    control, p = shooting.motions[k].control, parameters_of(of.problem, shooting.solution)
    t, h, z, costate = _step_ends(known, k)
    nz, nx = z.shape[2], costate.shape[2]

    def at(t: np.ndarray, z: np.ndarray, costate: np.ndarray) -> Reference:
        z, costate = (each.reshape(t.size, -1).T for each in (z, costate))
        (u,) = numbers(control, z[:nx], z[nx:], t.reshape(1, -1), p)
        return Reference(t.ravel(), z[:nx], u, costate)

    rates, turns = (each.T.reshape(costate.shape) for each in of.rates(at(t, z, costate), p))
    values, slopes = hermite(t.shape[1] - 1, tuple(nodes), _AROUND)
    found = values @ np.concatenate([z, costate], axis=2)
    # what is carried along are costates
    found += h * (slopes @ np.concatenate([rates, turns[:, :, : nz - nx], turns], axis=2))
    return at(t[:, :1] + (t.shape[1] - 1) * h[:, 0] * nodes, found[:, :, :nz], found[:, :, nz:])


def _step_ends(known: Induced, k: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return where the steps of the n intervals of phase k begin and end: times (n, s + 1), lengths
    of the steps (n, 1, 1), states with what is carried (n, s + 1, nz) and costates (n, s + 1, nx).
    """
    shooting = known.conditions.shooting
    sweep = known.conditions.linearised(known.at).sweeps[k]
    (n, steps, _), lengths = sweep.before.shape, sweep.each.reshape(len(sweep.before), -1)
    if steps < _AROUND - 1:
        steps, first = _AROUND - 1, sweep.before[:, 0]
        given = [first[:, :-2].T, first[:, -1:].T, lengths.sum(axis=1)[None], sweep.p]
        sweep = shooting.motions[k].sweep(given, steps)
    h = sweep.each.reshape(n, steps)[:, :1]
    z = np.concatenate([sweep.before[:, :, :-2], sweep.ends[:, None, :-1]], axis=1)
    later = sweep.returned(known.held[shooting.blocks[k].equations].T)
    costate = np.concatenate([later[:, :1] @ sweep.across[:, 0], later], axis=1)
    t = sweep.before[:, 0, -1:] + h * np.arange(steps + 1)
    return t, h[:, :, None], z, costate[:, :, : shooting.phased.of.x.numel()]


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

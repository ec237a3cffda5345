"""The motion along a phase's law by explicit Runge-Kutta steps of order 8, with its first and
second derivatives: functions built once a law, whatever words and intervals it stands in.

The formula is that of Dormand and Prince (Hairer, Norsett, Wanner, Solving ODEs I, II.5).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, final

import casadi
import numpy as np
from scipy.integrate import DOP853

from socp.model import Expr, Problem, cached, numbers, once, time
from socp.transcription.phases import Phase


@final
@dataclass(frozen=True, eq=False)
class Motion:
    """The motion along a law; z (nz,) are the states with what the phase carries."""

    problem: Problem
    phase: Phase

    @cached_property
    def step(self) -> casadi.Function:
        """One step (y, h, p) -> y of z, the running cost and the time."""
        problem, phase = self.problem, self.phase
        rate, running = phase.flow(problem)
        given = [casadi.vertcat(problem.x, phase.carried), time, problem.p]
        motion = casadi.Function("f", given, [casadi.vertcat(rate, phase.carried_rate, running, 1)])
        y, h = casadi.SX.sym("y", motion.size1_out(0)), casadi.SX.sym("h")
        slopes: list[Any] = []
        for row in DOP853.A:
            at = y + h * _sum(row, slopes)
            slopes.append(motion(at[:-2], at[-1], problem.p))
        return casadi.Function("step", [y, h, problem.p], [y + h * _sum(DOP853.B, slopes)])

    @once
    def flow(self, steps: int) -> casadi.Function:
        """Return the motion as a function (z, t, h, p) -> (z, running cost) after a time h."""
        sizes = self.step.size1_in(0) - 2, 1, 1, self.step.size1_in(2)
        Z, T, H, P = (casadi.MX.sym(name, size) for name, size in zip("zthp", sizes, strict=True))
        last = self.step.mapaccum(steps)(
            casadi.vertcat(Z, 0, T), casadi.repmat(H / steps, 1, steps), casadi.repmat(P, 1, steps)
        )
        return casadi.Function("flow", [Z, T, H, P], [last[:-2, -1], last[-2, -1]])

    @once
    def _slopes(self, steps: int) -> casadi.Function:
        """(z, t, h, p) -> z and the running cost, with their slopes by all of these."""
        given = self.flow(steps).mx_in()
        found = casadi.vertcat(*self.flow(steps)(*given))
        slopes = casadi.densify(casadi.jacobian(found, casadi.vertcat(*given)))
        return casadi.Function("slopes", given, [found, slopes])

    @once
    def _bent(self, steps: int) -> casadi.Function:
        """(z, t, h, p, multipliers) -> Hessian of the running cost and z times multipliers."""
        given = self.flow(steps).mx_in()
        end, running = self.flow(steps)(*given)
        held = casadi.MX.sym("l", end.numel())
        total = running + casadi.dot(held, end)
        hessian = casadi.densify(casadi.hessian(total, casadi.vertcat(*given))[0])
        return casadi.Function("bent", [*given, held], [hessian])

    def slopes(self, given: list[np.ndarray], steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Return z with the running cost (n, nz + 1) after n intervals, and their slopes (n, nz +
        1, nz + 2 + np) by what is given: z (nz, n), t (1, n), h (1, n), p (np, 1).
        """
        found, slopes = _evaluated(self._slopes(steps), given)
        return found[:, :, 0], slopes

    def bent(self, given: list[np.ndarray], held: np.ndarray, steps: int) -> np.ndarray:
        """Return the Hessians (n, nz + 2 + np,) twice, by the same, of the running cost and z times
        multipliers held (nz, n).
        """
        return _evaluated(self._bent(steps), [*given, held])[0]


def motion_of(problem: Problem, phase: Phase) -> Motion:
    """Return the motion along a phase's law; phases of one law share it."""
    known = cached(problem, motion_of)
    found = known.get(key := (phase.modes, phase.when))
    if found is None or not casadi.is_equal(found.phase.control, phase.control):
        known[key] = found = Motion(problem, phase)
    return found


def _sum(row: np.ndarray, slopes: list[Any]) -> Expr:
    """Return the sum of slopes times the coefficients of a row that are not zero."""
    return sum((a * k for a, k in zip(row, slopes, strict=False) if a), casadi.SX(0))


def _evaluated(function: casadi.Function, given: list[np.ndarray]) -> list[np.ndarray]:
    """Return the matrices (n, r, c) that a function gives for n columns."""
    n = given[0].shape[1]
    found = numbers(function, *given)
    return [each.reshape(each.shape[0], n, -1).transpose(1, 0, 2) for each in found]

"""Steps of DOP853 along a flow that casadi knows, each one call of a function that is built once.

Coefficients, error estimate, step sizes and what is in between are those of Hairer, Norsett,
Wanner, Solving ODEs I, II.4, II.5 and II.10, as scipy's class has them, but that a step is shorter
where what is in between is not resolved; what Python does there in every one of sixteen stages
takes ten times as long as a step here.
"""

import math
from collections.abc import Callable
from functools import cache, cached_property
from typing import Any, final

import casadi
import numpy as np

from socp.model import TINY, fast, numbers, once
from socp.transcription import (
    DOP853_ERRORS,
    DOP853_STAGES,
    DOP853_THROUGH,
    DOP853_TIMES,
    stage_points,
)

Plan = Callable[[np.ndarray], np.ndarray]  # times (k,) -> controls (nu, k)
# rates (x, u, t, p) -> (n,), the last of which no rate depends on, with controls and parameters
Flow = tuple[casadi.Function, Plan, np.ndarray]

_END = 12  # the stage at the end of the step: twelve before it, and three for what is in between
_EXPONENT = -1.0 / 8.0  # of the error, which is of order 7
_SAFETY, LEAST, _MOST = 0.9, 0.2, 10.0  # how a step follows from the last one, as factors
# Of a motion's size: what the last term of what is in between may be. Along smooth motion it is
# 1e-8; a long step along a motion that is stable to rounding has small errors at its end alone
_BETWEEN = 1e-7
_SHORT = 150  # operations of a rate: of so many both ways of writing out a step take as long
_PEAK = (4 / 7) ** 4 * (3 / 7) ** 3  # of x^4 (1 - x)^3, the last of the basis


@once
def one_step(flow: casadi.Function) -> casadi.Function:
    """Return a step along rates (x, u, t, p) -> (n,), the last of which no rate depends on: from y
    (n,), controls (nu, 16) and times (1, 16) of the stages, h and p to y after it and the slopes
    (n, 16) of the stages.

    Rates of a few operations are written out for all stages in one call, of points that hold the
    slopes before them as symbols: a call a stage takes twice as long. Others are called stage after
    stage, and those that look into tables: casadi 3.8 ends the process where calls in them are
    mapped or put in place.
    """
    count, symbol = DOP853_TIMES.size, casadi.SX.sym
    y, h, slopes, points = _stages(flow.size1_out(0))
    u, t = symbol("u", flow.size1_in(1), count), symbol("t", 1, count)
    p = symbol("p", flow.size1_in(3))
    many = flow.n_instructions()
    if many > _SHORT or casadi.OP_CALL in map(flow.instruction_id, range(many)):
        at, rates = [y], list[casadi.SX]()
        for point, plan, moment in zip(
            (*stage_points(y.numel()), None), casadi.horzsplit(u), casadi.horzsplit(t), strict=True
        ):
            rates.append(flow(at[-1][:-1], plan, moment, p))
            at += [] if point is None else [point(y, h, *rates)]
        found = [at[_END], casadi.horzcat(*rates)]
    else:
        rates = casadi.horzsplit(flow.map(count)(points[:-1, :], u, t, casadi.repmat(p, 1, count)))
        told = [points[:, _END], casadi.horzcat(*slopes)]
        found = casadi.substitute_inplace(slopes, rates, told)[1]
    return casadi.Function("step", [y, u, t, h, p], [casadi.densify(each) for each in found])


@cache
def _stages(n: int) -> tuple[casadi.SX, casadi.SX, list[casadi.SX], casadi.SX]:
    """Return y (n,), h, the slopes (n,) of the stages and where these look at y (n, 16), by the
    slopes of those before.
    """
    y, h = casadi.SX.sym("y", n), casadi.SX.sym("h")
    slopes = [casadi.SX.sym("k", n) for _ in DOP853_TIMES]
    later = [point(y, h, *slopes[:k]) for k, point in enumerate(stage_points(n), start=1)]
    return y, h, slopes, casadi.horzcat(y, *later)


@cache
def looked_at(n: int) -> casadi.Function:
    """Return, from y (n,), h, the slopes (n, 16) of the stages, and what may be missed, relative
    and absolute (n,), the error (2,) of a step and the coefficients (n, 7) of what is in between.

    The error is over what is allowed, by what the step misses and, where that is more than one, by
    what is left out in between.
    """
    symbol = casadi.SX.sym
    y, h, slopes = symbol("y", n), symbol("h"), symbol("slopes", n, DOP853_TIMES.size)
    rtol, atol = symbol("rtol"), symbol("atol", n)
    errors = h * casadi.mtimes(slopes[:, : _END + 1], casadi.DM(DOP853_ERRORS))
    moved = h * casadi.mtimes(slopes[:, :_END], casadi.DM(DOP853_STAGES[_END]))
    first, last = h * slopes[:, 0], h * slopes[:, _END]
    more = h * casadi.mtimes(slopes, casadi.DM(DOP853_THROUGH))
    between = casadi.horzcat(moved, first - moved, 2 * moved - last - first, more)
    scale = atol + casadi.fmax(casadi.fabs(y), casadi.fabs(y + moved)) * rtol
    fifth, third = casadi.vertsplit(casadi.sum1((errors / casadi.repmat(scale, 1, 2)) ** 2).T)
    both = (fifth + 0.01 * third) * n
    missed = fifth / casadi.sqrt(casadi.fmax(both, TINY))
    left = _PEAK * rtol / _BETWEEN * casadi.mmax(casadi.fabs(more[:, -1]) / scale)
    found = [casadi.densify(each) for each in (casadi.vertcat(missed, left), between)]
    return casadi.Function("looked_at", [y, h, slopes, rtol, atol], found)


@final
class Steps:
    """A motion of y (n,) along a flow: where it is and has been, and whether it is running,
    finished or failed.

    `span` is where it begins and ends, and the latest time that functions see, such as that before
    a jump at the end. `first` is the length of the first step, chosen where it is None.
    """

    def __init__(
        self,
        flow: Flow,
        span: tuple[float, float, float],
        y: np.ndarray,
        first: float | None,
        *,
        rtol: float,
        atol: np.ndarray,
    ) -> None:
        (self._flow, self._plan, self._p), (self.t, self._end, self._latest) = flow, span
        self._one = one_step(self._flow)
        self._rtol, self._atol = rtol, atol
        self.y, self.t_old, self.status = y, self.t, "running"
        self._before, self._between = y, np.zeros((y.size, 7))
        self._length = self._first() if first is None else first

    @cached_property
    def _call(self) -> Callable[..., np.ndarray]:
        return fast(self._flow)

    def rate(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return the rates (n,) at a time and a state."""
        t = min(t, self._latest)
        return self._call(y[:-1], self._plan(np.array([t]))[:, 0], t, self._p)

    def _once(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return the same without what a quick function takes to be built."""
        at = np.array([min(t, self._latest)])
        return numbers(self._flow, y[:-1], self._plan(at), at, self._p)[0][:, 0]

    def _first(self) -> float:
        """Return a length for the first step, from how large rates are and how fast they change."""
        scale = self._atol + np.abs(self.y) * self._rtol
        whole, rate = self._end - self.t, self._once(self.t, self.y)
        size, speed = _norm(self.y / scale), _norm(rate / scale)
        small = min(1e-6 if size < 1e-5 or speed < 1e-5 else 0.01 * size / speed, whole)
        turned = self._once(self.t + small, self.y + small * rate)
        bent = _norm((turned - rate) / scale / small)
        if speed <= 1e-15 and bent <= 1e-15:
            other = max(1e-6, small * 1e-3)
        else:
            other = (0.01 / max(speed, bent)) ** -_EXPONENT
        return min(100 * small, other, whole)

    def step(self) -> str:
        """Take one step; returns why there is none."""
        least = 10.0 * (math.nextafter(self.t, math.inf) - self.t)
        length, rejected = max(self._length, least), False
        while True:
            if not length >= least:  # nor what is no number
                self.status = "failed"
                return "the step is shorter than times can tell"
            t = min(self.t + length, self._end)
            length = t - self.t
            at = np.minimum(self.t + DOP853_TIMES * length, self._latest)
            after, slopes = numbers(self._one, self.y, self._plan(at), at, length, self._p)
            given = self.y, length, slopes, self._rtol, self._atol
            errors, between = numbers(looked_at(self.y.size), *given)
            error = float(worst(errors)[0])
            if error < 1:
                most = 1.0 if rejected else _MOST
                factor = min(most, shorter(error)) if error else most
                break
            length *= max(LEAST, shorter(error))
            rejected = True
        self.t_old, self.t, self._length = self.t, t, length * factor
        self._before, self.y, self._between = self.y, after[:, 0], between
        if t == self._end:
            self.status = "finished"
        return ""

    def between(self, t: np.ndarray) -> np.ndarray:
        """Return y (n, k) at times (k,) of the last step."""
        x = (t - self.t_old) / (self.t - self.t_old)
        found: np.ndarray = self._before[:, None] + self._between @ basis(x)
        return found


def basis(x: np.ndarray) -> np.ndarray:
    """Return x, x (1 - x), x^2 (1 - x), ... (7, k) at shares (k,) of a step."""
    factors = np.empty((7, x.size))
    factors[::2], factors[1::2] = x, 1.0 - x
    return np.cumprod(factors, axis=0)


def _norm(values: np.ndarray) -> float:
    return float(np.sqrt(values @ values / values.size))


def worst(errors: np.ndarray) -> np.ndarray:
    """Return the larger (k,) of errors (2, k) as steps have them, nan where the first one is."""
    missed, left = errors
    return np.array(np.where(left > 1, np.maximum(missed, left), missed))


def shorter(error: Any) -> Any:
    """Return by which factor a step with such an error is to be longer, or shorter."""
    return _SAFETY * error**_EXPONENT

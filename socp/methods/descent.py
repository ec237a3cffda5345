"""Controls improved along their own motion, for where no grid follows it.

A grid claims states that no control reaches where the motion is stiff or has a pole nearby: a
substrate below zero pays. Single shooting asks for no states: controls are held over equal
intervals, the motion follows in implicit steps, and the gradient through these improves the
controls (L-BFGS-B: Byrd, Lu, Nocedal, Zhu, SIAM J. Sci. Comput. 16(5), 1995). Ends and state
constraints are met by an augmented Lagrangian (Nocedal, Wright, Numerical Optimization, 17.3).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import final

import casadi
import numpy as np

from socp.errors import LateError
from socp.methods.driving import horizons, motions
from socp.methods.guess import guess_of
from socp.model import (
    APPROXIMATE,
    Expr,
    Problem,
    Solution,
    Stop,
    condition_function,
    condition_slopes,
    mayer_function,
    parameters_of,
    time,
)
from socp.process import in_time
from socp.transcription import Scale, radau_iia

_HELD = 50  # intervals: arcs are read from grids that are no finer
_STEPS = 2  # on each, of order 3: what is found is solved again, on a grid of its own
# Of the multipliers, and what a square weighs more in each than in the one before
_ROUNDS, _FIRMER = 4, 4.0
# What a square weighs first: a row that is off by a tenth of its magnitude counts half of what the
# objective does
_WEIGHT = 1e3
_ITERATIONS = 50  # of a round; they are cheap, and far from a solution the first ones do most
_BROKEN = 1e-6  # relative: a step of which Newton's method leaves more is none
_NEWTON = {"error_on_fail": False, "max_iter": 12}  # what takes more leaps about
_LOST = 1e6  # of the objective's magnitude: what a control is worth whose motion breaks down


def descended(problem: Problem, guess: Solution) -> Solution | None:
    """Return the motion to which constant controls are improved, each for a while, and then the one
    that is best; None where that misses the ends or the state constraints. Where the time allowed
    ends it, it is the best motion so far.

    Its controls are held over equal intervals; its objective has the three digits that coarse steps
    leave.
    """
    starts = list(motions(problem, guess, own=True))
    if not starts:
        return None
    descent, found = _Descent(problem, _scale(problem, starts)), list[_Point]()
    try:
        for start in starts:
            found.append(descent.begun(start))
        for _ in range(_ROUNDS):
            found.append(descent.improved(_best(found)))
    except LateError:
        pass
    return descent.motion(_best(found).z) if found else None


def _best(found: list["_Point"]) -> "_Point":
    """Return the point with the least merit among those of the most rounds."""
    return min(found, key=lambda each: (-each.weight, each.merit))


def _scale(problem: Problem, starts: Sequence[Solution]) -> Scale:
    """Return the largest magnitudes near some motions: what one control leaves alone another
    moves.
    """
    scales = [Scale.of(problem, each) for each in starts]
    x = np.max([each.x for each in scales], axis=0)
    return replace(scales[0], x=x, cost=max(each.cost for each in scales))


@final
@dataclass(frozen=True, eq=False)
class _Point:
    """Unknowns z (n,), multipliers (m,) of what they have to meet, the weight of its squares, and
    the augmented Lagrangian that led there.
    """

    z: np.ndarray
    multipliers: np.ndarray
    weight: float
    merit: float


@final
@dataclass(frozen=True, eq=False)
class _Descent:
    """The descent of a problem; the unknowns z, each in its own magnitude, are the states at the
    start, the parameters, both times and the controls, interval by interval.
    """

    problem: Problem
    scale: Scale

    def begun(self, start: Solution) -> _Point:
        """Return what a round makes of a motion. Raises LateError where the time is over first."""
        p, times = parameters_of(self.problem, start), [start.initial_time, start.final_time]
        u = np.tile(start.rows("u")[:, 0], _HELD)
        known = np.concatenate([start.rows("x")[:, 0], p, times, u]) / self.sizes
        z = np.clip(known, *self.box)
        return self.improved(_Point(z, np.zeros(self.equation.size), _WEIGHT, np.inf))

    def improved(self, point: _Point) -> _Point:
        """Return what one more round makes of a point. Raises LateError where the time is over
        first.
        """
        from scipy.optimize import minimize  # where a problem asks for it

        found = minimize(
            partial(self._merit, point.multipliers, point.weight),
            point.z,
            jac=True,
            method="L-BFGS-B",
            bounds=self.box.T.tolist(),
            options={"maxiter": _ITERATIONS},
        )
        multipliers = self._kept(point.multipliers + point.weight * self._values(found.x)[1])
        return _Point(found.x, multipliers, _FIRMER * point.weight, float(found.fun))

    def motion(self, z: np.ndarray) -> Solution | None:
        """Return the motion of some unknowns; None where it misses what it has to meet."""
        objective, left = self._values(z)
        if not np.abs([objective * 0.0, *self._kept(left)]).max() <= APPROXIMATE:
            return None
        *_, x, u = map(np.array, self.functions[0](z))
        first, last = (z * self.sizes)[self.at[1] : self.at[2]]
        p = (z * self.sizes)[self.at[0] : self.at[1]]
        known = dict(zip(self.problem.parameter_names, p.tolist(), strict=True))
        t = np.linspace(first, last, _HELD + 1)
        made = guess_of(self.problem, t, x, np.hstack([u[:, :1], u]), known)
        return replace(
            made,
            arcs=(replace(made.arcs[0], side="right"),),
            objective=objective * self.scale.cost,
            stop=Stop.SOLVED,
            message="a control that is held over every interval, improved along its own motion",
        )

    def _kept(self, rows: np.ndarray) -> np.ndarray:
        """Return rows (m,) without what inequalities do not ask for."""
        return np.where(self.equation, rows, np.maximum(rows, 0.0))

    def _merit(
        self, multipliers: np.ndarray, weight: float, z: np.ndarray
    ) -> tuple[float, np.ndarray]:
        """Return the augmented Lagrangian and its gradient."""
        in_time("a descent along motions")
        objective, left = self._values(z)
        pull = self._kept(multipliers + weight * left)
        value = objective + float(pull @ pull) / (2.0 * weight)
        if not np.isfinite(value):
            return _LOST, np.zeros_like(z)
        slope = np.array(self.functions[1](z, pull)).ravel()
        return value, np.where(np.isfinite(slope), slope, 0.0)

    def _values(self, z: np.ndarray) -> tuple[float, np.ndarray]:
        """Return objective and rows (m,), nan where the motion breaks down."""
        objective, rows, broken, *_ = self.functions[0](z)
        lost = 0.0 if float(broken) <= _BROKEN else np.nan
        return float(objective) + lost, np.array(rows).ravel() + lost

    @cached_property
    def at(self) -> tuple[int, int, int]:
        """Where among the unknowns the parameters, the times and the controls begin."""
        nx, count = self.problem.x.numel(), self.problem.p.numel()
        return nx, nx + count, nx + count + 2

    @cached_property
    def sizes(self) -> np.ndarray:
        """Magnitudes (n,) of the unknowns."""
        low, high = self.problem.box
        wide = np.tile(np.where(high > low, high - low, 1.0), _HELD)
        return np.concatenate([self.scale.x, self.scale.p, np.full(2, self.scale.time), wide])

    @cached_property
    def box(self) -> np.ndarray:
        """Least and greatest values (2, n) of the unknowns."""
        problem = self.problem
        times = np.array([problem.initial_time_box, problem.final_time_box]).T
        held = np.tile(problem.box, _HELD)
        times[0, 1] = max(times[0, 1], self._shortest)
        limits = np.hstack([problem.start_box, problem.parameter_box, times, held])
        return np.asarray(limits / self.sizes)

    @property
    def _shortest(self) -> float:
        """The least final time of a guess with the least of all horizons."""
        near, shortest = self.scale.near, min(horizons(self.problem))
        return near.initial_time + shortest * self.scale.time if near else -np.inf

    @cached_property
    def functions(self) -> tuple[casadi.Function, casadi.Function]:
        """Functions z -> objective, rows (m, 1), what steps leave at worst, states at the ends of
        all intervals and controls, and (z, multipliers (m,)) -> the gradient of the objective and
        the rows times these.
        """
        problem, z = self.problem, casadi.MX.sym("z", self.sizes.size)
        parts = casadi.vertsplit(z * self.sizes, [0, *self.at, self.sizes.size])
        x0, p, times, u = parts
        u = casadi.reshape(u, -1, _HELD)
        states, h = [x0], (times[1] - times[0]) / _HELD
        cost, broken = casadi.MX(0), casadi.MX(0)
        for k in range(_HELD):
            x, more, left = self._interval(states[-1], u[:, k], times[0] + k * h, h, p)
            states, cost, broken = [*states, x], cost + more, casadi.fmax(broken, left)
        ends = [states[-1], x0, p, times[0], times[1]]
        moments = [times[0] + k * h for k in range(_HELD + 1)]
        rows = casadi.vertcat(*self._ends(ends), *self._along(states, moments, p))
        objective = (mayer_function(problem)(*ends) + cost) / self.scale.cost
        by = casadi.MX.sym("by", rows.numel())
        slope = casadi.gradient(objective + casadi.dot(by, rows), z)
        found = [objective, rows, broken, casadi.horzcat(*states), u]
        return (
            casadi.Function("motion", [z], found),
            casadi.Function("slope", [z, by], [slope]),
        )

    @cached_property
    def equation(self) -> np.ndarray:
        """Which rows (m,) are equations."""
        low, high = self.problem.end_box
        sides = [[True]] * int((low == high).sum())
        sides += [[False]] * int((np.isfinite(np.vstack([low, high])) & (low < high)).sum())
        sides += [[each.equation] for each in self.problem.conditions]
        sides += [[False]] * (len(self.problem.constraints) * (_HELD + 1))
        return np.array(sides, dtype=bool).ravel()

    def _ends(self, ends: list[Expr]) -> Iterator[Expr]:
        """Yield what vanishes, or is not positive, at the ends, in its magnitude."""
        low, high = self.problem.end_box
        x = ends[0] / self.scale.x
        fixed = np.flatnonzero(low == high)
        yield from (x[i] - low[i] / self.scale.x[i] for i in fixed.tolist())
        for side, sign in ((low, -1.0), (high, 1.0)):
            given = np.flatnonzero(np.isfinite(side) & (low < high))
            yield from (sign * (x[i] - side[i] / self.scale.x[i]) for i in given.tolist())
        for each in self.problem.conditions:
            size = self.scale.condition(self.problem, condition_slopes(self.problem, each))
            yield condition_function(self.problem, each)(*ends) / size

    def _along(self, states: list[Expr], moments: list[Expr], p: Expr) -> Iterator[Expr]:
        """Yield the state constraints at the ends of all intervals, in their magnitudes."""
        problem = self.problem
        for each in problem.constraints:
            size = self.scale.path(problem, each.expression)
            row = casadi.Function("c", [problem.x, time, problem.p], [each.expression / size])
            yield from (row(x, t, p) for x, t in zip(states, moments, strict=True))

    @cached_property
    def _interval(self) -> casadi.Function:
        """(x, u, t, h, p) -> the states and the running cost after a time h with constant controls,
        in a few steps of Radau's method, and what these leave at worst, relative.
        """
        problem, scheme = self.problem, radau_iia(2)
        given = [problem.x, problem.u, time, problem.p]
        rates = casadi.Function("f", given, [problem.rate, problem.lagrangian])
        nx, count = problem.x.numel(), scheme.nodes.size - 1
        x, u, p = casadi.SX.sym("x", nx), casadi.SX.sym("u", problem.u.numel()), problem.p
        t, h, stages = casadi.SX.sym("t"), casadi.SX.sym("h"), casadi.SX.sym("X", nx, count)
        at = [t + h * (float(node) + 1.0) / 2.0 for node in scheme.nodes[1:]]
        slopes = [rates(stages[:, k], u, at[k], p) for k in range(count)]
        F = casadi.horzcat(*(slope for slope, _ in slopes))
        defects = casadi.mtimes(casadi.horzcat(x, stages), scheme.A.T)
        defects -= h / 2.0 * casadi.mtimes(F, scheme.B[:, 1:].T)
        cost = h / 2.0 * sum(w * q for w, (_, q) in zip(scheme.weights[1:], slopes, strict=True))
        sizes = np.tile(self.scale.x, count)
        inner, given = casadi.SX.sym("y", nx * count), [x, u, t, h, p]
        placed = casadi.reshape(inner * sizes, nx, count)
        residual = casadi.reshape(casadi.substitute(defects, stages, placed), -1, 1) / sizes
        function = casadi.Function("r", [inner, *given], [residual])
        newton = casadi.rootfinder("step", "fast_newton", function, _NEWTON)
        ends = casadi.Function("end", [stages, *given], [stages[:, -1], cost])
        X, U, P = (casadi.MX.sym(n, s.numel()) for n, s in (("x", x), ("u", u), ("p", p)))
        T, H = casadi.MX.sym("t"), casadi.MX.sym("h")
        state, total, broken, step = X, casadi.MX(0), casadi.MX(0), H / _STEPS
        for k in range(_STEPS):
            now = state, U, T + k * step, step, P
            found = newton(casadi.repmat(state, count, 1) / sizes, *now)
            broken = casadi.fmax(broken, casadi.norm_inf(function(found, *now)))
            state, more = ends(casadi.reshape(found * sizes, nx, count), *now)
            total += more
        return casadi.Function("interval", [X, U, T, H, P], [state, total, broken])

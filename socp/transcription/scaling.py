"""The magnitudes in which a programme is written, so that the units of a problem do not matter to
its solver.
"""

from dataclasses import dataclass
from typing import final

import casadi
import numpy as np

from socp.laws import admissible
from socp.model import (
    Condition,
    Expr,
    Problem,
    Solution,
    condition_slopes,
    end_values,
    objective_size,
    time,
)
from socp.transcription.phases import Phase

# Of what motions reach from the start: a state that a guess hardly moves is taken for at least as
# large. A guess may say nothing of it; motions with constant controls may take it too far
_MOVED = 1e-2


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Scale:
    """The magnitudes of time, states (nx,), parameters (np,) and objective, and a solution near
    which they were found, None where all are 1.
    """

    time: float
    x: np.ndarray
    p: np.ndarray
    cost: float
    near: Solution | None

    @classmethod
    def of(cls, problem: Problem, near: Solution | None) -> "Scale":
        """Return the magnitudes of a problem near a solution or a guess; all 1 without one."""
        nx, np_ = problem.x.numel(), problem.p.numel()
        if near is None:
            return cls(time=1.0, x=np.ones(nx), p=np.ones(np_), cost=1.0, near=None)
        return cls(
            time=near.final_time - near.initial_time,
            x=_states(problem, near),
            p=_widths(problem.parameter_box),
            cost=objective_size(problem, near),
            near=near,
        )

    @property
    def costate(self) -> np.ndarray:
        """Magnitudes of the costates (nx,): of the objective over those of the states."""
        found: np.ndarray = self.cost / self.x
        return found

    def control(self, phase: Phase) -> np.ndarray:
        """Return the widths (nv,) of the boxes of a phase's free controls."""
        return _widths(phase.box) if self.near is not None else np.ones(phase.box.shape[1])

    def law(self, problem: Problem, i: int) -> float:
        """Return the width of the box of a control that follows a law."""
        return 1.0 if self.near is None else float(_widths(problem.box[:, i : i + 1])[0])

    def path(self, problem: Problem, expression: Expr) -> float:
        """Return how much an expression of x, t, p changes by all magnitudes, at most, near the
        solution; 1 where nothing changes it.
        """
        return self._change(problem, [expression])

    def joint(self, problem: Problem, phase: Phase, row: Expr) -> float:
        """Return the same of an expression of x, t, p and what a phase carries, the costate."""
        if not casadi.depends_on(row, phase.carried):
            return self.path(problem, row)
        return self._change(problem, [row], phase.carried)

    def condition(self, problem: Problem, condition: Condition) -> float:
        """Return the same of an end condition."""
        if self.near is None:
            return 1.0
        slopes = condition_slopes(problem, condition)(*end_values(problem, self.near))
        sizes = (self.x, self.x, self.p, np.array([self.time]), np.array([self.time]))
        return _size(sum(float(np.abs(s.full()[0]) @ z) for s, z in zip(slopes, sizes, strict=True)))

    def _change(self, problem: Problem, rows: list[Expr], carried: Expr | None = None) -> float:
        if self.near is None:
            return 1.0
        x, t = self.near.rows("x"), self.near.t[None, :]
        p = np.array([[self.near.parameters.get(n, 0.0)] for n in problem.parameter_names])
        more = casadi.SX(0, 1) if carried is None else carried
        costate = np.repeat(self.costate[:, None], t.size, axis=1)
        given = [problem.x, time, problem.p, more]
        sizes = [self.x, np.array([self.time]), self.p]
        if carried is not None:
            sizes.append(self.costate)
        slopes = casadi.jacobian(casadi.vertcat(*rows), casadi.vertcat(*given))
        total = casadi.mtimes(casadi.fabs(slopes), casadi.DM(np.concatenate(sizes)))
        function = casadi.Function("change", given, [total])
        values = function.map(t.size)(
            x, t, np.repeat(p, t.size, axis=1).reshape(-1, t.size), costate[: more.numel()]
        ).full()
        finite = values[np.isfinite(values)]
        return _size(float(finite.max(initial=0.0)))


def _states(problem: Problem, near: Solution) -> np.ndarray:
    """Return the magnitudes of the states (nx,): what they reach near a solution, at their given
    ends, and in part by motions from the start; else their bounds'.
    """
    ends = np.vstack([problem.start_box, problem.end_box])
    named = np.where(np.isfinite(ends), np.abs(ends), 0.0).max(axis=0)
    own = np.abs(np.nan_to_num(near.rows("x"), posinf=0.0, neginf=0.0)).max(axis=1)
    moved = np.abs(admissible(problem)[1 : 1 + named.size]).max(axis=1)
    size = np.maximum(np.maximum(named, own), _MOVED * np.nan_to_num(moved, posinf=0.0))
    box = np.where(np.isfinite(problem.state_box), np.abs(problem.state_box), 0.0).max(axis=0)
    size = np.where(size > 0, size, box)
    return np.where(size > 0, size, 1.0)


def _widths(box: np.ndarray) -> np.ndarray:
    """Return the widths (n,) of intervals (2, n), 1 where they have none."""
    width = box[1] - box[0]
    return np.where(np.isfinite(width) & (width > 0), width, 1.0)


def _size(value: float) -> float:
    return value if 0.0 < value < np.inf else 1.0

"""Structure: read what kind of arc every control is on, and when it switches, off the values of a
solution.
"""

from itertools import groupby, pairwise

import casadi
import numpy as np

from socp import laws
from socp.model import (
    ACTIVE,
    AT_BOUND,
    LEFT,
    TINY,
    Arc,
    Constraint,
    Mode,
    Problem,
    Solution,
    column,
    constraint_function,
    evaluate,
    of_motion,
    once,
    parameters_of,
    scales,
    time,
)

Stretch = tuple[str, float, float]  # (mode as a word spells it, start, end)

# of the range of a state constraint's values: as near counts as on it where a word is fitted to a
# coarse solution, which comes no nearer than this
_FITS = 1e-2


def structure_of(problem: Problem, solution: Solution) -> dict[str, tuple[Stretch, ...]]:
    """Return every control's stretches in time; arcs that follow a law carry their own mode, other
    values are read.

    A single interval between two stretches of different kinds holds the switch: it is placed where
    the integral of the control over the interval is kept. A solution is read once.
    """
    return dict(_stretches(solution, problem))


@once
def _stretches(solution: Solution, problem: Problem) -> dict[str, tuple[Stretch, ...]]:
    found = {}
    for i, name in enumerate(problem.control_names):
        stretches: list[Stretch] = []
        for arc in solution.arcs:
            law = arc.modes[i]
            stretches += (
                _read(problem, solution, arc, i)
                if law.kind == "free"
                else [(str(law), float(arc.t[0]), float(arc.t[-1]))]
            )
        found[name] = _joined(stretches)
    return found


def misfit(
    problem: Problem, solution: Solution, control: int, mode: Mode, t: np.ndarray
) -> np.ndarray:
    """Return how badly a control fits a mode at times t (n,): 0 for a perfect fit, 1 for the far
    end of its box.

    A control at a bound fits a singular mode by half, as one inside the box fits a boundary mode
    off the constraint.
    """
    low, high = problem.box[:, control]
    share = np.clip((solution.at(t, "u")[control] - low) / (high - low), 0.0, 1.0)
    at_bound = (share < AT_BOUND) | (share > 1.0 - AT_BOUND)
    if mode.kind == "boundary":
        near = np.zeros(t.size, dtype=bool)
        for constraint in laws.controlled_constraints(problem, control):
            if mode.constraint in {None, constraint.name}:
                values = constraint_values(problem, solution, constraint, t, solution.at(t))
                near |= values > -_FITS * max(float(np.ptp(values)), TINY)
        return np.where(near, 0.0, 0.5)
    if mode.kind in {"lower", "upper"}:
        return np.array(share if mode.kind == "lower" else 1.0 - share)
    return np.array(0.5 * at_bound)


def constraint_values(
    problem: Problem, solution: Solution, constraint: Constraint, t: np.ndarray, x: np.ndarray
) -> np.ndarray:
    """Evaluate a state constraint at times t (n,) and states x (nx, n); returns (n,)."""
    function, p = constraint_function(problem, constraint), parameters_of(problem, solution)
    return evaluate(function, x, t, p)[0].ravel()


@of_motion
@once
def constraints_function(problem: Problem) -> casadi.Function:
    """Return the state constraints and their slopes in the states as a function of x, t, p."""
    stack = column(constraint.expression for constraint in problem.constraints)
    given = [problem.x, time, problem.p]
    return casadi.Function("c", given, [stack, casadi.densify(casadi.jacobian(stack, problem.x))])


@of_motion
@once
def constraint_curvature(problem: Problem, k: int) -> casadi.Function:
    """Return how much the slopes of a state constraint, by its number, change its value at most
    when every state changes by its own size s (nx,), that is s' |c_xx| s / 2, as a function of
    s, x, t, p.
    """
    sizes = casadi.SX.sym("s", problem.x.numel())
    bent = casadi.fabs(casadi.hessian(problem.constraints[k].expression, problem.x)[0])
    worth = 0.5 * casadi.dot(sizes, casadi.mtimes(bent, sizes))
    given = [sizes, problem.x, time, problem.p]
    return casadi.Function("bent", given, [casadi.densify(worth)])


@once
def nearness(solution: Solution, problem: Problem) -> np.ndarray:
    """Return how near to zero every state constraint counts as active on a solution (nc,).

    That is a share of its range, but no less than what a solver leaves of its magnitude, which is
    how much it changes when every state changes by its own: where a solution stays on a constraint
    its range is rounding.
    """
    if not problem.constraints:
        return np.empty(0)
    p, t = parameters_of(problem, solution), solution.t
    values, slopes = evaluate(constraints_function(problem), solution.rows("x"), t, p)
    sizes = np.abs(slopes.reshape(len(values), t.size, -1)) @ scales(problem, solution)
    share, least = ACTIVE * np.ptp(values, axis=1), LEFT * sizes.max(axis=1)
    return np.array(np.maximum(np.maximum(share, least), TINY))


def _read(problem: Problem, solution: Solution, arc: Arc, i: int) -> list[Stretch]:
    """Return the stretches of control i on an arc whose control was free, one label an interval,
    then merged.
    """
    low, high = problem.box[:, i]
    ends = arc.t[arc.mesh]
    mean = np.array([arc.u[i, arc.nodes(k, "u")].mean() for k in range(len(arc.mesh) - 1)])
    spread = np.array([np.ptp(arc.u[i, arc.nodes(k, "u")]) for k in range(len(arc.mesh) - 1)])
    near = AT_BOUND * (high - low)
    labels = np.full(mean.size, "s", dtype=object)
    for constraint in laws.controlled_constraints(problem, i):
        labels[_active(problem, solution, arc, constraint)] = f"b[{constraint.name}]"
    labels[(mean < low + near) & (spread < near)] = "-"
    labels[(mean > high - near) & (spread < near)] = "+"
    runs = [
        (str(label), [k for k, _ in group])
        for label, group in groupby(enumerate(labels), key=lambda pair: pair[1])
    ]
    stretches: list[Stretch] = []
    start = float(ends[0])
    for place, (label, intervals) in enumerate(runs):
        last = intervals[-1]
        inner = 0 < place < len(runs) - 1
        if (
            inner
            and len(intervals) == 1
            and {runs[place - 1][0], runs[place + 1][0]} != {label}
            and runs[place - 1][0] != runs[place + 1][0]
        ):
            before, after = mean[intervals[0] - 1], mean[last + 1]
            share = (
                np.clip((mean[last] - after) / (before - after), 0.0, 1.0)
                if before != after
                else 0.5
            )
            switch = float(ends[last] + share * (ends[last + 1] - ends[last]))
            mode, begin, _ = stretches.pop()
            stretches.append((mode, begin, switch))
            start = switch
            continue
        stretches.append((label, start, float(ends[last + 1])))
        start = float(ends[last + 1])
    return stretches


def _active(problem: Problem, solution: Solution, arc: Arc, constraint: Constraint) -> np.ndarray:
    """Return a mask (intervals,) of the intervals all of whose nodes lie on a state constraint."""
    values = constraint_values(problem, solution, constraint, arc.t, arc.x)
    near = values > -nearness(solution, problem)[problem.constraints.index(constraint)]
    return np.array([bool(near[a : b + 1].all()) for a, b in pairwise(arc.mesh)])


def _joined(stretches: list[Stretch]) -> tuple[Stretch, ...]:
    joined: list[Stretch] = []
    for mode, start, end in stretches:
        if joined and joined[-1][0] == mode:
            joined[-1] = (mode, joined[-1][1], end)
        elif end > start:
            joined.append((mode, start, end))
    return tuple(joined)

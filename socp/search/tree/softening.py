"""Softened ends: a problem whose end conditions may be missed at a price, so that every word has a
solution.
"""

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import casadi
import numpy as np

from socp.model import (
    Expr,
    Problem,
    Solution,
    column,
    condition_slopes,
    end_values,
    numbers,
    parameters,
    scales,
)

_HIGHER = 3.0  # the price over the worth of an end condition: above 1 the penalty is exact
_NAME = "slack"  # begins the names of the slacks


def softened_problem(problem: Problem, near: Solution, dearer: float = 1.0) -> Problem:
    """Return a problem with every end condition psi <= 0 or psi = 0 relaxed to |psi| <= size * e at
    a price of W e.

    e >= 0 are further parameters; sizes are those of the states (nx,) along a solution nearby,
    whose costates give the price W: threefold the largest worth of a state, times `dearer`. Fixed
    and bounded times stay as they are.
    """
    price, relaxed = dearer * _HIGHER * worth(problem, near), dict[str, Expr]()
    conditions = list(_conditions(problem, near))
    slacks = _slacks(len({name for name, *_ in conditions}))
    by_name = dict(zip(dict.fromkeys(name for name, *_ in conditions), slacks, strict=True))
    for name, side, expression, size in conditions:
        relaxed[f"{name} {side}"] = expression - size * by_name[name] <= 0
    bounds = {**problem.bounds, **dict.fromkeys(slacks, (0.0, None))}
    minimise = problem.mayer + price * casadi.sum1(column(slacks))
    return replace(problem, minimise=minimise, bounds=bounds, end={}, target=relaxed)


def worth(problem: Problem, near: Solution) -> float:
    """Return the largest worth of a state along a solution: |costate| times the state's magnitude,
    1 where unknown.

    What is larger for a tenth of the nodes is left out: costates of a direct solution ring where
    its controls do.
    """
    costate = np.nan_to_num(np.abs(near.rows("costate"))) * scales(problem, near)[:, None]
    return float(np.quantile(costate, 0.9, axis=1).max(initial=0.0)) or 1.0


def end_miss(solution: Solution) -> float:
    """Return by how much a solution of a softened problem misses its ends, relative to the sizes of
    the states.
    """
    return sum(value for name, value in solution.parameters.items() if name.startswith(_NAME))


@cache
def _slacks(count: int) -> tuple[Expr, ...]:
    """Declare the slacks once: declared symbols are never forgotten."""
    return tuple(parameters(f"{_NAME}_{count}_{k}") for k in range(count))


def _conditions(problem: Problem, near: Solution) -> Iterator[tuple[str, str, Expr, float]]:
    """Yield name, side, expression that is to be at most 0, and size of every end condition."""
    scale, (low, high) = scales(problem, near), problem.end_box
    for i, name in enumerate(problem.state_names):
        if np.isfinite(high[i]):
            yield name, "above", problem.x[i] - high[i], scale[i]
        if np.isfinite(low[i]):
            yield name, "below", low[i] - problem.x[i], scale[i]
    values = end_values(problem, near)
    for each in problem.conditions:
        slope = numbers(condition_slopes(problem, each), *values)[0][0]
        size = float(np.abs(slope) @ scale) or 1.0
        yield each.name, "above", each.expression, size
        if each.equation:
            yield each.name, "below", -each.expression, size

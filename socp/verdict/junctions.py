"""Junctions of singular arcs: where a control may jump onto one, and where only infinitely many
switches could.
"""

from itertools import pairwise

import numpy as np

from socp import laws
from socp.errors import MethodError
from socp.model import LAWS, Problem, Solution, on_intervals
from socp.process import time_limit

_BESIDE = 1e-9  # of the horizon: how far from a junction the control is looked at
_JUMP = 1e-3  # of the width of a control's box: a smaller difference is no jump


def chattering(problem: Problem, solution: Solution) -> list[str]:
    """Return the controls that jump onto or off a singular arc of even order, which no finite word
    allows.

    At a junction the order plus the least derivative of the control that jumps is odd (McDanell and
    Powers, SIAM Journal on Control 9, 1971): where the control itself jumps, the order has to be
    odd.
    """
    found = []
    for i, name in enumerate(problem.control_names):
        pairs = pairwise(solution.structure.get(name, ()))  # none where states are not finite
        joints = [t for (one, _, t), (other, _, _) in pairs if _meets(one, other)]
        if joints and _jumps(problem, solution, i, joints) and _order(problem, name) % 2 == 0:
            found.append(name)
    return found


def _meets(one: str, other: str) -> bool:
    return "s" in {one, other} and bool({one, other} & {"+", "-"})


def _jumps(problem: Problem, solution: Solution, i: int, joints: list[float]) -> bool:
    beside = _BESIDE * (solution.final_time - solution.initial_time)
    low, high = problem.box[:, i]
    t = np.add.outer([-beside, beside], joints).ravel()
    t = np.clip(t, solution.initial_time, solution.final_time)
    interval = np.searchsorted(solution.corners[1:-1], t, side="right")
    before, after = np.split(on_intervals(solution.arcs, "u", t, interval)[i], 2)
    return bool((np.abs(after - before) > _JUMP * (high - low)).any())


def _order(problem: Problem, name: str) -> int:
    """Return the order of the singular arcs of a control alone, 1 where they have no law or none in
    time.
    """
    try:
        with time_limit(LAWS):
            return laws.derive(problem, (name,)).orders[name]
    except MethodError:
        return 1

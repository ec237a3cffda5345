"""Polish: Newton on the switching and boundary conditions of a word, and digits counted by
comparing two meshes.
"""

from dataclasses import dataclass, replace
from typing import final

import numpy as np

from socp.model import TINY, Agreement, Problem, Solution
from socp.transcription import Shooting, rejoin
from socp.verdict import AWAY, Conditions, System, steps_of, word_problem

_NEWTON = 8  # steps: from a collocated solution two or three do
# Of the variables' magnitudes: a step below it is rounding, which may keep it at some times as much
_DONE = 1e-13
_ROUNDING = 100.0


def polished(problem: Problem, solution: Solution, points: int = 10) -> Solution | None:
    """Return a solution along a word with its conditions solved by Newton to rounding, or None
    where that fails.

    The first-order conditions of the shooting equations in arc lengths, free ends, parameters and
    multipliers are the boundary, transversality and switching conditions of the word: the
    multiplier of a joint is the costate of the rest of the horizon, and the slope in the length of
    an arc is the jump of the Hamiltonian. Its `agreement` is that of two meshes: with as many steps
    as the motion needs, and with twice as many.
    """
    known = word_problem(problem, solution, points)
    steps = None if known is None else steps_of(known[0], known[1])
    if known is None or steps is None:
        return None
    phased, start, pieces = known
    finer = Shooting(phased, start, 2 * steps)
    settled = _newton(Conditions(Shooting(phased, start, steps)))
    if settled is None:
        return None
    conditions = Conditions(finer)
    moved, _ = settled.system.step(*conditions.values(settled.at, settled.held)[:2])
    cost = conditions.values(settled.at + moved, settled.held)[2]
    agreement = Agreement(
        objective=abs(cost - settled.cost) / max(abs(cost), TINY),
        switches=float(np.abs(np.cumsum(moved[: 1 + len(phased.phases)])).max()),
    )
    return replace(rejoin(finer.lifted(settled.at + moved, cost), pieces), agreement=agreement)


@final
@dataclass(frozen=True, eq=False)
class _Settled:
    """Where Newton has settled: variables, multipliers, cost and the last matrix."""

    at: np.ndarray
    held: np.ndarray
    cost: float
    system: System


def _newton(conditions: Conditions) -> _Settled | None:
    """Solve the first-order conditions; None where Newton does not settle nearby, or a limit would
    rather be left.
    """
    start, signs, size = conditions.shooting.start, conditions.shooting.laid[2], conditions.size
    at, held = start, conditions.multipliers(start)
    for _ in range(_NEWTON):
        system = conditions.system(at, held)
        moved, change = system.step(*conditions.values(at, held)[:2])
        at, held = at + moved, held + change
        if not np.abs((at - start) / size).max() <= AWAY:
            return None
        if np.abs(moved / size).max() <= _DONE:
            break
    if (
        np.abs(moved / size).max() > _ROUNDING * _DONE
        or (signs * held < -_DONE * np.abs(held).max()).any()
    ):
        return None
    if system.open(np.eye(size.size)).any():
        return None
    return _Settled(at, held, conditions.values(at, held)[2], system)

"""Polish: Newton on the switching and boundary conditions of a word, and digits counted by
comparing two meshes.
"""

from dataclasses import replace

import numpy as np

from socp.model import TINY, Agreement, Problem, Solution
from socp.transcription import Shooting, rejoin
from socp.verdict import Conditions, settled, steps_of, word_problem


def polished(
    problem: Problem, solution: Solution, points: int = 10, origin: Problem | None = None
) -> Solution | None:
    """Return a solution along a word with its conditions solved by Newton to rounding, or None
    where that fails.

    The first-order conditions of the shooting equations in arc lengths, free ends, parameters and
    multipliers are the boundary, transversality and switching conditions of the word: the
    multiplier of a joint is the costate of the rest of the horizon, and the slope in the length of
    an arc is the jump of the Hamiltonian. Its `agreement` is that of two meshes: with as many steps
    as the motion needs, and with twice as many.

    `origin`: the problem that the solution is one of, where that may be another. Newton may go far
    from it then, and the limits that are met at its ends are met.
    """
    known = word_problem(problem, solution, points)
    steps = None if known is None else steps_of(known[0], known[1])
    if known is None or steps is None:
        return None
    phased, start, pieces = known
    active = frozenset[tuple[str, float]]()
    if origin is not None:
        own = Shooting(replace(phased, of=origin), start, steps).ends
        active = frozenset((row.name, row.sign) for row in own if row.sign)
    finer = Shooting(phased, start, 2 * steps, active=active)
    coarse = Conditions(Shooting(phased, start, steps, active=active))
    there = settled(coarse, far=origin is not None)
    if there is None or there.system.open(np.eye(there.at.size)).any():
        return None
    conditions = Conditions(finer)
    moved, _ = there.system.step(*conditions.values(there.at, there.held)[:2])
    cost = conditions.values(there.at + moved, there.held)[2]
    agreement = Agreement(
        objective=abs(cost - there.cost) / max(abs(cost), TINY),
        switches=float(np.abs(np.cumsum(moved[: 1 + len(phased.phases)])).max()),
    )
    return replace(rejoin(finer.lifted(there.at + moved, cost), pieces), agreement=agreement)

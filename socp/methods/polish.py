"""Polish: Newton on the switching and boundary conditions of a word, and digits counted by
comparing two meshes.
"""

from dataclasses import replace

import numpy as np

from socp.model import TINY, Agreement, Problem, Solution
from socp.transcription import Shooting, rejoin, residuals
from socp.verdict import settled, word_problem


def polished(
    problem: Problem,
    solution: Solution,
    points: int = 10,
    active: frozenset[tuple[str, float]] | None = None,
    ahead: Solution | None = None,
) -> Solution | None:
    """Return a solution along a word with its conditions solved by Newton to rounding, or None
    where that fails.

    The first-order conditions of the shooting equations in arc lengths, free ends, parameters and
    multipliers are the boundary, transversality and switching conditions of the word: the
    multiplier of a joint is the costate of the rest of the horizon, and the slope in the length of
    an arc is the jump of the Hamiltonian. Its `agreement` is that of two meshes: with as many steps
    as the motion needs, and with twice as many.

    `active`: the limits that are met at the ends, as `limits_met` tells, where the solution is one
    of another problem. Newton may go far from it then. `ahead`: a prediction along the same word on
    the same meshes, with which Newton begins.
    """
    known = word_problem(problem, solution, points)
    if known is None or known.steps is None:
        return None
    coarse, finer = (known.conditions(times, active=active or frozenset()) for times in (1.0, 2.0))
    arcs = known.solution.arcs
    first = None
    if ahead is not None and [len(a.t) for a in arcs] == [len(a.t) for a in ahead.arcs]:
        first = Shooting(known.phased, ahead, ()).start
    there = settled(coarse, far=active is not None, start=first, near=known.start(coarse))
    if there is None or there.system.open(np.eye(there.at.size)).any():
        return None
    moved, _ = there.system.step(*finer.values(there.at, there.held)[:2])
    cost = residuals(finer.shooting, there.at + moved)[1]
    agreement = Agreement(
        objective=abs(cost - there.cost) / max(abs(cost), TINY),
        switches=float(np.abs(np.cumsum(moved[: 1 + len(arcs)])).max()),
    )
    found = rejoin(finer.shooting.lifted(there.at + moved, cost), known.pieces)
    best = replace(solution, arcs=found.arcs, objective=cost, parameters=found.parameters)
    return best.with_judgement(agreement=agreement)


def limits_met(
    solution: Solution, origin: Problem, points: int = 10
) -> frozenset[tuple[str, float]]:
    """Return the limits, by name and sign, that a solution along a word meets at its ends in the
    problem that it is one of, `origin`; a neighbouring problem has them under the same names.
    """
    known = word_problem(origin, solution, points)
    return frozenset() if known is None else known.limits

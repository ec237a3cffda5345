"""Polish: Newton on the switching and boundary conditions of a word, and digits counted by
comparing two meshes.
"""

from contextlib import suppress
from dataclasses import replace

import numpy as np

from socp.model import (
    TINY,
    Agreement,
    Problem,
    Solution,
    evaluate,
    parameters_of,
    switching_function,
)
from socp.transcription import PhasedProblem, Shooting, rejoin, residuals
from socp.verdict import WordProblem, settled, word_problem

# Of the largest switching function of its control: a programme's multipliers on its first mesh are
# off by less, and what stays below all along an arc is slack
_WRONG, _SLACK = 1e-3, 1e-6
# Values at the ends of intervals: the spectrum of the conditions of as many takes a second, a
# sparse programme of theirs less
_MOST = 600


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
    return None if known is None else _solved(known, solution, active, ahead)


def polished_along(phased: PhasedProblem, solution: Solution) -> Solution | None:
    """Return what `polished` does of a solution with an arc a phase, on its own meshes; None where
    that is too large for a dense matrix as well, or an arc has no length.
    """
    pairs = list(zip(phased.phases, solution.arcs, strict=True))
    nx = phased.of.x.numel()
    count = sum((nx + phase.carried.numel()) * arc.mesh.size for phase, arc in pairs)
    free = any(phase.free.numel() for phase, _ in pairs)
    if free or count > _MOST or min(a.t[-1] - a.t[0] for _, a in pairs) <= 0.0:
        return None
    failures = np.linalg.LinAlgError, ValueError, ArithmeticError
    with np.errstate(all="ignore"), suppress(*failures):  # a wrong word may lead anywhere
        return _solved(WordProblem(phased, solution, [1] * len(pairs)), solution)
    return None


def plausible(problem: Problem, solution: Solution) -> bool:
    """Tell whether a solved word may be right, by the signs of its switching functions along bangs
    with the multipliers of its programme: none is clearly wrong, none vanishes.

    It takes no time, and decides nothing: along an arc that follows a state constraint the
    multipliers are not the principle's, and arcs that do are not looked at.
    """
    sigma, p = switching_function(problem), parameters_of(problem, solution)
    rows = [evaluate(sigma, a.x, a.costate, a.t, p)[0] for a in solution.arcs]
    size = np.nanmax(np.abs(np.hstack(rows)), axis=1, initial=0.0)
    for arc, row in zip(solution.arcs, rows, strict=True):
        if any(mode.kind == "boundary" for mode in arc.modes):
            continue
        for mode, own, most in zip(arc.modes, row, size, strict=True):
            if mode.kind not in {"lower", "upper"}:
                continue
            right = own if mode.kind == "lower" else -own
            least, greatest = np.nanmin(right, initial=np.inf), np.nanmax(right, initial=-np.inf)
            if least < -_WRONG * most or greatest <= _SLACK * most:
                return False
    return True


def _solved(
    known: WordProblem,
    solution: Solution,
    active: frozenset[tuple[str, float]] | None = None,
    ahead: Solution | None = None,
) -> Solution | None:
    if known.steps is None:
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

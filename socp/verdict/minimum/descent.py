"""Away from an extremal that is no minimum: along a direction of negative curvature, back onto the
conditions, and simulated.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import final

import numpy as np

from socp.model import COMPARED, TINY, Descent, Judgement, Problem, Solution
from socp.transcription import rejoin
from socp.verdict.minimum.induced import Pair
from socp.verdict.reintegration import verify

# Of an arc: no arc is shortened by more in a step, so that the word stays what it is
_SHORTENED = 0.5
_STEPS = 12  # halvings: the last step is so short that only rounding can hide what it lowers
_CORRECTIONS = 6  # Newton steps back onto the conditions: they converge quadratically
_MET = 1e-11  # of the magnitudes: as far may the conditions be off afterwards
# what is found over what is predicted: between these the second order is what lowers it
_LIKE = (0.5, 2.0)
# Of the objective: less may lie between the re-integrations of two equal ones (`RTOL` of each step)
_NOISE = 1e-8


@final
@dataclass(frozen=True, eq=False)
class Lower:
    """A solution with a lower objective, on the way from an extremal that is no minimum."""

    solution: Solution
    descent: Descent


def descents(problem: Problem, solution: Solution, pair: Pair) -> Iterator[Lower]:
    """Yield solutions on both sides of an extremal whose simulated objectives are as much lower as
    the second order predicts, where there are such.

    They satisfy the conditions at the ends and keep the word; the step is the longest of its side
    that does.
    """
    _, vectors, _ = pair.fine.spectrum(weak=False)
    lengths = slice(1, 1 + len(pair.phased.phases))
    horizon = solution.final_time - solution.initial_time
    for side in (1.0, -1.0):
        direction = side * vectors[:, 0]
        shorter = -direction[lengths] * horizon / pair.fine.conditions.shooting.start[lengths]
        longest = _SHORTENED / max(float(shorter.max(initial=0.0)), 1.0)
        for halving in range(_STEPS):
            step = longest * 0.5**halving
            moved = _moved(problem, solution, pair, step * direction)
            if moved is not None:
                yield moved
                break


def _moved(problem: Problem, solution: Solution, pair: Pair, change: np.ndarray) -> Lower | None:
    """Return the solution after a change of the variables q, None where its objective is not lower
    as predicted.
    """
    shooting, size = pair.fine.conditions.shooting, pair.fine.conditions.size
    at = corrected(pair, pair.fine.at + size * (pair.fine.lift @ change))
    if at is None:
        return None
    q = ((at - pair.fine.at) / size)[pair.fine.outer]
    predicted = float(0.5 * q @ pair.fine.hessian @ q)
    cost = pair.fine.conditions.linearised(at).cost
    other = rejoin(shooting.lifted(at, cost), pair.pieces)
    other = replace(other, judgement=Judgement(verified=verify(problem, other)))
    before, after = solution.verified[0], other.verified[0]
    found = after.objective - before.objective
    noise = _NOISE * max(abs(before.objective), TINY)
    if not after.worst <= COMPARED or not -found > noise:
        return None
    if not _LIKE[0] <= found / predicted <= _LIKE[1]:
        return None
    count = len(pair.phased.phases)
    times = np.cumsum((at - pair.fine.at)[: 1 + count])
    joints = np.cumsum([0, *pair.pieces])
    return Lower(
        other,
        Descent(
            times=tuple(times[joints].tolist()),
            parameters=tuple(
                (at - pair.fine.at)[1 + count : 1 + count + problem.p.numel()].tolist()
            ),
            predicted=predicted,
            found=float(found),
        ),
    )


def corrected(pair: Pair, at: np.ndarray) -> np.ndarray | None:
    """Return the nearest variables (n,) that meet the conditions, None where Newton finds none."""
    conditions = pair.fine.conditions
    lengths = slice(1, 1 + len(pair.phased.phases))
    for _ in range(_CORRECTIONS):
        here = conditions.linearised(at)
        slopes = here.slopes * conditions.size
        if not (np.isfinite(slopes).all() and np.isfinite(here.equations).all()):
            return None
        step: np.ndarray = np.linalg.lstsq(slopes, -here.equations, rcond=None)[0]
        at = at + conditions.size * step
        if not np.isfinite(at).all() or (at[lengths] <= 0.0).any():
            return None
        if np.abs(step).max() <= _MET:
            return at
    return None

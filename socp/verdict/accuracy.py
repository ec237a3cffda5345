"""Accuracy: how far switching times and objective of a solution are from those of the word's own
conditions.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Any, final

import numpy as np

from socp.errors import MethodError
from socp.model import ACTIVE, Arc, Problem, Solution, Verdict, digits_of, lately, once
from socp.transcription import (
    PhasedProblem,
    Shooting,
    between,
    cut_arcs,
    cut_at_knots,
    follow,
    interval_ends,
)
from socp.verdict.newton import AWAY, Conditions

# Of the states: steps are doubled until the motion changes by no more; rounding leaves some hundred
# ulps
_FINE = 1e-13
_STEPS = (
    2,
    4,
    8,
    16,
    32,
    64,
)  # steps an interval; a motion that wants more is none of this method's
# Times the step: next to a triple root, where a switching function is flat, Newton goes a third
_THRICE = 3.0
# Of the largest multiplier: one of an inequality that is less than this below zero is rounding
_SIGN = 1e-9


_KEPT = 2  # solutions of a problem of which is known what they are along their words


@final
@dataclass(frozen=True, eq=False)
class Accuracy:
    """How far a solution is from where its word's conditions hold, by one Newton step of the
    shooting equations.

    `times` (arcs + 1,) are the errors of the initial time, the times between the arcs and the final
    time, infinite where the conditions leave a time open; `objective` is that of the objective, in
    its own units.
    """

    times: np.ndarray
    objective: float


@final
@dataclass(frozen=True, eq=False)
class WordProblem:
    """The phased problem of a solution's word, its arcs cut where they have to be, with its
    solution and the number of pieces an arc.
    """

    phased: PhasedProblem
    solution: Solution
    pieces: list[int]

    @cached_property
    def steps(self) -> int | None:
        """Steps that an interval takes, None where no number of them settles."""
        return _steps_of(self.phased, self.solution)

    def conditions(
        self,
        steps: int,
        near: float = Shooting.near,
        active: frozenset[tuple[str, float]] = Shooting.active,
    ) -> Conditions:
        """Return the first-order conditions with so many steps an interval, and as equations the
        limits at the ends that are so `near` or `active`.
        """
        return self._conditions(steps, near, active)

    @once
    def _conditions(
        self, steps: int, near: float, active: frozenset[tuple[str, float]]
    ) -> Conditions:
        return Conditions(self._shooting(near, active).in_steps(steps))

    @once
    def _shooting(self, near: float, active: frozenset[tuple[str, float]]) -> Shooting:
        return Shooting(self.phased, self.solution, 1, near, active)

    @cached_property
    def accuracy(self) -> Accuracy | None:
        """How far the solution is from where the conditions hold, None where no step tells."""
        if self.steps is None:
            return None
        for near in (ACTIVE, Shooting.near):
            conditions = self.conditions(self.steps, near)
            shooting = conditions.shooting
            held, signs = conditions.multipliers(shooting.start), shooting.signs
            if (signs * held >= -_SIGN * np.abs(held).max(initial=0.0)).all():
                return _measured(conditions, held, self.pieces)
        return None  # a limit would rather be left: the word's conditions are others


def accuracy(problem: Problem, solution: Solution, points: int = 10) -> Accuracy | None:
    """Return how far a solution along a word is from where its conditions hold, or None where no
    step tells.

    The conditions are those of the problem itself: a solution whose end was missed is as far away
    as that takes it.
    """
    known = word_problem(problem, solution, points)
    return None if known is None else known.accuracy


def sharpened(problem: Problem, solution: Solution, verdict: Verdict) -> Verdict:
    """Return the verdict of a certified solution with the errors that one Newton step shows.

    Where no step tells, the errors are those of the verdict, with all that better controls would
    gain.
    """
    found = accuracy(problem, solution)
    error = (
        verdict.remaining_error if found is None else max(verdict.objective_error, found.objective)
    )
    verdict = replace(verdict, objective_error=error, digits=digits_of(error, solution.objective))
    flat, known = dict(verdict.flat), verdict.switch_errors
    if found is not None:
        joints = np.array([solution.initial_time, *solution.junctions, solution.final_time])
        known = tuple(
            (t, float(found.times[np.argmin(np.abs(joints - t))])) for t in solution.switches
        )
        verdict = replace(verdict, remaining_error=found.objective)
    return replace(
        verdict, switch_errors=tuple((t, max(error, flat.get(t, 0.0))) for t, error in known)
    )


def _measured(conditions: Conditions, held: np.ndarray, pieces: list[int]) -> Accuracy | None:
    """Take one step and measure it."""
    shooting, at = conditions.shooting, conditions.shooting.start
    slope, equations, cost = conditions.values(at, held)
    gradient = conditions.values(at, np.zeros_like(held))[0]
    system = conditions.system(at, held)
    moved, change = system.step(slope, equations)
    if not np.abs(moved / conditions.size).max() <= AWAY:
        return None
    rows = np.zeros((len(pieces) + 1, at.size))
    for row, last in zip(rows, accumulate(pieces, initial=0), strict=True):
        row[: last + 1] = 1.0
    rounding = system.rounding(np.vstack([rows, gradient[None, :]]), held)
    # along the step the conditions change to second order, and so does the Lagrangian, which is the
    # objective there
    _, left, there = conditions.values(at + moved, held + change)
    better = there + float((held + change) @ left)
    times = _THRICE * np.abs(rows @ moved) + rounding[:-1]
    apart = _THRICE * abs(better - shooting.solution.objective) + rounding[-1]
    apart += abs(cost) * float(np.finfo(float).eps)
    return Accuracy(np.where(system.open(rows), np.inf, times), float(apart))


def word_problem(problem: Problem, solution: Solution, points: int) -> WordProblem | None:
    """Return the problem of a solution's word, laid out once for the same values; None where there
    is no word, or an arc has no length.
    """
    # the judge, polish and the second order ask in turns
    key = points, *values_of(solution)
    return lately(problem, word_problem, key, lambda: _laid(problem, solution, points), _KEPT)


def values_of(solution: Solution) -> tuple[Any, ...]:
    """Return all values of a solution, as what a problem keeps of it is kept by."""
    arcs = (
        (arc.modes, arc.side, *(each.tobytes() for each in _arrays(arc))) for arc in solution.arcs
    )
    return solution.objective, *solution.parameters.items(), *arcs


def _arrays(arc: Arc) -> list[np.ndarray]:
    return [arc.t, arc.x, arc.u, arc.costate, arc.mesh, *arc.multipliers.values()]


def _laid(problem: Problem, solution: Solution, points: int) -> WordProblem | None:
    try:
        phased = follow(problem, solution.followed, solution)
    except MethodError:
        return None
    if (
        any(phase.free.numel() for phase in phased.phases)
        or min(a.t[-1] - a.t[0] for a in solution.arcs) <= 0
    ):
        return None
    phased, solution, parts = cut_at_knots(
        phased, solution, lambda arc, span: between(arc, span, points)
    )
    cut = cut_arcs(phased, solution, points)
    ends = list(accumulate(parts, initial=0))
    pieces = [sum(cut.pieces[a:b]) for a, b in pairwise(ends)]
    return WordProblem(cut.phased, cut.solution, pieces)


def _steps_of(phased: PhasedProblem, start: Solution) -> int | None:
    """Return how many steps an interval takes: as many as leave the ends of all intervals alone
    when doubled; None where none do, as where the motion is stiff, unstable or not smooth.
    """
    before: list[np.ndarray] = []
    nx = phased.of.x.numel()
    for count in _STEPS:
        now = interval_ends(phased, start, count)
        # what is carried along one arc is seen against its size there, states and cost against
        # theirs on all of them
        shared = np.max([np.abs(each).max(axis=1)[[*range(nx), -1]] for each in now], axis=0)
        sizes = [
            np.concatenate([shared[:-1], np.abs(each[nx:-1]).max(axis=1), shared[-1:]])
            for each in now
        ]
        if before and all(
            (abs(a - b) <= _FINE * c[:, None]).all()
            for a, b, c in zip(before, now, sizes, strict=True)
        ):
            return count // 2
        before = now
    return None

"""Accuracy: how far switching times and objective of a solution are from those of the word's own
conditions.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate, pairwise
from typing import Any, final

import numpy as np

from socp.errors import MethodError
from socp.laws import arc_law
from socp.model import (
    ACTIVE,
    Arc,
    Problem,
    Solution,
    Verdict,
    cached,
    digits_of,
    lately,
    of_motion,
    once,
)
from socp.transcription import (
    PhasedProblem,
    Shooting,
    between,
    cut_arcs,
    cut_at_knots,
    follow,
    interval_ends,
    knot_times,
    residuals,
)
from socp.verdict.newton import AWAY, ULPS, Conditions, Settled, System

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
# Of the largest singular value of the equations' slopes: the square of one that is less is rounding
# in Newton's matrix
_STATIONARY = 1e-6
# Of its largest entry: a Hessian with none larger along the directions asked for is none there
_SAME = 1e-8
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
    solution and the number of pieces an arc; `before` is that of the problem next to it that the
    solution is one of.
    """

    phased: PhasedProblem
    solution: Solution
    pieces: list[int]
    before: "WordProblem | None" = None

    def of(self, problem: Problem) -> "WordProblem":
        """Return the word of the same solution for another problem of the same motion."""
        found = replace(self, phased=replace(self.phased, of=problem), before=self)
        vars(found)["steps"] = self.steps
        return found

    @cached_property
    def steps(self) -> tuple[int, ...] | None:
        """Steps that the intervals of every phase take, None where no number of them settles."""
        return _steps_of(self.phased, self.solution)

    def conditions(
        self,
        times: float = 1.0,
        near: float = Shooting.near,
        active: frozenset[tuple[str, float]] = Shooting.active,
    ) -> Conditions:
        """Return the first-order conditions with so many times the steps that intervals take, and
        as equations the limits at the ends that are so `near` or `active`.
        """
        steps = tuple(int(times * each) for each in self.steps or ())
        shooting = self._shooting(near, active)
        known: dict[tuple[Any, ...], Conditions] = cached(self, WordProblem.conditions)
        key = steps, *((row.name, row.sign) for row in shooting.ends)
        if key not in known:
            known[key] = Conditions(shooting.in_steps(steps))
        return known[key]

    @once
    def _shooting(self, near: float, active: frozenset[tuple[str, float]]) -> Shooting:
        return Shooting(self.phased, self.solution, (), near, active)

    @cached_property
    def limits(self) -> frozenset[tuple[str, float]]:
        """The limits, by name and sign, that the solution meets at its ends."""
        rows = self._shooting(Shooting.near, Shooting.active).ends
        return frozenset((row.name, row.sign) for row in rows if row.sign)

    @cached_property
    def fitted(self) -> tuple[Conditions, np.ndarray] | None:
        """The conditions of the solution with the multipliers (m,) that fit best; None where no
        number of steps settles, or a limit would rather be left.
        """
        for near in (ACTIVE, Shooting.near) if self.steps else ():
            conditions = self.conditions(near=near)
            held, signs = (
                conditions.multipliers(conditions.shooting.start),
                conditions.shooting.signs,
            )
            if (signs * held >= -_SIGN * np.abs(held).max(initial=0.0)).all():
                return conditions, held
        return None

    @cached_property
    def accuracy(self) -> Accuracy | None:
        """How far the solution is from where the conditions hold, None where no step tells."""
        return None if self.fitted is None else _measured(*self.fitted, self.pieces)

    def start(self, conditions: Conditions) -> Settled | None:
        """Return where Newton may begin on conditions: where it has settled before, with the matrix
        there, if these are conditions of the same form.
        """
        known = None if self.before is None else self.before.fitted
        if known is None or known[0].rows != conditions.rows:
            return None
        at = known[0].shooting.start
        conditions.known(known[0].linearised(at))
        return Settled(at, known[1], np.nan, known[0].system(at, known[1]))


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
    asked = np.vstack([rows, gradient[None, :]])
    rounding = system.rounding(asked)
    if system.deficient:
        rounding = rounding + _by_curvature(conditions, system, asked)
    if not np.isfinite(rounding[-1]):  # nothing is told; the verdict's own error stands
        return None
    # along the step the conditions change to second order, and so does the Lagrangian, which is the
    # objective there
    left, there = residuals(shooting, at + moved)
    better = there + float((held + change) @ left)
    times = _THRICE * np.abs(rows @ moved) + rounding[:-1]
    apart = _THRICE * abs(better - shooting.solution.objective) + rounding[-1]
    apart += abs(cost) * float(np.finfo(float).eps)
    return Accuracy(np.where(system.open(rows), np.inf, times), float(apart))


def _by_curvature(conditions: Conditions, system: System, rows: np.ndarray) -> np.ndarray:
    """Return how far linear functions `rows` (k, n) of the variables may be off where a combination
    of the equations is stationary along the variables: (k,), infinite where none of these is at an
    extreme. Equations and variables are compared at the one magnitude that their matrix has.

    So it is at an abnormal extremal, towards which multipliers grow without end: the directions
    that keep the other equations are told by this one to second order alone, by the root of what is
    left of it. In Newton's matrix its slope stands squared, below rounding, as where two equations
    say the same; these have no curvature either.
    """
    shooting, at = conditions.shooting, conditions.shooting.start
    here, size = conditions.linearised(at), conditions.size
    across, along = system.d[size.size :], size * system.d[: size.size]
    slopes = across[:, None] * here.slopes * along
    to, values, by = np.linalg.svd(slopes)
    told = int((values > _STATIONARY * values.max(initial=0.0)).sum())
    kept, found = by[told:].T, list[np.ndarray]()
    # the equations of the motion itself are those of steps without end
    finer = shooting.in_steps(tuple(2 * each for each in shooting.steps))
    left = np.stack([residuals(each, at)[0] for each in (shooting, finer)])
    rounding, asked = ULPS * np.linalg.norm(slopes, axis=1), rows * along @ kept
    straight = here.hessian(np.zeros(len(slopes)))
    for each in to[:, told:].T:
        bent = (here.hessian(across * each) - straight) * along[:, None] * along
        values, vectors = np.linalg.eigh(kept.T @ bent @ kept)
        if np.abs(values).max(initial=0.0) <= _SAME * np.abs(bent).max(initial=0.0):
            continue
        off = np.abs(left @ (across * each)).max() + np.abs(each) @ rounding
        extreme = values.min() * values.max() > 0.0
        apart = (asked @ vectors) ** 2 @ np.abs(2.0 * off / values) if extreme else np.inf
        found.append(np.sqrt(apart) + np.zeros(len(rows)))
    return np.min(found, axis=0) if found else np.zeros(len(rows))


@of_motion
def word_problem(problem: Problem, solution: Solution, points: int) -> WordProblem | None:
    """Return the problem of a solution's word, laid out once for the same values; None where there
    is no word, or an arc has no length.
    """
    # the judge, polish and the second order ask in turns, and then the next problem
    key = points, *values_of(solution)
    known: dict[tuple[Any, ...], WordProblem | None] = cached(problem, word_problem)
    found = known.get(key)
    if found is not None and found.phased.of is not problem:
        if _alike(problem, solution) and not knot_times(found.phased.of):
            return found.of(problem)
        del known[key]
    return lately(problem, word_problem, key, lambda: _laid(problem, solution, points), _KEPT)


def _alike(problem: Problem, solution: Solution) -> bool:
    """Tell whether a word is laid out in the same way whatever the ends and times are: nothing is
    cut at a time, and the first arc's law asks for nothing where it begins.
    """
    law = arc_law(problem, solution.arcs[0].modes)
    return not (knot_times(problem) or law.kept or law.costate)


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


def _steps_of(phased: PhasedProblem, start: Solution) -> tuple[int, ...] | None:
    """Return how many steps the intervals of every phase take: as many as leave their ends alone
    when doubled; None where none do, as where the motion is stiff, unstable or not smooth.
    """
    nx, left = phased.of.x.numel(), range(len(phased.phases))
    moved = interval_ends(phased, start)
    ends = moved(left, _STEPS[0])
    found = dict[int, int]()
    for count in _STEPS[1:]:
        rest = [k for k in left if k not in found]
        now = dict(zip(rest, moved(rest, count), strict=True))
        before, ends = ends, [now.get(k, each) for k, each in enumerate(ends)]
        # what is carried along one arc is seen against its size there, states and cost against
        # theirs on all of them
        shared = np.max([np.abs(each).max(axis=1)[[*range(nx), -1]] for each in ends], axis=0)
        for k, each in now.items():
            carried = np.abs(each[nx:-1]).max(axis=1)
            size = np.concatenate([shared[:-1], carried, shared[-1:]])
            if (np.abs(each - before[k]) <= _FINE * size[:, None]).all():
                found[k] = count // 2
        if len(found) == len(ends):
            return tuple(found[k] for k in left)
    return None

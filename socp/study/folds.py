"""Folds of a branch, where its number turns back: conditions and number are solved for together,
with the length of the way in place of the number (pseudo-arclength: Keller, Applications of
Bifurcation Theory, 1977, 359-384).
"""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self, final

import numpy as np
from scipy.optimize import brentq

from socp.errors import MethodError, ProblemError
from socp.methods import limits_met
from socp.model import Judgement, Solution
from socp.study.branch import Event, Point
from socp.study.events import passed
from socp.study.naming import FOLD
from socp.study.walk import EVENT, Trial, Walk
from socp.transcription import rejoin
from socp.verdict import Conditions, WordProblem, learn, word_problem

_POINTS = 10  # collocation points of pieces that are cut at kinks, as those of `polish`
_DONE = 1e-10  # of the variables' magnitudes: a Newton step that is shorter is the last
_NEWTON = 8  # steps: from a prediction along the tangent three or four do
_DIFFERENCE = 1e-4  # of the span: central differences in the number err by its square
_SHORTEST, _LONGEST = 1e-4, 0.1  # steps of the way, in magnitudes of the variables and in spans
_STRAIGHT = 0.9  # cosine between the tangents at both ends of a step: one that bends more is cut
_KNOWN = 2  # points beyond a fold: what the next one is predicted from
_STEPS = 100  # of the way at most: what has not turned back by then does not
_FLAT = 1e-6  # of a step: how well the place where the number turns is known, it to the square
_FAILURES = np.linalg.LinAlgError, ArithmeticError, ValueError, MethodError, ProblemError


@final
@dataclass(frozen=True, eq=False)
class _Place:
    """A place on the way: variables (n,), multipliers (m,), the number, and the tangent there, of
    variables in their magnitudes, of multipliers, and of the number in spans (n + m + 1,).
    """

    at: np.ndarray
    held: np.ndarray
    value: float
    tangent: np.ndarray


@final
@dataclass(frozen=True, eq=False)
class _Way:
    """The conditions of a word over the number, laid out around one solution."""

    walk: Walk
    value: float
    solution: Solution
    active: frozenset[tuple[str, float]]

    @classmethod
    def of(cls, walk: Walk, now: Trial) -> Self:
        """Return the way through a point; ArithmeticError where its word has no such conditions."""
        problem = walk.at(now.value)
        known = word_problem(problem, now.solution, _POINTS)
        if known is None or known.steps is None:
            raise ArithmeticError
        active = limits_met(now.solution, problem)
        return cls(walk, now.value, now.solution, active)

    def laid(self, value: float) -> WordProblem:
        """Return the problem of the word at a value; ArithmeticError where there is none."""
        problem = self.walk.at(value)
        learn(problem, self.solution)
        known = word_problem(problem, self.solution, _POINTS)
        if known is None:
            raise ArithmeticError
        return known

    @cached_property
    def home(self) -> Conditions:
        """The conditions at the value that the solution belongs to."""
        return self.laid(self.value).conditions(active=self.active)

    @cached_property
    def size(self) -> np.ndarray:
        """Magnitudes of the variables (n,); the number is none of its own, which may be small."""
        found, shooting = self.home.size.copy(), self.home.shooting
        for k, name in enumerate(shooting.phased.of.parameter_names):
            if name in self.walk.family.open:
                found[1 + len(shooting.pairs) + k] = self.span
        return found

    @cached_property
    def row(self) -> int | None:
        """The place of the condition that the number is the level of, where it is in no other."""
        ends, held = self.home.shooting.ends, self.home.multipliers(self.home.shooting.start)
        names = [each.name for each in ends]
        if self.walk.name not in names:
            return None
        row, at = names.index(self.walk.name) - len(ends), self.home.shooting.start
        step = _DIFFERENCE * self.span
        other = self.laid(self.value + step).conditions(active=self.active)
        before, after = (self._left(each, at, held) for each in (self.home, other))
        before[row] -= step
        return row if np.allclose(before, after, rtol=0.0, atol=_DONE * step) else None

    def conditions(self, value: float) -> Conditions:
        """Return the conditions at a value, but for their level."""
        if self.row is not None:
            return self.home
        return self.laid(value).conditions(active=self.active)

    @property
    def span(self) -> float:
        """Return the width of the walk."""
        return abs(self.walk.width)

    def left(self, at: np.ndarray, held: np.ndarray, value: float) -> np.ndarray:
        """Return what the conditions leave (n + m,)."""
        found = self._left(self.conditions(value), at, held)
        if self.row is not None:
            found[self.row] -= value - self.value
        return found

    def _left(self, conditions: Conditions, at: np.ndarray, held: np.ndarray) -> np.ndarray:
        slope, equations, _ = conditions.values(at, held)
        return np.concatenate([slope * self.size, equations])

    def slope(self, at: np.ndarray, held: np.ndarray, value: float) -> np.ndarray:
        """Return the slopes of the conditions in the number, in spans (n + m,)."""
        step = _DIFFERENCE * self.span
        above, below = (self.left(at, held, value + sign * step) for sign in (1, -1))
        found: np.ndarray = (above - below) / (2 * _DIFFERENCE)
        return found

    def matrix(self, at: np.ndarray, held: np.ndarray, value: float) -> np.ndarray:
        """Return the slopes of the conditions in variables and multipliers (n + m, n + m)."""
        C, H = self.conditions(value).derivatives(at, held)
        C = C * self.size
        none = np.zeros((held.size, held.size))
        return np.block([[H * self.size[:, None] * self.size, C.T], [C, none]])

    def begun(self, value: float, toward: float) -> _Place:
        """Return where the way begins, its tangent in the direction of a change of the number."""
        conditions = self.conditions(value)
        at = conditions.shooting.start
        held = conditions.multipliers(at)
        row = np.zeros(at.size + held.size + 1)
        row[-1] = np.sign(toward)
        return self.corrected(at, held, value, row)

    def ahead(self, here: _Place, step: float) -> _Place:
        """Return the place a step along the tangent, on the conditions again. The way is measured
        without multipliers.
        """
        moved, n = step * here.tangent, here.at.size
        row = np.concatenate([here.tangent[:n] / n, np.zeros(here.held.size), here.tangent[-1:]])
        at = here.at + moved[:n] * self.size
        return self.corrected(at, here.held + moved[n:-1], here.value + moved[-1] * self.span, row)

    def corrected(self, at: np.ndarray, held: np.ndarray, value: float, row: np.ndarray) -> _Place:
        """Solve for conditions and a last row by Newton; ArithmeticError where it does not
        settle.
        """
        n = at.size
        slope = self.slope(at, held, value)[:, None]
        for _ in range(_NEWTON):
            matrix = np.vstack([np.hstack([self.matrix(at, held, value), slope]), row])
            given = np.append(self.left(at, held, value), 0.0)
            moved, tangent = _solved(matrix, np.column_stack([-given, np.eye(row.size)[-1]])).T
            at, held = at + moved[:n] * self.size, held + moved[n:-1]
            value += float(moved[-1]) * self.span
            if np.abs(np.delete(moved, np.s_[n:-1])).max() <= _DONE:
                return _Place(at, held, value, tangent / _length(tangent, n))
        raise ArithmeticError

    def judged(self, here: _Place) -> Trial:
        """Return the solution at a place, judged where its arcs have lengths."""
        known, conditions = self.laid(here.value), self.conditions(here.value)
        cost = conditions.values(here.at, here.held)[2]
        found = rejoin(conditions.shooting.lifted(here.at, cost), known.pieces)
        of_word = replace(
            self.solution,
            arcs=found.arcs,
            objective=cost,
            parameters=found.parameters,
            judgement=Judgement(),
        )
        return self.walk.judged(here.value, of_word)


def _solved(matrix: np.ndarray, given: np.ndarray) -> np.ndarray:
    """Solve linear equations whose rows are of many magnitudes."""
    rows = np.abs(matrix).max(axis=1)[:, None]
    found: np.ndarray = np.linalg.solve(matrix / rows, given / rows)
    return found


def _length(tangent: np.ndarray, n: int) -> float:
    """Return the length of a tangent: of the variables that which is usual, and the number."""
    return float(np.hypot(np.sqrt(np.mean(tangent[:n] ** 2)), tangent[-1]))


def rounded(walk: Walk, now: Trial, step: float) -> list[Trial]:
    """Go round the fold that a branch has on the way of a step, if there is one, until it is back
    at the value of the last point, or its word is about to end: points and event are those of the
    walk then, which goes the other way. Returns the points beyond, none where there is no fold.
    """
    before, beyond, turn = list[Trial](), list[Trial](), None
    with suppress(*_FAILURES), np.errstate(all="ignore"):
        way = _Way.of(walk, now)
        for here, there, length in _places(way, now.value, step):
            if turn is None and here.tangent[-1] * there.tangent[-1] <= 0.0:
                turn = way.judged(_turned(way, here, length))
            if turn is None and (there.value - now.value - step) * step > 0.0:
                break
            trial: Trial | None = way.judged(there)
            last = [now, *before, *beyond][-1]
            over = (there.value - walk.span[0]) * step <= 0.0
            if over and trial is not None:  # no further than where it began
                trial = walk.tried(walk.span[0], trial)
            if trial is None or not trial.holds or passed(last.margins, trial.margins):
                break
            (before if turn is None else beyond).append(trial)
            back = turn is not None and (there.value - now.value) * step <= 0.0
            if over or (back and len(beyond) >= _KNOWN):
                break
    if turn is None or not beyond:
        return []
    walk.points += [Point(each.value, each.solution) for each in before]
    walk.events.append(_fold(walk, turn))
    walk.points += [Point(each.value, each.solution) for each in beyond]
    walk.turn()
    return beyond


def _fold(walk: Walk, there: Trial) -> Event:
    return Event(
        value=there.value,
        error=EVENT * abs(walk.width),
        kind=FOLD,
        where=walk.name,
        time=float("nan"),
        before=there.solution.word,
        after=there.solution.word,
        place=len(walk.points),
        solution=there.solution,
    )


def _places(way: _Way, value: float, step: float) -> Iterator[tuple[_Place, _Place, float]]:
    """Yield steps of the way, from where it begins toward a step of the number: its ends, and its
    length.
    """
    here = way.begun(value, step)
    length = min(abs(step) / way.span, _LONGEST)
    for _ in range(_STEPS):
        there = None
        with suppress(ArithmeticError, np.linalg.LinAlgError):
            there = way.ahead(here, length)
        if there is None or _bend(here, there) < _STRAIGHT:
            length /= 2.0
            if length < _SHORTEST:
                return
            continue
        yield here, there, length
        here, length = there, min(2.0 * length, _LONGEST)


def _bend(one: _Place, other: _Place) -> float:
    """Return the cosine between two tangents."""
    n = one.at.size
    product = np.mean(one.tangent[:n] * other.tangent[:n]) + one.tangent[-1] * other.tangent[-1]
    return float(product)


def _turned(way: _Way, here: _Place, length: float) -> _Place:
    """Return the place within a step of the way at which the number turns back."""

    def slope(share: float) -> float:
        """Return how fast the number changes along the way, at a share of the length."""
        there = here if share == 0.0 else way.ahead(here, share * length)
        return float(there.tangent[-1])

    return way.ahead(here, float(brentq(slope, 0.0, 1.0, xtol=_FLAT)) * length)

"""Scouting: coarse direct solves from scattered guesses, to find the extremals of a problem and
which one is best.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import chain, islice
from typing import TypeAlias, final

import numpy as np

from socp.errors import SolveError
from socp.methods.contract import Coarse, lifting_watch
from socp.methods.driving import motions, other_horizons
from socp.methods.guess import guess_of, scattered_guesses
from socp.model import Problem, Solution, Stop, Watch, silent, staged
from socp.process import seconds_left
from socp.solvers import NLP, Backend, NLPPoint, default_backend
from socp.transcription import Layout, knotted, laid_out, lift, push, radau_iia, single_phase

_STEPS = 20  # intervals: the extremals of a problem differ by more than these are off
# To tell extremals apart takes no digits: what it leaves to the barrier is the same from all starts
# that end in one
_TOLERANCE, _ITERATIONS = 1e-5, 150
# In a row that seek the constraints alone: of the starts of fifty problems those that found
# back took less, and most of the others took all that they might
_LOST = 40
# From a motion it takes some hundred: the starts before it have led nowhere
_PATIENT = 500
# Relative: objectives of one extremal from different starts differ by rounding; of two, clearly
_ALIKE = 1e-3
# Starts that end in the best extremal known before it is believed to be the best, and no fewer than
# in all others: where starts end in many, a better one may be among those not met yet
_MET = 3
# Starts that lead nowhere before finer grids are tried: where the motion is unstable no coarse grid
# follows it from any, and every one takes as many iterations as it may
_FEW = 3
# Horizons that are held where those lead nowhere, over the one that is guessed: it is that of a
# straight way, and what swings to rest takes tens of it
_LENGTHS = (1, 2, 4, 8, 16, 32, 64)

_Programme: TypeAlias = tuple[NLP, Layout]


@final
@dataclass(frozen=True, eq=False)
class Scouted:
    """The extremals that coarse solves met, best first, each with the number of starts that ended
    in it, the number of starts tried, and what these solutions were lifted from. An interrupted
    solve stands alone, without a number.
    """

    met: tuple[tuple[Solution, int], ...]
    tried: int
    coarse: Mapping[Solution, Coarse] = field(default_factory=dict)

    @property
    def solutions(self) -> list[Solution]:
        """The coarse solutions, best first."""
        return [solution for solution, _ in self.met]


_NOTHING = Scouted((), 0)


def scouted(
    problem: Problem,
    guess: Solution,
    starts: int,
    watch: Watch = silent,
    backend: Backend | None = None,
    known: Scouted = _NOTHING,
) -> Scouted:
    """Return one coarse solution for every extremal met from the guess and scattered ones.

    At most `starts` guesses are tried, none for 0; it ends once the best extremal has been met
    three times, and as often as all others, or where the first few have led nowhere, nor horizons
    that were held: the guess may do on a finer grid. `known`: what came of those, to go on with all
    the others.
    """
    starting = islice(_guesses(problem, guess), known.tried, starts)
    rough = (backend or default_backend()).within(_TOLERANCE).limited(_ITERATIONS, _LOST)
    scouting = _Scouting(problem, guess, watch)
    found = scouting.all(starting, rough, known, 0 if known.tried else _FEW)
    if found.met or known.tried or found.tried < _FEW:
        return found
    return scouting.all(_over_held_horizons(problem, guess, rough, watch), rough, found)


def scouts(
    problem: Problem,
    guess: Solution,
    starts: int,
    watch: Watch = silent,
    backend: Backend | None = None,
) -> list[Solution]:
    """Return the coarse solutions of `scouted`, of all starts where the first lead nowhere."""
    found = scouted(problem, guess, starts, watch, backend)
    if not found.met and found.tried < starts:
        found = scouted(problem, guess, starts, watch, backend, found)
    return found.solutions


def scouts_from_motions(
    problem: Problem, guess: Solution, watch: Watch = silent, backend: Backend | None = None
) -> list[Solution]:
    """Return what `scouts` does, from motions with constant controls and from other horizons: for
    where scattered guesses lead nowhere.
    """
    starts = chain(motions(problem, guess), other_horizons(problem, guess))
    patient = (backend or default_backend()).within(_TOLERANCE).limited(_PATIENT)
    return _Scouting(problem, guess, watch).all(starts, patient).solutions


@final
class _Scouting:
    """Coarse solves from guesses, on one programme, and as long as that leads nowhere on the same
    in the problem's own units, which go first from where they have led somewhere; it ends with the
    time allowed.
    """

    def __init__(self, problem: Problem, guess: Solution, watch: Watch) -> None:
        self.problem, self.guess, self.watch = problem, guess, watch
        self.mesh = knotted(problem, radau_iia(2), _STEPS)
        self.coarse: dict[Solution, Coarse] = {}

    @property
    def units(self) -> tuple[Callable[[], _Programme], ...]:
        """The programmes, made when they are asked for, in the order in which they are tried."""
        return lambda: self.scaled, lambda: self.unscaled

    @cached_property
    def scaled(self) -> _Programme:
        """The programme in magnitudes near the guess."""
        return laid_out(single_phase(self.problem), [self.mesh], self.guess)

    @cached_property
    def unscaled(self) -> _Programme:
        """The programme in the problem's own units."""
        return laid_out(single_phase(self.problem), [self.mesh], None)

    def all(
        self,
        guesses: Iterator[Solution],
        backend: Backend,
        known: Scouted = _NOTHING,
        few: int = 0,
    ) -> Scouted:
        """Return the extremals met, those known among them, or an interrupted solve alone; it ends
        where the first few have led nowhere.
        """
        met, tried, units = list(known.met), known.tried, self.units
        self.coarse |= known.coarse
        for start in guesses:
            if seconds_left() <= 0.0:
                break
            tried += 1
            if start.stop is Stop.INTERRUPTED:
                return Scouted(((start, 0),), tried)
            watch = staged(self.watch, f"scout {tried}")
            programme = units[0]()
            point = self.point(programme, start, backend, watch)
            if not met and not (point and (point.stop.ok or point.stop is Stop.INTERRUPTED)):
                programme = units[1]()
                point = self.point(programme, start, backend, watch)
                if point and point.stop.ok:  # what leads somewhere goes first
                    units = units[::-1]
            if point is None:
                continue
            if point.stop is Stop.INTERRUPTED:
                return Scouted(((self.lifted(programme, point), 0),), tried)
            if point.stop.ok:  # of one that is met again the objective is enough
                k = _known(met, programme[1].restored(point).objective)
                met = count_in(met, self.lifted(programme, point)) if k is None else _again(met, k)
            if _told(met) or (not met and tried == few):
                break
        return Scouted(tuple(met), tried, {each: self.coarse[each] for each, _ in met})

    def solved(
        self, programme: _Programme, start: Solution, backend: Backend, watch: Watch
    ) -> Solution | None:
        """Return the solution of a programme from a start; None where that cannot be."""
        point = self.point(programme, start, backend, watch)
        return None if point is None else self.lifted(programme, point)

    def point(
        self, programme: _Programme, start: Solution, backend: Backend, watch: Watch
    ) -> NLPPoint | None:
        """Solve a programme from a start; None where that cannot be."""
        nlp, layout = programme
        try:
            return backend(nlp, push(layout, start), lifting_watch(watch, nlp, layout))
        except SolveError:
            return None

    def lifted(self, programme: _Programme, point: NLPPoint) -> Solution:
        """Return the solution that a point of a programme is, and note the two."""
        found = lift(programme[1], point)
        self.coarse[found] = Coarse(self.mesh, programme[1], point)
        return found


def _over_held_horizons(
    problem: Problem, guess: Solution, backend: Backend, watch: Watch
) -> Iterator[Solution]:
    """Yield the first few coarse solutions over horizons that are held, each twice as long as the
    one before, where the final time is free.

    One that is too short for the way is not lengthened by a solver that seeks the least time: it
    ends where the ends are missed the least. Over one that is long enough the same problem is
    linear where its dynamics are.
    """
    low, high = problem.final_time_box
    if low == high or np.ptp(problem.initial_time_box) > 0:
        return
    t, found = guess.t, 0
    for factor in _LENGTHS:
        times = t[0] + factor * (t - t[0])
        if not low <= times[-1] <= high:
            continue
        held = problem.with_(final_time=float(times[-1]))
        start = guess_of(held, times, guess.rows("x"), guess.rows("u"), dict(guess.parameters))
        told = staged(watch, f"horizon {times[-1]:.3g}")
        scouting = _Scouting(held, start, told)
        solved = scouting.solved(scouting.scaled, start, backend, told)
        if solved is not None and (solved.stop.ok or solved.stop is Stop.INTERRUPTED):
            yield solved
            found += 1
        if found == _FEW:
            return


def _guesses(problem: Problem, guess: Solution) -> Iterator[Solution]:
    yield guess
    yield from scattered_guesses(problem, guess)


def _told(met: list[tuple[Solution, int]]) -> bool:
    """Tell whether the best extremal was met as often as it takes to be believed the best."""
    return bool(met) and met[0][1] >= max(_MET, sum(count for _, count in met[1:]))


def count_in(met: list[tuple[Solution, int]], solution: Solution) -> list[tuple[Solution, int]]:
    """Count one more solution among those met, clustered by objective, best first."""
    k = _known(met, solution.objective)
    if k is None:
        return sorted([*met, (solution, 1)], key=lambda pair: pair[0].objective)
    return _again(met, k)


def _again(met: list[tuple[Solution, int]], k: int) -> list[tuple[Solution, int]]:
    """Count the one of a number once more."""
    return [*met[:k], (met[k][0], met[k][1] + 1), *met[k + 1 :]]


def _known(met: Sequence[tuple[Solution, int]], objective: float) -> int | None:
    """Return which of those met has an objective, None where none has."""
    for k, (known, _) in enumerate(met):
        if abs(known.objective - objective) <= _ALIKE * (abs(known.objective) + abs(objective)):
            return k
    return None

"""Scouting: coarse direct solves from scattered guesses, to find the extremals of a problem and
which one is best.
"""

from collections.abc import Iterator
from itertools import chain, islice
from typing import final

from socp.errors import SolveError
from socp.methods.contract import lifted
from socp.methods.driving import driven, stretched
from socp.methods.guess import scattered
from socp.model import Problem, Solution, Stop, Watch, silent
from socp.process import left
from socp.solvers import Ipopt
from socp.transcription import collocate, radau_iia, single_phase, uniform

_STEPS = 20  # intervals: the extremals of a problem differ by more than these are off
_BACKEND = Ipopt({"tol": 1e-6, "max_iter": 150})  # to tell extremals apart takes no digits
# From a motion it takes some hundred: the starts before it have led nowhere
_PATIENT = Ipopt({"tol": 1e-6, "max_iter": 500})
# Relative: objectives of one extremal from different starts differ by rounding; of two, clearly
_ALIKE = 1e-3
_MET = 3  # starts that end in the best extremal known before it is believed to be the best


def scouts(problem: Problem, guess: Solution, starts: int, watch: Watch = silent) -> list[Solution]:
    """Return one coarse solution for every extremal met from the guess and scattered ones, best
    first.

    At most `starts` guesses are tried, none for 0; it ends once the best extremal has been met
    three times. Where fewer than half of them lead anywhere, motions with constant controls follow,
    and other horizons where none does. An interrupted solve is returned alone.
    """
    looked = _Scouting(problem, watch)
    whole = looked.all(islice(_guesses(problem, guess), starts), _BACKEND)
    if whole and 2 * looked.solved < looked.tried:
        few = bool(looked.met)
        others = stretched(problem, guess) if not few else iter(())
        looked.all(chain(driven(problem, guess, own=few), others), _PATIENT)
    return [solution for solution, _ in looked.met]


@final
class _Scouting:
    """Coarse solves from guesses: how many were tried and solved, and the extremals met with how
    often each was, best first.
    """

    def __init__(self, problem: Problem, watch: Watch) -> None:
        self.reduced = collocate(single_phase(problem), [uniform(radau_iia(2), _STEPS)])
        self.watch = lifted(watch, self.reduced)
        self.tried, self.solved = 0, 0
        self.met: list[tuple[Solution, int]] = []

    def all(self, guesses: Iterator[Solution], backend: Ipopt) -> bool:
        """Solve from guesses until the best extremal has been met often enough.

        False where a solve is interrupted; that one alone is kept then.
        """
        for start in guesses:
            if left() <= 0.0:
                break
            self.tried += 1
            try:
                point = backend(self.reduced.problem, self.reduced.push(start), self.watch)
                found = self.reduced.lift(point)
            except SolveError:
                continue
            if found.stop is Stop.INTERRUPTED:
                self.met = [(found, 1)]
                return False
            if found.stop.ok:
                self.solved += 1
                self.met = counted(self.met, found)
            if self.met and self.met[0][1] >= _MET:
                break
        return True


def _guesses(problem: Problem, guess: Solution) -> Iterator[Solution]:
    yield guess
    yield from scattered(problem, guess)


def counted(met: list[tuple[Solution, int]], found: Solution) -> list[tuple[Solution, int]]:
    """Count one more solution among those met, clustered by objective, best first."""
    for k, (known, count) in enumerate(met):
        if abs(known.objective - found.objective) <= _ALIKE * (
            abs(known.objective) + abs(found.objective)
        ):
            return [*met[:k], (known, count + 1), *met[k + 1 :]]
    return sorted([*met, (found, 1)], key=lambda pair: pair[0].objective)

"""The default: direct solves show the arcs, their word is solved and mended until the judge certifies it."""

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import ClassVar, final

from socp import (
    Backend,
    Ipopt,
    Method,
    Problem,
    Solution,
    Watch,
    hookimpl,
    option,
    silent,
    single_phase,
    solve_collocated,
    uniform,
)
from socp.collocate import collocate
from socp.errors import SolveError
from socp.guess import scattered
from socp.refine import Search, concluded, refine
from socp.schemes import euler, radau_iia
from socp.solution import Stop

_STEPS = 20  # intervals of the scouting solves: the extremals of a problem differ by more than these are off
_SCOUT = Ipopt({"tol": 1e-6, "max_iter": 150})  # to tell extremals apart takes no digits
_DIRECT = Ipopt({"max_iter": 500})  # what a direct solve has not reached by then it hardly ever reaches
_ALIKE = 1e-3  # relative: objectives of one extremal from different starts differ by rounding; of two, clearly
_MET = 3  # starts that end in the best extremal known before it is believed to be the best


@final
@dataclass(frozen=True)
class Auto(Method):
    """No word, no guess: finds the arcs by itself and says whether they are an extremal."""

    name: ClassVar[str] = "auto"
    source: ClassVar[str] = "structure from direct collocation, mended by the minimum principle"
    steps: int = option(100, "steps of the first direct solves", least=10)
    starts: int = option(12, "coarse solves from scattered guesses, at most, to find the best extremal", least=0)
    backend: Backend = option(_DIRECT, "solver of the first direct solves")

    def solve(self, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
        """Scout from scattered guesses, then refine the best found until a word is certified; else return the best."""
        began, search, directs = time.perf_counter(), Search(), list[Solution]()
        try:
            found = self._searched(problem, guess, (search, directs), watch)
        except KeyboardInterrupt:  # between two solves; inside one the backend stops by itself
            known = search.best or (directs[-1] if directs else None)
            if known is None:
                raise
            found = replace(known, stop=Stop.INTERRUPTED)
        own = {name: found.seconds.get(name, 0.0) for name in ("build", "solve")}
        seconds = {"search": time.perf_counter() - began - sum(own.values()), **own}
        return replace(found, seconds=seconds, nodes=tuple(search.nodes))

    def _searched(
        self, problem: Problem, guess: Solution, known: tuple[Search, list[Solution]], watch: Watch
    ) -> Solution:
        search, directs = known
        for start in (*self._scouts(problem, guess, watch), guess):
            if start.stop is Stop.INTERRUPTED:
                return start
            for mesh in (uniform(radau_iia(2), self.steps // 2), uniform(euler(), 2 * self.steps)):
                direct = solve_collocated(single_phase(problem), [mesh], self.backend, start, watch)
                directs.append(direct)
                if direct.stop is Stop.INTERRUPTED:
                    return search.best or direct
                found = refine(problem, direct, search, watch) if direct.stop.ok else None
                if found is not None and search.over:
                    break
            if search.over:
                break
        return concluded(problem, search, directs)

    def _scouts(self, problem: Problem, guess: Solution, watch: Watch) -> list[Solution]:
        """Return one coarse solution for every extremal met, best first; none where the guess alone is to be used."""
        reduced = collocate(single_phase(problem), [uniform(radau_iia(2), _STEPS)])
        met: list[tuple[Solution, int]] = []
        for start in islice(_guesses(problem, guess), self.starts):
            try:
                found = reduced.lift(_SCOUT(reduced.problem, reduced.push(start), watch))
            except SolveError:
                continue
            if found.stop is Stop.INTERRUPTED:
                return [found]
            if found.stop.ok:
                met = _counted(met, found)
            if met and met[0][1] >= _MET:
                break
        return [solution for solution, _ in met]


def _guesses(problem: Problem, guess: Solution) -> Iterator[Solution]:
    yield guess
    yield from scattered(problem, guess)


def _counted(met: list[tuple[Solution, int]], found: Solution) -> list[tuple[Solution, int]]:
    """Count one more solution among those met, clustered by objective, best first."""
    for k, (known, count) in enumerate(met):
        if abs(known.objective - found.objective) <= _ALIKE * (abs(known.objective) + abs(found.objective)):
            return [*met[:k], (known, count + 1), *met[k + 1 :]]
    return sorted([*met, (found, 1)], key=lambda pair: pair[0].objective)


@hookimpl
def socp_methods() -> list[type[Method]]:
    """Register the method."""
    return [Auto]

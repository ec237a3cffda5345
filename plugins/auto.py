"""The default: direct solves show the arcs, their word is solved and mended until the judge
certifies it.
"""

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, TypeVar, final

from socp import (
    Backend,
    Method,
    Problem,
    Solution,
    Watch,
    hookimpl,
    option,
    silent,
)
from socp.errors import LateError, SocpError
from socp.methods import scouted, solve_directly
from socp.model import Stop
from socp.process import time_limit
from socp.search import (
    Ration,
    Search,
    along_words,
    conclude,
    escalate,
    lowered,
    meshes,
    next_to,
    outdo,
    pursue,
    refine,
    time_shares,
    warm_start,
    with_agreement,
    with_starts,
)
from socp.solvers import default_backend
from socp.study import limit_switches

Found = TypeVar("Found", Solution, Solution | None)

_ITERATIONS = 500  # what a direct solve has not reached by then it hardly ever reaches


@final
@dataclass(frozen=True)
class Auto(Method):
    """No word, no guess: finds the arcs by itself and says whether they are an extremal."""

    name: ClassVar[str] = "auto"
    source: ClassVar[str] = "structure from direct collocation, mended by the minimum principle"
    steps: int = option(100, "steps of the first direct solves", least=10)
    starts: int = option(
        12, "coarse solves from scattered guesses, at most, to find the best extremal", least=0
    )
    digits: int = option(
        9,
        "digits of objective and switching times that two computations have to agree on",
        least=1,
        most=15,
    )
    max_switches: int = option(
        6,
        "most switches where the control chatters, for each end of a singular arc; 0: any number",
        least=0,
    )
    seconds: float = option(
        60.0, "seconds allowed in all; used up before the search gives up", least=1
    )
    backend: Backend = option(default_backend(), "solver of the nonlinear programmes")

    def solve(self, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
        """Solve along the word of the guess, where it has one that holds; else scout from scattered
        guesses, then refine the best found until a word is certified; else return the best.
        """
        search, directs = self._search(), list[Solution]()
        known = search, directs

        def look() -> Solution:
            return self._searched(problem, guess, known, watch)

        return self._finished(problem, known, look, watch)

    def near(
        self, problem: Problem, guess: Solution, origin: Problem, watch: Watch = silent
    ) -> Solution | None:
        """Return what `solve` gives where Newton on the word of the guess leads to it, else
        None.
        """
        search = self._search()

        def look() -> Solution | None:
            found = next_to(problem, guess, origin, search)
            if found is not None and found.extremal:
                search.keep(found)
            return found

        return self._finished(problem, (search, []), look, watch)

    def _finished(
        self,
        problem: Problem,
        within: tuple[Search, list[Solution]],
        look: Callable[[], Found],
        watch: Watch,
    ) -> Found | Solution:
        """Return what is looked for, within the seconds, with its digits where it is certified;
        what there is by then where the time is over or a fault ends it; None where that is found.
        """
        began, (search, directs) = time.perf_counter(), within
        try:
            with time_limit(time_shares(self.seconds)[0]):
                found = look()
                if found is None:
                    return found
                if found.extremal:
                    found = with_agreement(problem, found, self.digits, search.backend, watch)
                    lower = lowered(problem, found, search.backend, watch)
                    if lower is not found:
                        found = with_agreement(problem, lower, self.digits, search.backend, watch)
        except (KeyboardInterrupt, LateError) as error:
            known = _in_hand(search, directs)
            if known is None:
                raise
            # Ctrl-C comes between two solves; inside one the backend stops by itself
            late = isinstance(error, LateError)
            found = known if late else replace(known, stop=Stop.INTERRUPTED)
        except Exception as error:  # a fault of the search's own loses nothing
            known = _in_hand(search, directs)
            if known is None or isinstance(error, SocpError):
                raise
            text = f"internal error: {type(error).__name__}: {error}; this is the best until then"
            warnings.warn(text, RuntimeWarning, stacklevel=2)
            found = replace(known, message="; ".join(filter(None, (known.message, text))))
        own = {name: found.seconds.get(name, 0.0) for name in ("build", "solve")}
        seconds = {"search": time.perf_counter() - began - sum(own.values()), **own}
        found = with_starts(found, search)
        return found.with_effort(seconds=seconds, nodes=tuple(search.nodes))

    def _searched(
        self, problem: Problem, guess: Solution, known: tuple[Search, list[Solution]], watch: Watch
    ) -> Solution:
        search, directs = known
        _, whole, first, scouting = time_shares(self.seconds)
        with time_limit(whole):
            with time_limit(first):
                found = warm_start(problem, guess, search, watch)
            if found is not None:
                return found
            with time_limit(first):
                stopped = self._begun(problem, guess, known, scouting, watch)
            if stopped is not None:
                return stopped
            other = guess if self.starts else None
            escalate(problem, search, directs, (other, self.steps, self.backend), watch)
        pursue(problem, search, directs, watch)
        if self.starts:
            outdo(problem, search, directs, watch, self.backend)
        found = conclude(problem, search, directs, watch)
        return limit_switches(problem, found, self.max_switches, watch, self.backend)

    def _search(self) -> Search:
        ration = Ration(backend=along_words(self.backend, near=True))
        return Search(backend=ration, seconds=self.seconds, steps=self.steps)

    def _begun(
        self,
        problem: Problem,
        guess: Solution,
        known: tuple[Search, list[Solution]],
        scouting: float,
        watch: Watch,
    ) -> Solution | None:
        """Scout, for some seconds, and refine from what is met and from the guess, which goes
        before the later starts where the first ones meet nothing; returns as `_first` does.
        """
        search, directs = known
        how = problem, guess, self.starts, watch, self.backend
        with time_limit(scouting):
            search.scouted = scouted(*how)
        met = search.scouted.solutions
        stopped = self._first(problem, [*met, guess], known, watch)
        if stopped is None and not met and not search.over and search.scouted.tried < self.starts:
            with time_limit(scouting):
                search.scouted = scouted(*how, search.scouted)
            met = search.scouted.solutions
            stopped = self._first(problem, met, known, watch)
        directs += met
        return stopped

    def _first(
        self,
        problem: Problem,
        starts: Sequence[Solution],
        known: tuple[Search, list[Solution]],
        watch: Watch,
    ) -> Solution | None:
        """Refine from one start after another; returns what there is where a solve is
        interrupted.
        """
        search, directs = known
        backend = self.backend.limited(_ITERATIONS)
        for start in starts:
            if start.stop is Stop.INTERRUPTED:
                return start
            shown: list[Solution] = []
            for mesh in meshes(problem, self.steps):
                coarse = search.scouted.coarse.get(start) if search.scouted else None
                direct = solve_directly(problem, mesh, backend, start, watch, coarse)
                directs.append(direct)
                if direct.stop is Stop.INTERRUPTED:
                    return search.best or direct
                if direct.stop.ok:
                    shown.append(direct)
                    refine(problem, direct, search, watch)
                if search.over:
                    break
            if search.chatters:  # nothing but infinitely many switches comes of more words
                break
            for direct in () if search.over else shown:
                refine(problem, direct, search, watch, late=True)
            if search.over:
                break
        return None


@hookimpl
def socp_methods() -> list[type[Method]]:
    """Register the method."""
    return [Auto]


def _in_hand(search: Search, directs: list[Solution]) -> Solution | None:
    return search.best or (directs[-1] if directs else None)

"""What a search comes to: the best of all that it had in hand, words and direct solutions, and what
is left open.
"""

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import final

import casadi

from socp.errors import SolveError
from socp.methods import solve_collocated
from socp.model import (
    APPROXIMATE,
    FEASIBLE,
    TINY,
    Met,
    Problem,
    Solution,
    Starts,
    Stop,
    Watch,
    nodes,
    silent,
)
from socp.process import overtime, seconds_left, time_limit
from socp.search.effort import ALIKE, FAR, Ration, Search, clearly, off, precedes
from socp.search.motions import held_solution, leaves_box, own_motion, stated_error
from socp.search.refinement import refine
from socp.solvers import Backend, default_backend
from socp.transcription import Mesh, euler, knotted, single_phase, trapezoid
from socp.verdict import certified, chattering, graded, judge, verify, verify_in_time

# Iterations times variables from a point that betters a certified one: half of what a search may do
_FURTHER = 5e5
_WORDS = 20  # words tried there
_STEPS = 800, 400  # of finer grids, after 20 to 200 intervals of the first solves
_JUDGED = 2.0  # times what the solution before it took: solving and judging another one
# Seconds, where the time is over: what is returned is known by the motion of its own control, which
# is stiff where that takes longer
_OWN = 5.0
_TOLERANCE = 1e-7  # of those: a solution is compared by its re-integration
# Relative: two certified objectives of one extremal differ by less
_SAME = 1e-6
_ITERATIONS = 150  # from a solution nearby it takes some ten


def conclude(
    problem: Problem, search: Search, directs: Sequence[Solution], watch: Watch = silent
) -> Solution:
    """Return the certified solution, or else the best there is, with what is left open in its
    message.

    A word and direct solutions, one at least, are compared by feasibility and by the objectives
    that their controls reach by re-integration. A direct solution that happens to be an extremal,
    its switches on the grid, goes before any word that is none.
    """
    best = search.best
    if best is not None and not best.stop.ok:
        return best
    if best is not None and best.extremal:
        search.better = known = better_point(problem, search, directs)
        return best if known is None else replace(best, message=f"{best.message}; {_worse(known)}")
    solved = [each for each in directs if each.stop.ok]
    certain = next((each for each in _exact(problem, solved[:2]) if each.extremal), None)
    if certain is not None:  # of the best start
        return certain
    if best is not None and (search.chatters or search.told):  # no finer grid comes as near
        solved = [each for each in solved if clearly(_verified(problem, each), best)]
    chosen, compared = foremost(problem, best, solved, watch, search.backend.backend)
    if chosen is None:
        return directs[0]
    parts = (chosen.message, explanation(problem, search), compared)
    return replace(chosen, message="; ".join(filter(None, parts)))


def _exact(problem: Problem, directs: Sequence[Solution]) -> Iterator[Solution]:
    """Yield those direct solutions, certified, whose motion is that of their controls: no other is
    an extremal.
    """
    for each in directs:
        seen = verify_in_time(problem, each)
        if seen.drift <= APPROXIMATE and seconds_left() > 0.0:
            yield certified(problem, each)


def with_starts(solution: Solution, search: Search) -> Solution:
    """Return a solution with the starts that it is the best of, and the other extremals that the
    search met.
    """
    if search.scouted is None or not search.scouted.tried:
        return solution
    met: list[Solution] = [solution]
    for each in search.extremals:
        if not any(_one(each, other) for other in met):
            met.append(each)
    others, better = sorted(met[1:], key=lambda each: each.objective), search.better
    starts = Starts(
        tried=search.scouted.tried,
        coarse=tuple(Met(objective=e.objective, starts=n) for e, n in search.scouted.met if n),
        extremals=tuple(Met(objective=each.objective, word=each.word) for each in others),
        better=better.reached if better is not None and clearly(better, solution) else None,
    )
    return solution.with_effort(starts=starts)


def _one(one: Solution, other: Solution) -> bool:
    """Tell whether two extremals are the same, by their objectives."""
    size = max(abs(one.objective), abs(other.objective), TINY)
    return abs(one.objective - other.objective) <= _SAME * size


def foremost(
    problem: Problem,
    word: Solution | None,
    directs: Sequence[Solution],
    watch: Watch = silent,
    backend: Backend | None = None,
) -> tuple[Solution | None, str]:
    """Return the better of the best word and the best direct solution, judged, and a text that
    tells which it is.
    """
    finer = _Finer(problem, backend or default_backend(), watch)
    direct = _best(finer, directs, word)
    if direct is None:
        return word, ""
    if word is None:
        return direct, "this is a direct solution"
    if _before(direct, graded(problem, word)):
        other = f"the best word tried, {word.word}, reaches {_reaches(word)}"
        return direct, f"this is a direct solution; {other}"
    return word, f"this is the best word tried; the best direct solution reaches {_reaches(direct)}"


def better_point(problem: Problem, search: Search, directs: Sequence[Solution]) -> Solution | None:
    """Return the best feasible point in hand that is clearly better than a certified solution, if
    there is one.
    """
    if search.best is None:
        return None
    best = search.best
    hopeful = [
        each
        for each in directs
        if each.stop.ok and best.objective - each.objective > ALIKE * abs(best.objective)
    ]
    points = [_verified(problem, each) for each in hopeful]
    points += [search.other] if search.other is not None else []
    better = [each for each in points if off(each) <= FEASIBLE and clearly(each, best)]
    return min(better, key=lambda each: each.reached, default=None)


def pursue(
    problem: Problem, search: Search, directs: list[Solution], watch: Watch = silent
) -> None:
    """Go on from a feasible point that is clearly better than the certified solution, for as much
    work as is fair.

    A better certified solution takes the place of the one that the search ended with. Where a
    coarse grid claims far less, it is first solved on finer ones, which join the direct solutions:
    its own control may miss what it claims.
    """
    best, finer = search.best, _Finer(problem, search.backend.backend, watch)
    if best is None or not best.extremal:
        return
    less = [
        each
        for each in directs
        if each.stop.ok and best.objective - each.objective > FAR * abs(each.objective)
    ]
    if less and better_point(problem, search, directs) is None:
        first = min(less, key=lambda each: each.objective)
        found = [finer(first, mesh) for mesh in finer.meshes]
        directs += [each for each in found if each is not None and each.stop.ok]
    known = better_point(problem, search, directs)
    if known is None:
        return
    more = Search(
        backend=Ration(_FURTHER, search.backend.backend),
        nodes=search.nodes,
        extremals=search.extremals,
        steps=search.steps,
    )
    for mesh in (None, finer.meshes[0]):
        direct = known if mesh is None else finer(known, mesh)
        if direct is None:
            return
        better = refine(problem, direct, more, watch, _WORDS) if direct.stop.ok else direct
        if better is not None and better.stop is Stop.INTERRUPTED:
            search.best = replace(best, stop=Stop.INTERRUPTED)
            return
        if better is not None and better.extremal and clearly(better, best):
            search.best = better
            return


def explanation(problem: Problem, search: Search) -> str:
    """Say in a clause or two what a search without a certified word has left open."""
    tried = _tried(search)
    if search.late:
        tried += f", and the search's part of the {search.seconds:g} s allowed is over"
    elif search.backend.left <= 0:
        tried += ", and the work allowed for the search is done"
    elif search.count >= search.words:
        tried += ", and no more words are allowed"
    if len(search.grids) > 1:
        tried += f", on grids of up to {max(search.grids)} steps"
    best = search.best
    if refusals := search.backend.refusals:
        tried += f"; of {search.backend.given} programmes along words {len(refusals)} could not be "
        tried += f"solved at all, the last one: {refusals[-1].rstrip('.')}{_few_slopes(problem)}"
    if best is None or best.verdict is None:
        return tried
    names = chattering(problem, best)
    if names:
        return (
            f"{', '.join(names)}: chattering; no finite number of switches joins a bang arc to a "
            "singular arc of even order inside its box, so the switches pile up where they meet; "
            "this word stands for infinitely many"
        )
    reasons = best.verdict.reasons
    if search.told:
        tried += (
            "; one keeps every condition but for the sign along an arc too short to show it, which "
            "no finer grid does either"
        )
    return f"{tried}; the best one leaves: {reasons[0] if reasons else 'nothing'}"


def _tried(search: Search) -> str:
    """Say what came of the words that were tried."""
    cut = [each for each in search.nodes if each.stop == Stop.LIMIT.name]
    ended, short = search.count - len(cut), len({each.word for each in cut})
    if ended > 0:
        more = f", {short} more cut off before they converged" if cut else ""
        return f"no word of the {ended} tried is certified{more}"
    if not cut:
        return "no word was tried"
    which = "the one word tried was" if short == 1 else f"all {short} words tried were"
    return f"{which} cut off before converging"


def _few_slopes(problem: Problem) -> str:
    """Say what to do if a programme lacks slopes of a table; empty where there is none."""
    everything = casadi.vertcat(problem.rate, problem.lagrangian)
    if not any(node.is_call() for node in nodes(everything)):
        return ""
    return (
        "; if slopes of a table are lacking, as a spline has one more of them than its degree "
        "and laws take up to six, write interpolant(.., {'degree': [5]})"
    )


def _best(finer: "_Finer", directs: Sequence[Solution], word: Solution | None) -> Solution | None:
    """Return the best direct solution, judged: of those that claim less than the word where that is
    feasible.

    The grids on which words are looked for are coarse, and their controls often miss what they
    claim: it is solved on finer ones too, whose controls keep their box between the nodes; where
    these are not near an extremal, with controls that are held over every interval, which do what
    they claim and do not ring.
    """
    problem, feasible = finer.problem, word is not None and off(word) <= FEASIBLE
    worth = [
        each for each in directs if word is None or not feasible or each.objective < word.reached
    ]
    if not worth:
        return judge(problem, min(directs, key=lambda each: each.objective)) if directs else None
    # coarse ones miss most of what they claim; what leaves its box is known once it is held
    worth.sort(key=lambda each: (leaves_box(problem, each), -each.arcs[0].t.size))
    with overtime(_OWN):
        first = own_motion(problem, worth[0])
    with time_limit(seconds_left() / 2.0):
        best = _first([first, *(own_motion(problem, each) for each in _while_time(worth[1:]))])
    began = time.monotonic()
    with overtime(_OWN):
        best = judge(problem, best)
    *grids, held = finer.ways
    for solve in (*grids, held):
        spent = _JUDGED * (time.monotonic() - began)  # the next takes no less, and as much to solve
        if seconds_left() <= spent or (solve is held and stated_error(best) < float("inf")):
            break
        began = time.monotonic()
        with time_limit(seconds_left() - spent):
            found = solve(best)
        if found is not None and found.stop.ok:
            best = _first([best, judge(problem, own_motion(problem, found))])
    return best


def _while_time(solutions: Sequence[Solution]) -> Iterator[Solution]:
    """Yield solutions as long as time is left."""
    for each in solutions:
        if seconds_left() <= 0.0:
            return
        yield each


def _first(solutions: Sequence[Solution]) -> Solution:
    """Return the one that goes before the others."""
    best = solutions[0]
    for each in solutions[1:]:
        best = each if _before(each, best) else best
    return best


def _before(one: Solution, other: Solution) -> bool:
    """Tell whether one solution is to be preferred: as `precedes` does, but for one that reaches no
    more than another and is the nearer to an extremal by the error that its verdict states, and
    for two that state one: of these that which reaches less, or by less than both errors the one
    that is known better.
    """
    for better, worse in ((one, other), (other, one)):
        if better.reached <= worse.reached and stated_error(better) < stated_error(worse):
            return better is one
    errors = stated_error(one), stated_error(other)
    if max(errors) < float("inf"):
        alike = abs(one.reached - other.reached) <= min(errors)
        return errors[0] < errors[1] if alike else one.reached < other.reached
    return precedes(one, other)


def _verified(problem: Problem, solution: Solution) -> Solution:
    return solution.with_judgement(verified=verify(problem, solution))


@final
@dataclass(frozen=True, eq=False)
class _Finer:
    """Solves a problem directly from a solution that is known."""

    problem: Problem
    backend: Backend
    watch: Watch

    @property
    def meshes(self) -> tuple[Mesh, Mesh]:
        """Finer grids than words are read from: the first keeps controls in their box."""
        schemes = euler(), trapezoid()
        made = [knotted(self.problem, each, n) for each, n in zip(schemes, _STEPS, strict=True)]
        return made[0], made[1]

    @property
    def ways(self) -> list[Callable[[Solution], Solution | None]]:
        """Ways to solve from a solution: on finer grids, and with held controls."""
        held = partial(held_solution, self.problem, backend=self.backend, watch=self.watch)
        return [*(partial(self, mesh=mesh) for mesh in self.meshes), held]

    def __call__(self, known: Solution, mesh: Mesh) -> Solution | None:
        """Solve on another mesh; None where that fails."""
        backend = self.backend.within(_TOLERANCE).limited(_ITERATIONS)
        try:
            return solve_collocated(single_phase(self.problem), [mesh], backend, known, self.watch)
        except SolveError:
            return None


def _reaches(solution: Solution) -> str:
    missed = off(solution)
    return f"{solution.reached:.8g}" + (
        "" if missed <= FEASIBLE else f", its re-integration off by {missed:.1e}"
    )


def _worse(known: Solution) -> str:
    what = f"along the word {known.word}" if known.structure else "a direct solution"
    return (
        f"an extremal, but not the best: a feasible point with the objective {known.reached:.8g} "
        f"is known ({what}), from which no certified word was found"
    )

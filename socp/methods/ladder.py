"""Large uniform grids, solved from the solutions of coarser ones.

An interior-point method takes as many iterations on a fine grid as on a coarse one, or many more
where controls ring. From the point of a grid a tenth as fine, multipliers included, it takes a few
(nested iteration: Brandt, Math. Comp. 31, 1977, section 4).
"""

import time
from dataclasses import replace

from socp.methods.contract import lifting_watch, solve_collocated
from socp.model import Solution, Stop, Watch, silent
from socp.process import one_thread
from socp.solvers import Backend, NLPPoint
from socp.transcription import (
    Layout,
    PhasedProblem,
    Scheme,
    laid_out,
    lift,
    prolonged,
    push,
    uniform,
)

# Intervals of the coarsest grid at least: as many as tell arcs from one another. Each grid has a
# tenth of the next one's, so that all of them together cost little beside the last
_COARSEST, _FINER = 500, 10
# All but the last are only on the way: what a barrier of an interior point method leaves there is
# what the next one begins with. Solved to their ends they show controls at bounds that the next
# grid has to leave first, which takes as many iterations as all the rest
_ROUGH = 1e-5


@one_thread()
def solve_uniform(
    phased: PhasedProblem,
    scheme: Scheme,
    count: int,
    backend: Backend,
    guess: Solution,
    watch: Watch = silent,
) -> Solution:
    """Solve a phased problem of one phase of free controls on so many equal intervals of a scheme.

    Where these are ten times as many as a grid needs at least, grids of a tenth as many are solved
    first, each from the one before, with its multipliers; the message tells. Where one of these
    does not meet the solver's tolerances, or the last one does not from there, it is solved from
    the guess as `solve_collocated` does. An interrupted solution is that of the grid it was on.
    """
    counts = [count]
    while counts[0] >= _COARSEST * _FINER:
        counts.insert(0, counts[0] // _FINER)
    climbed = _climbed(phased, scheme, counts, backend, guess, watch) if counts[1:] else None
    whole = climbed is not None and len(climbed.arcs[0].mesh) == count + 1
    if climbed is not None and ((climbed.stop.ok and whole) or climbed.stop is Stop.INTERRUPTED):
        return climbed
    solution = solve_collocated(phased, [uniform(scheme, count)], backend, guess, watch)
    if climbed is None:
        return solution
    solution = solution.after(climbed)
    if solution.stop.ok or solution.stop is Stop.INTERRUPTED or not whole:
        return solution
    # neither meets the tolerances: the one that began nearer is as good as any
    return replace(climbed, effort=solution.effort)


def _climbed(
    phased: PhasedProblem,
    scheme: Scheme,
    counts: list[int],
    backend: Backend,
    guess: Solution,
    watch: Watch,
) -> Solution:
    """Return the solution on the last of grids of so many intervals, from one to the next, or on
    the first of them that does not meet the tolerances.
    """
    known: tuple[Layout, NLPPoint, Solution] | None = None
    for count in counts:
        began = time.perf_counter()
        nlp, layout = laid_out(phased, [uniform(scheme, count)], guess)
        start = push(layout, guess) if known is None else prolonged(known[0], layout, *known[1:])
        laid = time.perf_counter() - began
        solver = backend if count == counts[-1] else backend.within(_ROUGH)
        point = solver(nlp, start, lifting_watch(watch, nlp, layout))
        solution = lift(layout, point)
        solution = solution.spent(build=point.seconds.get("build", 0.0) + laid)
        known = layout, point, solution if known is None else solution.after(known[2])
        if not point.stop.ok:
            break
    assert known is not None  # noqa: S101 - there is one grid at least
    climbed, done = known[2], counts.index(count)
    if count < counts[-1]:
        climbed = replace(climbed, message=f"{climbed.message}, on {count} intervals")
    if not done:
        return climbed
    before = " and ".join(map(str, counts[:done]))
    return replace(climbed, message=f"{climbed.message}, by way of {before} intervals")

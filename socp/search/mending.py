"""Mending words: read one off a direct solution, and change it where a judged solution says that it
is wrong.
"""

from collections.abc import Iterator, Sequence
from itertools import chain, islice, pairwise, product

import numpy as np

from socp import laws
from socp.laws import arc_modes, control_modes
from socp.model import OUTSIDE, SHORTEST, Arc, Mode, Place, Problem, Solution, Verdict
from socp.search.candidate import Candidate, held, insert, merged, without_short_arcs
from socp.search.indifference import with_bangs_for
from socp.search.reading import Stretch
from socp.verdict import constraint_values, misfit, nearness

# -- mending


def mends(problem: Problem, tried: Candidate, solution: Solution) -> Iterator[Candidate]:
    """Yield the words that may mend a judged solution, the most promising first."""
    now = Candidate.of(solution, tried.arcs)
    shortest = SHORTEST * (now.edges[-1] - now.edges[0])
    gone = [k for k, (a, b) in enumerate(pairwise(now.edges)) if b - a <= shortest]
    if gone:
        yield merged(without_short_arcs(now, shortest))
    slack = () if solution.verdict is None else solution.verdict.slack
    if len(slack) > 1:  # where all else holds none is asked for, else they stand for a singular arc
        yield _dropped(now, slack) if _holds(solution) else _smoothed(now, slack)
    yield from (_dropped(now, [place]) for place in slack)
    if gone:
        yield from (_swapped(now, k) for k in gone if 0 < k < len(now.arcs) - 1)
    yield from _outside(problem, now)
    yield from _violated(problem, now)
    if solution.verdict is None:
        return
    wished = _wished(problem, now, solution.verdict)
    yield from islice(wished, 1)  # before the contacts, of which there may be many
    yield from _opened(problem, now)
    yield from wished


def _wished(problem: Problem, now: Candidate, verdict: Verdict) -> Iterator[Candidate]:
    """Yield what the judge wants where the principle fails, and a singular arc there, where it
    fails most first.
    """
    for finding in sorted(verdict.findings, key=lambda f: -f.residual):
        name, wants, t = finding.control, finding.wants, finding.t
        if name is None or wants is None or t is None or finding.holds:
            continue
        if name not in verdict.chattering:  # else one of infinitely many more arcs
            control = problem.control_names.index(name)
            yield insert(now, control, wants, t)
            yield insert(now, control, Mode("singular"), t)


def _holds(solution: Solution) -> bool:
    """Tell whether every condition of the judge holds, whatever the margins are."""
    return solution.verdict is not None and all(each.holds for each in solution.verdict.findings)


def _dropped(given: Candidate, places: Sequence[Place]) -> Candidate:
    """Return a candidate whose controls go on with the modes beside some of their stretches."""
    found = given
    for i, row, gone in _rows(given, places):
        left = [k for k in range(len(row)) if k not in gone]
        for k in gone if left else ():
            beside = max((j for j in left if j < k), default=left[0])
            found = _set(found, i, row[k], Mode.parse(row[beside][0]))
    return merged(found)


def _smoothed(given: Candidate, places: Sequence[Place]) -> Candidate:
    """Return a candidate with singular arcs where neighbouring stretches of a control are among
    some.
    """
    found = given
    for i, row, gone in _rows(given, places):
        for k in gone:
            if {k - 1, k + 1} & set(gone):
                found = _set(found, i, row[k], Mode("singular"))
    return merged(found)


def _rows(
    given: Candidate, places: Sequence[Place]
) -> Iterator[tuple[int, Sequence[Stretch], list[int]]]:
    """Yield every control with its stretches and which of them some places are."""
    for i, name in enumerate(given.source.control_names):
        gone = [each.stretch - 1 for each in places if each.control == name and each.stretch]
        yield i, given.source.structure[name], gone


def _set(given: Candidate, i: int, stretch: Stretch, mode: Mode) -> Candidate:
    """Return a candidate whose control i has a mode all along a stretch."""
    _, a, b = stretch
    arcs = tuple(
        (*arc[:i], mode, *arc[i + 1 :]) if a <= (start + end) / 2.0 <= b else arc
        for arc, (start, end) in zip(given.arcs, pairwise(given.edges), strict=True)
    )
    return Candidate(arcs, given.edges, given.source)


def _swapped(given: Candidate, k: int) -> Candidate:
    """Return a candidate in which two controls switch in the other order around an arc without
    length.
    """
    before, after = given.arcs[k - 1], given.arcs[k + 1]
    other = tuple(
        b if here == a else a for a, here, b in zip(before, given.arcs[k], after, strict=True)
    )
    return merged(
        Candidate((*given.arcs[:k], other, *given.arcs[k + 1 :]), given.edges, given.source)
    )


def _outside(problem: Problem, now: Candidate) -> Iterator[Candidate]:
    """Yield what puts bounds where laws leave the box, for as long as they are outside, everywhere
    at once and then where one is furthest out: where it pays to leave it, a shorter one shrinks to
    none.
    """
    by_arc = [list(_excursions(problem, arc)) for arc in now.source.arcs]
    if sum(map(len, by_arc)) > 1:
        everywhere = now
        for i, bound, span, _, _ in chain.from_iterable(by_arc):
            everywhere = held(everywhere, i, bound, span)
        yield everywhere
    for runs in by_arc:
        for i in range(len(problem.control_names)):
            own = [run for run in runs if run[0] == i]
            if own:
                _, bound, span, t, _ = max(own, key=lambda run: run[-1])
                yield held(now, i, bound, span)
                yield insert(now, i, bound, t)


def _excursions(
    problem: Problem, arc: Arc
) -> Iterator[tuple[int, Mode, tuple[float, float], float, float]]:
    """Yield where a law leaves the box on an arc: the control, the bound, from when to when, and
    when it is how far outside.
    """
    for i, (low, high) in enumerate(problem.box.T):
        sides = (Mode("lower"), low - arc.u[i]), (Mode("upper"), arc.u[i] - high)
        for bound, excess in sides:
            out = np.flatnonzero(excess > OUTSIDE * (high - low))
            for run in np.split(out, np.flatnonzero(np.diff(out) > 1) + 1):
                if run.size:
                    k = run[np.argmax(excess[run])]
                    span = float(arc.t[run[0]]), float(arc.t[run[-1]])
                    yield i, bound, span, float(arc.t[k]), float(excess[k])


def _violated(problem: Problem, now: Candidate) -> Iterator[Candidate]:
    """Yield what follows a state constraint where it is violated."""
    found = now.source.verified[0] if now.source.verified else None
    if found is None or found.path <= 1e-7:  # beyond the solver's own tolerance
        return
    constraint = next((c for c in problem.constraints if c.name == found.path_at), None)
    if constraint is None:  # where time ended a motion, nothing is known of it
        return
    t = np.linspace(now.edges[0], now.edges[-1], 2001)
    worst = float(
        t[np.argmax(constraint_values(problem, now.source, constraint, t, now.source.at(t)))]
    )
    for i in range(len(problem.control_names)):
        if constraint in laws.controlled_constraints(problem, i):
            yield insert(now, i, Mode("boundary", constraint.name), worst)


def _opened(problem: Problem, now: Candidate) -> Iterator[Candidate]:
    """Yield arcs along state constraints that are met where two arcs join of which neither follows
    them: where the principle fails a contact may open into an arc.
    """
    t = np.array(now.edges[1:-1])
    x = now.source.at(t)
    for c, near in zip(problem.constraints, nearness(now.source, problem), strict=True):
        met = np.flatnonzero(constraint_values(problem, now.source, c, t, x) >= -near)
        mode = Mode("boundary", c.name)
        for i in range(len(problem.control_names)):
            if c in laws.controlled_constraints(problem, i):
                apart = (k for k in met if mode not in {now.arcs[k][i], now.arcs[k + 1][i]})
                yield from (insert(now, i, mode, float(t[k])) for k in apart)


def starts(first: Candidate) -> Iterator[Candidate]:
    """Yield words with bang arcs where a control begins or ends singular: a given end is seldom on
    its surface.
    """
    ends = ((0, first.edges[0]), (-1, first.edges[-1]))
    places = [
        (k, t, i)
        for k, t in ends
        for i, mode in enumerate(first.arcs[k])
        if mode.kind == "singular"
    ]
    low, high = Mode("lower"), Mode("upper")
    signs = [(high, low) if _pulls(first.source, i, t) > 0 else (low, high) for _, t, i in places]
    for choice in product((0, 1), repeat=len(places)):
        new = first
        for (_, t, i), pair, k in zip(places, signs, choice, strict=True):
            new = insert(new, i, pair[k], t)
        yield new
    yield from (
        insert(first, i, sign, t)
        for (_, t, i), pair in zip(places, signs, strict=True)
        for sign in pair
    )


def _pulls(solution: Solution, i: int, t: float) -> float:
    """Return how far a control at an end of the horizon is from what it is along the way."""
    nearest = solution.at(np.array([t]), "u")[i, 0]
    return float(nearest - np.median(solution.rows("u")[i]))


def collapsed(tried: Candidate, unsolved: Solution) -> Iterator[Candidate]:
    """Yield the word without the arcs that a solver had made as good as none where it gave up: they
    may be what kept it from converging.
    """
    if len(unsolved.arcs) != len(tried.arcs):
        return
    lengths = np.array([arc.t[-1] - arc.t[0] for arc in unsolved.arcs])
    gone = np.flatnonzero(lengths <= _COLLAPSED * lengths.sum())
    if 0 < gone.size < lengths.size:
        keep = [k for k in range(lengths.size) if k not in gone]
        edges = (tried.edges[0], *(tried.edges[k] for k in keep[1:]), tried.edges[-1])
        yield merged(Candidate(tuple(tried.arcs[k] for k in keep), edges, tried.source))


# Of the horizon: an arc as short in a point that has not converged is on its way to none
_COLLAPSED = 1e-4
_LOOKS = 9  # points of a stretch at which a mode is held against the control


def substitutes(problem: Problem, given: Candidate) -> Iterator[Candidate]:
    """Yield candidates without the arcs that have no law, the best fitting modes first; nothing
    where all have one.
    """
    possible = set(arc_modes(problem))
    lawless = [k for k, modes in enumerate(given.arcs) if modes not in possible]
    if any(mode.kind == "singular" for k in lawless for mode in given.arcs[k]):
        yield with_bangs_for(problem, given, lawless)
    for i in range(len(problem.control_names)):
        modes = {
            given.arcs[k][i] for k in lawless if given.arcs[k][i].kind in {"singular", "boundary"}
        }
        for mode in modes:
            ranked = sorted(
                (other for other in control_modes(problem, i) if other != mode),
                key=lambda other: _misfit(problem, given, (i, mode), other),
            )
            yield from (merged(_replaced(given, lawless, (i, mode), other)) for other in ranked)


def _misfit(problem: Problem, given: Candidate, old: tuple[int, Mode], new: Mode) -> float:
    i, mode = old
    spans = [
        span
        for modes, span in zip(given.arcs, pairwise(given.edges), strict=True)
        if modes[i] == mode
    ]
    t = np.concatenate([np.linspace(a, b, _LOOKS + 2)[1:-1] for a, b in spans])
    return float(misfit(problem, given.source, i, new, t).mean())


def _replaced(given: Candidate, lawless: list[int], old: tuple[int, Mode], new: Mode) -> Candidate:
    i, mode = old
    arcs = tuple(
        (*modes[:i], new, *modes[i + 1 :]) if k in lawless and modes[i] == mode else modes
        for k, modes in enumerate(given.arcs)
    )
    return Candidate(arcs, given.edges, given.source)

"""Words next to a word: without one of its arcs, or with one more."""

from collections.abc import Container, Iterator, Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from socp.model import Mode, Modes, Solution
from socp.search import candidate
from socp.search.candidate import Candidate, merged
from socp.transcription import rejoin

_LENGTH = 0.1  # of the shorter neighbour: the first length of an arc put between two


def word_of(solution: Solution) -> Candidate:
    """Return the word that a solution follows, as a candidate."""
    return Candidate.of(solution, [arc.modes for arc in solution.arcs])


def shortened(given: Candidate, shortest: float) -> Candidate:
    """Return a candidate without its arcs that are at most so short, relative to the horizon."""
    return merged(
        candidate.without_short_arcs(given, shortest * (given.edges[-1] - given.edges[0]))
    )


def arc_removals(now: Candidate) -> Iterator[Candidate]:
    """Yield a word without each of its arcs."""
    yield from (
        without_arc(now, k) for k in np.argsort(np.diff(now.edges)).tolist() if len(now.arcs) > 1
    )


def without_arc(now: Candidate, k: int) -> Candidate:
    """Return a word without an arc, whose time its neighbours share."""
    a, b = now.edges[k], now.edges[k + 1]
    middle = b if k == 0 else a if k == len(now.arcs) - 1 else (a + b) / 2.0
    edges = [*now.edges[:k], middle, *now.edges[k + 2 :]]
    edges[0], edges[-1] = now.edges[0], now.edges[-1]
    return merged(Candidate((*now.arcs[:k], *now.arcs[k + 1 :]), tuple(edges), now.source))


def mode_changes(now: Candidate, modes: Sequence[Modes]) -> Iterator[Candidate]:
    """Yield words with one control in another mode on one arc."""
    for k, arc in enumerate(now.arcs):
        for mode in modes:
            if sum(a != b for a, b in zip(mode, arc, strict=True)) == 1:
                yield merged(
                    Candidate((*now.arcs[:k], mode, *now.arcs[k + 1 :]), now.edges, now.source)
                )


def arc_insertions(
    now: Candidate, modes: Sequence[Modes], near: Container[Modes] | None = None
) -> Iterator[Candidate]:
    """Yield words with one arc more, at an end or between two, in whose mode one control differs
    from a neighbour; with `near` only those at the ends and beside an arc of one of these
    modes.
    """
    lengths = np.diff(now.edges)
    for k in range(len(now.arcs) + 1):
        before, after = (now.arcs[j] if 0 <= j < len(now.arcs) else None for j in (k - 1, k))
        beside = [each for each in (before, after) if each is not None]
        if near is not None and len(beside) > 1 and not any(each in near for each in beside):
            continue
        length, t = (
            _LENGTH * min(lengths[j] for j in (k - 1, k) if 0 <= j < len(now.arcs)),
            now.edges[k],
        )
        left = t if before is None else t - length * (1.0 if after is None else 0.5)
        right = t if after is None else t + length * (1.0 if before is None else 0.5)
        edges = (*now.edges[:k], left, right, *now.edges[k + 1 :])
        for mode in modes:
            alike = any(sum(a != b for a, b in zip(mode, each, strict=True)) < 2 for each in beside)
            if alike and mode not in beside:
                yield Candidate((*now.arcs[:k], mode, *now.arcs[k:]), edges, now.source)


def past(solution: Solution, k: int) -> list[Solution]:
    """Return guesses along the words that may hold where an arc has lost its length."""
    return [_without(solution, k), *_turned(solution, k)] if len(solution.arcs) > 1 else []


def without_length(solution: Solution, shortest: float) -> Solution:
    """Return a solution without its arcs that are at most so long, of which one stays in any case;
    arcs that are one along the same modes then are joined.
    """
    found, k = solution, 0
    while k < len(found.arcs):
        if len(found.arcs) > 1 and np.ptp(found.arcs[k].t) <= shortest:
            found = _without(found, k)
        else:
            k += 1
    pieces = [len(list(own)) for _, own in groupby(found.arcs, key=lambda arc: arc.modes)]
    return rejoin(found, pieces)


def _without(solution: Solution, k: int) -> Solution:
    """Return a solution without an arc, whose time a neighbour has."""
    arcs = list(solution.arcs)
    gone, j = arcs[k], 1 if k == 0 else k - 1
    span = sorted((*gone.t[[0, -1]], *arcs[j].t[[0, -1]]))
    share = (arcs[j].t - arcs[j].t[0]) / np.ptp(arcs[j].t)
    arcs[j] = replace(arcs[j], t=span[0] + share * (span[-1] - span[0]))
    return replace(solution, arcs=(*arcs[:k], *arcs[k + 1 :]))


def _turned(solution: Solution, k: int) -> Iterator[Solution]:
    """Yield a solution with a control at its other bound on an arc that it is at this bound on
    alone: a start that crosses a singular surface is met from the other side.
    """
    arcs = solution.arcs
    for i, mode in enumerate(arcs[k].modes):
        other = {"+": Mode("lower"), "-": Mode("upper")}.get(str(mode))
        beside = [arcs[j].modes[i] for j in (k - 1, k + 1) if 0 <= j < len(arcs)]
        if other is not None and not {mode, other} & set(beside):
            modes = (*arcs[k].modes[:i], other, *arcs[k].modes[i + 1 :])
            yield replace(solution, arcs=(*arcs[:k], replace(arcs[k], modes=modes), *arcs[k + 1 :]))

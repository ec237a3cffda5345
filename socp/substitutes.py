"""Substitutes: words in which a mode without a law, as singular in a linear system, gives way to one that fits."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from socp.mending import Candidate, merged
from socp.modes import arc_modes, control_modes
from socp.problem import Problem
from socp.structure import misfit
from socp.word import Mode

_LOOKS = 9  # points of a stretch at which a mode is held against the control


def substitutes(problem: Problem, given: Candidate) -> Iterator[Candidate]:
    """Yield candidates without the arcs that have no law, the best fitting modes first; nothing where all have one."""
    possible = set(arc_modes(problem))
    lawless = [k for k, modes in enumerate(given.arcs) if modes not in possible]
    for i in range(len(problem.control_names)):
        modes = {given.arcs[k][i] for k in lawless if given.arcs[k][i].kind in {"singular", "boundary"}}
        for mode in modes:
            ranked = sorted(
                (other for other in control_modes(problem, i) if other != mode),
                key=lambda other: _misfit(problem, given, (i, mode), other),
            )
            yield from (merged(_replaced(given, lawless, (i, mode), other)) for other in ranked)


def _misfit(problem: Problem, given: Candidate, old: tuple[int, Mode], new: Mode) -> float:
    i, mode = old
    spans = [span for modes, span in zip(given.arcs, pairwise(given.edges), strict=True) if modes[i] == mode]
    t = np.concatenate([np.linspace(a, b, _LOOKS + 2)[1:-1] for a, b in spans])
    return float(misfit(problem, given.source, i, new, t).mean())


def _replaced(given: Candidate, lawless: list[int], old: tuple[int, Mode], new: Mode) -> Candidate:
    i, mode = old
    arcs = tuple(
        (*modes[:i], new, *modes[i + 1 :]) if k in lawless and modes[i] == mode else modes
        for k, modes in enumerate(given.arcs)
    )
    return Candidate(arcs, given.edges, given.source)

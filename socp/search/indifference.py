"""Stretches on which the principle leaves a control open: what counts there is its integral, and
bangs have it too.

Where a price is flat, or a switching function vanishes with all its derivatives, the best controls
are many. One of them is at its bounds almost everywhere, with as few switches as the integral
needs.
"""

from itertools import pairwise

import numpy as np

from socp.model import Problem
from socp.search.candidate import Candidate
from socp.search.reading import Stretch, candidate, control_stretches
from socp.transcription import knot_times

_LOOKS = 40  # at a stretch: its integral is a start, and the solver finds the length
_SLIGHT = 0.02  # of a stretch: a shorter bang in it is what a grid has smeared


def with_bangs_for(problem: Problem, given: Candidate, lawless: list[int]) -> Candidate:
    """Return a candidate with a bang in every singular stretch that lies on arcs without a law.

    The bang goes to the upper bound for as long as the integral of the control there asks for, and
    stands where its middle is; between knots, at which the problem itself changes, every part of a
    stretch has a bang of its own.
    """
    spans = [(given.edges[k], given.edges[k + 1]) for k in lawless]
    rows: dict[str, tuple[Stretch, ...]] = {}
    for i, name in enumerate(problem.control_names):
        row: list[Stretch] = []
        for mode, a, b in control_stretches(given, i):
            if mode == "s" and any(a <= 0.5 * (c + d) <= b for c, d in spans):
                inside = [t for t in knot_times(problem) if a < t < b]
                for part in pairwise([a, *inside, b]):
                    row += _bang(problem, given, i, part)
            else:
                row.append((mode, a, b))
        rows[name] = tuple(row)
    return candidate(given.source, rows)


def _bang(problem: Problem, given: Candidate, i: int, span: tuple[float, float]) -> list[Stretch]:
    """Return the stretches in place of one of control i: lower bound, upper bound, lower bound."""
    (a, b), (low, high) = span, problem.box[:, i]
    t = a + (b - a) * (np.arange(_LOOKS) + 0.5) / _LOOKS
    share = np.clip((given.source.at(t, "u")[i] - low) / (high - low), 0.0, 1.0)
    length = float(share.mean()) * (b - a)
    if length < _SLIGHT * (b - a):
        return [("-", a, b)]
    if length > (1.0 - _SLIGHT) * (b - a):
        return [("+", a, b)]
    middle = float(share @ t / share.sum())
    begin = float(np.clip(middle - 0.5 * length, a, b - length))
    apart = _SLIGHT * (b - a)
    begin = a if begin - a < apart else b - length if b - length - begin < apart else begin
    parts = [("-", a, begin), ("+", begin, begin + length), ("-", begin + length, b)]
    return [each for each in parts if each[2] > each[1]]

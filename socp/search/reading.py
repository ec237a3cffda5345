"""Hidden arcs: bangs shorter than a step of the grid, found by how far they carry a control off its
singular or boundary law.
"""

from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from socp import laws
from socp.errors import MethodError
from socp.model import (
    SAME_TIME,
    Mode,
    Problem,
    Solution,
    evaluate,
    parameters_of,
)
from socp.search.candidate import Candidate, held, merged
from socp.verdict import structure_of

# a deviation counts from so many times the median one, which the grid's own error makes, and from
# this share of the width of the control's box
_CLEAR, _LEAST = 10.0, 0.01
# Intervals of a grid: a bang that is longer shows in more of them
_HIDDEN = 2.0


Stretch = tuple[str, float, float]  # of one control: its mode, start and end


def with_hidden_bangs(problem: Problem, first: Candidate) -> Candidate:
    """Return a candidate with a bang arc wherever a control leaves its singular or boundary law at
    an end of its stretch.

    The integral of the deviation over the intervals there, over how far the bang is off the law, is
    the length of the arc. A neighbouring bang of the same sign explains a deviation by itself: its
    switch is smeared.
    """
    found = first
    for i in range(len(problem.control_names)):
        edges = control_stretches(first, i)
        for k, (mode, a, b) in enumerate(edges):
            if mode in "+-":
                continue
            beside = (edges[k - 1][0] if k else "", edges[k + 1][0] if k + 1 < len(edges) else "")
            for bang, start, end in _bangs(problem, first, i, (a, b)):
                if bang != beside[int(start + end > a + b)]:
                    found = _in_place(found, i, Mode.parse(bang), (start, end))
    return found


def _in_place(given: Candidate, i: int, mode: Mode, span: tuple[float, float]) -> Candidate:
    """Return a candidate with control i in another mode over a span, whatever arcs it is of."""
    found = given
    for start, end in pairwise(given.edges):
        if start < span[1] and end > span[0]:
            found = held(found, i, mode, (max(start, span[0]), min(end, span[1])))
    return found


def control_stretches(given: Candidate, i: int) -> list[Stretch]:
    """Return the stretches of control i in a candidate: mode, start and end."""
    return _joined(
        (str(arc[i]), a, b) for arc, (a, b) in zip(given.arcs, pairwise(given.edges), strict=True)
    )


def _joined(stretches: Iterable[Stretch]) -> list[Stretch]:
    """Return stretches in which neighbours of one mode are one."""
    joined: list[Stretch] = []
    for mode, a, b in stretches:
        if joined and joined[-1][0] == mode:
            joined[-1] = (mode, joined[-1][1], b)
        else:
            joined.append((mode, a, b))
    return joined


def _bangs(problem: Problem, given: Candidate, i: int, span: tuple[float, float]) -> list[Stretch]:
    """Return the bangs at the ends of a stretch of control i along a law at which it deviates
    clearly: they go to the bound that it deviates towards, over all intervals in a row in which it
    does.
    """
    t, off, law, steps = _deviations(problem, given, i, span)
    if t.size < 4:  # too short a stretch to tell a deviation from the law's own course
        return []
    low, high = problem.box[:, i]
    level = max(_CLEAR * float(np.median(np.abs(off))), _LEAST * (high - low))
    found = list[Stretch]()
    for first in (True, False):
        order = slice(None, None, 1 if first else -1)
        at_end, along, step = off[order], law[order], steps[order]
        if not abs(at_end[0]) > level:
            continue
        bang, bound = ("+", high) if at_end[0] > 0 else ("-", low)
        run = int(np.argmin(np.append(np.sign(at_end[0]) * at_end > level, False)))
        # laws may leave the box
        share = np.divide(at_end, bound - along, np.ones(t.size), where=along != bound)[:run]
        length = float(step[:run] @ np.where(share > 0, np.minimum(share, _HIDDEN), 1.0))
        length = min(length, span[1] - span[0])
        ends = (span[0], span[0] + length) if first else (span[1] - length, span[1])
        found.append((bang, *ends))
    return found


def _deviations(
    problem: Problem, given: Candidate, i: int, span: tuple[float, float]
) -> np.ndarray:
    """Return the middles of the grid's intervals in a stretch, the mean deviation of control i
    there, its mean law, and their lengths: (4, k).
    """
    rows = [np.empty((4, 0))]
    for modes, (a, b) in zip(given.arcs, pairwise(given.edges), strict=True):
        if not span[0] <= (a + b) / 2.0 <= span[1]:
            continue
        try:
            law = laws.feedback_function(problem, modes)
        except MethodError:
            continue
        for arc in given.source.arcs:
            own = evaluate(law, arc.x, arc.t, parameters_of(problem, given.source))[0][i]
            t = np.empty(arc.mesh.size - 1)
            for some, nodes in arc.alike("u"):
                t[some] = arc.t[nodes].mean(axis=1)
            inside = (a <= t) & (t <= b)
            off, along = (arc.means(each)[inside] for each in (arc.u[i] - own, own))
            rows.append(np.array([t[inside], off, along, np.diff(arc.t[arc.mesh])[inside]]))
    found = np.hstack(rows)
    return found[:, np.argsort(found[0])]


def candidate(solution: Solution, stretches: dict[str, tuple[Stretch, ...]]) -> Candidate:
    """Return the word that the stretches of all controls spell together."""
    start, end = solution.initial_time, solution.final_time
    apart = SAME_TIME * (end - start)
    times = sorted(
        {t for row in stretches.values() for _, _, t in row[:-1] if start + apart < t < end - apart}
    )
    edges = [start, *(t for k, t in enumerate(times) if k == 0 or t - times[k - 1] > apart), end]
    arcs = []
    for a, b in pairwise(edges):
        middle = (a + b) / 2.0
        arcs.append(tuple(Mode.parse(_mode(row, middle)) for row in stretches.values()))
    return merged(Candidate(tuple(arcs), tuple(edges), solution))


def _mode(row: tuple[Stretch, ...], t: float) -> str:
    return next((mode for mode, a, b in row if a <= t <= b), row[-1][0])


def read(
    problem: Problem, solution: Solution, *, plain: bool = False, limits: bool = False
) -> Candidate:
    """Read the word of a direct solution, what its grid has smeared taken back, or as plainly as it
    stands.

    limits: short stretches along state constraints are taken at their word.
    """
    step = (solution.final_time - solution.initial_time) / sum(
        len(arc.mesh) - 1 for arc in solution.arcs
    )
    rows = {}
    for name, row in structure_of(problem, solution).items():
        kept = list(row) if plain else _calmed(list(row), _FLUTTER * step)
        while len(kept) > 1 and not plain:
            blurred = [
                k
                for k, (mode, a, b) in enumerate(kept)
                if mode not in "+-"
                and b - a < _BLURRED * step
                and not (limits and mode.startswith("b"))
            ]
            if not blurred:
                break
            above = [_time_above(problem, solution, name, each) for each in kept]
            kept = _absorbed(kept, blurred[0], above, limits=limits)
        rows[name] = tuple(kept)
    return candidate(solution, rows)


def _calmed(row: list[Stretch], shortest: float) -> list[Stretch]:
    """Return stretches in which every flutter from bound to bound, shorter than a few steps each
    time, is singular.
    """

    def mode_of(k: int) -> str:
        mode, a, b = row[k]
        flutters = 0 < k < len(row) - 1 and mode in "+-s" and b - a < shortest
        return "s" if flutters and len(row) > _MANY else mode

    return _joined((mode_of(k), a, b) for k, (_, a, b) in enumerate(row))


def _absorbed(
    row: list[Stretch], k: int, times: list[float], *, limits: bool = False
) -> list[Stretch]:
    """Return stretches with bangs of the same integral in place of one inside the box, which the
    grid has smeared: times (n,) are those that the control of every stretch would spend at its
    upper bound.

    Between unlike bangs it is their switch; beside one bang, or between two alike, it hides a burst
    to the other bound. Beside an arc of another kind it is divided between its neighbours; limits:
    at an end of the horizon it is the bang that leads to or from the constraint there.
    """
    (_, a, b), above = row[k], times[k]
    before, after = (row[j][0] if 0 <= j < len(row) else "" for j in (k - 1, k + 1))
    if limits and not (before and after) and (before or after).startswith("b"):
        j = k - 1 if before else k + 1
        higher = above / (b - a) > times[j] / (row[j][2] - row[j][1])
        return _joined([*row[:k], ("+" if higher else "-", a, b), *row[k + 1 :]])
    if not {before, after} <= {"", "+", "-"}:
        at = (a + b) / 2.0
        inner = [(before or after, a, at), (after or before, at, b)]
        return _joined([*row[:k], *inner, *row[k + 1 :]])
    first, last = before or _OTHER[after], after or _OTHER[before]
    spent = {"+": above, "-": b - a - above}
    if first != last:
        at = a + spent[first]
        inner = [(first, a, at), (last, at, b)]
    elif spent[_OTHER[first]] < _LEAST * (b - a):
        inner = [(first, a, b)]
    else:
        rim = spent[first] / 2.0
        inner = [(first, a, a + rim), (_OTHER[first], a + rim, b - rim), (last, b - rim, b)]
    return _joined([*row[:k], *(each for each in inner if each[2] > each[1]), *row[k + 1 :]])


def _time_above(problem: Problem, solution: Solution, name: str, stretch: Stretch) -> float:
    """Return how long a control would have to be at its upper bound, and else at its lower one, to
    have its integral over a stretch.
    """
    i, (_, a, b) = problem.control_names.index(name), stretch
    low, high = problem.box[:, i]
    area = 0.0
    for arc in solution.arcs:
        ends = arc.t[arc.mesh]
        common = np.minimum(b, ends[1:]) - np.maximum(a, ends[:-1])
        area += float(np.maximum(common, 0.0) @ arc.means(arc.u[i]))
    return float(np.clip((area - low * (b - a)) / (high - low), 0.0, b - a))


_OTHER = {"+": "-", "-": "+"}


# Steps of a grid: a stretch shorter than this, inside its box, is a switch that the grid has
# smeared
_BLURRED = 2.5


_FLUTTER = (
    6.0  # steps of a grid: bangs in a row that are all shorter than this imitate a singular arc
)


_MANY = 6  # stretches of one control from which on short bangs are taken for flutter

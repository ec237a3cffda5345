"""Mending words: read one off a direct solution, and change it where a judged solution says that it is wrong."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise, product
from typing import final

import numpy as np

from socp import laws
from socp.guess import split
from socp.problem import Problem
from socp.solution import Solution
from socp.structure import constraint_values, structure_of
from socp.verdict import EXTREMAL, SHORTEST
from socp.word import Mode, Word

_BLURRED = 2.5  # steps of a grid: a stretch shorter than this, inside its box, is a switch that the grid has smeared
_FLUTTER = 6.0  # steps of a grid: bangs in a row that are all shorter than this imitate a singular arc
_MANY = 6  # stretches of one control from which on short bangs are taken for flutter
_SPROUT = 0.02  # of the arc that it is put into: the first length of an inserted arc, soon corrected by the solver

Joint = tuple[Mode, ...]


@final
@dataclass(frozen=True, eq=False)
class Candidate:
    """A word to try: its arcs with their edges in time, and the solution whose states are the guess."""

    arcs: tuple[Joint, ...]
    edges: tuple[float, ...]
    source: Solution

    @property
    def key(self) -> str:
        """The word as text."""
        return str(Word(tuple(str(i) for i in range(len(self.arcs[0]))), self.arcs))

    def place(self, t: float) -> int:
        """Return the index of the arc at a time, the later one where arcs meet."""
        return int(np.clip(np.searchsorted(self.edges, t, side="right") - 1, 0, len(self.arcs) - 1))

    def guess(self) -> Solution:
        """Return the source cut at the edges."""
        lengths = np.diff(self.edges)
        return split(self.source, np.maximum(lengths, 1e-6 * lengths.sum()).tolist())


def candidate(solution: Solution, stretches: dict[str, tuple[tuple[str, float, float], ...]]) -> Candidate:
    """Return the word that the stretches of all controls spell together."""
    start, end = solution.initial_time, solution.final_time
    apart = 1e-9 * (end - start)
    times = sorted({t for row in stretches.values() for _, _, t in row[:-1] if start + apart < t < end - apart})
    edges = [start, *(t for k, t in enumerate(times) if k == 0 or t - times[k - 1] > apart), end]
    arcs = []
    for a, b in pairwise(edges):
        middle = (a + b) / 2.0
        arcs.append(tuple(Mode.parse(_mode(row, middle)) for row in stretches.values()))
    return merged(Candidate(tuple(arcs), tuple(edges), solution))


def _mode(row: tuple[tuple[str, float, float], ...], t: float) -> str:
    return next((mode for mode, a, b in row if a <= t <= b), row[-1][0])


def merged(given: Candidate) -> Candidate:
    """Return a candidate without equal neighbours."""
    keep = [0, *(k for k in range(1, len(given.arcs)) if given.arcs[k] != given.arcs[k - 1])]
    arcs = tuple(given.arcs[k] for k in keep)
    return Candidate(arcs, (*(given.edges[k] for k in keep), given.edges[-1]), given.source)


def read(problem: Problem, solution: Solution, *, plain: bool = False) -> Candidate:
    """Read the word of a direct solution, what its grid has smeared taken back, or as plainly as it stands."""
    step = (solution.final_time - solution.initial_time) / sum(len(arc.mesh) - 1 for arc in solution.arcs)
    rows = {}
    for name, row in structure_of(problem, solution).items():
        kept = list(row) if plain else _calmed(list(row), _FLUTTER * step)
        while len(kept) > 1 and not plain:
            blurred = [k for k, (mode, a, b) in enumerate(kept) if mode not in "+-" and b - a < _BLURRED * step]
            if not blurred:
                break
            _absorb(kept, blurred[0])
        rows[name] = tuple(kept)
    return candidate(solution, rows)


def _calmed(row: list[tuple[str, float, float]], shortest: float) -> list[tuple[str, float, float]]:
    """Return stretches in which every flutter from bound to bound, shorter than a few steps each time, is singular."""
    calm: list[tuple[str, float, float]] = []
    for k, (mode, a, b) in enumerate(row):
        flutters = 0 < k < len(row) - 1 and mode in "+-s" and b - a < shortest
        new = "s" if flutters and len(row) > _MANY else mode
        if calm and calm[-1][0] == new:
            calm[-1] = (new, calm[-1][1], b)
        else:
            calm.append((new, a, b))
    return calm


def _absorb(row: list[tuple[str, float, float]], k: int) -> None:
    """Divide a stretch between its neighbours."""
    _, a, b = row.pop(k)
    if k == 0:
        row[0] = (row[0][0], a, row[0][2])
    elif k == len(row):
        row[-1] = (row[-1][0], row[-1][1], b)
    else:
        middle = (a + b) / 2.0
        row[k - 1], row[k] = (row[k - 1][0], row[k - 1][1], middle), (row[k][0], middle, row[k][2])
        if row[k - 1][0] == row[k][0]:
            row[k - 1 : k + 1] = [(row[k][0], row[k - 1][1], row[k][2])]


# -- mending


def insert(given: Candidate, control: int, mode: str, t: float) -> Candidate:
    """Return a candidate with one control in another mode for a while around a time."""
    arc = given.arcs[given.place(t)]
    return planted(given, (*arc[:control], Mode.parse(mode), *arc[control + 1 :]), t)


def planted(given: Candidate, new: Joint, t: float) -> Candidate:
    """Return a candidate with all controls in given modes for a while around a time."""
    edges, k = np.array(given.edges), given.place(t)
    a, b = edges[k], edges[k + 1]
    length = _SPROUT * (b - a)
    start = float(np.clip(t - length / 2.0, a, b - length))
    start = a if start - a < 2.0 * length else b - length if b - start < 3.0 * length else start
    arc = given.arcs[k]
    arcs = (*given.arcs[:k], arc, new, arc, *given.arcs[k + 1 :])
    cut = Candidate(arcs, (*given.edges[: k + 1], start, start + length, *given.edges[k + 1 :]), given.source)
    return merged(without(cut, 0.0))


def without(given: Candidate, shortest: float) -> Candidate:
    """Return a candidate without the arcs that are no longer than the shortest; the longest one stays in any case."""
    longest = int(np.argmax(np.diff(given.edges)))  # of a horizon that shrank to a point too
    keep = [k for k, (a, b) in enumerate(pairwise(given.edges)) if b - a > shortest or k == longest]
    edges = (given.edges[0], *(given.edges[k] for k in keep[1:]), given.edges[-1])
    return Candidate(tuple(given.arcs[k] for k in keep), edges, given.source)


def mends(problem: Problem, tried: Candidate, solution: Solution) -> Iterator[Candidate]:
    """Yield the words that may mend a judged solution, the most promising first."""
    edges = (solution.initial_time, *solution.junctions.tolist(), solution.final_time)
    now = Candidate(tried.arcs, edges, solution)
    shortest = SHORTEST * (edges[-1] - edges[0])
    gone = [k for k, (a, b) in enumerate(pairwise(edges)) if b - a <= shortest]
    yield from (_dropped(now, problem, label) for label in _slack(solution))
    if gone:
        yield merged(without(now, shortest))
        yield from (_swapped(now, k) for k in gone if 0 < k < len(now.arcs) - 1)
    yield from _outside(problem, now)
    yield from _violated(problem, now)
    if solution.verdict is None:
        return
    for finding in sorted(solution.verdict.findings, key=lambda f: -f.residual):
        if finding.wants and finding.t is not None and not finding.holds:
            name = finding.where.split(",")[0]
            if name in solution.verdict.chattering:  # what it asks for is one of infinitely many more arcs
                continue
            control = problem.control_names.index(name)
            yield insert(now, control, finding.wants, finding.t)
            yield insert(now, control, "s", finding.t)


def _slack(solution: Solution) -> Iterator[str]:
    """Yield the bang stretches whose switching function never takes the right sign clearly."""
    if solution.verdict is not None:
        level = min(solution.verdict.residual, EXTREMAL)
        yield from (label for label, margin in solution.verdict.margins.items() if margin <= level)


def _dropped(given: Candidate, problem: Problem, label: str) -> Candidate:
    """Return a candidate whose control goes on with its neighbouring mode on a stretch, such as `r, stretch 2 (-)`."""
    name, _, place = label.partition(", stretch ")
    number = int(place.partition(" ")[0]) - 1
    i, row = problem.control_names.index(name), list(given.source.structure[name])
    if len(row) == 1:
        return given
    neighbour = row[number - 1][0] if number else row[1][0]
    _, a, b = row[number]
    arcs = []
    for arc, (start, end) in zip(given.arcs, pairwise(given.edges), strict=True):
        inside = a <= (start + end) / 2.0 <= b
        arcs.append((*arc[:i], Mode.parse(neighbour), *arc[i + 1 :]) if inside else arc)
    return merged(Candidate(tuple(arcs), given.edges, given.source))


def _swapped(given: Candidate, k: int) -> Candidate:
    """Return a candidate in which two controls switch in the other order around an arc without length."""
    before, after = given.arcs[k - 1], given.arcs[k + 1]
    other = tuple(b if here == a else a for a, here, b in zip(before, given.arcs[k], after, strict=True))
    return merged(Candidate((*given.arcs[:k], other, *given.arcs[k + 1 :]), given.edges, given.source))


def _outside(problem: Problem, now: Candidate) -> Iterator[Candidate]:
    """Yield what puts a bound where a law leaves the box."""
    for arc in now.source.arcs:
        for i, (low, high) in enumerate(problem.box.T):
            excess = np.maximum(low - arc.u[i], arc.u[i] - high)
            k = int(np.argmax(excess))
            if excess[k] > 1e-6 * (high - low):
                yield insert(now, i, "+" if arc.u[i, k] > high else "-", float(arc.t[k]))


def _violated(problem: Problem, now: Candidate) -> Iterator[Candidate]:
    """Yield what follows a state constraint where it is violated."""
    found = now.source.verified[0] if now.source.verified else None
    if found is None or found.path <= 1e-7:  # beyond the solver's own tolerance
        return
    constraint = next(c for c in problem.constraints if c.name == found.path_at)
    t = np.linspace(now.edges[0], now.edges[-1], 2001)
    worst = float(t[np.argmax(constraint_values(problem, now.source, constraint, t, now.source.at(t)))])
    for i in range(len(problem.control_names)):
        if constraint in laws.acting(problem, i):
            yield insert(now, i, f"b[{constraint.name}]", worst)


def starts(first: Candidate) -> Iterator[Candidate]:
    """Yield words with bang arcs where a control begins or ends singular: a given end is seldom on its surface."""
    ends = ((0, first.edges[0]), (-1, first.edges[-1]))
    places = [(k, t, i) for k, t in ends for i, mode in enumerate(first.arcs[k]) if mode.kind == "singular"]
    signs = ["+-" if _pulls(first.source, i, t) > 0 else "-+" for _, t, i in places]
    for choice in product((0, 1), repeat=len(places)):
        new = first
        for (_, t, i), pair, k in zip(places, signs, choice, strict=True):
            new = insert(new, i, pair[k], t)
        yield new
    yield from (insert(first, i, sign, t) for (_, t, i), pair in zip(places, signs, strict=True) for sign in pair)


def _pulls(solution: Solution, i: int, t: float) -> float:
    """Return how far a control at an end of the horizon is from what it is along the way."""
    nearest = solution.at(np.array([t]), "u")[i, 0]
    return float(nearest - np.median(solution.rows("u")[i]))

"""Hidden arcs: bangs shorter than a step of the grid, found by how far they carry a control off its singular law."""

from itertools import pairwise

import casadi
import numpy as np

from socp import laws
from socp.errors import MethodError
from socp.mending import Candidate, insert
from socp.misses import parameters_of
from socp.problem import Problem
from socp.solution import Arc
from socp.symbols import time

# a deviation counts from so many times the median one, which the grid's own error makes, and from this share of the
# width of the control's box
_CLEAR, _LEAST = 10.0, 0.01


def revealed(problem: Problem, first: Candidate) -> Candidate:
    """Return a candidate with a bang arc wherever a control leaves its singular law at an end of its stretch.

    The integral of the deviation over the interval there, over how far the bang is off the law, is the length of the
    arc. A neighbouring bang of the same sign explains a deviation by itself: its switch is smeared.
    """
    found = first
    for i, name in enumerate(problem.control_names):
        edges = _stretches(first, i)
        for k, (mode, a, b) in enumerate(edges):
            if mode != "s":
                continue
            beside = (edges[k - 1][0] if k else "", edges[k + 1][0] if k + 1 < len(edges) else "")
            for t, bang in _bangs(problem, first, i, (a, b)):
                if bang != beside[t > (a + b) / 2.0]:
                    found = insert(found, problem.control_names.index(name), bang, t)
    return found


def _stretches(given: Candidate, i: int) -> list[tuple[str, float, float]]:
    found: list[tuple[str, float, float]] = []
    for arc, (a, b) in zip(given.arcs, pairwise(given.edges), strict=True):
        mode = str(arc[i])
        if found and found[-1][0] == mode:
            found[-1] = (mode, found[-1][1], b)
        else:
            found.append((mode, a, b))
    return found


def _bangs(problem: Problem, given: Candidate, i: int, span: tuple[float, float]) -> list[tuple[float, str]]:
    """Return the ends of a singular stretch of control i at which it deviates clearly, with the bound it goes to."""
    t, off = _deviations(problem, given, i, span)
    if t.size < 4:  # too short a stretch to tell a deviation from the law's own course
        return []
    low, high = problem.box[:, i]
    level = max(_CLEAR * float(np.median(np.abs(off))), _LEAST * (high - low))
    ends = ((0, span[0]), (-1, span[1]))
    return [(at, "+" if off[k] > 0 else "-") for k, at in ends if abs(off[k]) > level]


def _deviations(
    problem: Problem, given: Candidate, i: int, span: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Return the middles of the grid's intervals in a stretch (k,) and the mean deviation of control i there (k,)."""
    middles: list[float] = []
    means: list[float] = []
    for modes, (a, b) in zip(given.arcs, pairwise(given.edges), strict=True):
        if not span[0] <= (a + b) / 2.0 <= span[1]:
            continue
        try:
            law = laws.arc_law(problem, modes)
        except MethodError:
            continue
        if law.costate:
            continue
        function = casadi.Function("law", [problem.x, time, problem.p], [law.control[i]])
        for arc in given.source.arcs:
            for k in range(len(arc.mesh) - 1):
                t = arc.t[arc.nodes(k, "u")]
                if a <= t.mean() <= b:
                    middles.append(float(t.mean()))
                    means.append(_mean(problem, given, arc, (k, i, function)))
    order = np.argsort(middles)
    return np.array(middles)[order], np.array(means)[order]


def _mean(problem: Problem, given: Candidate, arc: Arc, what: tuple[int, int, casadi.Function]) -> float:
    k, i, law = what
    nodes = arc.nodes(k, "u")
    x, t = arc.x[:, nodes], arc.t[nodes]
    p = np.repeat(parameters_of(problem, given.source)[:, None], t.size, axis=1)
    off = arc.u[i, nodes] - law.map(t.size)(x, t[None, :], p).full().ravel()
    ends = arc.t[arc.mesh[k : k + 2]]
    tau = (2.0 * t - ends.sum()) / np.ptp(ends)
    # the mean of the polynomial through the nodes: the first of its Legendre coefficients
    return float(np.linalg.solve(np.polynomial.legendre.legvander(tau, t.size - 1), off)[0])

"""Solve along a given word: laws on every arc, free lengths, meshes refined until the states have converged."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import final

from socp.backends import Ipopt
from socp.collocate import Mesh, uniform
from socp.meshing import refined
from socp.method import solve_collocated
from socp.nlp import Backend, Watch, silent
from socp.phases import follow
from socp.problem import Problem
from socp.schemes import lgr
from socp.simulate import scales, verify
from socp.solution import Solution
from socp.word import Word

_MISSED = 1e-9  # of the re-integrated control: collocation of smooth motion at the default tolerance stays below
_PASSES = 8  # meshes tried; each multiplies the intervals of an arc by up to four


@final
@dataclass(frozen=True)
class Follower:
    """How to solve along a word.

    points: collocation points an interval; intervals: fixed number of intervals an arc, 0 for as many as needed;
    tolerance: size of the states' last Legendre coefficients, relative, that ends refinement; boxed: impose the box of
    the controls on the values of the laws, which a right word keeps by itself.
    """

    points: int = 10
    intervals: int = 0
    tolerance: float = 1e-7
    boxed: bool = False
    backend: Backend = field(default_factory=lambda: Ipopt({"tol": 1e-11}))

    def __call__(self, problem: Problem, word: Word, guess: Solution, watch: Watch = silent) -> Solution:
        """Solve along a word from one guess; raises MethodError where a law of the word cannot be had."""
        phased = follow(problem, word)
        if self.boxed:
            phased = replace(phased, phases=tuple(replace(phase, boxed=True) for phase in phased.phases))
        meshes: Sequence[Mesh] = [uniform(lgr(self.points), self.intervals or 1)] * len(phased.phases)
        solution = solve_collocated(phased, meshes, self.backend, guess, watch)
        tolerance = self.tolerance
        for _ in range(0 if self.intervals else _PASSES):
            if not sound(problem, solution):
                break
            finer = refined(solution.arcs, scales(problem, solution), self.points, tolerance)
            if finer is None:
                if verify(problem, solution)[0].worst <= _MISSED:
                    break
                tolerance /= 100.0  # where the motion is not smooth the end of an interval is no better than its inside
                continue
            solution = solve_collocated(phased, finer, self.backend, solution, watch).after(solution)
        return solution


def sound(problem: Problem, solution: Solution) -> bool:
    """Tell whether the solver is content and the laws stay in the box, which the programme need not impose."""
    low, high = problem.box[0][:, None], problem.box[1][:, None]
    margin = 1e-6 * (high - low)  # beyond the solver's own tolerance
    return solution.stop.ok and all(((arc.u >= low - margin) & (arc.u <= high + margin)).all() for arc in solution.arcs)

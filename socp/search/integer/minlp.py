"""Mixed-integer solvers on the mixed-binary reduction: which modes, and when, from the number of
switches alone.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice, pairwise, product
from time import perf_counter
from typing import final

import casadi
import numpy as np

from socp.errors import MethodError
from socp.laws import arc_modes
from socp.model import Modes, Node, Problem, Solution, Stop, Watch, Word, final_time, silent
from socp.search.integer.bounds import reachable
from socp.search.integer.disjunctive import disjunctive
from socp.search.integer.reduction import binary_modes
from socp.search.integer.starts import starts
from socp.solvers import (
    NLP,
    Backend,
    Bonmin,
    Decomposition,
    NLPPoint,
    Outcome,
    Reduced,
    Scip,
    gurobi,
    knitro,
)
from socp.transcription import Mesh, collocate, lgr, table, uniform

_SEEDS = 12  # words a layout that a decomposition solves first
_LONGEST = (
    1.5  # horizons, over that of the direct solution, for decompositions: their cuts need bounds
)
_FIRST = (
    0.4  # of the time that a global solver has: at most so much is spent on a point to start from
)

Reduction = Reduced[NLP, Solution, NLPPoint]


@final
@dataclass(frozen=True)
class Solver:
    """A mixed-integer solver: one sentence about it, what it lacks here (empty where it can run),
    and how it runs.
    """

    about: str
    lacks: Callable[[], str]
    solve: "Callable[[Task], tuple[Reduction, Outcome]]"


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Task:
    """A problem on so many switches, its collocation points an arc, layouts to start from, and when
    to be done.
    """

    problem: Problem
    switches: int
    points: int
    layouts: Sequence[Solution]
    until: float
    watch: Watch

    @property
    def left(self) -> float:
        """Seconds left, a little at least."""
        return max(self.until - perf_counter(), 0.1)

    @property
    def meshes(self) -> list[Mesh]:
        """One interval an arc."""
        return [uniform(lgr(self.points), 1)] * (self.switches + 1)

    def reduction(self, *, collocated: bool = False) -> Reduction:
        """Return the programme."""
        return collocate(
            binary_modes(self.problem, self.switches, collocated=collocated), self.meshes
        )


def minlp(  # noqa: PLR0913, PLR0917 - what a mixed-integer solve is made of
    problem: Problem,
    solver: str,
    switches: int,
    points: int,
    time: float,
    guess: Solution,
    watch: Watch = silent,
    backend: Backend | None = None,
) -> Solution:
    """Find modes and lengths of `switches` + 1 arcs with a mixed-integer solver, in about `time`
    seconds.

    The programme is the mixed-binary reduction with `points` Legendre-Gauss-Radau points an arc.
    What comes back is the best point that was verified by casadi, lifted: its arcs have the modes
    that the binaries choose, arcs of length zero included. `stop` says why the solver stopped,
    `message` with which objective, bound and gap; `nodes` holds the solver's result with its bound.
    Where no feasible point was found the arcs are those of the start and `stop` is not ok.

    Raises MethodError for a solver that is not known or not available here, saying what is missing,
    and as `binary_modes` does.
    """
    chosen = available(solver)
    began = perf_counter()
    layouts = starts(problem, switches, guess, watch, backend)
    stopped = next((each for each in layouts if each.stop is Stop.INTERRUPTED), None)
    if stopped is not None:
        return stopped
    task = Task(
        problem=problem,
        switches=switches,
        points=points,
        layouts=layouts,
        until=began + time,
        watch=watch,
    )
    reduced, outcome = chosen.solve(task)
    return _told(problem, reduced.lift(outcome.point), outcome, perf_counter() - began)


def available(solver: str) -> Solver:
    """Return a solver; MethodError says which there are, and what one that is not available here is
    lacking.
    """
    able = ", ".join(name for name, each in SOLVERS.items() if not each.lacks()) or "none"
    if solver not in SOLVERS:
        raise MethodError(f"no mixed-integer solver '{solver}'; available here: {able}")
    lacking = SOLVERS[solver].lacks()
    if lacking:
        raise MethodError(f"solver '{solver}' is not available: {lacking}; available here: {able}")
    return SOLVERS[solver]


def _told(problem: Problem, solution: Solution, outcome: Outcome, seconds: float) -> Solution:
    """Return the lifted point with what is known of it."""
    arcs = tuple(arc.modes for arc in solution.arcs)
    word = str(Word(problem.control_names, arcs)) if outcome.found else ""
    parts = [outcome.point.message]
    if outcome.found:
        parts.append(f"feasible to {outcome.violation:.1g}, binaries to {outcome.integrality:.1g}")
    if np.isfinite(outcome.bound):
        gap = f", gap {100 * outcome.gap:.2g} %" if outcome.found else ""
        parts.append(f"proved lower bound of the discretised problem {outcome.bound:.9g}{gap}")
    objective = outcome.point.objective
    node = Node(word=word, stop=outcome.point.stop.name, objective=objective, bound=outcome.bound)
    spent = {"build": seconds - outcome.point.seconds.get("solve", 0.0), **outcome.point.seconds}
    return replace(solution, objective=objective, message="; ".join(parts)).with_effort(
        nodes=(node,), seconds=spent
    )


# -- the solvers


def _bonmin(task: Task) -> tuple[Reduction, Outcome]:
    reduced = task.reduction()
    return reduced, Bonmin()(
        reduced.problem, [reduced.push(each) for each in task.layouts], task.left, task.watch
    )


def _scip(task: Task) -> tuple[Reduction, Outcome]:
    reduced, first, nlp = _global(task)
    if first.point.stop is Stop.INTERRUPTED:
        return reduced, first
    return reduced, Scip()(nlp, [first.point], task.left, task.watch).or_better(first)


def _gurobi(task: Task) -> tuple[Reduction, Outcome]:
    reduced, first, nlp = _global(task)
    if first.point.stop is Stop.INTERRUPTED:
        return reduced, first
    return reduced, gurobi.Gurobi()(nlp, [first.point], task.left, task.watch).or_better(first)


def _knitro(task: Task) -> tuple[Reduction, Outcome]:
    reduced = task.reduction()
    begun = [reduced.push(each) for each in task.layouts]
    return reduced, knitro.Knitro()(reduced.problem, begun, task.left, task.watch)


def _global(task: Task) -> tuple[Reduction, Outcome, NLP]:
    """Return a programme, a first point of it, and the programme with the bounds that follow from
    that point.
    """
    reduced = task.reduction()
    begun = [reduced.push(each) for each in task.layouts]
    first = Bonmin()(reduced.problem, begun, _FIRST * task.left, task.watch)
    return reduced, first, with_bounds(task, reduced.problem, first)


def with_bounds(task: Task, nlp: NLP, known: Outcome) -> NLP:
    """Return a programme with bounds of states and lengths that every point no worse than the known
    one satisfies.
    """
    problem, box = task.problem, nlp.v_box.copy()
    horizon = problem.final_time_box[1] - problem.initial_time_box[0]
    fastest = casadi.is_equal(problem.mayer, final_time) and problem.lagrangian.is_zero()
    if fastest and known.found:
        horizon = min(
            horizon, known.point.objective * (1 + 1e-9) + 1e-6 - problem.initial_time_box[0]
        )
    if not np.isfinite(horizon):
        return nlp
    count, arcs = problem.x.numel(), task.switches + 1
    states = slice(
        1 + arcs + problem.p.numel(),
        1 + arcs + problem.p.numel() + count * (arcs * task.points + 1),
    )
    box[1, 1 : 1 + arcs] = np.minimum(box[1, 1 : 1 + arcs], horizon)
    reach = np.tile(
        reachable(problem, horizon, table(task.meshes[0])), (states.stop - states.start) // count
    )
    box[:, states] = [np.maximum(box[0, states], reach[0]), np.minimum(box[1, states], reach[1])]
    return replace(nlp, v_box=box)


def _decomposed(name: str, task: Task) -> tuple[Reduction, Outcome]:
    reduced = task.reduction(collocated=True)
    begun = [reduced.push(each) for each in task.layouts]
    low, high = task.problem.final_time_box
    longest = high if low == high else _LONGEST * float(np.ptp(task.layouts[0].t))
    written = disjunctive(
        task.problem, task.switches, task.points, begun[0], horizon=longest, elementary=True
    )
    solver = Decomposition(name, written.script, written.binaries, _seeds(task))
    return reduced, solver(reduced.problem, begun, task.left, task.watch)


def _seeds(task: Task) -> list[list[int]]:
    """Return words to try first: those of the layouts, short arcs one bang away from a
    neighbour.
    """
    combinations = arc_modes(task.problem)
    found: list[list[int]] = []
    for layout in task.layouts:
        arcs = [arc.modes for arc in layout.arcs]
        known = [k for k, modes in enumerate(arcs) if modes in combinations]
        nearest = [arcs[min(known or [k], key=partial(_apart, k))] for k in range(len(arcs))]
        options = [
            [modes] if k in known else _one_away(nearest[k], combinations)
            for k, modes in enumerate(arcs)
        ]
        words = [
            each
            for each in islice(product(*options), _SEEDS)
            if all(a != b for a, b in pairwise(each))
        ]
        found += [[combinations.index(modes) for modes in word] for word in words]
    return found


def _apart(k: int, other: int) -> int:
    return abs(k - other)


def _one_away(modes: Modes, combinations: Sequence[Modes]) -> list[Modes]:
    """Return the combinations that differ from some modes in one control, which is at a bound."""
    found = []
    for each in combinations:
        changed = [mode for mode, own in zip(each, modes, strict=True) if mode != own]
        if len(changed) == 1 and changed[0].kind in {"lower", "upper"}:
            found.append(each)
    return found


def _nothing() -> str:
    return ""


SOLVERS: Mapping[str, Solver] = {
    "bonmin": Solver(
        "branch and bound over local solves, from layouts that a direct solve shows",
        _nothing,
        _bonmin,
    ),
    "gdpopt": Solver(
        "Pyomo's logic-based outer approximation, with HiGHS and Ipopt",
        _nothing,
        partial(_decomposed, "gdpopt"),
    ),
    "mindtpy": Solver(
        "Pyomo's outer approximation of the big-M programme, with HiGHS and Ipopt",
        _nothing,
        partial(_decomposed, "mindtpy"),
    ),
    "gurobi": Solver(
        "global branch and bound with a proved lower bound, under its own licence",
        gurobi.lacks,
        _gurobi,
    ),
    "knitro": Solver(
        "branch and bound over local solves, under its own licence", knitro.lacks, _knitro
    ),
    "scip": Solver(
        "global branch and bound: a feasible point and a proved lower bound", _nothing, _scip
    ),
}

"""Problems cut into phases: one control law on each, free lengths between the switching times."""

from dataclasses import dataclass, field
from functools import partial
from typing import final

import numpy as np

from socp import laws
from socp.problem import Problem
from socp.symbols import Expr, column
from socp.word import Mode, Word


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Phase:
    """One arc as it is transcribed.

    `control` (nu, 1) is an expression of x, t, p, of `free` (nv, 1), the controls that are collocated within `box`
    (2, nv), and of `carried` (ny, 1), quantities with a `carried_rate` (ny, 1) of their own that are integrated along
    with the states: the costate, where a law needs it. `entry` holds expressions of x, carried, t, p that vanish where
    the arc begins; `kept` names the state constraints that the law itself keeps from there on: imposed again on this
    arc, they would be dependent. `length` bounds the arc's length; `boxed` imposes the box on the values of the law,
    which a right word keeps by itself.
    """

    modes: tuple[Mode, ...]
    control: Expr
    free: Expr
    box: np.ndarray
    entry: tuple[Expr, ...] = ()
    kept: frozenset[str] = frozenset()
    length: tuple[float, float] = (0.0, np.inf)
    boxed: bool = False
    carried: Expr = field(default_factory=partial(column, ()))
    carried_rate: Expr = field(default_factory=partial(column, ()))


@final
@dataclass(frozen=True, eq=False)
class PhasedProblem:
    """A problem with the phases that its horizon is cut into."""

    of: Problem
    phases: tuple[Phase, ...]


def single_phase(problem: Problem, phases: int = 1) -> PhasedProblem:
    """Return the problem with all controls collocated, in one phase or in a given number of phases of free lengths."""
    free = Word(problem.control_names, ((Mode("free"),) * len(problem.control_names),) * phases)
    return follow(problem, free)


def follow(problem: Problem, word: Word) -> PhasedProblem:
    """Return the problem on the arcs of a word: bounds and laws in place of the controls, free lengths.

    Raises MethodError where a law is asked for that the problem does not have.
    """
    phases: list[Phase] = []
    for modes in laws.resolved(problem, word).arcs:
        phases.append(_phase(problem, modes, phases[-1].kept if phases else frozenset()))
    return PhasedProblem(problem, tuple(phases))


def _phase(problem: Problem, modes: tuple[Mode, ...], kept: frozenset[str]) -> Phase:
    """Return the phase of one arc; what the arc before it has `kept` holds at its entry already."""
    law = laws.arc_law(problem, modes)
    at = [i for i, mode in enumerate(modes) if mode.kind == "free"]
    new = [constraint for constraint in problem.constraints if constraint.name in law.kept - kept]
    entry = [e for constraint in new for e in laws.tower(problem, constraint)[0]]
    if law.costate:
        carried = {"carried": problem.costate, "carried_rate": law.costate_rate}
        entry += law.costate_entry
    else:
        carried = {}
    return Phase(
        modes=modes, control=law.control, free=column(problem.u[i] for i in at), box=problem.box[:, at],
        entry=tuple(entry), kept=law.kept, **carried,
    )  # fmt: skip

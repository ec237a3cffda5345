"""Problems cut into phases: one control law on each, free lengths between the switching times."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Self, TypeVar, final

import casadi
import numpy as np

from socp import laws
from socp.errors import MethodError
from socp.model import (
    Expr,
    Mode,
    Modes,
    Problem,
    Solution,
    Word,
    cached,
    column,
    identity,
    of_motion,
    once,
    time,
)
from socp.transcription.kinks import decided

_ROUNDING = 1e-12  # of the start's values: what an entry condition leaves there that they meet

Made = TypeVar("Made")
Row = tuple[Expr, float, float]  # an expression with the bounds that it has to keep


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Choice:
    """The modes that an arc chooses among by binaries, which are constant on it.

    `z` (nz, 1) holds the binaries: one a mode of every control but its last mode, which it is in
    where none of them is 1. `modes[i]` are those of control i, `weights[i]` their shares as
    expressions of z: 1 for the mode it is in. `along` holds rows in x, free, carried, t, p, z that
    bind at every collocated node, `entry` those that bind where the arc begins, without the free
    controls.
    """

    z: Expr
    modes: tuple[Modes, ...]
    weights: tuple[tuple[Expr, ...], ...]
    along: tuple[Row, ...] = ()
    entry: tuple[Row, ...] = ()

    def values(self, modes: Modes) -> np.ndarray:
        """Return binaries (nz,) for modes; even shares where a mode is not among the choices."""
        found: list[float] = []
        for own, mode in zip(self.modes, modes, strict=True):
            known = mode in own
            found += [float(each == mode) if known else 1.0 / len(own) for each in own[:-1]]
        return np.array(found)

    def read(self, z: np.ndarray) -> Modes:
        """Return the modes that binaries (nz,) choose, those of the largest share where they are
        fractions.
        """
        found, at = [], 0
        for own in self.modes:
            shares = z[at : at + len(own) - 1]
            found.append(own[int(np.argmax([*shares, 1.0 - shares.sum()]))])
            at += len(own) - 1
        return tuple(found)


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Phase:
    """One arc as it is transcribed.

    `control` (nu, 1) is an expression of x, t, p, of `free` (nv, 1), the controls that are
    collocated within `box` (2, nv), and of `carried` (ny, 1), quantities with a `carried_rate` (ny,
    1) of their own that are integrated along with the states: the costate, where a law needs it.
    `entry` holds expressions of x, carried, t, p that vanish where the arc begins, `exit` those
    that vanish where it ends; `kept` names the state constraints that the law itself keeps from its
    entry on, `touched` those that the entry itself keeps at zero where the arc begins: imposed
    again, they would be dependent. `length` bounds the arc's length; `boxed` imposes the box on the
    values of the law, which a right word keeps by itself; `held` keeps free controls constant over
    every interval of its mesh, whose scheme collocates one end. `when` is a time between the two
    knots of the problem that an arc's piece lies between, None where it does not: the functions are
    smooth there, those of that time. Where there is a `choice`, `control` depends on its binaries
    too, and `modes` is what the arc is taken for while they are not known.
    """

    modes: Modes
    control: Expr
    free: Expr
    box: np.ndarray
    entry: tuple[Expr, ...] = ()
    exit: tuple[Expr, ...] = ()
    kept: frozenset[str] = frozenset()
    touched: frozenset[str] = frozenset()
    length: tuple[float, float] = (0.0, np.inf)
    boxed: bool = False
    held: bool = False
    carried: Expr = field(default_factory=partial(column, ()))
    carried_rate: Expr = field(default_factory=partial(column, ()))
    choice: Choice | None = None
    when: float | None = None

    @property
    def z(self) -> Expr:
        """Binaries of the arc (nz, 1), none where its modes are given."""
        return column(()) if self.choice is None else self.choice.z

    def flow(self, problem: Problem) -> tuple[Expr, Expr]:
        """Return the rate of the states (nx, 1) and the running cost under the arc's control."""
        rate, running = (
            casadi.substitute(each, problem.u, self.control) for each in self._of(problem)
        )
        return rate, running

    def at_rest(self, problem: Problem, among: Sequence[int]) -> list[int]:
        """Return which of some states stay as they are under the arc's control."""
        if not among:
            return []
        rates = casadi.substitute(self._of(problem)[0][list(among)], problem.u, self.control)
        return [i for i, rate in zip(among, rates.elements(), strict=True) if rate.is_zero()]

    def _of(self, problem: Problem) -> tuple[Expr, Expr]:
        when = self.when
        return (problem.rate, problem.lagrangian) if when is None else _at(problem, when)

    @once
    def opened(self, problem: Problem) -> tuple[Self, Expr, list[float]]:
        """Return the phase with symbols in place of the constants among its controls, and both
        (nc, 1): phases that differ in these alone are alike. A control that is 0 stays, as it
        leaves entries out.
        """
        control = casadi.vertsplit(self.control)
        at = [i for i, law in enumerate(control) if law.is_constant() and not law.is_zero()]
        rows = column(problem.u[i] if i in at else law for i, law in enumerate(control))
        symbols = casadi.vertcat(casadi.SX(0, 1), *(problem.u[i] for i in at))
        return replace(self, control=rows), symbols, [float(control[i]) for i in at]


@of_motion
@once
def _at(problem: Problem, when: float) -> tuple[Expr, Expr]:
    """Return the rate of the states and the running cost as they are between the knots around a
    time.
    """
    return decided(problem.rate, when), decided(problem.lagrangian, when)


@final
@dataclass(frozen=True, eq=False)
class PhasedProblem:
    """A problem with the phases that its horizon is cut into, and rows in the binaries of several
    of them.
    """

    of: Problem
    phases: tuple[Phase, ...]
    rules: tuple[Row, ...] = ()

    @property
    def length(self) -> float | None:
        """The length of a single phase between times that are both given, None of others.

        Held by its bounds it is a number to a solver. A variable that a row holds is a dense
        column, and convex programmes are so by cancellation alone in its products with the rates.
        """
        first, last = self.of.initial_time_box, self.of.final_time_box
        if len(self.phases) > 1 or first[0] < first[1] or last[0] < last[1]:
            return None
        (low, high), length = self.phases[0].length, last[0] - first[0]
        return length if low <= length <= high else None

    def with_phases(self, **changes: Any) -> Self:
        """Return it with the given fields of every phase replaced, such as `boxed` or `length`."""
        return replace(self, phases=tuple(replace(phase, **changes) for phase in self.phases))


def single_phase(problem: Problem, phases: int = 1) -> PhasedProblem:
    """Return the problem with all controls collocated, in one phase or in a given number of phases
    of free lengths.

    Raises MethodError for fewer than one phase.
    """
    if phases < 1:
        raise MethodError(f"{phases} phases where 1 or more are needed")
    free = Word(problem.control_names, ((Mode("free"),) * len(problem.control_names),) * phases)
    return follow(problem, free)


def follow(
    problem: Problem, word: Word, near: Solution | None = None, *, loose: bool = False
) -> PhasedProblem:
    """Return the problem on the arcs of a word: bounds and laws in place of the controls, free
    lengths.

    Unless it is `loose`, the law of a boundary arc is at its control's bound where the arc cannot
    be met or left otherwise, as far as the problem tells, or a guess or solution that is `near` and
    has the arcs of the word. Raises MethodError where a law is asked for that the problem does not
    have.
    """
    phases: list[Phase] = []
    for modes in laws.name_constraints(problem, word).arcs:
        phases.append(_phase(problem, modes, phases[-1].kept if phases else frozenset()))
    for tie in () if loose else laws.tangential_joints(problem, word, near):
        phases[tie.arc] = _tied(problem, phases, tie)
    phases[0] = replace(
        phases[0], entry=tuple(each for each in phases[0].entry if not _met(problem, each))
    )
    return PhasedProblem(problem, tuple(phases))


def _met(problem: Problem, entry: Expr) -> bool:
    """Tell whether what vanishes where the first arc begins does so by the values that the start
    gives.
    """
    (low, high), times = problem.start_box, problem.initial_time_box
    fixed = [i for i in range(low.size) if low[i] == high[i]]
    known = [*(problem.x[i] for i in fixed), *([time] if times[0] == times[1] else [])]
    values = [*(float(low[i]) for i in fixed), *([float(times[0])] if times[0] == times[1] else [])]
    at = casadi.substitute(casadi.SX(entry), column(known), column(values))
    if casadi.symvar(at):
        return False
    size = max([1.0, *map(abs, values)])
    return abs(float(casadi.evalf(at))) <= _ROUNDING * size


def _tied(problem: Problem, phases: Sequence[Phase], tie: laws.Tie) -> Phase:
    """Return a phase whose law has the value of the bound beside it at one of its ends.

    A law that is a constant has no time at which it does, and one of free controls is not known.
    """
    phase, i = phases[tie.arc], tie.control
    beside = phases[tie.arc + (1 if tie.end else -1)].modes[i]
    row = phase.control[i] - float(problem.box[int(beside.kind == "upper"), i])
    if row.is_constant() or casadi.depends_on(row, phase.free):
        return phase
    if tie.end:
        return replace(phase, exit=(*phase.exit, row))
    return replace(phase, entry=(*phase.entry, row))


def _phase(problem: Problem, modes: Modes, kept: frozenset[str]) -> Phase:
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
        modes=modes,
        control=law.control,
        free=column(problem.u[i] for i in at),
        box=problem.box[:, at],
        entry=tuple(entry),
        kept=law.kept,
        **carried,
    )


def once_along(
    problem: Problem,
    phase: Phase,
    function: Callable[..., Any],
    make: Callable[[], Made],
    *more: Any,
) -> Made:
    """Return what a function makes of a phase, and of `more`: once for all arcs of its modes
    between two knots, for as long as these have the same law; anew where it has a choice.
    """
    if phase.choice is not None:
        return make()
    known: dict[tuple[Any, ...], tuple[Expr, Made]] = cached(problem, function)
    key = phase.modes, phase.when, *more
    law, found = known.get(key, (None, None))
    if found is None or not (law is phase.control or casadi.is_equal(law, phase.control)):
        known[key] = phase.control, (found := make())
    return found


def once_alike(
    problem: Problem,
    phase: Phase,
    function: Callable[..., Any],
    make: Callable[[], Made],
    rows: Sequence[Expr] = (),
) -> Made:
    """Return what a function makes of a phase, and of rows of expressions: once for all arcs
    between two knots on which these, the controls and what is carried are the same expressions,
    whatever their modes; anew where it has a choice.
    """
    if phase.choice is not None:
        return make()
    known: dict[tuple[Any, ...], tuple[tuple[Expr, ...], Made]] = cached(problem, function)
    told = phase.control, phase.free, phase.carried, phase.carried_rate, *rows
    key = phase.when, *map(identity, told)
    if key not in known:
        known[key] = told, make()  # kept with it, told apart as they are by their places in memory
    return known[key][1]

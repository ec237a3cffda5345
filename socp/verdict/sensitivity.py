"""How an extremal moves with its data: derivatives of its objective, times, parameters and states.

The conditions of its word are as many as its unknowns, so that the implicit function theorem gives
the derivatives by one back-substitution in Newton's matrix at the solution (Kim, Maurer, CDC 2003;
Büskens, Maurer, J. Comput. Appl. Math. 120, 2000). They are those of the extremal along its word;
no other word is asked.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import numpy as np

from socp.errors import MethodError, ProblemError, SolveError
from socp.model import Problem, Sensitivities, Sensitivity, Solution, known_problem
from socp.process import one_thread
from socp.transcription import PhasedProblem, Shooting
from socp.verdict.accuracy import word_problem
from socp.verdict.newton import Conditions, Settled, System, settled

_POINTS = 10  # collocation points of pieces that are cut at kinks, as those of `polish`
# Of the largest multiplier: a limit with less may as well be left, and there are two derivatives
_WEAK = 1e-8
# Differences of order 4 in a number of the problem: with this step, of its magnitude, both their
# error and rounding are below 1e-11
_STEP = 1e-3
# and a derivative that moves a quantity by less, of its magnitude, is none
_ROUNDING = 1e-11
_WEIGHTS: Mapping[int, float] = {-2: 1 / 12, -1: -2 / 3, 1: 2 / 3, 2: -1 / 12}


@one_thread()
def derivatives(
    problem: Problem,
    solution: Solution,
    to: Sequence[str] = (),
    at: Sequence[float] = (),
) -> Sensitivities:
    """Return the derivatives of a certified solution with respect to data `to`, all that there are
    where none is named, with those of the states at times `at`.

    Data are the values that hold at the ends, `start.x`, `end.x`, `initial_time`, `final_time`,
    parameters with equal bounds, named constants, levels of end conditions, `target.NAME`, and
    finite bounds of controls and states, `u.upper`, `x.lower`. What is within the rounding of its
    quantity is 0. Raises MethodError for what is no datum, SolveError where there are no
    derivatives, with the reason; where none is named, data without one are `missing` in its place.
    """
    found, missing = [], dict[str, str]()
    with np.errstate(all="ignore"):
        system = _system(problem, solution)
        for name in to or data_values(problem):
            try:
                found.append(_rounded(system, _derived(system, name, at)))
            except SolveError as error:
                if to:
                    raise
                missing[name] = str(error)
    return Sensitivities(
        problem=problem.name,
        word=solution.word,
        junctions=tuple(solution.junctions.tolist()),
        states=problem.state_names,
        derivatives=tuple(found),
        missing=missing,
    )


def sensitivity_view(
    solution: Solution,
    problem: Problem | None = None,
    to: Sequence[str] = (),
    at: Sequence[float] = (),
) -> Sensitivities:
    """Return the derivatives of a solution as its method `sensitivity` does."""
    found = problem or known_problem(solution)
    if found is None:
        raise MethodError(
            "the solution carries no problem; give one: solution.sensitivity(problem)"
        )
    return derivatives(found, solution, to, at)


def data_values(problem: Problem) -> dict[str, float]:
    """Return the data of a problem that a solution may be derived by, and their values; 0 for the
    level of an end condition.
    """
    rows = [
        *((f"start.{n}", b) for n, b in zip(problem.state_names, problem.start_box.T, strict=True)),
        *((f"end.{n}", b) for n, b in zip(problem.state_names, problem.end_box.T, strict=True)),
        *zip(problem.parameter_names, problem.parameter_box.T, strict=True),
        *((name, np.full(1, each.value)) for name, each in problem.constants.items()),
        ("initial_time", np.array(problem.initial_time_box)),
        ("final_time", np.array(problem.final_time_box)),
        *((f"target.{each.name}", np.zeros(1)) for each in problem.conditions),
    ]
    bounds = ((problem.control_names, problem.box), (problem.state_names, problem.state_box))
    for names, box in bounds:
        for name, (low, high) in zip(names, box.T, strict=True):
            rows += [(f"{name}.lower", np.full(1, low)), (f"{name}.upper", np.full(1, high))]
    ends = ((name, box[np.isfinite(box)]) for name, box in rows)
    return {name: float(np.abs(box).max()) for name, box in ends if box.size}


def _rounded(system: "_System", found: Sensitivity) -> Sensitivity:
    """Return derivatives with 0 for what is within the rounding of its quantity: a change of the
    datum by its magnitude, 1 at least as its differences are made, moves it by less.
    """
    solution, change = system.solution, max(data_values(system.problem)[found.to], 1.0)
    horizon = max(abs(solution.initial_time), abs(solution.final_time))
    sizes = np.abs(solution.rows("x")).max(axis=1)

    def kept(value: float, size: float) -> float:
        return 0.0 if abs(value) * change <= _ROUNDING * abs(size) else value

    return replace(
        found,
        objective=kept(found.objective, solution.objective),
        initial_time=kept(found.initial_time, horizon),
        junctions=tuple(kept(each, horizon) for each in found.junctions),
        final_time=kept(found.final_time, horizon),
        parameters={n: kept(v, solution.parameters[n]) for n, v in found.parameters.items()},
        states={t: tuple(map(kept, values, sizes.tolist())) for t, values in found.states.items()},
    )


@final
@dataclass(frozen=True, eq=False)
class _System:
    """The settled conditions of a word, and what was cut off its phases."""

    conditions: Conditions
    there: Settled
    phased: PhasedProblem
    pieces: list[int]
    solution: Solution

    @property
    def problem(self) -> Problem:
        return self.phased.of

    @cached_property
    def matrix(self) -> System:
        """Newton's matrix where it has settled; its last one may be from next to it."""
        return self.conditions.system(self.there.at, self.there.held)

    @cached_property
    def weak(self) -> set[str]:
        """Names of limits at the ends whose multipliers are zero."""
        rows, held = self.conditions.shooting.ends, self.there.held
        own, size = held[held.size - len(rows) :], np.abs(held).max(initial=0.0)
        pairs = zip(rows, own, strict=True)
        return {row.name for row, value in pairs if row.sign and abs(value) <= _WEAK * size}


def _system(problem: Problem, solution: Solution) -> _System:
    if not solution.extremal:
        raise SolveError("no derivatives: the solution is not certified as an extremal")
    known = word_problem(problem, solution, _POINTS)
    if known is None or known.steps is None:
        raise SolveError(
            "no derivatives: controls without laws, or explicit steps do not settle on the motion"
        )
    conditions = known.conditions()
    there = settled(conditions)
    if there is None:
        raise SolveError("no derivatives: Newton does not settle on the conditions of the word")
    system = _System(conditions, there, known.phased, known.pieces, solution)
    if system.matrix.open(np.eye(there.at.size)).any():
        raise SolveError("no derivatives: the conditions of the word leave a direction open")
    if system.matrix.deficient:
        raise SolveError(
            "no derivatives: conditions of the word depend on one another, as where two controls "
            "switch at one time; a change of the data parts them"
        )
    if system.weak:
        raise SolveError(
            f"no derivatives: {', '.join(sorted(system.weak))} is met without being needed, and a "
            "change of the data may leave it"
        )
    return system


@final
@dataclass(frozen=True, eq=False)
class _Change:
    """Partial derivatives by a datum at fixed variables: slope of the Lagrangian (n,), equations
    (m,), the Lagrangian itself, and the shootings of changed problems with their weights.
    """

    slope: np.ndarray
    equations: np.ndarray
    lagrangian: float
    changed: Sequence[tuple[float, Shooting]] = ()


def _derived(system: _System, name: str, at: Sequence[float]) -> Sensitivity:
    change = _change(system, name)
    moved, _ = system.matrix.step(change.slope, change.equations)
    if not np.isfinite(moved).all():
        raise SolveError(f"no derivative by {name}: the conditions contradict one another")
    count = len(system.phased.phases)
    times = np.cumsum(moved[: 1 + count])[np.cumsum([0, *system.pieces])]
    names = system.problem.parameter_names
    return Sensitivity(
        to=name,
        objective=change.lagrangian,
        initial_time=float(times[0]),
        junctions=tuple(times[1:-1].tolist()),
        final_time=float(times[-1]),
        parameters=dict(
            zip(names, moved[1 + count : 1 + count + len(names)].tolist(), strict=True)
        ),
        states={float(t): _state(system, moved, change, float(t)) for t in at},
    )


def _change(system: _System, name: str) -> _Change:
    """Return the partial derivatives by a datum."""
    rows, (at, held) = system.conditions.shooting.ends, (system.there.at, system.there.held)
    names = [row.name for row in rows]
    if name in names:  # its row is an expression less the value
        equations = np.zeros(held.size)
        place = held.size - len(rows) + names.index(name)
        equations[place] = -1.0
        return _Change(np.zeros(at.size), equations, -float(held[place]))
    symbol, _, end = name.rpartition(".")
    known = data_values(system.problem)
    if name not in known:
        raise MethodError(f"'{name}' is no datum of the problem; there are {', '.join(known)}")
    if name in system.problem.constants:
        value = system.problem.constants[name].value
        return _varied(system, name, value, lambda new: system.problem.with_(**{name: new}))
    if end not in {"lower", "upper"}:  # a limit at an end that is not met
        return _Change(np.zeros(at.size), np.zeros(held.size), 0.0)
    bounds = system.problem.bounds
    own = next(each for each in bounds if each.name() == symbol)
    low, high = bounds[own]

    def moved(new: float) -> Problem:
        pair = (new, high) if end == "lower" else (low, new)
        return replace(system.problem, bounds={**bounds, own: pair})

    return _varied(system, name, float((low if end == "lower" else high) or 0.0), moved)


def _varied(
    system: _System, name: str, value: float, changed: Callable[[float], Problem]
) -> _Change:
    """Return the partial derivatives by a number of the problem, by differences of the conditions
    at fixed variables.
    """
    shooting, step = system.conditions.shooting, _STEP * max(abs(value), 1.0)
    at, held = system.there.at, system.there.held
    slope, equations, lagrangian, flows = np.zeros(at.size), np.zeros(held.size), 0.0, []
    active = frozenset((row.name, row.sign) for row in shooting.ends if row.sign)
    for side, weight in _WEIGHTS.items():
        try:
            problem = changed(value + side * step)
        except ProblemError as error:
            raise SolveError(f"no derivative by {name}: moved by {step:g}, {error}") from None
        known = word_problem(problem, system.solution, _POINTS)
        if known is None or known.pieces != system.pieces:
            raise SolveError(f"no derivative by {name}: kinks move with it")
        there = Shooting(known.phased, shooting.solution, shooting.steps, active=active)
        if there.signs.size != held.size:
            raise SolveError(f"no derivative by {name}: it is met at an end of the horizon")
        values = Conditions(there).values(at, held)
        slope += weight / step * values[0]
        equations += weight / step * values[1]
        lagrangian += weight / step * (values[2] + float(held @ values[1]))
        flows.append((weight / step, there))
    return _Change(slope, equations, lagrangian, flows)


def _state(system: _System, moved: np.ndarray, change: _Change, t: float) -> tuple[float, ...]:
    """Return the derivative of the states (nx,) at a time that stays."""
    shooting, at = system.conditions.shooting, system.there.at
    corners = np.cumsum(at[: 1 + len(shooting.pairs)])
    if not corners[0] <= t <= corners[-1]:
        raise MethodError(f"time {t:g} is outside the horizon, {corners[0]:g} to {corners[-1]:g}")
    k = min(int(np.searchsorted(corners[1:-1], t, side="right")), len(shooting.pairs) - 1)
    arc, nx = shooting.pairs[k][1], system.problem.x.numel()
    shares = (arc.t[arc.mesh] - arc.t[0]) / (arc.t[-1] - arc.t[0])
    begins = corners[k] + at[1 + k] * shares
    j = int(np.clip(np.searchsorted(begins, t, side="right") - 1, 0, shares.size - 2))
    start = float(np.sum(moved[: 1 + k]) + shares[j] * moved[1 + k])
    first = 1 + len(shooting.pairs)
    p = slice(first, first + system.problem.p.numel())
    z, dz = (shooting.split(each)[2][k][:, [j]] for each in (at, moved))
    begin, length = begins[j : j + 1], t - begins[j : j + 1]
    given = [z, begin[None, :], length[None, :], at[p][:, None]]
    by_z, by_t, by_h, by_p = np.split(
        shooting.motions[k].sweep(given, shooting.steps[k]).slopes[0],
        [len(z), len(z) + 1, len(z) + 2],
        axis=1,
    )
    found = by_z @ dz[:, 0] + (by_t - by_h)[:, 0] * start + by_p @ moved[p]
    for weight, other in change.changed:
        ended = other.motions[k].moved(z, begin, length, at[p], other.steps[k])[-1]
        found = found + weight * ended[:-1, 0]
    return tuple(found[:nx].tolist())

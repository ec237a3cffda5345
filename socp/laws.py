"""Control laws on arcs: derived from the problem by Pontryagin's principle, or given by the user and checked against it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import final
from weakref import WeakKeyDictionary

import casadi
import numpy as np

from socp import eliminate, extremal
from socp import points as sampled
from socp.brackets import extended, hamiltonian_value, total_derivative
from socp.errors import MethodError
from socp.extremal import Contact, Setting, tower
from socp.problem import Constraint, Problem
from socp.singular import Chain, chain, matrix_of
from socp.symbols import Expr, column
from socp.word import Mode, Word

__all__ = [
    "ArcLaw", "Extremal", "acting", "arc_law", "derive", "extremal_arc", "hamiltonian_value", "resolved", "total_derivative", "tower",
]  # fmt: skip

Modes = tuple[Mode, ...]


@final
@dataclass(frozen=True, eq=False)
class ArcLaw:
    """Control (nu, 1) on an arc, conditions that vanish at its entry, and the state constraints that it keeps active.

    `control` is an expression of x, t, p, of the problem's symbols of free controls and, where `costate` is true, of
    `problem.costate`: then `costate_rate` (nx, 1) is lambda' on the arc and `costate_entry` vanishes where the arc begins,
    in x, lambda, t, p. It fixes the costate's length where the conditions leave that open.
    """

    control: Expr
    entry: tuple[Expr, ...]
    kept: frozenset[str]
    costate_rate: Expr = None
    costate_entry: tuple[Expr, ...] = ()

    @property
    def costate(self) -> bool:
        """Tell whether the costate has to be carried along the arc."""
        return self.costate_rate is not None


@final
@dataclass(frozen=True, eq=False)
class Extremal:
    """What Pontryagin's principle says on an arc, in x, lambda (`problem.costate`), t, p and the constant controls.

    `control` (nu, 1) with the costate; `feedback` (nu, 1) without it or None, `hamiltonian` telling whether it needs the known
    value of H; `orders` by singular control and by state constraint; `conditions` (m, 1) vanish all along the arc, among them
    every sigma; `entry` (k, 1) are the state equations c = .. = c^(q-1) = 0; `surface` (j, 1) are consequences in x, t, p alone;
    `multipliers` mu >= 0 by constraint name, with lambda' = -H_x - sum mu dc/dx = `costate_rate`; `legendre_clebsch` (s, s) over
    the singular controls must be positive semidefinite; `points` (nv, n), see `socp.points`, lie on the arc's surface.
    """

    control: Expr
    feedback: Expr | None
    hamiltonian: bool
    orders: dict[str, int]
    conditions: Expr
    entry: Expr
    surface: Expr
    multipliers: dict[str, Expr]
    costate_rate: Expr
    legendre_clebsch: Expr
    points: np.ndarray


@final
@dataclass(eq=False)
class _Known:
    """Laws already derived for one problem."""

    extremals: dict[tuple[Modes, bool], Extremal] = field(default_factory=dict)
    laws: dict[Modes, ArcLaw] = field(default_factory=dict)
    acting: dict[int, tuple[Constraint, ...]] = field(default_factory=dict)


_CACHE: WeakKeyDictionary[Problem, _Known] = WeakKeyDictionary()


def arc_law(problem: Problem, modes: Modes) -> ArcLaw:
    """Return the control law of an arc: given by the problem where it gives one, derived otherwise.

    Raises MethodError, naming the control and the case, where the law is ambiguous, degenerate or cannot be derived.
    """
    laws = _known(problem).laws
    if modes not in laws:
        laws[modes] = _arc_law(problem, modes)
    return laws[modes]


def extremal_arc(problem: Problem, modes: Modes) -> Extremal:
    """Return all that the principle says on an arc with these modes; free controls count as known functions of time.

    Raises MethodError as `arc_law` does; laws that the user gives play no part.
    """
    return _extremal(problem, modes, constant=False)


def derive(problem: Problem, singular: tuple[str, ...] = (), boundary: Mapping[str, str] | None = None) -> Extremal:
    """Return what the principle says where some controls are singular, some on constraints, the others constant, whatever their value.

    `boundary` names a state constraint by control. The constant controls keep the problem's symbols. Raises MethodError.
    """
    on = boundary or {}
    kinds = {name: Mode("singular") for name in singular} | {name: Mode("boundary", on[name]) for name in on}
    return _extremal(problem, tuple(kinds.get(name, Mode("free")) for name in problem.control_names), constant=True)


def acting(problem: Problem, control: int) -> tuple[Constraint, ...]:
    """Return the state constraints on which a control acts: those whose first controlled derivative holds it."""
    known = _known(problem).acting
    if control not in known:
        known[control] = tuple(c for c in problem.constraints if _acts(problem, c, control))
    return known[control]


def resolved(problem: Problem, word: Word) -> Word:
    """Return the word with a state constraint named on every boundary arc.

    Where several constraints act on the control, the neighbouring bang arcs tell: before contact the control drives c up to
    zero, after it away from zero. Raises MethodError, listing the names, where they do not.
    """
    arcs = [tuple(_named(problem, word, k, i) for i in range(len(arc))) for k, arc in enumerate(word.arcs)]
    return Word(word.controls, tuple(arcs))


def _known(problem: Problem) -> _Known:
    return _CACHE.setdefault(problem, _Known())


def _acts(problem: Problem, constraint: Constraint, control: int) -> bool:
    try:
        held, top = tower(problem, constraint)
    except MethodError:
        return False
    at = sampled.onto(problem, column(held), sampled.admissible(problem))
    slope = casadi.jacobian(top, problem.u[control])
    return bool(slope.nnz() and (not at.shape[1] or sampled.nonzero(problem, slope, at).all()))


# -- words


def _named(problem: Problem, word: Word, k: int, i: int) -> Mode:
    mode = word.arcs[k][i]
    if mode.kind != "boundary" or mode.constraint is not None:
        return mode
    candidates = acting(problem, i)
    row = [arc[i] for arc in word.arcs]
    before = next((m.kind for m in reversed(row[:k]) if m != mode), None)
    after = next((m.kind for m in row[k + 1 :] if m != mode), None)
    fitting = [c for c in candidates if _fits(problem, c, i, (before, after))]
    if len(candidates) > 1 and len(fitting) == 1:
        return Mode("boundary", fitting[0].name)
    return Mode("boundary", _followed(problem, i, mode).name)


def _fits(problem: Problem, constraint: Constraint, i: int, around: tuple[str | None, str | None]) -> bool:
    """Tell whether bang neighbours can enter and leave a constraint: c^(q) < 0 after it, (-1)^q c^(q) < 0 before."""
    held, top = tower(problem, constraint)
    at = sampled.onto(problem, column(held), sampled.admissible(problem))
    slopes = sampled.evaluator(problem, casadi.jacobian(top, problem.u[i]))(at)[0].ravel()
    if not slopes.size or slopes.min() * slopes.max() <= 0:
        return False
    push = {"upper": 1, "lower": -1}
    before, after = (push.get(kind or "", 0) * int(np.sign(slopes[0])) for kind in around)
    return bool((before or after) and before * (-1) ** len(held) <= 0 and after <= 0)


def _followed(problem: Problem, i: int, mode: Mode) -> Constraint:
    """Return the constraint that a boundary mode follows, if it can be told from the mode alone."""
    name, candidates = problem.control_names[i], acting(problem, i)
    listed = " or ".join(f"b[{c.name}]" for c in candidates) or "none does"
    if mode.constraint is None and len(candidates) == 1:
        return candidates[0]
    if mode.constraint is None:
        question = "which state constraint does the boundary arc follow? Write" if candidates else "no state constraint depends on it:"
        raise MethodError(f"problem '{problem.name}', control '{name}': {question} {listed}")
    found = next((c for c in problem.constraints if c.name == mode.constraint), None)
    if found is None:
        known = ", ".join(c.name for c in problem.constraints) or "none"
        raise MethodError(f"problem '{problem.name}' has no state constraint '{mode.constraint}' for control '{name}' to follow; it has {known}")
    return found


# -- one arc


def _arc_law(problem: Problem, modes: Modes) -> ArcLaw:
    setting = _setting(problem, modes, constant=False)
    given = {i: law for i in setting.singular if (law := given_singular(problem, i)) is not None}
    given |= {j: law for j, c in setting.boundary.items() if (law := given_boundary(problem, j, c)) is not None}
    if all(i in given for i in setting.singular):
        touch = extremal.contact(_setting(problem, modes, constant=False, given=given))
        control, carried = touch.control, None
    else:
        found = extremal_arc(problem, modes)
        touch = Contact(found.control, _towers(setting), extremal.flow(problem, found.control))
        control, carried = (found.feedback, None) if found.feedback is not None else (found.control, found)
    control = column(given.get(i, control[i]) for i in range(control.numel()))
    _inside(problem, setting, control)
    kept, entry = frozenset(touch.towers), tuple(casadi.vertsplit(touch.held)) if touch.towers else ()
    if carried is None:
        return ArcLaw(control, entry, kept)
    return ArcLaw(control, entry, kept, carried.costate_rate, _costate_entry(problem, carried))


def _towers(setting: Setting) -> dict[str, list[Expr]]:
    return {c.name: tower(setting.problem, c, setting.given)[0] for c in setting.boundary.values()}


def _costate_entry(problem: Problem, found: Extremal) -> tuple[Expr, ...]:
    conditions = casadi.vertsplit(found.conditions)
    if extremal.homogeneous(problem):
        conditions.append(casadi.sumsqr(problem.costate) - 1)
    return tuple(conditions)


def _inside(problem: Problem, setting: Setting, control: Expr) -> None:
    """Refuse a law that is a constant outside the bounds: no such arc is admissible."""
    for i in (*setting.singular, *setting.boundary):
        if control[i].is_constant() and not problem.box[0, i] <= float(control[i]) <= problem.box[1, i]:
            name, low, high = problem.control_names[i], *problem.box[:, i]
            raise MethodError(f"{setting.name()}: its law {name} = {float(control[i]):g} lies outside the bounds ({low:g}, {high:g})")


def given_singular(problem: Problem, i: int) -> Expr | None:
    """Return the singular law that the user gives for control i, if any."""
    return next((casadi.SX(law) for control, law in problem.singular.items() if control.name() == problem.control_names[i]), None)


def given_boundary(problem: Problem, j: int, constraint: Constraint) -> Expr | None:
    """Return the boundary law that the user gives for control j on a constraint, if any."""
    given = next((law for control, law in problem.boundary.items() if control.name() == problem.control_names[j]), None)
    law = given.get(constraint.name) if isinstance(given, Mapping) else given
    return None if law is None else casadi.SX(law)


def _setting(problem: Problem, modes: Modes, *, constant: bool, given: Mapping[int, Expr] | None = None) -> Setting:
    """Return the setting of an arc; laws `given` for singular controls make these known."""
    values, singular, boundary, varying = [], [], {}, []
    for i, mode in enumerate(modes):
        value = problem.u[i]
        if mode.kind in {"lower", "upper"}:
            value = problem.box[int(mode.kind == "upper"), i]
        elif mode.kind == "boundary":
            boundary[i] = _followed(problem, i, mode)
        elif mode.kind == "singular" and i in (given or {}):
            value = (given or {})[i]
        elif mode.kind == "singular":
            singular.append(i)
        elif not constant:
            varying.append(problem.u[i])
        values.append(value)
    return Setting(problem, column(values), tuple(singular), boundary, column(varying))


def _extremal(problem: Problem, modes: Modes, *, constant: bool) -> Extremal:
    known = _known(problem).extremals
    if (modes, constant) not in known:
        setting = _setting(problem, modes, constant=constant)
        touch = extremal.contact(setting)
        known[modes, constant] = _with_singular(setting, touch) if setting.singular else _without_singular(setting, touch)
    return known[modes, constant]


def _without_singular(setting: Setting, touch: Contact) -> Extremal:
    z = extended(setting.problem)
    conditions = column(casadi.mtimes(row, z) for row in touch.rows)
    points = sampled.onto(setting.problem, extremal.equations(setting, touch, touch.rows), sampled.admissible(setting.problem))
    return Extremal(
        control=touch.control, feedback=touch.control, hamiltonian=False, orders={c: len(held) for c, held in touch.towers.items()},
        conditions=conditions, entry=touch.held, surface=casadi.SX(0, 1), multipliers=_multipliers(touch, z, {}),
        costate_rate=_costate_rate(touch, z), legendre_clebsch=casadi.SX(0, 0), points=points,
    )  # fmt: skip


def _with_singular(setting: Setting, touch: Contact) -> Extremal:
    problem, z = setting.problem, extended(setting.problem)
    found = chain(setting, touch)
    law, feedback = eliminate.with_costate(setting, found), eliminate.feedback(setting, found)
    names = [problem.control_names[i] for i in setting.singular]
    put = {"symbols": setting.unknown, "values": law}
    return Extremal(
        control=casadi.substitute(touch.control, setting.unknown, law),
        feedback=None if feedback is None else casadi.substitute(touch.control, setting.unknown, feedback.control),
        hamiltonian=feedback is not None and feedback.hamiltonian,
        orders=dict(zip(names, found.orders, strict=True)) | {c: len(held) for c, held in touch.towers.items()},
        conditions=column(casadi.mtimes(row, z) for row in found.rows),
        entry=touch.held,
        surface=eliminate.surface(setting, found),
        multipliers=_multipliers(touch, z, put),
        costate_rate=casadi.substitute(_costate_rate(touch, z), setting.unknown, law),
        legendre_clebsch=_legendre_clebsch(found, z),
        points=found.points,
    )


def _multipliers(touch: Contact, z: Expr, put: Mapping[str, Expr]) -> dict[str, Expr]:
    found = {name: casadi.mtimes(row, z) for name, row in touch.multipliers.items()}
    return {name: casadi.substitute(e, put["symbols"], put["values"]) for name, e in found.items()} if put else found


def _costate_rate(touch: Contact, z: Expr) -> Expr:
    return casadi.mtimes(touch.flow.matrix, z)[: z.numel() - 1]


def _legendre_clebsch(found: Chain, z: Expr) -> Expr:
    """Return (-1)^q d/du sigma^(2q) over the singular controls (s, s); it must be positive semidefinite where H is minimised."""
    signs = casadi.diag(column((-1) ** q * factor for q, factor in zip(found.orders, found.factors, strict=True)))
    return casadi.mtimes(signs, matrix_of(found.slopes, z))

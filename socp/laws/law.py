"""Control laws on arcs: derived from the problem by Pontryagin's principle, or as the user gives
them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, final

import casadi

from socp.errors import MethodError
from socp.laws.principle import ArcPrinciple, at_any_bounds, extremal_arc, setting_of
from socp.laws.setting import Setting, contact, homogeneous, length_fixed, tower
from socp.model import Constraint, Expr, Modes, Problem, column, identity, of_motion, once


@final
@dataclass(frozen=True, eq=False)
class ArcLaw:
    """Control (nu, 1) on an arc, conditions that vanish at its entry, and the state constraints
    that it keeps active.

    `control` is an expression of x, t, p, of the problem's symbols of free controls and, where
    `costate` is true, of `problem.costate`: then `costate_rate` (nx, 1) is lambda' on the arc, and
    `costate_entry` vanishes where the arc begins, in x, lambda, t, p. It fixes the costate's length
    where the conditions leave that open.
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


@of_motion
@once
def arc_law(problem: Problem, modes: Modes) -> ArcLaw:
    """Return the control law of an arc: given by the problem where it gives one, derived otherwise.

    Raises MethodError, naming the control and the case, where the law is ambiguous, degenerate or
    cannot be derived.
    """
    setting = setting_of(problem, modes, constant=False)
    given = {i: law for i in setting.singular if (law := given_singular(problem, i)) is not None}
    carried = None
    if not (setting.singular or setting.boundary):
        control = setting.given
    elif not setting.singular:
        control = extremal_arc(problem, modes).touch.control
    elif all(i in given for i in setting.singular):
        values = enumerate(setting.given.elements())
        known = column(given.get(i, value) for i, value in values)
        control = contact(replace(setting, given=known, singular=())).control
    else:
        control = _shared(problem, modes)
        if control is None:
            found = extremal_arc(problem, modes)
            carried = found if found.feedback is None else None
            control = found.control if found.feedback is None else found.feedback
    given |= {
        j: law
        for j, c in setting.boundary.items()
        if (law := given_boundary(problem, j, c)) is not None
    }
    control = column(_as_before(problem, given.get(i, control[i])) for i in range(control.numel()))
    _inside(problem, setting, control)
    own = setting.given if setting.known else None
    kept = {c.name: tower(problem, c, own)[0] for c in setting.boundary.values()}
    entry = tuple(e for held in kept.values() for e in held)
    if carried is None:
        return ArcLaw(control, entry, frozenset(kept))
    return ArcLaw(
        control, entry, frozenset(kept), carried.costate_rate, _costate_entry(problem, carried)
    )


def _as_before(problem: Problem, law: Expr) -> Expr:
    """Return the law (1, 1) of another arc that has the same operations, if any, else the law
    itself: what is built for one serves both.
    """
    if law.is_constant():
        return law
    symbols = casadi.vertcat(*casadi.symvar(law))
    said = casadi.Function("law", [symbols], [law]).serialize()
    return _laws(problem).setdefault((said, *identity(symbols)), law)


@of_motion
@once
def _laws(_problem: Problem) -> dict[tuple[Any, ...], Expr]:
    """Return the laws of arcs by their operations and symbols."""
    return {}


def given_singular(problem: Problem, i: int) -> Expr | None:
    """Return the singular law that the user gives for control i, if any."""
    return next(
        (
            casadi.SX(law)
            for control, law in problem.singular.items()
            if control.name() == problem.control_names[i]
        ),
        None,
    )


def given_boundary(problem: Problem, j: int, constraint: Constraint) -> Expr | None:
    """Return the boundary law that the user gives for control j on a constraint, if any."""
    given = next(
        (
            law
            for control, law in problem.boundary.items()
            if control.name() == problem.control_names[j]
        ),
        None,
    )
    law = given.get(constraint.name) if isinstance(given, Mapping) else given
    return None if law is None else casadi.SX(law)


def _shared(problem: Problem, modes: Modes) -> Expr | None:
    """Return the feedback (nu, 1) of the arc with its bang controls left open, their values put in,
    where the law turns out not to depend on these.
    """
    general = at_any_bounds(problem, modes)
    if general is None:
        return None
    try:
        law = general.feedback
    except MethodError:
        return None
    at = [i for i, mode in enumerate(modes) if mode.kind in {"lower", "upper"}]
    bangs = column(problem.u[i] for i in at)
    if law is None or any(
        casadi.depends_on(law[i], bangs) for i in range(len(modes)) if i not in at
    ):
        return None
    values = column(problem.box[int(modes[i].kind == "upper"), i] for i in at)
    return casadi.substitute(law, bangs, values)


def _costate_entry(problem: Problem, principle: ArcPrinciple) -> tuple[Expr, ...]:
    conditions = casadi.vertsplit(principle.conditions)
    if homogeneous(problem):
        conditions.append(length_fixed(problem))
    return tuple(conditions)


def _inside(problem: Problem, setting: Setting, control: Expr) -> None:
    """Refuse a law that is a constant outside the bounds: no such arc is admissible."""
    for i in (*setting.singular, *setting.boundary):
        if (
            control[i].is_constant()
            and not problem.box[0, i] <= float(control[i]) <= problem.box[1, i]
        ):
            name, low, high = problem.control_names[i], *problem.box[:, i]
            raise MethodError(
                f"{setting.name()}: its law {name} = {float(control[i]):g} lies outside the "
                f"bounds ({low:g}, {high:g})"
            )

"""What Pontryagin's principle says on an arc: controls, costate, multipliers, orders,
Legendre-Clebsch condition.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import casadi
import numpy as np

from socp.errors import LateError, MethodError
from socp.laws import elimination as eliminate
from socp.laws import probes
from socp.laws.brackets import extended_costate
from socp.laws.contacts import constraint_of
from socp.laws.setting import Contact, Setting, contact, equations
from socp.laws.singular import Derivatives, derivatives, matrix_of
from socp.model import Expr, Mode, Modes, Problem, cached, column, of_motion, once
from socp.process import in_time

# Times what was spent on a law in vain: with less time than that there is no use in beginning anew
_LONGER = 2.0


@final
@dataclass(frozen=True, eq=False)
class ArcPrinciple:
    """What Pontryagin's principle says on an arc, in x, lambda (`problem.costate`), t, p and the
    constant controls.

    - control (nu, 1) with the costate; feedback (nu, 1) without it or None; hamiltonian: it
      needs the known value of H;
    - orders by singular control and by state constraint;
    - conditions (m, 1) vanish all along the arc, among them every sigma; entry (k, 1): c = .. =
      c^(q-1) = 0;
    - multipliers mu >= 0 by constraint name, with lambda' = -H_x - sum mu dc/dx = costate_rate
      (nx, 1);
    - legendre_clebsch (s, s) over the singular controls must be positive semidefinite;
    - equations (e, 1): all that vanishes on the arc, H = const included; points (nv, n)
      (`socp.laws.probes`) satisfy them.
    """

    control: Expr
    feedback: Expr | None
    hamiltonian: bool
    orders: dict[str, int]
    conditions: Expr
    entry: Expr
    multipliers: dict[str, Expr]
    costate_rate: Expr
    legendre_clebsch: Expr
    equations: Expr
    points: np.ndarray
    derivatives: tuple[Setting, Derivatives] | None = None

    @property
    def surface(self) -> Expr:
        """Equations (j, 1) in x, t, p alone that follow for the states of a singular arc."""
        return casadi.SX(0, 1) if self.derivatives is None else eliminate.surface(*self.derivatives)


def extremal_arc(problem: Problem, modes: Modes) -> ArcPrinciple:
    """Return all that the principle says on an arc with these modes; free controls count as known
    functions of time.

    Raises MethodError as `arc_law` does; laws that the user gives play no part.
    """
    return arc(problem, modes, constant=False)


def derive(
    problem: Problem, singular: tuple[str, ...] = (), boundary: Mapping[str, str] | None = None
) -> ArcPrinciple:
    """Return what the principle says with some controls singular, some on constraints, the others
    constant.

    `boundary` names a state constraint by control. The constant controls keep the problem's
    symbols: the result holds whatever their values. Raises MethodError.
    """
    on = boundary or {}
    kinds = {name: Mode("singular") for name in singular} | {
        name: Mode("boundary", on[name]) for name in on
    }
    return arc(
        problem,
        tuple(kinds.get(name, Mode("free")) for name in problem.control_names),
        constant=True,
    )


def setting_of(
    problem: Problem, modes: Modes, *, constant: bool, given: Mapping[int, Expr] | None = None
) -> Setting:
    """Return the setting of an arc; laws `given` for singular controls make these known."""
    values, singular, boundary, varying = [], [], {}, []
    for i, mode in enumerate(modes):
        value = problem.u[i]
        if mode.kind in {"lower", "upper"}:
            value = problem.box[int(mode.kind == "upper"), i]
        elif mode.kind == "boundary":
            boundary[i] = constraint_of(problem, i, mode)
        elif mode.kind == "singular" and i in (given or {}):
            value = (given or {})[i]
        elif mode.kind == "singular":
            singular.append(i)
        elif not constant:
            varying.append(problem.u[i])
        values.append(value)
    return Setting(problem, column(values), tuple(singular), boundary, column(varying))


def arc(problem: Problem, modes: Modes, *, constant: bool) -> ArcPrinciple:
    """Return what the principle says on an arc; free controls are constants, or functions of time
    that vary freely.
    """
    found = _found(problem, modes, constant)
    if isinstance(found, MethodError):
        raise found
    return found


def forget_derivation(problem: Problem) -> None:
    """Forget the arcs for which no law was found: points noted since then may show one."""
    known = cached(problem, _found)
    for key in [key for key, found in known.items() if isinstance(found, MethodError)]:
        del known[key]


@of_motion
@once
def _spent(_problem: Problem) -> dict[tuple[Modes, bool], float]:
    """Return the seconds that went into laws which were not found in time, by arc."""
    return {}


@of_motion
@once
def _found(problem: Problem, modes: Modes, constant: bool) -> ArcPrinciple | MethodError:
    spent, began = _spent(problem), time.monotonic()
    try:
        setting = setting_of(problem, modes, constant=constant)
        if setting.singular:
            in_time(setting.name(), _LONGER * spent.get((modes, constant), 0.0))
        touch = contact(setting)
        if setting.singular:
            return _with_singular(setting, touch)
        return _without_singular(setting, touch)
    except LateError:  # what is not known for want of time is not known to be none
        took = time.monotonic() - began
        spent[modes, constant] = max(took, spent.get((modes, constant), 0.0))
        raise
    except MethodError as error:
        return error


def _without_singular(setting: Setting, touch: Contact) -> ArcPrinciple:
    z = extended_costate(setting.problem)
    conditions = column(casadi.mtimes(row, z) for row in touch.rows)
    kept = equations(setting, touch, touch.rows)
    points = probes.onto(setting.problem, kept, probes.admissible(setting.problem))
    return ArcPrinciple(
        control=touch.control,
        feedback=touch.control,
        hamiltonian=False,
        orders={c: len(held) for c, held in touch.towers.items()},
        conditions=conditions,
        entry=touch.held,
        multipliers=_multipliers(touch, z, {}),
        costate_rate=_costate_rate(touch, z),
        legendre_clebsch=casadi.SX(0, 0),
        equations=kept,
        points=points,
    )


def _with_singular(setting: Setting, touch: Contact) -> ArcPrinciple:
    problem, z = setting.problem, extended_costate(setting.problem)
    found = derivatives(setting, touch)
    in_time(setting.name())
    law, feedback = eliminate.with_costate(setting, found), eliminate.feedback(setting, found)
    names = [problem.control_names[i] for i in setting.singular]
    put = {"symbols": setting.unknown, "values": law}
    return ArcPrinciple(
        control=casadi.substitute(touch.control, setting.unknown, law),
        feedback=None
        if feedback is None
        else casadi.substitute(touch.control, setting.unknown, feedback.control),
        hamiltonian=feedback is not None and feedback.hamiltonian,
        orders=dict(zip(names, found.orders, strict=True))
        | {c: len(held) for c, held in touch.towers.items()},
        conditions=column(casadi.mtimes(row, z) for row in found.rows),
        entry=touch.held,
        multipliers=_multipliers(touch, z, put),
        costate_rate=casadi.substitute(_costate_rate(touch, z), setting.unknown, law),
        legendre_clebsch=_legendre_clebsch(found, z),
        equations=equations(setting, touch, found.rows),
        points=found.points,
        derivatives=(setting, found),
    )


def _multipliers(touch: Contact, z: Expr, put: Mapping[str, Expr]) -> dict[str, Expr]:
    found = {name: casadi.mtimes(row, z) for name, row in touch.multipliers.items()}
    return (
        {name: casadi.substitute(e, put["symbols"], put["values"]) for name, e in found.items()}
        if put
        else found
    )


def _costate_rate(touch: Contact, z: Expr) -> Expr:
    return casadi.mtimes(touch.flow.matrix, z)[: z.numel() - 1]


def _legendre_clebsch(found: Derivatives, z: Expr) -> Expr:
    """Return (-1)^q d/du sigma^(2q) over the singular controls (s, s): positive semidefinite where
    H is minimised.
    """
    signs = casadi.diag(
        column((-1) ** q * factor for q, factor in zip(found.orders, found.factors, strict=True))
    )
    return casadi.mtimes(signs, matrix_of(found.slopes, z))

"""What Pontryagin's principle says on an arc: controls, costate, multipliers, orders,
Legendre-Clebsch condition.
"""

import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import final

import casadi
import numpy as np

from socp.errors import LateError, MethodError
from socp.laws import elimination as eliminate
from socp.laws import probes
from socp.laws.brackets import extended_costate
from socp.laws.contacts import constraint_of
from socp.laws.links import LostError
from socp.laws.setting import Contact, Setting, contact, equations
from socp.laws.singular import Derivatives, along_constraints, at_values, derivatives, matrix_of
from socp.model import Expr, Mode, Modes, Problem, cached, column, of_motion, once
from socp.process import in_time

# Times what was spent on a law in vain: with less time than that there is no use in beginning anew
_LONGER = 2.0


@final
@dataclass(frozen=True, eq=False)
class ArcPrinciple:
    """What Pontryagin's principle says on an arc, in x, lambda (`problem.costate`), t, p and the
    constant controls: each worked out when it is asked for first.

    - control (nu, 1) with the costate; feedback (nu, 1) without it or None; hamiltonian: it
      needs the known value of H;
    - orders by singular control and by state constraint;
    - conditions (m, 1) vanish all along the arc, among them every sigma; entry (k, 1): c = .. =
      c^(q-1) = 0;
    - multipliers mu >= 0 by constraint name, with lambda' = -H_x - sum mu dc/dx = costate_rate
      (nx, 1);
    - legendre_clebsch (s, s) over the singular controls must be positive semidefinite;
    - equations (e, 1): all that vanishes on the arc, H = const included; points (nv, n)
      (`socp.laws.probes`) satisfy them;
    - without_costate: the singular controls of the feedback; `general` is the arc with its constant
      controls left open, of which the chain was derived, and whose law serves where it holds.
    """

    setting: Setting
    touch: Contact
    chain: Derivatives | None = None
    general: "ArcPrinciple | None" = None

    @cached_property
    def control(self) -> Expr:
        """The controls (nu, 1) with the costate."""
        return self._put(self.touch.control, self._law)

    @cached_property
    def feedback(self) -> Expr | None:
        """The controls (nu, 1) without the costate, None where there is no such law."""
        if self.chain is None:
            return self.touch.control
        found = self.without_costate
        return None if found is None else self._put(self.touch.control, found.control)

    @property
    def hamiltonian(self) -> bool:
        """Tell whether the feedback needs the known value of H."""
        return self.chain is not None and bool(
            self.without_costate and self.without_costate.hamiltonian
        )

    @cached_property
    def orders(self) -> dict[str, int]:
        """The orders of singular controls and of state constraints, by name."""
        names = [self.setting.problem.control_names[i] for i in self.setting.singular]
        own = [] if self.chain is None else zip(names, self.chain.orders, strict=True)
        return dict(own) | {c: len(held) for c, held in self.touch.towers.items()}

    @cached_property
    def conditions(self) -> Expr:
        """What vanishes all along the arc (m, 1)."""
        return column(casadi.mtimes(row, self._z) for row in self._rows)

    @property
    def entry(self) -> Expr:
        """What vanishes where the arc begins (k, 1)."""
        return self.touch.held

    @cached_property
    def multipliers(self) -> dict[str, Expr]:
        """The multipliers of state constraints, by name."""
        rows = self.touch.multipliers
        return {c: self._put(casadi.mtimes(row, self._z), self._law) for c, row in rows.items()}

    @cached_property
    def costate_rate(self) -> Expr:
        """The costate's rate (nx, 1)."""
        rate = casadi.mtimes(self.touch.flow.matrix, self._z)[: self._z.numel() - 1]
        return self._put(rate, self._law)

    @cached_property
    def legendre_clebsch(self) -> Expr:
        """(-1)^q d/du sigma^(2q) over the singular controls (s, s): positive semidefinite where H
        is minimised.
        """
        found = self.chain
        if found is None:
            return casadi.SX(0, 0)
        signs = ((-1) ** q * f for q, f in zip(found.orders, found.factors, strict=True))
        return casadi.mtimes(casadi.diag(column(signs)), matrix_of(found.slopes, self._z))

    @cached_property
    def equations(self) -> Expr:
        """All that vanishes on the arc (e, 1)."""
        return equations(self.setting, self.touch, self._rows)

    @cached_property
    def points(self) -> np.ndarray:
        """Points (nv, n) on the arc."""
        problem = self.setting.problem
        if self.chain is None:
            return probes.onto(problem, self.equations, probes.admissible(problem))
        return self.chain.points

    @property
    def surface(self) -> Expr:
        """Equations (j, 1) in x, t, p alone that follow for the states of a singular arc."""
        return (
            casadi.SX(0, 1) if self.chain is None else eliminate.surface(self.setting, self.chain)
        )

    @cached_property
    def _z(self) -> Expr:
        return extended_costate(self.setting.problem)

    @property
    def _rows(self) -> list[Expr]:
        return self.touch.rows if self.chain is None else self.chain.rows

    @cached_property
    def _law(self) -> Expr:
        """The singular controls (s, 1) with the costate."""
        if self.chain is None:
            return casadi.SX(0, 1)
        in_time(self.setting.name())
        return eliminate.with_costate(self.setting, self.chain)

    @cached_property
    def without_costate(self) -> eliminate.Feedback | None:
        """The singular controls without the costate."""
        if self.chain is None:
            return None
        shared = None if self.general is None else self.general.without_costate
        if shared is not None and eliminate.serves(self.setting, self.touch, self.chain, shared):
            return shared
        in_time(self.setting.name())
        return eliminate.feedback(self.setting, self.chain)

    def _put(self, expression: Expr, law: Expr) -> Expr:
        """Return an expression with a law (s, 1) of the singular controls put in."""
        unknown = self.setting.unknown
        return casadi.substitute(expression, unknown, law) if unknown.numel() else expression


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


@of_motion
@once
def setting_of(problem: Problem, modes: Modes, *, constant: bool) -> Setting:
    """Return the setting of an arc; free controls are constants, or functions of time."""
    values, singular, boundary, varying = [], [], {}, []
    for i, mode in enumerate(modes):
        value = problem.u[i]
        if mode.kind in {"lower", "upper"}:
            value = problem.box[int(mode.kind == "upper"), i]
        elif mode.kind == "boundary":
            boundary[i] = constraint_of(problem, i, mode)
        elif mode.kind == "singular":
            singular.append(i)
        elif not constant:
            varying.append(problem.u[i])
        values.append(value)
    return Setting(problem, column(values), tuple(singular), boundary, column(varying))


def bangs_open(modes: Modes) -> Modes:
    """Return the modes with bang controls left open: constants, whatever their values."""
    return tuple(Mode("free") if mode.kind in {"lower", "upper"} else mode for mode in modes)


def at_any_bounds(problem: Problem, modes: Modes) -> ArcPrinciple | None:
    """Return the arc with its bang controls left open, None where it has none of them, other
    controls are free, or no law was found.

    What it says in the symbols of these controls holds for their values wherever the matrix of the
    singular controls, and what was divided by, are not zero with them.
    """
    general = bangs_open(modes)
    if general == modes or any(mode.kind == "free" for mode in modes):
        return None
    with suppress(MethodError):
        return arc(problem, general, constant=True)
    return None


def arc(problem: Problem, modes: Modes, *, constant: bool) -> ArcPrinciple:
    """Return what the principle says on an arc; free controls are constants, or functions of time
    that vary freely.
    """
    constant = constant and any(mode.kind == "free" for mode in modes)  # else it is all the same
    found = _found(problem, modes, constant)
    if isinstance(found, MethodError):
        raise found
    return found


def forget_derivation(problem: Problem) -> None:
    """Forget the arcs for which no law was found, unless it is proved that there is none: points
    noted since then may show one.
    """
    known = cached(problem, _found)
    for key, found in [*known.items()]:
        proved = isinstance(found, LostError) and found.proved
        if isinstance(found, MethodError) and not proved:
            del known[key]


@of_motion
@once
def _tried(_problem: Problem) -> dict[tuple[Modes, bool], int]:
    """Return from how many sets of noted points no law was found, by arc: nor from random ones."""
    return {}


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
        if not setting.singular:
            return ArcPrinciple(setting, touch)
        known = _known(setting, touch, modes)
        if known is not None:
            return ArcPrinciple(setting, touch, known[1], known[0])
        tried = _tried(problem).get((modes, constant))
        return ArcPrinciple(setting, touch, derivatives(setting, touch, tried))
    except LateError:  # what is not known for want of time is not known to be none
        took = time.monotonic() - began
        spent[modes, constant] = max(took, spent.get((modes, constant), 0.0))
        raise
    except MethodError as error:
        _tried(problem)[modes, constant] = len(probes.noted_points(problem))
        return error


def _known(
    setting: Setting, touch: Contact, modes: Modes
) -> tuple[ArcPrinciple, Derivatives] | None:
    """Return the arc with the constant controls of this one left open, and what was derived on it
    with their values put in, wherever that determines the singular controls too: one derivation
    serves all bounds, and the constraints on which a law turns out to be a number.
    """
    general = bangs_open(modes)
    kept = general == modes and all(touch.control[i].is_constant() for i in setting.boundary)
    if kept:
        general = tuple(mode if mode.kind == "singular" else Mode("free") for mode in modes)
    if general == modes or setting.varying.numel():
        return None
    with suppress(MethodError):
        known = arc(setting.problem, general, constant=True)
        if known.chain is None:
            return None
        put = along_constraints if kept else at_values
        found = put(known.chain, setting, touch)
        return None if found is None else (known, found)
    return None

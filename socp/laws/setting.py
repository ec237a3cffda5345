"""Arcs before the singular controls are known: motion, boundary controls and multipliers, and what
vanishes.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import final

import casadi
import numpy as np

from socp.errors import MethodError
from socp.laws import probes
from socp.laws.algebra import cramer, primitive, ratio
from socp.laws.brackets import (
    Flow,
    extended_costate,
    flow,
    hamiltonian_row,
    hamiltonian_value,
    silent_costates,
    switching_row,
)
from socp.model import Constraint, Expr, Problem, column, identity, numbers, of_motion, once

DEEPEST = 12  # total derivatives tried before an order is called infinite


@final
@dataclass(frozen=True, eq=False)
class Setting:
    """What is known of an arc beforehand.

    `given` (nu, 1) holds the controls that are known, as numbers or feedback in x, t, p, and the
    problem's own symbols for the others. Symbols of controls that are neither singular nor on a
    constraint are constants, unless they are in `varying`.
    """

    problem: Problem
    given: Expr
    singular: tuple[int, ...] = ()
    boundary: Mapping[int, Constraint] = field(default_factory=dict)
    varying: Expr = field(default_factory=lambda: casadi.SX(0, 1))

    @cached_property
    def unknown(self) -> Expr:
        """Symbols of the singular controls (k, 1)."""
        return column(self.problem.u[i] for i in self.singular)

    @property
    def known(self) -> bool:
        """Tell whether any control is known."""
        return identity(self.given) != identity(self.problem.u)

    @cached_property
    def energy(self) -> list[Expr]:
        """The row of H minus its value where the problem tells it, else none; controls with sigma =
        0 drop out of H.
        """
        value, problem = hamiltonian_value(self.problem), self.problem
        if value is None:
            return []
        idle = {*self.singular, *self.boundary}
        known = enumerate(self.given.elements())
        row = hamiltonian_row(problem, column(0 if i in idle else each for i, each in known))
        row[problem.x.numel()] -= value
        return [casadi.sparsify(row)]

    def name(self) -> str:
        """Return the arc in words, for messages."""
        names = self.problem.control_names
        parts = [f"{names[i]} singular" for i in self.singular] + [
            f"{names[j]} on {c.name}" for j, c in self.boundary.items()
        ]
        return f"problem '{self.problem.name}', arc with {' and '.join(parts)}"


@final
@dataclass(frozen=True, eq=False)
class Contact:
    """The boundary part of an arc.

    `control` (nu, 1) has the boundary controls put in, in x, t, p and the singular controls;
    `towers` are [c, .., c^(q-1)] by constraint name; `flow` carries the multipliers; `rows` vanish
    on the arc: sigma_j and derivatives; `multipliers` are the rows of mu by constraint name, mu >=
    0 where the constraint pushes.
    """

    control: Expr
    towers: dict[str, list[Expr]]
    flow: Flow
    rows: list[Expr] = field(default_factory=list)
    multipliers: dict[str, Expr] = field(default_factory=dict)

    @cached_property
    def held(self) -> Expr:
        """All state equations of the arc, stacked."""
        return column(e for tower in self.towers.values() for e in tower)


@of_motion
@once
def tower(
    problem: Problem, constraint: Constraint, given: Expr | None = None
) -> tuple[list[Expr], Expr]:
    """Return ([c, c', .., c^(q-1)], c^(q)) of a state constraint, q its order: c^(q) is the first
    that holds a control.

    `given` (nu, 1) may put in known controls, so that the order is that for the others. Raises
    MethodError where no control appears.
    """
    motion = flow(problem, problem.u if given is None else given)
    unknown = (
        problem.u
        if given is None
        else column(s for s in casadi.vertsplit(problem.u) if casadi.depends_on(given, s))
    )
    held = [constraint.expression]
    at = probes.points_on(problem, column(held))
    for _ in range(DEEPEST):
        derivative = motion.of_state(held[-1])
        slopes = casadi.jacobian(derivative, unknown)
        if slopes.nnz() and (not at.shape[1] or probes.nonzero(problem, slopes, at).any()):
            return held, derivative
        derivative = casadi.substitute(derivative, unknown, 0) if slopes.nnz() else derivative
        if not probes.nonzero(problem, derivative, at).any():
            break
        held.append(derivative)
        at = probes.onto(problem, column(held), at)
        if not at.shape[1]:
            break
    raise MethodError(
        f"problem '{problem.name}': no control appears in the derivatives of state constraint "
        f"'{constraint.name}' ({len(held)} tried): no boundary arc can follow it"
    )


def contact(setting: Setting) -> Contact:
    """Return the boundary controls, the costate's flow with the multipliers put in, and what
    vanishes.

    Raises MethodError where a constraint has no order, a control does not act on its constraint, or
    the multipliers stay open.
    """
    problem = setting.problem
    if not setting.boundary:
        return Contact(setting.given, {}, flow(problem, setting.given))
    own = column(problem.u[j] for j in setting.boundary)
    towers, tops = {}, []
    for j, constraint in setting.boundary.items():
        towers[constraint.name], top = _tower(setting, j, constraint)
        tops.append(top)
    matrix = casadi.jacobian(column(tops), own)
    held = column(e for held in towers.values() for e in held)
    at = probes.points_on(problem, held)
    numerators, denominator = cramer(matrix, -casadi.substitute(column(tops), own, 0))
    if len(towers) < len(setting.boundary) or not probes.nonzero(problem, denominator, at).all():
        raise MethodError(
            f"{setting.name()}: the constraints do not determine these controls one by one"
        )
    laws = _held_fixed(
        problem, held, column(ratio(numerators[k], denominator) for k in range(own.numel()))
    )
    control = casadi.substitute(setting.given, own, laws)
    return _multipliers(setting, Contact(control, towers, flow(problem, control)))


def _held_fixed(problem: Problem, held: Expr, laws: Expr) -> Expr:
    """Put numbers in place of the states that the equations `held` (m, 1) fix one by one: on u = 2
    a law u |u| is 4.
    """
    for k, value in probes.fixed_states(problem, held).items():
        laws = casadi.substitute(laws, problem.x[k], value)
    return laws


def _tower(setting: Setting, j: int, constraint: Constraint) -> tuple[list[Expr], Expr]:
    """Return the tower of a constraint that control j follows; MethodError where it does not act on
    it.
    """
    problem = setting.problem
    held, top = tower(problem, constraint)
    if setting.known:
        with suppress(MethodError):  # other controls act on it, and these are known here
            held, top = tower(problem, constraint, setting.given)
    at = probes.points_on(problem, column(held))
    slopes = probes.nonzero(problem, casadi.jacobian(top, problem.u), at)[0]
    if not slopes[j]:
        others = ", ".join(
            name for name, its in zip(problem.control_names, slopes, strict=True) if its
        )
        raise MethodError(
            f"{setting.name()}: control '{problem.control_names[j]}' does not act on "
            f"'{constraint.name}' (order {len(held)}), {others or 'no control'} does"
        )
    return held, top


def _multipliers(setting: Setting, free: Contact) -> Contact:
    """Put mu into the costate's flow: lambda' = -H_x - sum mu_k dc_k/dx, with sigma_j = 0 kept on
    the arc.
    """
    problem, n = setting.problem, setting.problem.x.numel()
    slopes = casadi.jacobian(column(c.expression for c in setting.boundary.values()), problem.x)
    at = probes.points_on(problem, free.held)
    rows, tops, pulls = [], [], []
    for j in setting.boundary:
        row = switching_row(problem, j)
        for _ in range(DEEPEST):
            rows.append(row)
            pull = casadi.mtimes(row[:n], slopes.T)
            top = free.flow.of_row(row)
            if pull.nnz() and probes.nonzero(problem, pull, at).any():
                break
            row = _without(setting, top, at)
        else:
            raise MethodError(
                f"{setting.name()}: no multiplier appears in the derivatives of its switching "
                "function"
            )
        tops.append(top)
        pulls.append(pull)
    mu = casadi.mtimes(
        casadi.inv_minor(casadi.densify(casadi.vertcat(*pulls))), casadi.vertcat(*tops)
    )
    matrix = casadi.SX(free.flow.matrix)
    matrix[:n, :] -= casadi.mtimes(slopes.T, mu)
    multipliers = {c.name: mu[k, :] for k, c in enumerate(setting.boundary.values())}
    return replace(free, flow=replace(free.flow, matrix=matrix), rows=rows, multipliers=multipliers)


def _without(setting: Setting, row: Expr, at: np.ndarray) -> Expr:
    """Return a row without the singular controls that it does not really hold; refuse one that
    holds them.
    """
    unknown, problem = setting.unknown, setting.problem
    if casadi.depends_on(row, casadi.vertcat(unknown, setting.varying)):
        value = casadi.mtimes(row, extended_costate(problem))
        if probes.nonzero(
            problem, casadi.jacobian(value, casadi.vertcat(unknown, setting.varying)), at
        ).any():
            raise MethodError(
                f"{setting.name()}: its multiplier depends on the rate of change of another "
                "control; not derived"
            )
        row = casadi.substitute(row, unknown, 0) if unknown.numel() else row
    return row


def equations(setting: Setting, touch: Contact, rows: Sequence[Expr]) -> Expr:
    """Return all that vanishes at points of the arc, as one column: rows times z, state equations,
    H where it is known.

    Where all is linear in the costate, its length is fixed to one, so that it cannot vanish.
    """
    problem = setting.problem
    stack = casadi.vertcat(*rows, *setting.energy)
    found = casadi.vertcat(casadi.mtimes(stack, extended_costate(problem)), touch.held)
    if homogeneous(problem):
        found = casadi.vertcat(found, length_fixed(problem))
    return found


@once
def homogeneous(problem: Problem) -> bool:
    """Tell whether every condition is linear in the costate alone, so that it is known up to its
    length only.
    """
    return not casadi.sparsify(problem.lagrangian).nnz() and not hamiltonian_value(problem)


@of_motion
@once
def length_fixed(problem: Problem) -> Expr:
    """Return what vanishes where a costate that is known up to its length only has the one that it
    is given.

    Where nothing but the Mayer term phi depends on a state x_j, and on x_j with a constant slope,
    lambda_j is that slope all along (Bryson, Ho, Applied Optimal Control, 1975, 2.4): a cost that
    is written as a state counts as a running cost does. Elsewhere the squares of the costates over
    their spreads sum up to one, without those that vanish all along: no row holds them, and one
    that took the length would leave the others none.
    """
    along = casadi.vertcat(problem.rate, *(c.expression for c in problem.constraints))
    ends = (c.expression for c in problem.conditions)
    fixed = casadi.vertcat(along, *ends)
    slopes = casadi.simplify(casadi.jacobian(problem.mayer, problem.x))
    for j, box in enumerate(problem.end_box.T):
        known = slopes[j].is_constant() and float(slopes[j]) and not np.isfinite(box).any()
        if known and not casadi.depends_on(fixed, problem.x[j]):
            return problem.costate[j] - float(slopes[j])
    sizes = probes.spread(problem)[1 + problem.x.numel() + problem.p.numel() :]
    heard = casadi.SX(problem.costate / sizes[: problem.x.numel()])
    heard[silent_costates(problem)] = 0
    return casadi.sumsqr(heard) - 1


def at_length(problem: Problem, costate: np.ndarray) -> np.ndarray:
    """Return costates (nx, n) multiplied so that the first ones have the length that laws give
    them; as they are where that is not left open.
    """
    if not homogeneous(problem):
        return costate
    row = length_fixed(problem)
    if casadi.jacobian(row, problem.costate).is_constant():
        return costate
    (square,) = numbers(casadi.Function("square", [problem.costate], [row + 1]), costate[:, 0])
    return costate / np.sqrt(square) if 0.0 < square < np.inf else costate


def common_factor(row: Expr) -> tuple[Expr, Expr]:
    """Return (factor, row / factor) where entries share a factor; a lone entry of the constant
    column keeps its own.
    """
    row = casadi.sparsify(row)
    if row.nnz() and not casadi.sparsify(row[: row.numel() - 1]).nnz():
        return casadi.SX(1), row
    return primitive(row)

"""The controls of a word as a family: on an arc they are functions of X = (x, t, eta), eta the
costates that the law of a singular arc needs, and the arc is as long as one likes.

Conditions that are affine in the costates fix some of them; where there is no running cost all are
homogeneous, and one more is 1. What is left and enters the law is eta, and moves along.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import final

import casadi
import numpy as np

from socp.model import Expr, column
from socp.proof.hamilton import Hamiltonian, Loop, determined, put_in


@final
@dataclass(frozen=True, eq=False)
class Steered:
    """The motion X' = rate (n, 1) of an arc, and its running cost; `begins` is eta in z."""

    state: Expr
    rate: Expr
    running: Expr
    begins: Expr

    @cached_property
    def both(self) -> Expr:
        """(X, P) (2 n, 1), P the adjoint of X."""
        return casadi.vertcat(self.state, casadi.SX.sym("P", self.state.numel()))

    @property
    def flow(self) -> Expr:
        """(X, P)' (2 n, 1) by the Hamiltonian K = running + P . rate."""
        energy = self.running + casadi.dot(self.both[self.state.numel() :], self.rate)
        return casadi.vertcat(self.rate, -casadi.gradient(energy, self.state))


def steered(system: Hamiltonian, its: Loop, near: Callable[[Expr], np.ndarray]) -> Steered:
    """Return the motion of an arc under its law, with values of expressions `near` it."""
    z, nx = system.z, system.x.numel()
    places = list(range(nx, 2 * nx))
    affine = [e for e in its.vanishing if casadi.depends_on(e, system.costate)]
    if not system.costs:  # homogeneous: no costate would be left of as many conditions
        affine = affine[: nx - 1]
    put = determined(z, affine, near, lambda i, _: i in places)
    control = put_in(z, its.control, put)
    left = [i for i in places if i not in put]
    unit: int | None = None
    if not system.costs and any(casadi.depends_on(control, z[i]) for i in left):
        unit = max(left, key=lambda i: float(np.abs(near(z[i])).min()))
        put = {i: put_in(z, e, {unit: casadi.SX(1)}) for i, e in put.items()} | {unit: casadi.SX(1)}
        control = casadi.simplify(put_in(z, its.control, put))
    rates = _rates(system, its, put, unit)
    needed: list[int] = []
    parts = [control]
    while parts:
        part = parts.pop()
        new = [i for i in rates if i not in needed and casadi.depends_on(part, z[i])]
        needed += new
        parts += [rates[i] for i in new]
    eta = column(z[i] for i in needed)
    rate, running = (
        casadi.substitute(each, system.u, control) for each in (system.rate, system.running)
    )
    return Steered(
        casadi.vertcat(system.x, z[-1], eta),
        casadi.vertcat(rate, 1, column(rates[i] for i in needed)),
        running,
        eta if unit is None else eta / z[unit],
    )


def _rates(
    system: Hamiltonian, its: Loop, put: dict[int, Expr], unit: int | None
) -> dict[int, Expr]:
    """Return the rates of the costates that nothing fixes, or of their shares of the unit."""
    z, nx = system.z, system.x.numel()
    slopes = -casadi.gradient(system.value, system.x)
    for name, multiplier in its.multipliers.items():
        slopes -= multiplier * casadi.gradient(system.constraints[name], system.x)
    moved = put_in(z, casadi.substitute(slopes, system.u, its.control), put)
    growth = 0 if unit is None else moved[unit - nx]
    return {i: moved[i - nx] - z[i] * growth for i in range(nx, 2 * nx) if i not in put}

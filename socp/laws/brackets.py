"""Lie derivatives along an arc, written without the costate: every function of it is a row times z
= (lambda, 1).

The Hamiltonian is H = [f', L] z, a switching function sigma_i = [g_i', L_ui] z, and z' = M(x, t, p,
u) z on every arc, the multipliers of active state constraints included. The time derivative of a
row is a row again: r' = r M + dr/dt. Costates that vanish all along have no place in a row: what
they multiply tells nothing.
"""

from dataclasses import dataclass
from typing import final

import casadi

from socp.model import Expr, Problem, final_time, initial_time, of_motion, once, that_matter, time


@final
@dataclass(frozen=True, eq=False)
class Flow:
    """Motion on an arc: `rate` x' (nx, 1) and `matrix` M (nx + 1, nx + 1) of z' = M z, the arc's
    controls put in.
    """

    problem: Problem
    rate: Expr
    matrix: Expr

    def of_state(self, expression: Expr) -> Expr:
        """Return d/dt of an expression (m, 1) of x, t, p."""
        return casadi.jtimes(expression, self.problem.x, self.rate) + casadi.jacobian(
            expression, time
        )

    def of_row(self, row: Expr) -> Expr:
        """Return the row (1, nx + 1) of d/dt (row z)."""
        return casadi.mtimes(row, self.matrix) + self.of_state(row.T).T


@of_motion
@once
def flow(problem: Problem, control: Expr) -> Flow:
    """Return the flow under a control (nu, 1) in x, t, p, without multipliers: lambda' = -H_x at
    fixed u.
    """
    given = [problem.rate, _open_matrix(problem)]
    rate, matrix = casadi.substitute(given, [problem.u], [control])
    return Flow(problem, rate, casadi.sparsify(matrix))


@of_motion
@once
def _open_matrix(problem: Problem) -> Expr:
    """Return M of z' = M z (nx + 1, nx + 1) with the controls as they are."""
    n = problem.x.numel()
    matrix = casadi.SX(n + 1, n + 1)
    matrix[:n, :n] = -casadi.jacobian(problem.rate, problem.x).T
    matrix[:n, n] = -casadi.gradient(problem.lagrangian, problem.x)
    return _heard(problem, matrix)


def _heard(problem: Problem, rows: Expr) -> Expr:
    """Return rows (m, nx + 1) without the costates that vanish all along."""
    silent = silent_costates(problem)
    if silent:
        rows = casadi.SX(rows)
        rows[:, silent] = 0
    return rows


@of_motion
@once
def silent_costates(problem: Problem) -> list[int]:
    """Return the places of costates that vanish all along: those of states that nothing depends on,
    no end among it.
    """
    matter = that_matter(problem)
    return [k for k, state in enumerate(casadi.vertsplit(problem.x)) if hash(state) not in matter]


@of_motion
@once
def extended_costate(problem: Problem) -> Expr:
    """Return z = (lambda, 1) as a column (nx + 1, 1)."""
    return casadi.vertcat(problem.costate, 1)


@of_motion
@once
def switching_row(problem: Problem, i: int) -> Expr:
    """Return the row of sigma_i = dH/du_i."""
    cost = casadi.substitute(casadi.jacobian(problem.lagrangian, problem.u[i]), problem.u, 0)
    return casadi.sparsify(_heard(problem, casadi.horzcat(problem.fields[:, i].T, cost)))


def hamiltonian_row(problem: Problem, control: Expr) -> Expr:
    """Return the row of H under a control (nu, 1)."""
    row = casadi.horzcat(problem.rate.T, problem.lagrangian)
    return _heard(problem, casadi.substitute(row, problem.u, control))


@once
def hamiltonian_value(problem: Problem) -> float | None:
    """Return the value of H along every extremal where the problem tells it, None where it does
    not.

    It does where nothing but the Mayer term depends on time and a time is free: H = -d(Mayer)/d(tf)
    = d(Mayer)/d(t0), so -1 for minimum time and 0 where the free time does not enter. A finite
    interval of times may bind: it tells nothing.
    """
    along = casadi.vertcat(
        problem.rate, problem.lagrangian, *(c.expression for c in problem.constraints)
    )
    if casadi.depends_on(along, time):
        return None
    last, first = problem.final_time_box, problem.initial_time_box
    if last[1] == casadi.inf and last[0] <= first[0]:
        return _slope(problem, final_time, -1.0)
    if first[0] == -casadi.inf and first[1] >= last[1]:
        return _slope(problem, initial_time, 1.0)
    return None


def _slope(problem: Problem, symbol: Expr, sign: float) -> float | None:
    ends = casadi.vertcat(casadi.SX(0), *(c.expression for c in problem.conditions))
    slope = casadi.jacobian(problem.mayer, symbol)
    known = casadi.sparsify(casadi.simplify(slope)).is_constant() and not casadi.depends_on(
        ends, symbol
    )
    return sign * float(slope) if known else None

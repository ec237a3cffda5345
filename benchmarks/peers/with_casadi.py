"""CasADi's Opti: multiple shooting by RK4 with controls constant a step, as in its example
race_car.
"""

from typing import Any

import casadi
from common import Statement, main

N = 100


def solve(s: Statement) -> dict[str, Any]:
    """Solve a problem."""
    opti = casadi.Opti()
    x, u = opti.variable(len(s.states), N + 1), opti.variable(len(s.controls), N)
    tf = opti.variable() if s.free else s.guess
    f = lambda x, u: casadi.vertcat(  # noqa: E731 - as the example has it
        *s.rates(casadi, casadi.vertsplit(x), casadi.vertsplit(u))
    )
    dt = tf / N
    for k in range(N):
        k1 = f(x[:, k], u[:, k])
        k2 = f(x[:, k] + dt / 2 * k1, u[:, k])
        k3 = f(x[:, k] + dt / 2 * k2, u[:, k])
        k4 = f(x[:, k] + dt * k3, u[:, k])
        opti.subject_to(x[:, k + 1] == x[:, k] + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4))
    pairs = [(u[k, :], s.control_box[:, k]) for k in range(len(s.controls))]
    for k in range(len(s.states)):
        pairs += [(x[k, :], s.box[:, k]), (x[k, 0], s.start[:, k]), (x[k, N], s.end[:, k])]
    for expression, (low, high) in pairs:
        if low > -casadi.inf or high < casadi.inf:
            opti.subject_to(opti.bounded(low, expression, high))
    last = casadi.vertsplit(x[:, N])
    for relation in s.at_end(s.relations, casadi, last, tf):
        opti.subject_to(relation <= 0)
    if s.free:
        opti.subject_to(opti.bounded(s.horizon[0, 0], tf, s.horizon[1, 0]))
        opti.set_initial(tf, s.guess)
    opti.set_initial(x, s.line(N + 1))
    opti.minimize(s.at_end([s.objective], casadi, last, tf)[0])
    opti.solver("ipopt")
    found = opti.solve()
    return {
        "objective": found.value(opti.f),
        "status": opti.stats()["return_status"],
        "u": found.value(u).reshape(len(s.controls), N),
    }


if __name__ == "__main__":
    main(solve)

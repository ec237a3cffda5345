"""rockit: multiple shooting with its own Runge-Kutta method, as in its example of first steps."""

from typing import Any

import casadi
from common import Statement, main
from rockit import FreeTime, MultipleShooting, Ocp

N = 100


def solve(s: Statement) -> dict[str, Any]:
    """Solve a problem."""
    ocp = Ocp(T=FreeTime(s.guess) if s.free else s.guess)
    x, u = [ocp.state() for _ in s.states], [ocp.control() for _ in s.controls]
    for state, rate in zip(x, s.rates(casadi, x, u), strict=True):
        ocp.set_der(state, rate)
    pairs = [(each, s.control_box[:, k]) for k, each in enumerate(u)]
    for k, state in enumerate(x):
        pairs += [(ocp.at_t0(state), s.start[:, k]), (ocp.at_tf(state), s.end[:, k])]
        pairs += [(state, s.box[:, k])]
    for expression, (low, high) in pairs:
        if low == high:
            ocp.subject_to(expression == low)
        elif low > -casadi.inf and high < casadi.inf:
            ocp.subject_to(low <= (expression <= high))
        elif low > -casadi.inf or high < casadi.inf:
            ocp.subject_to(expression >= low if low > -casadi.inf else expression <= high)
    if s.free:
        ocp.subject_to(s.horizon[0, 0] <= (s.horizon[1, 0] >= ocp.T))
    last = [ocp.at_tf(each) for each in x]
    for relation in s.at_end(s.relations, casadi, last, ocp.T):
        ocp.subject_to(relation <= 0)
    for state, values in zip(x, s.line(N + 1), strict=True):
        ocp.set_initial(state, values[0] + (values[-1] - values[0]) * ocp.t / s.guess)
    ocp.add_objective(s.at_end([s.objective], casadi, last, ocp.T)[0])
    ocp.solver("ipopt")
    ocp.method(MultipleShooting(N=N, M=1, intg="rk"))
    found = ocp.solve()
    sampled = [found.sample(each, grid="control")[1][:-1] for each in u]  # the last stands twice
    return {
        "objective": found.value(ocp.objective),
        "status": found.stats["return_status"],
        "u": sampled,
    }


if __name__ == "__main__":
    main(solve)

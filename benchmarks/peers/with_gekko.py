"""GEKKO: simultaneous optimal control (IMODE 6) on this machine, time scaled to 1, as in its
examples of free final time.
"""

from types import SimpleNamespace
from typing import Any

import numpy as np
from common import Statement, main
from gekko import GEKKO

N = 101


def solve(s: Statement) -> dict[str, Any]:
    """Solve a problem."""
    m = GEKKO(remote=False)
    m.time = np.linspace(0, 1, N)
    last = np.zeros(N)
    last[-1] = 1.0
    final = m.Param(value=last)
    low, high = s.horizon[:, 0]
    tf = m.FV(value=s.guess, lb=low, ub=high) if s.free else m.Const(s.guess)
    if s.free:
        tf.STATUS = 1
    line = s.line(N)
    x = [_variable(m, line[k], s.box[:, k]) for k in range(len(s.states))]
    u = [
        m.MV(value=float(s.middle[k]), lb=s.control_box[0, k], ub=s.control_box[1, k])
        for k in range(len(s.controls))
    ]
    for each in u:
        each.STATUS, each.DCOST = 1, 0
    names = ("sin", "cos", "tanh", "exp", "sqrt")
    functions = SimpleNamespace(fabs=m.abs2, **{name: getattr(m, name) for name in names})
    for state, rate in zip(x, s.rates(functions, x, u), strict=True):
        m.Equation(state.dt() == tf * rate)
    for k, state in enumerate(x):
        low, high = s.end[:, k]
        if low == high:
            m.fix_final(state, val=float(low))
    for relation in s.at_end(s.relations, functions, x, tf):
        m.Equation(final * relation <= 0)
    m.Minimize(final * s.at_end([s.objective], functions, x, tf)[0])
    m.options.IMODE, m.options.NODES, m.options.SOLVER = 6, 3, 3
    m.solve(disp=False)
    return {
        "objective": m.options.OBJFCNVAL,
        "status": f"APPSTATUS {m.options.APPSTATUS}",
        "u": [each.VALUE.value[1:] for each in u],  # the first is the value before the start
    }


def _variable(m: Any, values: np.ndarray, box: np.ndarray) -> Any:
    """Return a state that starts where its line does."""
    low, high = (float(each) if np.isfinite(each) else None for each in box)
    return m.Var(value=values, lb=low, ub=high)


if __name__ == "__main__":
    main(solve)

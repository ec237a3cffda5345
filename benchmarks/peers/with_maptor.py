"""maptor: its adaptive solver with its own settings, from the mesh of its examples' kind."""

from typing import Any

import casadi
import maptor
import numpy as np
from common import Statement, main

INTERVALS, DEGREE = 10, 4


def solve(s: Statement) -> dict[str, Any]:
    """Solve a problem."""
    problem = maptor.Problem("peer")
    phase = problem.set_phase(1)
    t = phase.time(initial=0.0, final=_side(s.horizon[:, 0]))
    x = [
        phase.state(name, *(_side(box[:, k]) for box in (s.start, s.end, s.box)))
        for k, name in enumerate(s.states)
    ]
    u = [phase.control(name, _side(s.control_box[:, k])) for k, name in enumerate(s.controls)]
    phase.dynamics(dict(zip(x, s.rates(casadi, x, u), strict=True)))
    last = [each.final for each in x]
    for relation in s.at_end(s.relations, casadi, last, t.final):
        phase.event_constraints(relation <= 0)
    phase.mesh([DEGREE] * INTERVALS, np.linspace(-1, 1, INTERVALS + 1))
    problem.minimize(s.at_end([s.objective], casadi, last, t.final)[0])
    line = s.line(INTERVALS * DEGREE + 1)
    states = [line[:, k * DEGREE : (k + 1) * DEGREE + 1] for k in range(INTERVALS)]
    controls = [np.repeat(s.middle[:, None], DEGREE, axis=1)] * INTERVALS
    phase.guess(states=states, controls=controls, terminal_time=s.guess)
    found = maptor.solve_adaptive(problem, show_summary=False)
    if not found.status["success"]:
        raise RuntimeError(found.status["message"])
    mesh = "converged" if found.adaptive["converged"] else "not converged"
    return {
        "objective": found.status["objective"],
        "status": f"success; mesh {mesh}",
        "u": [found[(1, name)] for name in s.controls],
    }


def _side(box: np.ndarray) -> Any:
    """Return a box as maptor has it: a number, or a pair with None for infinity."""
    low, high = (float(each) if np.isfinite(each) else None for each in box)
    if low is None and high is None:
        return None
    return low if low == high else (low, high)


if __name__ == "__main__":
    main(solve)

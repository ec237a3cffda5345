"""socp: its method `auto` as it is, without a guess and without a grid."""

from typing import Any

import casadi
import numpy as np
from common import Statement, main

import socp


def solve(s: Statement) -> dict[str, Any]:
    """Solve a problem."""
    x = [socp.states(name) for name in s.states]
    u = [socp.controls(name) for name in s.controls]
    relations = s.at_end(s.relations, casadi, x, socp.final_time)
    problem = socp.Problem(
        name="peer",
        minimise=s.at_end([s.objective], casadi, x, socp.final_time)[0],
        dynamics=dict(zip(x, s.rates(casadi, x, u), strict=True)),
        bounds=dict(zip([*u, *x], np.hstack([s.control_box, s.box]).T.tolist(), strict=True)),
        start=dict(zip(x, s.start.T.tolist(), strict=True)),
        end=dict(zip(x, s.end.T.tolist(), strict=True)),
        target={f"relation_{k}": each <= 0 for k, each in enumerate(relations)},
        **({} if s.free else {"final_time": s.horizon[0, 0]}),
    )
    found = socp.solve(problem, watch=socp.silent)
    return {
        "objective": found.objective,
        "status": found.stop.value,
        "u": found.rows("u"),
        "variation": found.total_variation().tolist(),
        "certified": found.extremal,
        "switches": found.switches,
        "final_time": found.final_time,
    }


if __name__ == "__main__":
    main(solve)

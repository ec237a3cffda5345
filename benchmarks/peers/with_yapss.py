"""yapss: its spectral method unless told otherwise, on the mesh of its examples' kind."""

from typing import Any

import numpy as np
from common import Statement, main
from yapss import Problem
from yapss import math as functions

SEGMENTS, POINTS = 20, 5


def solve(s: Statement) -> dict[str, Any]:
    """Solve a problem."""
    ocp = Problem(name="peer", nx=[len(s.states)], nu=[len(s.controls)], nd=len(s.relations))

    def objective(arg: Any) -> None:
        last = arg.phase[0].final_state
        arg.objective = s.at_end([s.objective], functions, last, arg.phase[0].final_time)[0]

    def continuous(arg: Any) -> None:
        phase = arg.phase[0]
        phase.dynamics[:] = s.rates(functions, phase.state, phase.control)

    def discrete(arg: Any) -> None:
        last = arg.phase[0].final_state
        arg.discrete[:] = s.at_end(s.relations, functions, last, arg.phase[0].final_time)

    ocp.functions.objective, ocp.functions.continuous = objective, continuous
    if s.relations:
        ocp.functions.discrete = discrete
        ocp.bounds.discrete.upper[:] = 0.0
    bounds = ocp.bounds.phase[0]
    bounds.initial_time.lower = bounds.initial_time.upper = 0.0
    bounds.final_time.lower, bounds.final_time.upper = s.horizon.ravel()
    for box, (low, high) in (
        (bounds.initial_state, s.start),
        (bounds.final_state, s.end),
        (bounds.state, s.box),
        (bounds.control, s.control_box),
    ):
        box.lower[:], box.upper[:] = low, high
    guess = ocp.guess.phase[0]
    guess.time = (0.0, s.guess)
    guess.state = s.line(2)
    guess.control = np.repeat(s.middle[:, None], 2, axis=1)
    ocp.mesh.phase[0].collocation_points = SEGMENTS * (POINTS,)
    ocp.mesh.phase[0].fraction = SEGMENTS * (1 / SEGMENTS,)
    ocp.derivatives.method, ocp.derivatives.order = "auto", "second"
    found = ocp.solve()
    return {
        "objective": found.objective,
        "status": str(found.nlp_info.ipopt_status_message),
        "u": found.phase[0].control,
    }


if __name__ == "__main__":
    main(solve)

"""Dymos: Radau collocation with SLSQP, the optimiser that comes with pip, coloured derivatives."""

import re
from typing import Any

import dymos
import numpy as np
import openmdao.api as om
from common import Statement, main

SEGMENTS, ORDER = 20, 3


def solve(s: Statement) -> dict[str, Any]:
    """Solve a problem."""
    problem = om.Problem()
    problem.driver = om.ScipyOptimizeDriver(optimizer="SLSQP", maxiter=500)
    problem.driver.declare_coloring()
    trajectory = problem.model.add_subsystem("traj", dymos.Trajectory())
    phase = dymos.Phase(
        ode_class=_system(s), transcription=dymos.Radau(num_segments=SEGMENTS, order=ORDER)
    )
    trajectory.add_phase("phase", phase)
    phase.set_time_options(
        fix_initial=True, fix_duration=not s.free, duration_bounds=tuple(s.horizon.ravel())
    )
    for k, name in enumerate(s.states):
        (low, high), (last, same) = s.box[:, k], s.end[:, k]
        phase.add_state(name, rate_source=f"rate_{name}", targets=_targets(s, name),
                        fix_initial=True, fix_final=bool(last == same), lower=_side(low),
                        upper=_side(high))  # fmt: skip
    for k, name in enumerate(s.controls):
        phase.add_control(name, targets=[name], lower=s.control_box[0, k],
                          upper=s.control_box[1, k], continuity=False,
                          rate_continuity=False)  # fmt: skip
    for k, _ in enumerate(s.relations):
        phase.add_boundary_constraint(f"relation_{k}", loc="final", upper=0.0)
    if s.objective != "tf":
        phase.add_timeseries_output("cost_at")
    phase.add_objective("time" if s.objective == "tf" else "cost_at", loc="final")
    problem.setup()
    phase.set_time_val(initial=0.0, duration=s.guess)
    for name, values in zip(s.states, s.line(2), strict=True):
        phase.set_state_val(name, values)
    for name, value in zip(s.controls, s.middle, strict=True):
        phase.set_control_val(name, [value, value])
    failed = dymos.run_problem(problem, run_driver=True, simulate=False, make_plots=False)
    time = "traj.phase.timeseries.time"
    key = time if s.objective == "tf" else "traj.phase.timeseries.cost_at"
    return {
        "objective": problem.get_val(key)[-1],
        "status": str(getattr(failed, "exit_status", "") or ("success" if failed else "failed")),
        "u": [problem.get_val(f"traj.phase.timeseries.{name}").ravel() for name in s.controls],
    }


def _targets(s: Statement, name: str) -> list[str]:
    """Return where a state enters; some enter nowhere."""
    used = [*s.dynamics, *s.relations, s.objective]
    return [name] if any(_within(name, text) for text in used) else []


def _system(s: Statement) -> type:
    """Return the component of the dynamics, its formulas as ExecComp has them."""
    outputs = [f"rate_{name} = {rate}" for name, rate in zip(s.states, s.dynamics, strict=True)]
    outputs += [f"relation_{k} = {text}" for k, text in enumerate(s.relations)]
    outputs += [] if s.objective == "tf" else [f"cost_at = {s.objective}"]

    class System(om.Group):  # type: ignore[misc]
        def initialize(self) -> None:
            self.options.declare("num_nodes", types=int)

        def setup(self) -> None:
            shape = {"shape": (self.options["num_nodes"],)}
            lines = [line.replace("fabs(", "abs(") for line in outputs]
            names = {*s.states, *s.controls, *(line.partition(" = ")[0] for line in lines)}
            names = {name for name in names if any(_within(name, line) for line in lines)}
            ode = om.ExecComp(lines, has_diag_partials=True, **dict.fromkeys(names, shape))
            self.add_subsystem("ode", ode, promotes=["*"])

    return System


def _within(name: str, line: str) -> bool:
    return re.search(rf"\b{name}\b", line) is not None


def _side(bound: float) -> float | None:
    return float(bound) if np.isfinite(bound) else None


if __name__ == "__main__":
    main(solve)

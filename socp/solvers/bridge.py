"""Ipopt in this process as a solver of Pyomo, over an .nl file: Pyomo itself brings none."""

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import casadi
import numpy as np

_OPTIONS: dict[str, Any] = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.option_file_name": "",
    "print_time": False,
    "show_eval_warnings": False,
    "ipopt.tol": 1e-7,
    "ipopt.max_iter": 300,
    "ipopt.bound_relax_factor": 1e-6,
}
# MindtPy takes no other; it is known by this name in the process that registers it alone
NAME = "ipopt"


def register(solved: Callable[[Any], None]) -> None:
    """Make Pyomo take this for `ipopt`; `solved` is called with every model that has been
    solved.
    """
    import pyomo.environ as pyo
    from pyomo.opt import SolverResults, SolverStatus, TerminationCondition

    class Bridge:
        """What Pyomo asks of a solver."""

        def __init__(self, **_given: Any) -> None:
            self.options: dict[str, Any] = {}

        def __enter__(self) -> Self:
            return self

        def __exit__(self, *_error: object) -> None:
            return

        def available(self, exception_flag: bool = False) -> bool:  # noqa: ARG002 - Pyomo's call
            """Tell Pyomo that the solver is there."""
            return True

        def license_is_valid(self) -> bool:
            """Tell Pyomo that no licence is needed."""
            return True

        def version(self) -> tuple[int, ...]:
            """Return the version of casadi, (major, minor, patch)."""
            return tuple(int(part) for part in casadi.__version__.split(".")[:3])

        def solve(self, model: Any, **_given: Any) -> Any:
            """Solve a continuous model from the values of its variables, and leave the solution in
            them.
            """
            ok, status = solve_nl(model)
            results = SolverResults()
            conditions = TerminationCondition
            results.solver.termination_condition = (
                conditions.optimal
                if ok
                else conditions.maxIterations
                if "Iter" in status
                else conditions.infeasible
            )
            results.solver.status = SolverStatus.ok if ok else SolverStatus.warning
            results.solver.message = status
            if ok:
                value = pyo.value(next(model.component_data_objects(pyo.Objective, active=True)))
                results.problem.lower_bound = results.problem.upper_bound = value
                solved(model)
            return results

    pyo.SolverFactory.register(NAME, doc="Ipopt of the casadi wheel")(Bridge)


def solve_nl(model: Any) -> tuple[bool, str]:
    """Solve a Pyomo model with Ipopt through an .nl file; returns whether it met its tolerances,
    and its status.
    """
    from pyomo.repn.plugins.nl_writer import NLWriter

    with tempfile.TemporaryDirectory(prefix="socp-") as place:
        path = Path(place) / "model.nl"
        with path.open("w", encoding="utf-8", newline="") as file:
            info = NLWriter().write(model, file, linear_presolve=False, scale_model=False)
        builder = casadi.NlpBuilder()
        builder.import_nl(str(path))
    v, f, g = casadi.vertcat(*builder.x), builder.f, casadi.vertcat(*builder.g)
    solver = casadi.nlpsol("nl", "ipopt", {"x": v, "f": f, "g": g}, _OPTIONS)
    start = np.array([0.0 if x.value is None else x.value for x in info.variables])
    result = solver(
        x0=start, lbx=builder.x_lb, ubx=builder.x_ub, lbg=builder.g_lb, ubg=builder.g_ub
    )
    status = str(solver.stats()["return_status"])
    if solver.stats()["success"]:
        for variable, value in zip(info.variables, result["x"].full().ravel(), strict=True):
            variable.set_value(float(value), skip_validation=True)
        duals = model.component("dual")
        if duals is not None:  # AMPL's sign: the change of the objective with the right-hand side
            for row, multiplier in zip(
                info.constraints, result["lam_g"].full().ravel(), strict=True
            ):
                duals[row] = -float(multiplier)
    return bool(solver.stats()["success"]), status

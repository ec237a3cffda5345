"""Gurobi through Pyomo, where its user has installed and licensed it: global branch and bound with
a proved bound.
"""

import importlib.util
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, final

import casadi
import numpy as np

from socp.model import Watch, silent
from socp.solvers.contract import NLP, NLPPoint
from socp.solvers.process import Job, Outcome, programme_job, solved_apart
from socp.solvers.pyomo_model import pyomo_programme
from socp.solvers.worker import Tell


def lacks() -> str:
    """Return what Gurobi lacks here, empty where it can run."""
    found = importlib.util.find_spec("gurobipy")
    return (
        ""
        if found
        else "the Python package 'gurobipy' (12 or later) is not installed; it needs its own "
        "licence"
    )


@final
@dataclass(frozen=True)
class Gurobi:
    """Parameters of Gurobi by their own names."""

    options: Mapping[str, Any] = field(default_factory=dict)

    def __call__(
        self, nlp: NLP, starts: Sequence[NLPPoint], seconds: float, watch: Watch = silent
    ) -> Outcome:
        """Solve for so many seconds at most, from the first start."""
        options = {"options": dict(self.options)}
        job = Job(
            __name__, "gurobi", seconds, lambda at: programme_job(nlp, starts[:1], at) | options
        )
        return solved_apart(nlp, starts[0], job, watch)


def work(job: Mapping[str, Any], tell: Tell) -> None:
    """Solve the programme of a job, in the process of its own."""
    import pyomo.environ as pyo

    function = casadi.Function.load(str(Path(job["folder"]) / "nlp.casadi"))
    v = casadi.SX.sym("v", function.size1_in(0))
    f, g = function(v)
    boxes = {name: np.array(job[name], dtype=float) for name in ("v_box", "g_box")}
    binary = np.array(job["binary"], dtype=bool)
    nlp = NLP.of(v, f, g, v_box=boxes["v_box"], g_box=boxes["g_box"], binary=binary)
    model = pyomo_programme(nlp, np.array(job["starts"][0]), elementary=True)
    solver = pyo.SolverFactory("gurobi_direct_minlp")
    limit = {"TimeLimit": max(job["until"] - time.time(), 0.1), **job["options"]}
    results = solver.solve(
        model, options=limit, load_solutions=False, raise_exception_on_nonoptimal_result=False
    )
    condition = str(results.solver.termination_condition)
    found = len(results.solution) > 0
    if found:
        model.solutions.load_from(results)
    tell(
        {
            "v": [model.v[i].value for i in range(v.numel())] if found else None,
            "bound": float(results.problem.lower_bound),
            "status": {"maxTimeLimit": "limit"}.get(condition, condition),
        }
    )

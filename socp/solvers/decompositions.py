"""GDPopt and MindtPy, Pyomo's own decompositions, with HiGHS for the linear part and Ipopt for the
rest.

They run on the disjunctive programme in a process of their own. Every feasible point of a
subproblem is told. Their linearisations hold for convex problems only, so nothing that they call a
bound is one.
"""

import logging
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, final

from socp.errors import load
from socp.model import Watch, silent
from socp.solvers.bridge import NAME, register
from socp.solvers.contract import NLP, NLPPoint
from socp.solvers.process import Job, Outcome, solved_apart
from socp.solvers.worker import Tell

_OPTIONS: Mapping[str, Mapping[str, Any]] = {
    "gdpopt": {"algorithm": "LOA"},
    "mindtpy": {
        "strategy": "OA",
        "init_strategy": "rNLP",
        "add_slack": True,
        "heuristic_nonconvex": True,
    },
}
_ROUND = 3.0  # seconds: they look at the clock once a round only
_STATUS = {
    "optimal": "optimal",
    "feasible": "limit",
    "infeasible": "infeasible",
    "maxTimeLimit": "limit",
}


@final
@dataclass(frozen=True)
class Decomposition:
    """One of Pyomo's decompositions, `gdpopt` or `mindtpy`, with options by its own names.

    `script` builds the disjunctive programme, `binaries` are what each of its combinations stands
    for in the reduction, and `seeds` the words, a combination an arc, that GDPopt solves first.
    """

    name: str
    script: str
    binaries: Sequence[Sequence[float]]
    seeds: Sequence[Sequence[int]] = ()
    options: Mapping[str, Any] = field(default_factory=dict)

    def __call__(
        self, nlp: NLP, starts: Sequence[NLPPoint], seconds: float, watch: Watch = silent
    ) -> Outcome:
        """Solve for so many seconds at most; `nlp` is the collocated reduction, against which
        points are checked. Raises MethodError where pyomo is not installed.
        """
        load("pyomo", "mip", self.name)

        def prepared(folder: Path) -> dict[str, Any]:
            """Write the model into a folder and return what the worker is told."""
            (folder / "model.py").write_text(self.script, encoding="utf-8")
            return {
                "solver": self.name,
                "binaries": self.binaries,
                "seeds": self.seeds,
                "options": {**_OPTIONS[self.name], **self.options},
            }

        return solved_apart(nlp, starts[0], Job(__name__, self.name, seconds, prepared), watch)


def work(job: Mapping[str, Any], tell: Tell) -> None:
    """Solve the programme of a job, in the process of its own."""
    import pyomo.environ as pyo

    names: dict[str, Any] = {"__name__": "model"}
    script = (Path(job["folder"]) / "model.py").read_text(encoding="utf-8")
    exec(compile(script, "model.py", "exec"), names)  # noqa: S102 - the script is our own
    model = names["model"]

    def told(solved: Any) -> None:
        chosen = [_chosen(solved, names, k) for k in range(names["ARCS"])]
        values = [solved.find_component(v.name) for v in names["variables"](model)]
        if all(c is not None for c in chosen) and all(
            v is not None and v.value is not None for v in values
        ):
            binaries = [z for c in chosen for z in job["binaries"][c]]
            tell({"v": [v.value for v in values] + binaries, "status": "limit"})

    register(told)
    logging.getLogger("pyomo").setLevel(logging.ERROR)
    given = {**job["options"], "nlp_solver": NAME, "mip_solver": "appsi_highs"}
    given["time_limit"] = max(int(job["until"] - time.time() - _ROUND), 1)
    if job["solver"] == "gdpopt" and job["seeds"]:
        seeds = [[model.mode[k, c] for k, c in enumerate(seed)] for seed in job["seeds"]]
        given |= {"init_algorithm": "custom_disjuncts", "custom_init_disjuncts": seeds}
    if job["solver"] == "mindtpy":
        pyo.TransformationFactory("gdp.bigm").apply_to(model)
    results = pyo.SolverFactory(job["solver"]).solve(model, **given)
    told(model)
    condition = str(results.solver.termination_condition)
    tell({"status": _STATUS.get(condition, condition)})


def _chosen(model: Any, names: Mapping[str, Any], k: int) -> int | None:
    """Return the combination that an arc of a solved model is in, None where that cannot be
    told.
    """
    for c in range(len(names["MODES"])):
        disjunct = model.find_component(f"mode[{k},{c}]")
        value = None if disjunct is None else disjunct.binary_indicator_var.value
        if value is not None and value > 0.5:
            return c
    return None

"""SCIP through an .nl file that Pyomo writes: global branch and bound, with a proved lower bound of
the programme.

SCIP runs in a process of its own, which tells of every better point and of the bound as it rises.
"""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, final

from socp.errors import load
from socp.model import Watch, silent
from socp.solvers.contract import NLP, NLPPoint
from socp.solvers.process import Job, Outcome, solved_apart
from socp.solvers.pyomo_model import pyomo_programme, write_nl
from socp.solvers.worker import Tell

_DEFAULTS: dict[str, Any] = {"numerics/feastol": 5e-6}  # a point to start from is no sharper
_ENDING = 0.2  # seconds that it needs to stop
_STATUS = {
    "optimal": "optimal",
    "gaplimit": "optimal",
    "infeasible": "infeasible",
    "timelimit": "limit",
    "memlimit": "limit",
    "nodelimit": "limit",
    "userinterrupt": "limit",
    "unbounded": "unbounded",
    "inforunbd": "infeasible or unbounded",
}


@final
@dataclass(frozen=True)
class Scip:
    """Parameters of SCIP by their own names, such as `limits/gap`."""

    options: Mapping[str, Any] = field(default_factory=dict)

    def __call__(
        self, nlp: NLP, starts: Sequence[NLPPoint], seconds: float, watch: Watch = silent
    ) -> Outcome:
        """Solve for so many seconds at most; the first start is offered to SCIP as a solution.

        Raises MethodError where pyscipopt or pyomo is not installed.
        """
        load("pyscipopt", "mip", "SCIP")

        def prepared(folder: Path) -> dict[str, Any]:
            """Write the programme into a folder and return what the worker is told."""
            model = pyomo_programme(nlp, starts[0].v, elementary=True)
            return {
                "columns": write_nl(model, folder / "programme.nl"),
                "starts": [start.v.tolist() for start in starts],
                "options": {**_DEFAULTS, **self.options},
            }

        return solved_apart(nlp, starts[0], Job(__name__, "scip", seconds, prepared), watch)


def work(job: Mapping[str, Any], tell: Tell) -> None:
    """Solve the programme of a job, in the process of its own."""
    import pyscipopt

    model = pyscipopt.Model()
    model.readProblem(str(Path(job["folder"]) / "programme.nl"))
    model.setParam("limits/time", max(float(job["until"]) - time.time() - _ENDING, 0.1))
    for name, value in job["options"].items():
        model.setParam(name, value)
    variables = {v.name: v for v in model.getVars()}
    by_place = {int(name[1:]): v for name, v in variables.items() if name[1:].isdigit()}
    base = list(job["starts"][0])

    def values(solution: Any) -> list[float]:
        """Return a solution's values by the programme's columns."""
        found = base.copy()  # variables that occur nowhere keep their start
        for place, column in enumerate(job["columns"]):
            found[column] = float(model.getSolVal(solution, by_place[place]))
        return found

    def bound() -> float:
        """Return the bound proved so far, nan where there is none."""
        value = float(model.getDualbound())
        return value if abs(value) < model.infinity() else math.nan

    class Listener(pyscipopt.Eventhdlr):  # type: ignore[misc]
        """Tells of every better point, and of the bound whenever it has risen."""

        def eventinit(self) -> None:
            """Ask to be told of better points and of solved nodes."""
            self.told = -math.inf
            self.model.catchEvent(pyscipopt.SCIP_EVENTTYPE.BESTSOLFOUND, self)
            self.model.catchEvent(pyscipopt.SCIP_EVENTTYPE.NODESOLVED, self)

        def eventexec(self, event: Any) -> None:
            """Tell of a better point, or of a bound that has risen."""
            at = bound()
            now = {"bound": at, "nodes": int(self.model.getNNodes()), "status": "limit"}
            if event.getType() == pyscipopt.SCIP_EVENTTYPE.BESTSOLFOUND:
                tell({**now, "v": values(self.model.getBestSol())})
            elif at > self.told + 1e-6 * (1.0 + abs(at)):
                self.told = at
                tell(now)

    model.includeEventhdlr(Listener(), "listener", "tells of points and bounds")
    model.optimize()
    best = values(model.getBestSol()) if model.getNSols() else None
    status = _STATUS.get(model.getStatus(), model.getStatus())
    tell({"v": best, "bound": bound(), "status": status, "nodes": int(model.getNNodes())})

"""Knitro through casadi, where its user has installed and licensed it: branch and bound over local
solves.
"""

import importlib.util
import os
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
from socp.solvers.worker import Tell


def lacks() -> str:
    """Return what Knitro lacks here, empty where it can run."""
    if importlib.util.find_spec("knitro") or os.environ.get("KNITRODIR"):
        return ""
    return (
        "Knitro is not installed (no KNITRODIR, no Python package 'knitro'); it needs its own "
        "licence"
    )


@final
@dataclass(frozen=True)
class Knitro:
    """Options of Knitro by their own names."""

    options: Mapping[str, Any] = field(default_factory=dict)

    def __call__(
        self, nlp: NLP, starts: Sequence[NLPPoint], seconds: float, watch: Watch = silent
    ) -> Outcome:
        """Solve from one start after the other, in all for so many seconds; the best verified point
        comes back.
        """
        options = {"options": dict(self.options)}
        job = Job(__name__, "knitro", seconds, lambda at: programme_job(nlp, starts, at) | options)
        return solved_apart(nlp, starts[0], job, watch)


def work(job: Mapping[str, Any], tell: Tell) -> None:
    """Solve the programme of a job from its starts, in the process of its own."""
    function = casadi.Function.load(str(Path(job["folder"]) / "nlp.casadi"))
    v = casadi.SX.sym("v", function.size1_in(0))
    f, g = function(v)
    box = dict(zip(("lbx", "ubx", "lbg", "ubg"), (*job["v_box"], *job["g_box"]), strict=True))
    for k, start in enumerate(job["starts"]):
        left = max(job["until"] - time.time(), 0.1) / (len(job["starts"]) - k)
        given = {
            f"knitro.{name}": value
            for name, value in {"maxtime_real": left, **job["options"]}.items()
        }
        programme = {"x": v, "f": f, "g": g}
        solver = casadi.nlpsol(
            "knitro", "knitro", programme, {"discrete": job["binary"], "print_time": False, **given}
        )
        result = solver(x0=start, **box)
        status = "optimal" if solver.stats()["success"] else str(solver.stats()["return_status"])
        tell({"v": np.array(result["x"].full()).ravel().tolist(), "status": status})

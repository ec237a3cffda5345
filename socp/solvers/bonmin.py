"""Bonmin through casadi: branch and bound over local solves, in a process of its own since it keeps
no time limit.

Bonmin takes the local minima of its relaxations for bounds, so on a problem that is not convex it
proves nothing: its outcome has no bound. Every integral, feasible iterate that it passes through is
kept as an incumbent.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, final

import casadi
import numpy as np

from socp.model import Watch, silent
from socp.solvers.contract import NLP, NLPPoint
from socp.solvers.process import FEASIBLE, INTEGRAL, Job, Outcome, programme_job, solved_apart
from socp.solvers.worker import Tell

_DEFAULTS: dict[str, Any] = {
    "algorithm": "B-BB",  # the others linearise, which cuts off points where nothing is convex
    "bound_relax_factor": 1e-6,  # a law that keeps a constraint leaves the constraint no inside
    "tol": 1e-7,
    "max_iter": 200,
    # It takes longer than the tree, and what it finds is far off
    "heuristic_feasibility_pump": "no",
    "pump_for_minlp": "no",
    "bb_log_level": 0,
    "nlp_log_level": 0,
}
_STATUS = {
    "SUCCESS": "optimal",
    "INFEASIBLE": "infeasible",
    "LIMIT_EXCEEDED": "limit",
    "CONTINUOUS_UNBOUNDED": "unbounded",
}
_WORTH = 1e-9  # relative: a point is told of when it is better by more


@final
@dataclass(frozen=True)
class Bonmin:
    """Options of Bonmin and of the Ipopt inside it, by their own names."""

    options: Mapping[str, Any] = field(default_factory=dict)

    def __call__(
        self, nlp: NLP, starts: Sequence[NLPPoint], seconds: float, watch: Watch = silent
    ) -> Outcome:
        """Solve from one start after the other, in all for so many seconds; the best verified point
        comes back.

        A start whose binaries are 0 or 1 in part is solved with those held first, which leaves few
        to branch on. Last comes a solve with all of them free, from the best point so far, for what
        is better than that.
        """
        options = {"options": {**_DEFAULTS, **self.options}}
        job = Job(__name__, "bonmin", seconds, lambda at: programme_job(nlp, starts, at) | options)
        return solved_apart(nlp, starts[0], job, watch)


def work(job: Mapping[str, Any], tell: Tell) -> None:
    """Solve the programme of a job from its starts, in the process of its own."""
    function = casadi.Function.load(str(Path(job["folder"]) / "nlp.casadi"))
    spy = _Spy(function, job, tell)
    solver_of = _solvers(function, spy, job)
    stages = [(np.array(start), held) for held in (True, False) for start in job["starts"]]
    if not spy.binary.any() or all(not _held(start, spy.binary).any() for start, _ in stages):
        stages = stages[: len(job["starts"])]
    status = ""
    for k, (start, held) in enumerate(stages):
        left = job["until"] - time.time()
        if left <= 0 or (not held and spy.v is not None and k > len(job["starts"])):
            break  # one solve with all binaries free, from the best point, is enough
        options = {"time_limit": left / (len(stages) - k)}
        if spy.v is not None:
            options["cutoff"] = spy.best - _WORTH
        solver = solver_of(options)
        begin = start if held or spy.v is None else spy.v
        result = solver(x0=begin, **_boxes(job, begin, _held(start, spy.binary) & held))
        status = str(solver.stats()["return_status"])
        if status in {"SUCCESS", "LIMIT_EXCEEDED"}:
            spy.show(np.array(result["x"].full()).ravel())
    found = (
        "optimal" if spy.v is not None and status == "INFEASIBLE" else _STATUS.get(status, status)
    )
    tell({"status": "limit" if time.time() >= job["until"] else found})


def _held(start: np.ndarray, binary: np.ndarray) -> np.ndarray:
    """Return a mask (n,) of the binaries that a start knows."""
    known: np.ndarray = binary & ((start == 0.0) | (start == 1.0))
    return known


def _boxes(job: Mapping[str, Any], start: np.ndarray, held: np.ndarray) -> dict[str, np.ndarray]:
    low, high = np.array(job["v_box"], dtype=float)
    return {
        "lbx": np.where(held, start, low),
        "ubx": np.where(held, start, high),
        "lbg": job["g_box"][0],
        "ubg": job["g_box"][1],
    }


def _solvers(
    function: casadi.Function, spy: "_Spy", job: Mapping[str, Any]
) -> Callable[[Mapping[str, float]], casadi.Function]:
    """Return what makes a solver with further options.

    The spy sits in the Jacobian, which is taken at every iterate: this build of Bonmin calls
    nothing else back.
    """
    v, p, x = (
        casadi.MX.sym("v", function.size1_in(0)),
        casadi.MX.sym("p", 0),
        casadi.SX.sym("x", function.size1_in(0)),
    )
    slopes = casadi.Function("slopes", [x], [function(x)[1], casadi.jacobian(function(x)[1], x)])
    jacobian = casadi.Function(
        "nlp_jac_g", [v, p], slopes.call([spy(v)]), ["x", "p"], ["g", "jac_g_x"]
    )
    programme = dict(zip("xfg", (v, *function(v)), strict=True))
    given = {f"bonmin.{name}": value for name, value in job["options"].items()}
    given |= {"print_time": False, "discrete": job["binary"], "jac_g": jacobian}

    def make(options: Mapping[str, float]) -> casadi.Function:
        """Return the solver with options of Bonmin's own."""
        more = {f"bonmin.{name}": value for name, value in options.items()}
        return casadi.nlpsol("bonmin", "bonmin", programme, {**more, **given})

    return make


class _Spy(casadi.Callback):  # type: ignore[misc]
    """Passes points through, and tells of those that are integral, feasible and better than any
    before.
    """

    def __init__(self, function: casadi.Function, job: Mapping[str, Any], tell: Tell) -> None:
        super().__init__()
        self.function, self.tell, self.best = function, tell, math.inf
        self.v: np.ndarray | None = None
        self.binary = np.array(job["binary"], dtype=bool)
        self.low, self.high = np.array(job["g_box"], dtype=float)
        self.construct("spy", {})

    def get_sparsity_in(self, _i: int) -> casadi.Sparsity:
        """Return the shape of the variables."""
        return casadi.Sparsity.dense(self.function.size1_in(0), 1)

    def get_sparsity_out(self, _i: int) -> casadi.Sparsity:
        """Return the shape of the variables."""
        return casadi.Sparsity.dense(self.function.size1_in(0), 1)

    def eval(self, given: Sequence[casadi.DM]) -> list[casadi.DM]:
        """Tell of a point and return it."""
        self.show(np.array(given[0].full()).ravel())
        return [given[0]]

    def show(self, v: np.ndarray) -> None:
        """Tell of a point where it is worth it."""
        z = v[self.binary]
        if (np.abs(z - np.round(z)) > INTEGRAL / 10).any():
            return
        f, g = (each.full().ravel() for each in self.function(v))
        better = f[0] < self.best - _WORTH * (1.0 + abs(f[0]))
        if better and (np.maximum(self.low - g, g - self.high) <= FEASIBLE / 10).all():
            self.best, self.v = float(f[0]), v
            self.tell({"v": v.tolist(), "objective": self.best, "status": "limit"})

"""Ipopt through casadi: sparse, exact Hessian, a trace of every iteration, a clean stop on
Ctrl-C.
"""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, final

import casadi
import numpy as np

from socp.errors import SolveError
from socp.model import Progress, Stop, Watch, silent
from socp.process import left, requesting
from socp.solvers import documented, overdetermined
from socp.solvers.contract import NLP, NLPPoint

_DEFAULTS: dict[str, Any] = {
    "tol": 1e-9,
    # Ipopt's 1e-8 moves every bound, and with it the ninth digit of the objective
    "bound_relax_factor": 0.0,
    # Singular arcs make the Hessian flat, not indefinite: little is enough
    "first_hessian_perturbation": 1e-8,
    "acceptable_iter": 100,  # the flatness slows the last digits; its 15 would give up some of them
    "max_iter": 3000,
    "print_level": 0,
    "sb": "yes",
    "option_file_name": "",  # otherwise it reads ipopt.opt where the user is, without a word
}
_STOPS = {
    "Solve_Succeeded": Stop.SOLVED,
    "Solved_To_Acceptable_Level": Stop.ACCEPTABLE,
    "Feasible_Point_Found": Stop.SOLVED,
    "Infeasible_Problem_Detected": Stop.INFEASIBLE,
    "Maximum_Iterations_Exceeded": Stop.LIMIT,
    "Maximum_CpuTime_Exceeded": Stop.LIMIT,
    "Maximum_WallTime_Exceeded": Stop.LIMIT,
    "User_Requested_Stop": Stop.INTERRUPTED,
}
_INSTANT = 1e-3  # seconds
_TRACED = {
    "obj": "objective",
    "inf_pr": "inf_pr",
    "inf_du": "inf_du",
    "mu": "mu",
    "d_norm": "step",
    "alpha_pr": "alpha_pr",
    "alpha_du": "alpha_du",
}


@final
@dataclass(frozen=True)
class Ipopt:
    """Options of Ipopt by their own names, over defaults that keep the digits (tol 1e-9,
    bound_relax_factor 0).

    Raises MethodError for an option that Ipopt does not have, with the closest match, or a value
    that it does not take.
    """

    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        documented.check(self.options)

    def __call__(self, nlp: NLP, guess: NLPPoint, watch: Watch = silent) -> NLPPoint:
        """Solve from a guess, warm where it carries multipliers.

        Raises SolveError where casadi cannot build the programme, and whatever the watch raises.
        """
        began = time.perf_counter()
        equations, unknowns = overdetermined.counted(nlp)
        if equations > unknowns:
            return overdetermined.met(nlp, guess, int({**_DEFAULTS, **self.options}["max_iter"]))
        if left() <= 0.0:
            return replace(guess, stop=Stop.LIMIT, message="the time allowed is over")
        observer = _Observer(nlp, watch)
        given = {
            "x0": guess.v,
            "lbx": nlp.v_box[0],
            "ubx": nlp.v_box[1],
            "lbg": nlp.g_box[0],
            "ubg": nlp.g_box[1],
        }
        if guess.lam_v is not None and guess.lam_g is not None:
            given |= {"lam_x0": guess.lam_v, "lam_g0": guess.lam_g}
        try:
            with requesting(
                observer.ask
            ):  # from the start: in a callback Ctrl-C would pass for a failure of casadi
                solver = _solver(nlp, observer, {**_DEFAULTS, **self.options})
                built = time.perf_counter()
                result = solver(**given)
        except RuntimeError as error:
            raise SolveError(f"Ipopt could not run: {_last_line(error)}") from error
        if observer.error is not None:
            raise observer.error
        seconds = {"build": built - began, "solve": time.perf_counter() - built}
        point = _point(result, solver.stats(), seconds)
        point = (
            replace(point, stop=Stop.INTERRUPTED) if observer.stop else point
        )  # Ipopt asks no more at its end
        return _explained(point, nlp, guess, self.options) if point.stop is Stop.FAILED else point


def _solver(nlp: NLP, observer: "_Observer", options: Mapping[str, Any]) -> casadi.Function:
    settings = {"print_time": False, "show_eval_warnings": False, "iteration_callback": observer}
    settings |= {f"ipopt.{name}": value for name, value in options.items()}
    if math.isfinite(rest := left()):  # of the caller's time; Ipopt takes no 0
        wall = min(rest, float(options.get("max_wall_time", math.inf)))
        settings["ipopt.max_wall_time"] = max(wall, _INSTANT)
    try:
        return casadi.nlpsol("ipopt", "ipopt", {"x": nlp.v, "f": nlp.f, "g": nlp.g}, settings)
    except RuntimeError as error:
        raise SolveError(f"Ipopt could not be set up: {_last_line(error)}") from error


def _point(
    result: Mapping[str, Any], stats: Mapping[str, Any], seconds: Mapping[str, float]
) -> NLPPoint:
    iterations, status = stats.get("iterations", {}), stats["return_status"]
    trace = {
        name: tuple(map(float, iterations[key]))
        for key, name in _TRACED.items()
        if key in iterations
    }
    flat = {key: np.array(result[key].full()).ravel() for key in ("x", "lam_x", "lam_g")}
    return NLPPoint(
        v=flat["x"],
        objective=float(result["f"]),
        lam_v=flat["lam_x"],
        lam_g=flat["lam_g"],
        stop=_STOPS.get(status, Stop.FAILED),
        message=f"Ipopt: {status.replace('_', ' ')}",
        iterations=max(len(trace.get("objective", ())) - 1, 0),
        trace=trace,
        seconds=seconds,
    )


class _Observer(casadi.Callback):  # type: ignore[misc]
    """Passes every iteration to a watch; casadi swallows exceptions here, so the first one is kept
    for later.

    It reads casadi's own memory: matrices made of it, five an iteration, would cost more than a
    watch.
    """

    def __init__(self, nlp: NLP, watch: Watch) -> None:
        super().__init__()
        self.sizes = {
            "x": nlp.v.numel(),
            "f": 1,
            "g": nlp.g.numel(),
            "lam_x": nlp.v.numel(),
            "lam_g": nlp.g.numel(),
        }
        self.low, self.high = nlp.g_box
        self.watch, self.stop, self.count = watch, False, 0
        self.error: BaseException | None = None
        self.construct("observer", {})

    def ask(self) -> None:
        """Ask Ipopt to stop after this iteration."""
        self.stop = True

    def get_n_in(self) -> int:
        return int(casadi.nlpsol_n_out())

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, i: int) -> str:
        return str(casadi.nlpsol_out(i))

    def get_sparsity_in(self, i: int) -> casadi.Sparsity:
        size = self.sizes.get(casadi.nlpsol_out(i), 0)
        return casadi.Sparsity.dense(size, 1) if size else casadi.Sparsity(0, 0)

    def has_eval_buffer(self) -> bool:
        return True

    def eval_buffer(self, given: Sequence[memoryview], asked: Sequence[memoryview]) -> int:
        try:
            if self.watch is not silent and self.error is None:
                g = np.frombuffer(given[2]) if self.sizes["g"] else np.zeros(0)
                self._show(np.frombuffer(given[0]).copy(), float(np.frombuffer(given[1])[0]), g)
            self.count += 1
        except BaseException as error:  # noqa: BLE001 - anything raised here would vanish inside Ipopt
            self.error, self.stop = error, True
        np.frombuffer(asked[0])[0] = float(self.stop)
        return 0

    def _show(self, v: np.ndarray, objective: float, g: np.ndarray) -> None:
        violation = float(np.max(np.maximum(self.low - g, g - self.high), initial=0.0))
        if self.watch(Progress("ipopt", self.count, objective, violation, v=v)):
            self.stop = True  # never assigned from the answer: Ctrl-C may have set it meanwhile


def _explained(point: NLPPoint, nlp: NLP, guess: NLPPoint, options: Mapping[str, Any]) -> NLPPoint:
    """Return a failure with its likely reason; one before the first iteration has no objective."""
    reason = _unusable(nlp, guess)
    if point.message.endswith("Invalid Option"):
        given = ", ".join(f"{name}={value}" for name, value in options.items())
        reason = f"this build of Ipopt cannot carry out one of {given}"
    objective = point.objective if point.trace else float("nan")
    return replace(
        point,
        objective=objective,
        message=f"{point.message}; {reason}" if reason else point.message,
    )


def _unusable(nlp: NLP, guess: NLPPoint) -> str:
    """Say what cannot be computed at the guess: the usual reason for a failure at the first
    iteration.
    """
    if not np.isfinite(guess.v).all():
        return "the guess itself is not finite"
    f, g = casadi.Function("start", [nlp.v], [nlp.f, nlp.g])(guess.v)
    bad = int((~np.isfinite(g.full())).sum())
    if not np.isfinite(float(f)):
        return f"the objective is {float(f)} at the guess; give a guess where it is finite"
    return (
        f"{bad} of {g.numel()} constraints are not finite at the guess; give a guess where they are"
        if bad
        else ""
    )


def _last_line(error: Exception) -> str:
    return str(error).strip().splitlines()[-1].rsplit(": ", 1)[-1]

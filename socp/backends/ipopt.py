"""Ipopt through casadi: sparse, exact Hessian, a trace of every iteration, a clean stop on Ctrl-C."""

import difflib
import re
import signal
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass, field
from functools import cache
from io import StringIO
from types import FrameType
from typing import Any, final

import casadi
import numpy as np

from socp.errors import MethodError
from socp.nlp import NLP, NLPPoint, Progress, Watch, silent
from socp.solution import Stop

_DEFAULTS: dict[str, Any] = {
    "tol": 1e-9,
    "bound_relax_factor": 0.0,  # Ipopt's 1e-8 moves every bound, and with it the ninth digit of the objective
    "max_iter": 3000,
    "print_level": 0,
    "sb": "yes",
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
_TRACED = {"obj": "objective", "inf_pr": "inf_pr", "inf_du": "inf_du", "mu": "mu", "d_norm": "step", "alpha_pr": "alpha_pr", "alpha_du": "alpha_du"}


@final
@dataclass(frozen=True)
class Ipopt:
    """Options of Ipopt by their own names, over defaults that keep the digits (tol 1e-9, bound_relax_factor 0)."""

    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, value in self.options.items():
            _check(name, value)

    def __call__(self, nlp: NLP, guess: NLPPoint, watch: Watch = silent) -> NLPPoint:
        """Solve from a guess, warm where it carries multipliers."""
        began = time.perf_counter()
        observer = _Observer(nlp, watch)
        solver = casadi.nlpsol(
            "ipopt", "ipopt", {"x": nlp.v, "f": nlp.f, "g": nlp.g},
            {"print_time": False, "iteration_callback": observer, **{f"ipopt.{k}": v for k, v in {**_DEFAULTS, **self.options}.items()}},
        )  # fmt: skip
        built = time.perf_counter()
        given = {"x0": guess.v, "lbx": nlp.v_box[0], "ubx": nlp.v_box[1], "lbg": nlp.g_box[0], "ubg": nlp.g_box[1]}
        if guess.lam_v is not None and guess.lam_g is not None:
            given |= {"lam_x0": guess.lam_v, "lam_g0": guess.lam_g}
        with _sigint(observer):
            result = solver(**given)
        if observer.error is not None:
            raise observer.error
        stats = solver.stats()
        trace = {name: tuple(map(float, stats["iterations"][key])) for key, name in _TRACED.items() if key in stats.get("iterations", {})}
        flat = {key: np.array(result[key].full()).ravel() for key in ("x", "lam_x", "lam_g")}
        status = stats["return_status"]
        return NLPPoint(
            v=flat["x"], objective=float(result["f"]), lam_v=flat["lam_x"], lam_g=flat["lam_g"], stop=_STOPS.get(status, Stop.FAILED),
            message=f"Ipopt: {status.replace('_', ' ')}", iterations=max(len(trace.get("objective", ())) - 1, 0), trace=trace,
            seconds={"build": built - began, "solve": time.perf_counter() - built},
        )  # fmt: skip


class _Observer(casadi.Callback):
    """Passes every iteration to a watch; casadi swallows exceptions here, so the first one is kept for later."""

    def __init__(self, nlp: NLP, watch: Watch) -> None:
        super().__init__()
        self.sizes = {"x": nlp.v.numel(), "f": 1, "g": nlp.g.numel(), "lam_x": nlp.v.numel(), "lam_g": nlp.g.numel(), "lam_p": 0}
        self.low, self.high = nlp.g_box
        self.watch, self.stop, self.count = watch, False, 0
        self.error: BaseException | None = None
        self.construct("observer", {})

    def get_n_in(self) -> int:
        return len(self.sizes)

    def get_n_out(self) -> int:
        return 1

    def get_name_in(self, i: int) -> str:
        return casadi.nlpsol_out(i)

    def get_sparsity_in(self, i: int) -> casadi.Sparsity:
        size = self.sizes[casadi.nlpsol_out(i)]
        return casadi.Sparsity.dense(size, 1) if size else casadi.Sparsity(0, 0)

    def eval(self, arguments: list[casadi.DM]) -> list[int]:
        try:
            if self.watch is not silent:
                g = arguments[2].full().ravel()
                violation = float(np.max(np.maximum(self.low - g, g - self.high), initial=0.0))
                self.stop |= bool(self.watch(Progress("ipopt", self.count, float(arguments[1]), violation)))
            self.count += 1
        except BaseException as error:  # noqa: BLE001 - anything raised here would vanish inside Ipopt
            self.error, self.stop = error, True
        return [int(self.stop)]


@contextmanager
def _sigint(observer: _Observer) -> Iterator[None]:
    """Turn Ctrl-C into a request to stop after this iteration: inside Ipopt it would end as an obscure failure."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def request(_number: int, _frame: FrameType | None) -> None:
        observer.stop = True

    before = signal.signal(signal.SIGINT, request)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


@cache
def _documented() -> Mapping[str, str]:
    """Return Ipopt's own options: name -> documentation, as this build of Ipopt prints them."""
    v = casadi.SX.sym("v")
    text = StringIO()
    with redirect_stdout(text):
        solver = casadi.nlpsol("options", "ipopt", {"x": v, "f": v**2}, {"ipopt.print_options_documentation": "yes", "print_time": False, "ipopt.sb": "yes"})
        solver(x0=1.0)
    found = re.split(r"^(\w+) +(?=\S)", text.getvalue(), flags=re.MULTILINE)
    return dict(zip(found[1::2], found[2::2], strict=True))


def _check(name: str, value: Any) -> None:
    """Raise MethodError for an option that Ipopt does not have, or a value that it does not take."""
    v = casadi.SX.sym("v")
    try:
        casadi.nlpsol("probe", "ipopt", {"x": v, "f": v**2}, {"ipopt.print_level": 0, "ipopt.sb": "yes", f"ipopt.{name}": value})
    except RuntimeError as error:
        if name not in _documented():
            close = difflib.get_close_matches(name, _documented(), n=1)
            raise MethodError(f"ipopt has no option '{name}'" + (f"; did you mean '{close[0]}'?" if close else "")) from None
        reason = str(error).strip().splitlines()[-1].rsplit(": ", 1)[-1]
        raise MethodError(f"ipopt.{name}: {value!r} is not allowed ({reason}); {_documented()[name].strip().splitlines()[0].strip()}") from None

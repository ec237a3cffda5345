"""Ipopt through casadi: sparse, exact Hessian, a trace of every iteration, a clean stop on
Ctrl-C.
"""

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self, final

import casadi

from socp.errors import SolveError
from socp.model import Stop, Watch, silent
from socp.process import requesting, seconds_left
from socp.solvers import documented, overdetermined
from socp.solvers.backends.observer import Observer, arguments, last_line, unusable
from socp.solvers.contract import NLP, NLPPoint

_DEFAULTS: dict[str, Any] = {
    "tol": 1e-9,
    # Ipopt's 1e-8 moves every bound, and with it the ninth digit of the objective
    "bound_relax_factor": 0.0,
    # Singular arcs make the Hessian flat, not indefinite: little is enough
    "first_hessian_perturbation": 1e-8,
    "acceptable_iter": 100,  # the flatness slows the last digits; its 15 would give up some of them
    # Steps whose residual is small are as good as they need to be: to refine each of them once all
    # the same, as Ipopt does, takes a tenth of a small programme's time
    "min_refinement_steps": 0,
    "max_iter": 3000,
    "print_level": 0,
    "sb": "yes",
    "option_file_name": "",  # otherwise it reads ipopt.opt where the user is, without a word
}
# Variables of a large programme, whose time goes into factorisation. A free final time makes a
# dense column: of the orderings of MUMPS, that by minimum degree which sets such apart (6, QAMD)
# leaves the least fill-in, and takes little time itself
_LARGE, _DENSE_APART = 10_000, {"ipopt.mumps_pivot_order": 6}
# Of a chain of states pivots are small by the hundred; at Ipopt's 1e-6 MUMPS may lose six
# digits to each, and says of a convex programme that it is none: three are left to it. Of more
# variables than this pivots put off fill twice the memory, and Ipopt's own stays
_HUGE, _PIVOTS = 200_000, {"ipopt.mumps_pivtol": 1e-3}
# MUMPS orders pivots once, in pairs that it matches by the first matrix's values: where the
# multipliers grow these fail, and the pivots that they delay fill the factors, so that one step of
# 1800 variables takes minutes, which no limit of time ends. Large programmes fill theirs without,
# as that of a rod of 100 points on 400 steps; huge ones with, as of 100,000 trapezoids
_UNPAIRED = {"ipopt.mumps_permuting_scaling": 0}
_NEARBY = 1e-3  # first barrier parameter where the guess is near
# The same where the guess has multipliers, and how far it is moved inside: a grid a tenth as fine
# that is solved to a tolerance of 1e-5 ends with 1e-6, of which every node here has a tenth
_KNOWN = 1e-7
_WARM: dict[str, Any] = {
    "mu_init": _KNOWN,
    "warm_start_init_point": "yes",
    "warm_start_bound_push": _KNOWN,
    "warm_start_bound_frac": _KNOWN,
    "warm_start_slack_bound_push": _KNOWN,
    "warm_start_slack_bound_frac": _KNOWN,
    "warm_start_mult_bound_push": _KNOWN,
}
# Of a solve that may be given up for lost: what a step leaves of its equations is not looked at. Of
# 150 problems as many starts lead as near, in less time
_GIVEN_UP = {"fast_step_computation": "yes"}
_FINAL = ("max_iter", "obj_scaling_factor")  # what is asked for takes account of what is set
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
# What Ipopt says of iterations in all as of those that seek the constraints alone
_EXCEEDED = "Ipopt: Maximum Iterations Exceeded"
_LOST = "Ipopt: it does not find back to the constraints"
_INSTANT, _WALL = 1e-3, "ipopt.max_wall_time"  # seconds
# Of the time left, by which a solve may end late where it takes over what one before it was set up
# with: less than what comes of its result takes, and more than some solves of a small programme
_HAIR = 0.05
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
    bound_relax_factor 0); `asked` is what whoever solves with it has asked for.

    Raises MethodError for an option that Ipopt does not have, with the closest match, or a value
    that it does not take.
    """

    options: Mapping[str, Any] = field(default_factory=dict)
    asked: Mapping[str, Any] = field(default_factory=dict, repr=False)
    name: ClassVar[str] = "ipopt"

    def __post_init__(self) -> None:
        documented.check(self.options)

    def limited(self, iterations: int, lost: int | None = None) -> Self:
        """Return it with so many iterations at most; `lost` of them in a row may seek the
        constraints alone.
        """
        asked: dict[str, Any] = {"max_iter": min(iterations, int(self._settings()["max_iter"]))}
        asked |= {} if lost is None else {"max_resto_iter": lost, **_GIVEN_UP}
        return replace(self, asked={**self.asked, **asked})

    def within(self, tolerance: float) -> Self:
        """Return it with a tolerance on residuals and violations; one set by hand stays."""
        return self._asked("tol", tolerance)

    def scaled(self, factor: float) -> Self:
        """Return it with the objective multiplied while it solves: its tolerance on multipliers is
        absolute.
        """
        known = float(self._settings().get("obj_scaling_factor", 1.0))
        return self._asked("obj_scaling_factor", factor * known)

    def nearby(self) -> Self:
        """Return it for a guess that is near: a large barrier would lead away from it."""
        return self._asked("mu_init", _NEARBY)

    def __call__(self, nlp: NLP, guess: NLPPoint, watch: Watch = silent) -> NLPPoint:
        """Solve from a guess, warm where it carries multipliers.

        Raises SolveError where casadi cannot build the programme, and whatever the watch raises.
        """
        began = time.perf_counter()
        equations, unknowns = overdetermined.equations_and_unknowns(nlp)
        if equations > unknowns:
            return overdetermined.met(nlp, guess, int(self._settings()["max_iter"]))
        if seconds_left() <= 0.0:
            return replace(guess, stop=Stop.LIMIT, message="the time for it is over")
        warm = {} if guess.lam_v is None or guess.lam_g is None else _WARM
        settings = _settings(nlp, warm | self._settings())
        known: _Ready | None = vars(nlp).pop(_READY, None)  # nobody else's while it is at work
        known = known if known is not None and known.will_do(settings) else None
        observer = Observer(self.name, nlp) if known is None else known.observer
        observer.begin(watch)
        try:
            with requesting(
                observer.ask
            ):  # from the start: in a callback Ctrl-C would pass for a failure of casadi
                known = known or _Ready(settings, observer, _solver(nlp, observer, settings))
                built = time.perf_counter()
                result = known.solver(**arguments(nlp, guess))
        except RuntimeError as error:
            raise SolveError(f"Ipopt could not run: {last_line(error)}") from error
        if observer.error is not None:
            raise observer.error
        stopped, stats = observer.stop, known.solver.stats()
        if nlp.count < _LARGE:  # the factors of a large one fill memory
            observer.begin(silent)  # whoever watched is not kept with it
            vars(nlp)[_READY] = known
        seconds = {"build": built - began, "solve": time.perf_counter() - built}
        point = _point(result, stats, seconds)
        if point.message == _EXCEEDED and point.iterations < int(self._settings()["max_iter"]):
            point = replace(point, stop=Stop.INFEASIBLE, message=_LOST)
        point = (
            replace(point, stop=Stop.INTERRUPTED) if stopped else point
        )  # Ipopt asks no more at its end
        return _explained(point, nlp, guess, self.options) if point.stop is Stop.FAILED else point

    def _asked(self, name: str, value: float) -> Self:
        return replace(self, asked={**self.asked, name: value})

    def _settings(self) -> dict[str, Any]:
        """Return all options: those set by hand hold, but for what has to be less or more than they
        are.
        """
        found = {**_DEFAULTS, **self.asked, **self.options}
        return found | {name: self.asked[name] for name in _FINAL if name in self.asked}


@final
@dataclass(frozen=True, eq=False)
class _Ready:
    """What casadi made of a programme and settings, and what it calls at every iteration: solves
    of it from other guesses need no other.
    """

    settings: Mapping[str, Any]
    observer: Observer
    solver: casadi.Function

    def will_do(self, settings: Mapping[str, Any]) -> bool:
        """Tell whether it is what settings make, but for a hair of the time that is left."""
        untimed = ({**each, _WALL: 0.0} for each in (self.settings, settings))
        limits = (each.get(_WALL, math.inf) for each in (self.settings, settings))
        (ours, wanted), (known, left) = untimed, limits
        return ours == wanted and left <= known <= (1.0 + _HAIR) * left


_READY = "ready for ipopt"  # where it stands beside what a programme has of its own


def _settings(nlp: NLP, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return what casadi is told of a programme, for options of Ipopt."""
    settings: dict[str, Any] = {"print_time": False, "show_eval_warnings": False}
    settings |= _DENSE_APART if nlp.count >= _LARGE else {}
    settings |= {} if _LARGE <= nlp.count < _HUGE else _UNPAIRED
    settings |= _PIVOTS if nlp.count < _HUGE else {}
    settings |= {f"ipopt.{name}": value for name, value in options.items()}
    if math.isfinite(rest := seconds_left()):  # of the caller's time; Ipopt takes no 0
        wall = min(rest, float(options.get("max_wall_time", math.inf)))
        settings[_WALL] = max(wall, _INSTANT)
    return settings


def _solver(nlp: NLP, observer: Observer, settings: Mapping[str, Any]) -> casadi.Function:
    given = {**settings, "iteration_callback": observer}
    try:
        if nlp.derivatives is None:
            return casadi.nlpsol("ipopt", "ipopt", {"x": nlp.v, "f": nlp.f, "g": nlp.g}, given)
        # casadi would differentiate it once more, for multipliers of its own that nobody reads
        given |= {"no_nlp_grad": True, "calc_lam_p": False}
        known = dict(vars(nlp.derivatives()))
        return casadi.nlpsol("ipopt", "ipopt", known.pop("nlp"), given | known)
    except RuntimeError as error:
        raise SolveError(f"Ipopt could not be set up: {last_line(error)}") from error


def _point(
    result: Mapping[str, Any], stats: Mapping[str, Any], seconds: Mapping[str, float]
) -> NLPPoint:
    iterations, status = stats.get("iterations", {}), stats["return_status"]
    trace = {
        name: tuple(map(float, iterations[key]))
        for key, name in _TRACED.items()
        if key in iterations
    }
    return NLPPoint.of(
        result,
        stop=_STOPS.get(status, Stop.FAILED),
        message=f"Ipopt: {status.replace('_', ' ')}",
        iterations=max(len(trace.get("objective", ())) - 1, 0),
        trace=trace,
        seconds=seconds,
    )


def _explained(point: NLPPoint, nlp: NLP, guess: NLPPoint, options: Mapping[str, Any]) -> NLPPoint:
    """Return a failure with its likely reason; one before the first iteration has no objective."""
    reason = unusable(nlp, guess)
    if point.message.endswith("Invalid Option"):
        given = ", ".join(f"{name}={value}" for name, value in options.items())
        reason = f"this build of Ipopt cannot carry out one of {given}"
    objective = point.objective if point.trace else float("nan")
    return replace(
        point,
        objective=objective,
        message=f"{point.message}; {reason}" if reason else point.message,
    )

"""Uno through casadi: a filter SQP method with a trust region and exact Hessians, its QPs solved by
active sets.
"""

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Self, final

import casadi
import numpy as np

from socp.errors import MethodError, SolveError
from socp.model import Stop, Watch, silent
from socp.process import close, requesting, shown
from socp.solvers import overdetermined
from socp.solvers.backends.observer import Observer, arguments, last_line, unusable
from socp.solvers.backends.uno_options import KINDS, WANTED, WORDS
from socp.solvers.contract import NLP, NLPPoint, Reduced

_DEFAULTS: dict[str, Any] = {
    "preset": "filtersqp",
    "logger": "SILENT",  # it writes on standard output otherwise
    "max_iterations": 1000,
}
_TOLERANCE = 1e-9
# Uno takes what has stayed below its loose tolerances for a while for solved: here they are no
# looser than the others
_TOLERANCES = (
    "primal_tolerance",
    "dual_tolerance",
    "loose_primal_tolerance",
    "loose_dual_tolerance",
)
# Where rounding leaves no step that gains, a feasible point of this stationarity is acceptable, as
# to Ipopt by default
_ACCEPTABLE = 1e-6
_STOPS = {
    "Converged with feasible KKT point": Stop.SOLVED,
    "Converged with infeasible stationary point": Stop.INFEASIBLE,
}
_STUCK = "Terminated with feasible small step"
_TRUTH = {"yes": True, "no": False}
# casadi loses the point where rounding leaves Uno no further step: then it is asked for less, from
# the guess again, since near the solution it has no step either
_ROUNDING = 1e-8
_SAID = "Uno: Converged as far as rounding allows"
_RAISED = "An exception was raised in the solver"


@final
@dataclass(frozen=True)
class Uno:
    """Options of Uno by their own names; `asked` is what whoever solves with it has asked for.

    Raises MethodError for an option that Uno does not have, with the closest match, or a value that
    it does not take.
    """

    options: Mapping[str, Any] = field(default_factory=dict)
    asked: Mapping[str, Any] = field(default_factory=dict, repr=False)
    factor: float = field(default=1.0, repr=False)
    name: ClassVar[str] = "uno"

    def __post_init__(self) -> None:
        for name, value in self.options.items():
            _check(name, value)

    def limited(self, iterations: int, _lost: int | None = None) -> Self:
        """Return it with so many iterations at most; it does not tell which of them seek what."""
        most = min(iterations, int(self._settings()["max_iterations"]))
        return replace(self, asked={**self.asked, "max_iterations": most})

    def within(self, tolerance: float) -> Self:
        """Return it with a tolerance on residuals and violations; those set by hand stay."""
        return replace(self, asked={**self.asked, **dict.fromkeys(_TOLERANCES, tolerance)})

    def scaled(self, factor: float) -> Self:
        """Return it with the objective multiplied while it solves; values and multipliers come back
        unscaled.
        """
        return replace(self, factor=self.factor * factor)

    def nearby(self) -> Self:
        """Return it as it is: nothing leads active sets away from a guess that is near."""
        return self

    def __call__(self, nlp: NLP, guess: NLPPoint, watch: Watch = silent) -> NLPPoint:
        """Solve from a guess, warm where it carries multipliers; Uno hands over no trace.

        Raises SolveError where casadi cannot build the programme, and whatever the watch raises.
        """
        equations, unknowns = overdetermined.equations_and_unknowns(nlp)
        settings = self._settings()
        if equations > unknowns:
            return overdetermined.met(nlp, guess, int(settings["max_iterations"]))
        began = time.perf_counter()
        reduced = _reduced(nlp, self.factor)
        small = reduced.problem
        whole = None if watch is silent else _whole(nlp, small.v)
        observer = Observer(self.name, small, watch, whole)
        solver, point = _solver(small, observer, settings), reduced.push(guess)
        built = time.perf_counter()
        with requesting(observer.ask):
            found = _solved(solver, small, point, observer)
            if found is None and not observer.stop:
                loose = {each: max(_ROUNDING, settings[each]) for each in _TOLERANCES}
                solver = _solver(small, observer, settings | loose)
                found = _solved(solver, small, point, observer)
                if found is not None and found.stop is Stop.SOLVED:
                    found = replace(found, stop=Stop.ACCEPTABLE, message=_SAID)
        if observer.error is not None:
            raise observer.error
        if found is None:
            return _failed(nlp, guess, replace(guess, message="Uno: it broke off"))
        seconds = {"build": built - began, "solve": time.perf_counter() - built}
        point = replace(reduced.lift(found), iterations=observer.count, seconds=seconds)
        if observer.stop:
            return replace(point, stop=Stop.INTERRUPTED)
        return point if point.stop is not Stop.FAILED else _failed(nlp, guess, point)

    def _settings(self) -> dict[str, Any]:
        tolerances = dict.fromkeys(_TOLERANCES, _TOLERANCE)
        found = {**_DEFAULTS, **tolerances, **self.asked, **self.options}
        if "max_iterations" in self.asked:  # what is asked for takes account of what is set
            found["max_iterations"] = self.asked["max_iterations"]
        return found


def _solver(nlp: NLP, observer: Observer, settings: Mapping[str, Any]) -> casadi.Function:
    given = {"print_time": False, "show_eval_warnings": False, "iteration_callback": observer}
    given["uno"] = {
        name: float(value) if KINDS[name] is float else _TRUTH.get(value, value)
        for name, value in settings.items()
    }
    try:
        return casadi.nlpsol("uno", "uno", {"x": nlp.v, "f": nlp.f, "g": nlp.g}, given)
    except RuntimeError as error:
        raise SolveError(f"Uno could not be set up: {last_line(error)}") from error


def _solved(
    solver: casadi.Function, nlp: NLP, start: NLPPoint, observer: Observer
) -> NLPPoint | None:
    """Solve a programme; None where Uno broke off, and its point with it."""
    try:
        result = solver(**arguments(nlp, start))
    except RuntimeError as error:
        if _RAISED in str(error) or observer.error is not None:
            return None
        raise SolveError(f"Uno could not run: {last_line(error)}") from error
    stats = solver.stats()
    return NLPPoint.of(
        result,
        stop=_stop(stats),
        message=f"Uno: {stats['return_status']}",
        iterations=int(stats["iter_count"]),
    )


def _stop(stats: Mapping[str, Any]) -> Stop:
    status = stats["return_status"]
    if status == _STUCK and stats["stationarity"] <= _ACCEPTABLE:
        return Stop.ACCEPTABLE
    if stats["unified_return_status"] == "SOLVER_RET_LIMITED":
        return Stop.LIMIT
    return _STOPS.get(status, Stop.FAILED)


def _failed(nlp: NLP, guess: NLPPoint, point: NLPPoint) -> NLPPoint:
    """Return a failure with its likely reason."""
    reason = unusable(nlp, guess)
    objective = float("nan") if reason else point.objective
    said = f"{point.message}; {reason}" if reason else point.message
    return replace(point, objective=objective, stop=Stop.FAILED, message=said)


def _all(nlp: NLP, w: casadi.SX) -> casadi.SX:
    """Return all variables by the free ones: the others are held at their bounds."""
    low, high = nlp.v_box
    v = casadi.SX(casadi.DM(np.where(low == high, low, 0.0)))
    v[np.flatnonzero(low != high).tolist()] = w
    return v


def _whole(nlp: NLP, w: casadi.SX) -> casadi.Function:
    """Return the function of the free variables to all of them, the objective and the
    constraints.
    """
    v = _all(nlp, w)
    return casadi.Function("whole", [w], [v, *casadi.substitute([nlp.f, nlp.g], [nlp.v], [v])])


def _reduced(nlp: NLP, factor: float) -> Reduced[NLP, NLPPoint, NLPPoint]:
    """Return a programme without its fixed variables, of which Uno's interior-point method knows
    nothing, and with its objective multiplied.

    The multiplier of a fixed variable is what makes the Lagrangian stationary in it.
    """
    free = np.flatnonzero(nlp.v_box[0] != nlp.v_box[1])
    w = casadi.SX.sym("w", free.size)
    f, g = casadi.substitute([nlp.f, nlp.g], [nlp.v], [_all(nlp, w)])
    small = replace(
        nlp,
        formula=lambda: (w, factor * f, g),
        v_box=nlp.v_box[:, free],
        binary=nlp.binary[free],
        derivatives=None,
    )

    def push(point: NLPPoint) -> NLPPoint:
        if point.lam_v is None or point.lam_g is None:
            return replace(point, v=point.v[free])
        lam_v, lam_g = factor * point.lam_v[free], factor * point.lam_g
        return replace(point, v=point.v[free], lam_v=lam_v, lam_g=lam_g)

    def lift(point: NLPPoint) -> NLPPoint:
        at: np.ndarray = nlp.v_box[0].copy()
        at[free] = point.v
        lam_g: np.ndarray = np.asarray(point.lam_g) / factor
        weights = casadi.SX.sym("weights", lam_g.size)
        slope = casadi.gradient(nlp.f + casadi.dot(weights, nlp.g), nlp.v)
        lam_v = -casadi.Function("slope", [nlp.v, weights], [slope])(at, lam_g).full().ravel()
        lam_v[free] = np.asarray(point.lam_v) / factor
        return replace(point, v=at, objective=point.objective / factor, lam_v=lam_v, lam_g=lam_g)

    return Reduced(small, push, lift)


def _check(name: str, value: Any) -> None:
    """Raise MethodError for an option that Uno does not have, or a value that it does not take:
    casadi passes over both without a word.
    """
    if name not in KINDS:
        raise MethodError(f"uno has no option '{name}'{close(str(name), KINDS)}")
    kind = KINDS[name]
    if kind is bool:
        fits = isinstance(value, bool) or value in _TRUTH
    elif kind is str:
        fits = isinstance(value, str) and (name not in WORDS or value in WORDS[name])
    else:
        fits = isinstance(value, (int, float)) and not isinstance(value, bool)
        fits = fits and not math.isnan(value) and (kind is float or float(value).is_integer())
    if not fits:
        allowed = ", ".join(WORDS[name]) if name in WORDS else WANTED[kind]
        raise MethodError(f"uno.{name}: {shown(value)} is not allowed; allowed: {allowed}")

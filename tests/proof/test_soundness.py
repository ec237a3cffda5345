"""Lower bounds of registered problems against the motions themselves: along random controls, and
along the best path known; and changed certificates of several problems.
"""

import copy
from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import cache
from importlib import import_module
from typing import Any

import casadi
import numpy as np
import pytest
from test_bound import bounded

from socp import Problem, Solution, default_guess, final_time, run
from socp.errors import SolveError
from socp.model import time
from socp.proof import LowerBound, checked
from socp.proof.bound.checking import Check
from socp.registry import Registry

pytestmark = pytest.mark.slow

Data = dict[str, Any]
DEGREES = {
    "auv": 3,
    "catalyst_mixing": 4,
    "double_integrator_time": 6,
    "double_integrator_vlimit": 4,
    "dubins_csc": 4,
    "fishery_discounted": 6,
    "fuller": 5,
    "goddard": 3,
    "goddard_fixed_time": 2,
    "goddard_vlimit": 2,
    "jacobson_1": 4,
    "lotka_fishing": 5,
    "rayleigh_time": 6,
    "vdp_regulator": 5,
}
SLOW = ("dubins_csc", "goddard_fixed_time", "vdp_regulator")  # every further region takes 20 s
FUNCTIONS: Mapping[str, Callable[[Any], Any]] = {
    "exp": casadi.exp,
    "tanh": casadi.tanh,
    "sin": casadi.sin,
    "cos": casadi.cos,
    "inv": lambda a: 1 / a,
}
PROBLEMS: dict[str, Problem] = {
    name: import_module(f"socp_problems.{name}").problem for name in DEGREES
}
COUNT, STEPS = 1000, 400  # trajectories; steps of Runge and Kutta's method


@cache
def known(name: str) -> Solution:
    method = Registry.load().method("auto")(seconds=300.0)
    return run(method, PROBLEMS[name], default_guess(PROBLEMS[name]))


@cache
def found(name: str) -> LowerBound:
    return bounded(PROBLEMS[name], known(name), DEGREES[name], 1 if name in SLOW else None)


def combined(terms: list[Any], at: list[Any]) -> Any:
    """Return a polynomial of a certificate in coordinates."""
    total = casadi.SX(0)
    for powers, number in terms:
        term = casadi.SX(float(Fraction(number)))
        for k, power in powers:
            term *= at[k] ** power
        total += term
    return total


@cache
def value(name: str) -> casadi.Function:
    """Return the subsolution as a function of states and time: it is one of coordinates from -1 to
    1, of functions too.
    """
    certificate = found(name).certificate
    stage, at = certificate["stages"][-1], casadi.SX.sym("at", len(PROBLEMS[name].state_names) + 1)
    full = casadi.vertsplit(at)
    for k, side in stage["clipped"]:
        edge = float(Fraction(stage["box"][k][side]))
        full[k] = casadi.fmin(full[k], edge) if side else casadi.fmax(full[k], edge)
    for operation, of in certificate["functions"]:
        full.append(FUNCTIONS[operation](combined(of, full)))
    ranges = [None if its is None else list(map(Fraction, its)) for its in stage["box"]]
    ranges += function_ranges(certificate, ranges)
    for k, its in enumerate(ranges):
        if its is not None:
            middle, radius = float(its[0] + its[1]) / 2, float(its[1] - its[0]) / 2
            full[k] = (full[k] - middle) / radius
    return casadi.Function("value", [at], [combined(stage["value"]["function"], full)])


def function_ranges(certificate: Data, ranges: list[Any]) -> list[Any]:
    """Return the ranges of functions as the checker has them: they are part of the coordinates."""
    check = Check(certificate)
    box = [None if its is None else [str(end) for end in its] for its in ranges]
    return check._ranges(box)[len(ranges) : len(ranges) + len(certificate["functions"])]


def region(certificate: Data, problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Return the limits (n + 1,) of states and time; a unit around the start where there are
    none.
    """
    names = [*problem.state_names, "t"]
    limits = []
    for name, its in zip(names, certificate["stages"][-1]["box"], strict=True):
        start = certificate["problem"]["start"].get(name, (0.0, 1.0))[0]
        limits.append(
            (float(start) - 1.0, float(start) + 1.0)
            if its is None
            else tuple(float(Fraction(end)) for end in its)
        )
    low, high = np.array(limits).T
    return low, high


def beyond(certificate: Data, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the limits within which the function says something: none at clipped sides."""
    limits = np.array([low, high])
    for k, side in certificate["stages"][-1]["clipped"]:
        limits[side, k] = np.inf if side else -np.inf
    return limits[0], limits[1]


def flows(problem: Problem) -> casadi.Function:
    """Return the rates of states and of the cost, that of time in it, as a function of x, u, t."""
    price = casadi.jacobian(problem.mayer, final_time) if timed(problem) else casadi.SX(0)
    running = casadi.SX(0 if problem.running is None else problem.running)
    rates = casadi.vertcat(problem.rate, running + price)
    return casadi.Function("rates", [problem.x, problem.u, time], [rates])


def timed(problem: Problem) -> bool:
    return bool(problem.final_time_box[1] == np.inf)


Now = tuple[np.ndarray, np.ndarray, np.ndarray]


def moved(rates: casadi.Function, now: Now, u: np.ndarray, h: np.ndarray) -> Now:
    """Return states, costs and times after a step."""
    x, cost, t = now
    slopes = [rates(x, u, t[None]).full()]
    for part in (0.5, 0.5, 1.0):
        slopes.append(rates(x + part * h * slopes[-1][:-1], u, (t + part * h)[None]).full())
    both = h / 6 * (slopes[0] + 2 * slopes[1] + 2 * slopes[2] + slopes[3])
    return x + both[:-1], cost + both[-1], t + h


def drawn(box: np.ndarray, draw: np.random.Generator) -> np.ndarray:
    """Return controls (nu, COUNT), most of them at vertices of their box."""
    shape = (box.shape[1], COUNT)
    at_vertices = draw.integers(0, 2, shape).astype(float)
    share = np.where(draw.random(shape) < 0.7, at_vertices, draw.random(shape))
    return box[0][:, None] + share * np.ptp(box, axis=0)[:, None]


@pytest.mark.parametrize("name", DEGREES)
def test_along_random_controls_no_cost_is_saved(name: str) -> None:
    """Cost so far + V never decreases on the region, whatever the control: so whoever ends there
    has paid V(start) - V(end), and V(end) is at most the final cost.
    """
    problem, certificate = PROBLEMS[name], found(name).certificate
    draw, rates = np.random.default_rng(7), flows(problem)
    low, high = region(certificate, problem)
    x = draw.uniform(low[:-1, None], high[:-1, None], (len(low) - 1, COUNT))
    t = np.zeros(COUNT) if timed(problem) else draw.uniform(low[-1], high[-1], COUNT)
    span = min(1.0, known(name).arcs[-1].t[-1])
    h = np.full(COUNT, span / STEPS) if timed(problem) else (high[-1] - t) / STEPS
    cost, inside, seen = np.zeros(COUNT), np.ones(COUNT, dtype=bool), 0
    start = np.vstack([x, t])
    below = value(name)
    first = below(start).full()[0]
    low, high = beyond(certificate, low, high)
    for k in range(STEPS):
        if k % 20 == 0:
            u = drawn(problem.box, draw)
        x, cost, t = moved(rates, (x, cost, t), u, h)
        inside &= np.all((low[:-1, None] <= x) & (x <= high[:-1, None]), axis=0)
        x = np.where(inside, x, start[:-1])  # whoever has left is not followed
        kept = cost + below(np.vstack([x, t])).full()[0] - first
        assert np.all(kept[inside] >= -1e-4 * max(abs(known(name).objective), 1.0))
        seen += np.count_nonzero(inside)
    assert seen > 20 * COUNT


@pytest.mark.parametrize("name", DEGREES)
def test_along_the_best_path_the_bound_is_below_the_cost_to_go(name: str) -> None:
    problem, bound, solution = PROBLEMS[name], found(name).bound, known(name)
    assert bound is not None
    size = max(abs(solution.objective), 1.0)
    assert bound <= solution.objective + 1e-9 * size
    rates, spent = flows(problem), 0.0
    for arc in solution.arcs:
        costs = rates(arc.x, arc.u, arc.t[None]).full()[-1]
        so_far = spent + np.concatenate([[0.0], np.cumsum(trapezoids(costs, arc.t))])
        below = value(name)(np.vstack([arc.x, arc.t])).full()[0]
        # trapezoids are off by the square of a mesh
        assert np.all(below <= solution.objective - so_far + 1e-2 * size)
        spent = so_far[-1]


def trapezoids(values: np.ndarray, t: np.ndarray) -> np.ndarray:
    return np.asarray(np.diff(t) * (values[1:] + values[:-1]) / 2)


Change = Callable[[Data], Any]


def last(data: Data) -> Data:
    return data["stages"][-1]["value"]  # type: ignore[no-any-return]


def turned(k: int) -> Change:
    """Return a change of sign of the k-th largest coefficient of a variable."""

    def change(data: Data) -> None:
        terms = [term for term in last(data)["function"] if term[0]]
        term = sorted(terms, key=lambda each: -abs(Fraction(each[1])))[k]
        term[1] = str(-Fraction(term[1]))

    return change


def scaled(place: int, percent: int) -> Change:
    def change(data: Data) -> None:
        part = max(last(data)["proofs"][place], key=lambda each: len(each[2]))
        part[2] = [[each * percent // 100 for each in row] for row in part[2]]

    return change


def widened(data: Data) -> None:
    """Let the region grow, and the function on it with its coordinates."""
    box = data["stages"][-1]["box"]
    k = next(k for k, its in enumerate(box) if its is not None)
    low, high = map(Fraction, box[k])
    box[k] = [str(low - (high - low)), str(high + (high - low))]


def faster(data: Data) -> None:
    name = data["problem"]["controls"][0]
    low, high = data["problem"]["bounds"][name]
    data["problem"]["bounds"][name] = [low - (high - low), high + (high - low)]


CHANGES: dict[str, Change] = {
    **{f"sign of coefficient {k}": turned(k) for k in range(3)},
    **{f"squares {place} times {n} %": scaled(place, n) for place in (0, 1) for n in (50, 150)},
    "no proof at the first vertex": lambda data: last(data)["proofs"].pop(0),
    "no proof at the end": lambda data: last(data)["proofs"].pop(),
    "no proofs": lambda data: last(data).update(proofs=[]),
    "proofs in another order": lambda data: last(data)["proofs"].reverse(),
    "a larger region": widened,
    "controls of a larger box": faster,
    "a bound raised by 1 %": lambda data: data.update(
        bound=str(Fraction(data["bound"]) + abs(Fraction(data["bound"])) / 100)
    ),
    "no regions": lambda data: data.update(stages=[]),
}
CHANGED = (
    "double_integrator_time",
    "double_integrator_vlimit",
    "jacobson_1",
    "auv",
    "goddard",
)


@pytest.mark.parametrize("name", CHANGED)
@pytest.mark.parametrize("what", CHANGES)
def test_a_changed_certificate_of_another_problem_is_refused(name: str, what: str) -> None:
    data = copy.deepcopy(found(name).certificate)
    CHANGES[what](data)
    with pytest.raises(SolveError, match=r"not shown|no certificate"):
        checked(data)


def test_there_are_fifty_of_them() -> None:
    assert len(CHANGES) * len(CHANGED) >= 50

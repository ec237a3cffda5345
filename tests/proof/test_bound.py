"""Lower bounds: below every admissible trajectory, near the optimum where it is known, and refused
by the checker as soon as anything of the certificate is changed.
"""

import copy
import json
import os
import time as clock
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from functools import cache
from itertools import islice
from math import inf, isnan
from typing import Any

import numpy as np
import pytest
from casadi import exp, fabs
from test_prove import PROBLEMS
from test_prove import solved as known

from socp import (
    Ipopt,
    Problem,
    Solution,
    Word,
    controls,
    default_guess,
    final_time,
    judge,
    parameters,
    solve_collocated,
    states,
    uniform,
)
from socp.errors import LateError, SolveError
from socp.model import Progress, Rung, time
from socp.proof import LowerBound, checked, flint, lower_bound
from socp.proof.bound.bounding import spread_of
from socp.proof.bound.closing import Clock
from socp.proof.bound.domain import setting
from socp.proof.bound.lifting import Lift
from socp.proof.bound.searching import Job, _told, bounds
from socp.proof.bound.sets import Region
from socp.proof.bound.squares import Blocks, Demand, expense
from socp.transcription import follow, lgr

x, v = states("x v")
u = controls("u")
Data = dict[str, Any]

# From x = 1 straight to 0, then there: the integral of (1 - t)^2, 1/3
REST = Problem(
    name="rest",
    running=x**2,
    dynamics={x: u},
    bounds={u: (-1, 1)},
    start={x: 1},
    final_time=2,
)
# Down to the unstable rest of x' = x + u: x = 1 - e^t / 2, until t = log 2
UNSTABLE = REST.with_(name="unstable", dynamics={x: x + u}, start={x: 0.5})
# A distance of 2 from rest to rest under |v| <= 1: 1 s up, 1 s down, 1 s at the limit
LIMITED = Problem(
    name="limited",
    minimise=final_time,
    dynamics={x: v, v: u},
    bounds={u: (-1, 1), v: (-1, 1), x: (-1, 3)},
    start={x: 0, v: 0},
    end={x: 2, v: 0},
)


@cache
def solved(problem: Problem, word: str) -> Solution:
    phased = follow(problem, Word.parse(word, problem.control_names))
    meshes = [uniform(lgr(8), 2)] * len(phased.phases)
    return judge(problem, solve_collocated(phased, meshes, Ipopt(), default_guess(problem)))


def bounded(
    problem: Problem, solution: Solution | None, degree: int, regions: int | None = None
) -> LowerBound:
    """Return what a search in this process finds, on so many regions at most."""
    goal = None if solution is None else solution.objective
    until = clock.time() + 200.0
    job = Job(problem, spread_of(solution), goal, degree, until, os.getpid())
    *_, found = islice(bounds(job), regions)
    return found


@cache
def rest(degree: int = 6) -> LowerBound:
    return bounded(REST, solved(REST, "- s"), degree)


def value(certificate: Data, at: np.ndarray) -> np.ndarray:
    """Return the subsolution of a certificate (m,) at points (n, m) of its base variables."""
    ends = np.array(
        [[float(Fraction(end)) for end in its] for its in certificate["stages"][-1]["box"]]
    )
    middle, radius = ends.mean(axis=1), np.ptp(ends, axis=1) / 2
    scaled = (at - middle[:, None]) / radius[:, None]
    found = np.zeros(at.shape[1])
    for powers, number in certificate["stages"][-1]["value"]["function"]:
        term = np.full(at.shape[1], float(Fraction(number)))
        for k, power in powers:
            term = term * scaled[k] ** power
        found += term
    return found


def test_a_bound_is_near_the_optimum_and_is_a_rung() -> None:
    found, solution = rest(), solved(REST, "- s")
    assert found.bound is not None
    assert 0.995 / 3 < found.bound <= 1 / 3
    gap = found.gap(solution)
    assert gap == pytest.approx(1 - 3 * found.bound, abs=1e-6)
    (rung,) = found.rungs(solution)
    assert rung.rung is Rung.GLOBAL
    assert rung.margin == gap
    assert checked(json.loads(json.dumps(found.certificate))) == Fraction(
        found.certificate["bound"]
    )


def test_higher_degrees_are_nearer() -> None:
    bounds = [rest(degree).bound or 0.0 for degree in (2, 4, 6)]
    assert bounds == sorted(bounds)
    assert bounds[0] < bounds[-1] <= 1 / 3


def test_no_admissible_trajectory_costs_less() -> None:
    """Along motions under random controls cost so far + V never decreases within the region."""
    draw = np.random.default_rng(1)
    certificate, count, steps = rest().certificate, 1000, 200
    (low, high), _ = (
        [float(Fraction(end)) for end in its] for its in certificate["stages"][-1]["box"]
    )
    t = draw.uniform(0, 2, count)
    states_ = draw.uniform(low, high, count)
    h = (2 - t) / steps
    first, cost, inside = value(certificate, np.array([states_, t])), np.zeros(count), True
    for k in range(steps):
        if k % 20 == 0:
            control = np.where(draw.random(count) < 0.6, draw.choice([-1.0, 1.0], count), 0.0)
        cost = cost + h * (states_**2 + states_ * control * h + (control * h) ** 2 / 3)
        states_, t = states_ + h * control, t + h
        inside = inside & (low <= states_) & (states_ <= high)
        kept = cost + value(certificate, np.array([states_, t])) - first
        assert np.all(kept[inside] >= -1e-5)
    assert np.count_nonzero(inside) > 300
    assert np.all(cost[inside] >= first[inside] - 1e-5)


def test_along_the_optimal_path_the_bound_is_below_the_cost_to_go() -> None:
    t = np.linspace(0, 2, 101)
    path = np.maximum(1 - t, 0.0)
    assert np.all(value(rest().certificate, np.array([path, t])) <= path**3 / 3 + 1e-6)


def _changed(certificate: Data, change: Callable[[Data], Any]) -> Data:
    found = copy.deepcopy(certificate)
    change(found)
    return found


def _of_value(k: int) -> Callable[[Data], Any]:
    """Return a change of the k-th of the largest coefficients: its sign, or two of its digits."""

    def change(data: Data) -> None:
        terms = data["stages"][-1]["value"]["function"]
        largest = sorted(terms, key=lambda each: -abs(Fraction(each[1])))
        term = largest[k % 5]
        number = float(Fraction(term[1]))
        term[1] = str(Fraction(-number if k < 5 else float(f"{number:.2g}")))

    return change


def _of_rows(place: int, factor: Fraction) -> Callable[[Data], Any]:
    def change(data: Data) -> None:
        part = data["stages"][-1]["value"]["proofs"][place][0]
        part[2] = [[int(each * factor) for each in row] for row in part[2]]

    return change


def _of_box(k: int, side: int, share: Fraction) -> Callable[[Data], Any]:
    def change(data: Data) -> None:
        ends = [Fraction(each) for each in data["stages"][-1]["box"][k]]
        ends[side] += share * (ends[1 - side] - ends[side])
        data["stages"][-1]["box"][k] = list(map(str, ends))

    return change


def _of_statement(*keys: Any, to: Any) -> Callable[[Data], Any]:
    def change(data: Data) -> None:
        inner = data["problem"]
        for key in keys[:-1]:
            inner = inner[key]
        inner[keys[-1]] = to

    return change


def _dropped(place: int) -> Callable[[Data], Any]:
    return lambda data: data["stages"][-1]["value"]["proofs"].pop(place)


def _raised(factor: float) -> Callable[[Data], Any]:
    return lambda data: data.update(bound=str(Fraction(data["bound"]) * Fraction(factor)))


def _swapped(a: int, b: int) -> Callable[[Data], Any]:
    def change(data: Data) -> None:
        proofs = data["stages"][-1]["value"]["proofs"]
        proofs[a], proofs[b] = proofs[b], proofs[a]

    return change


def _of_scale(to: Any) -> Callable[[Data], Any]:
    def change(data: Data) -> None:
        data["stages"][-1]["value"]["proofs"][0][0][3] = to

    return change


def _with_square(guard: Any, basis: list[Any]) -> Callable[[Data], Any]:
    def change(data: Data) -> None:
        data["stages"][-1]["value"]["proofs"][0].append([guard, basis, [[1]], 1])

    return change


MUTATIONS = [
    _with_square("one", [[[2, 1]]]),  # of the control, which no region bounds
    _with_square(["box", 2], [[]]),
    _with_square(["given", 0], [[]]),
    *(_of_value(k) for k in range(10)),
    *(_of_rows(place, Fraction(n, 100)) for place in range(3) for n in (99, 101, 50)),
    *(_of_box(0, side, Fraction(n, 10)) for side in (0, 1) for n in (1, 3, 5)),
    *(_of_box(1, side, Fraction(n, 10)) for side in (0, 1) for n in (1, 5)),
    *(_dropped(place) for place in range(3)),
    *(_swapped(a, b) for a, b in ((0, 1), (0, 2), (1, 2))),
    *(_raised(factor) for factor in (1.0001, 1.01, 2.0, 1e9)),
    *(_of_scale(to) for to in (0, -1, 1, 0.5, "2")),
    _of_statement("bounds", "u", to=[-2.0, 1.0]),
    _of_statement("bounds", "u", to=[-1.0, 2.0]),
    _of_statement("final_time", to=[3.0, 3.0]),
    _of_statement("start", "x", to=[0.9, 0.9]),
    _of_statement("end", "x", to=[5.0, 5.0]),
    _of_statement("running", to=None),
    lambda data: data["stages"][-1].update(exits=[]),
    lambda data: data["stages"][-1]["exits"].pop(),
    lambda data: data.update(format="socp bound 0"),
]


@pytest.mark.parametrize("k", range(len(MUTATIONS)))
def test_a_changed_certificate_is_refused(k: int) -> None:
    changed = _changed(rest().certificate, MUTATIONS[k])
    with pytest.raises(SolveError, match=r"not shown|no certificate"):
        checked(changed)


def test_there_are_fifty_changes() -> None:
    assert len(MUTATIONS) >= 50


def test_another_motion() -> None:
    """The integral of (1 - e^t/2)^2 until log 2: log 2 - 1 + 3/8."""
    best = np.log(2) - 1 + 3 / 8
    found = bounded(UNSTABLE, solved(UNSTABLE, "- s"), 6).bound
    assert found is not None
    assert 0.98 * best < found <= best


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "degree", "allowed"),
    [
        ("double_integrator_time", 8, 0.01),
        ("double_integrator_vlimit", 6, 0.01),
        ("jacobson_1", 6, 1e-4),
        ("catalyst_mixing", 5, 0.01),
    ],
)
def test_registered_problems(name: str, degree: int, allowed: float) -> None:
    reference = PROBLEMS[name].reference
    assert reference is not None
    found = bounded(PROBLEMS[name], known(name), degree)
    assert found.bound is not None
    best, size = reference.objective, abs(reference.objective)
    assert best - allowed * size < found.bound <= best
    stages = found.certificate["stages"]
    if len(stages) > 1:  # the floor of those that leave the last region
        with pytest.raises(SolveError, match="not shown"):
            checked({**found.certificate, "stages": stages[1:]})


def test_minimum_time_under_a_speed_limit() -> None:
    found = bounded(LIMITED, None, 6)
    assert found.bound is not None
    assert 0.9 * 3 < found.bound <= 3


@pytest.mark.parametrize(
    ("problem", "reason"),
    [
        (REST.with_(final_time=(0.1, None), minimise=final_time**2), "not linear in it"),
        (REST.with_(dynamics={x: u + parameters("p")}), "parameters"),
        (REST.with_(start={x: (None, None)}), "start of 'x' is not given"),
        (REST.with_(dynamics={x: exp(-fabs(x)) * u}), "no rate"),
        (REST.with_(running=-x - time, dynamics={x: x**2 + u}), "stay within a region"),
    ],
)
def test_what_has_no_bound_is_told(problem: Problem, reason: str) -> None:
    found = lower_bound(problem, None, 60.0, 2)
    assert found.bound is None
    assert reason in found.reason
    assert not found.certificate


def test_the_bound_in_hand_is_returned_when_the_time_is_over_or_ctrl_c_comes() -> None:
    """A watch raises what Ctrl-C does, as soon as there is something in hand."""
    told = []

    def see(now: Progress, /) -> bool:
        if isnan(now.objective):
            return False
        told.append(now.objective)
        raise KeyboardInterrupt

    found = lower_bound(REST, solved(REST, "- s"), 600.0, watch=see)
    assert found.interrupted
    assert found.bound == told[0]
    assert checked(found.certificate) == Fraction(found.certificate["bound"])
    assert found.seconds < 100.0
    nothing = lower_bound(REST, replace(solved(REST, "- s"), objective=float("nan")), 1e-3)
    assert nothing.reason == "there was no time for it"
    assert found.gap(replace(solved(REST, "- s"), objective=float("nan"))) is None
    late = lower_bound(REST, solved(REST, "- s"), 1e-3)
    assert late.bound is None
    assert late.reason == "there was no time for it"


def test_a_watch_ends_a_search_that_has_no_bound_yet() -> None:
    with pytest.raises(KeyboardInterrupt):
        lower_bound(REST, None, 600.0, watch=lambda now: isnan(now.objective))


def test_sides_of_a_region_are_told_one_by_one() -> None:
    half = REST.with_(bounds={x: (-5, None)})
    given = setting(half)
    region = Region(given.lift, [(Fraction(-5), None), *[(None, None)] * 3], [])
    assert list(_told(given, region)) == ["x >= -5"]


def test_no_programme_is_begun_that_there_is_no_time_for() -> None:
    """A block of 100 has 5050 entries, and the factorisation the third of 5050^3 products."""
    ring = flint().fmpq_mpoly_ctx.get(("x",), flint().Ordering.lex)
    region = Region(Lift(["x"], ring, 1, []), [(Fraction(-1), Fraction(1))], [])
    blocks = Blocks(Demand("", region, {}, []), ["one"], [[(k,) for k in range(100)]], [], None)
    assert expense([blocks]) == pytest.approx(0.2 + 1.2e-8 * 5050**3 / 3)
    with pytest.raises(LateError, match="no time for a programme of 515 s"):
        Clock(100.0).solved(np.zeros(1), [blocks], inf)

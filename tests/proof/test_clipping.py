"""Clipped sides: a state beyond one is as if it were at it, where that can only be better; and
horizons that are free at no cost.
"""

import copy
from collections.abc import Callable
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import pytest
from test_bound import bounded, solved

from socp import Problem, controls, final_time, states
from socp.errors import SolveError
from socp.proof import LowerBound, checked
from socp.proof.bound.checking import FORMAT, Check
from socp.proof.bound.closing import hull_of
from socp.proof.bound.comparing import Beyond
from socp.proof.bound.domain import domain, setting

Data = dict[str, Any]

h, w, m = states("h w m")  # height, speed, fuel
u = controls("u")

# Vertically up under gravity 1 with thrust 3 and fuel for one second: 2 fast and 1 high after it,
# and then up by another 2. Who waits falls without end.
CLIMB = Problem(
    name="climb",
    minimise=-h,
    dynamics={h: w, w: 3 * u - 1, m: -u},
    bounds={u: (0, 1)},
    start={h: 0, w: 0, m: 1},
    end={m: 0},
)
DIVE = CLIMB.with_(name="dive", minimise=h, dynamics={h: w, w: 1 - 3 * u, m: -u})
LIMITED = CLIMB.with_(name="limited", bounds={u: (0, 1), w: (None, 1)})


@cache
def found(problem: Problem, word: str) -> LowerBound:
    return bounded(problem, solved(problem, word), 2)


@pytest.mark.parametrize(("problem", "side"), [(CLIMB, 0), (DIVE, 1)])
def test_what_falls_without_end_is_clipped_and_the_free_horizon_costs_nothing(
    problem: Problem, side: int
) -> None:
    its = found(problem, "+ -")
    assert its.bound is not None
    assert -3.001 < its.bound <= -3.0
    assert its.certificate["stages"][0]["clipped"] == [[0, side], [1, side]]
    assert checked(its.certificate) == Fraction(its.certificate["bound"])


def test_a_bound_of_a_clipped_state_stays() -> None:
    """Half a second of full thrust to speed 1 and height 1/4, a third of it for 1.5 seconds, and
    up by another 1/2: 2.25.
    """
    its = bounded(LIMITED, solved(LIMITED, "+ b[w.upper] -"), 4)
    assert its.bound is not None
    assert -2.3 < its.bound <= -2.25


def clipped(problem: Problem) -> dict[int, int]:
    """Return the sides that are clipped around states from 0 to 1."""
    given = setting(problem)
    hull = hull_of(given, dict.fromkeys(problem.state_names, (0.0, 1.0)))
    return dict(domain(given, hull, {}, 0.5, given.idle()).region.clipped)


@pytest.mark.parametrize(
    ("change", "sides"),
    [
        ({}, {0: 0, 1: 0}),
        # a spring throws back up who fell
        ({"dynamics": {h: w, w: 3 * u - 1 - h, m: -u}}, {}),
        # who is higher climbs faster
        ({"dynamics": {h: w, w: 3 * u - 1 + h, m: -u}}, {0: 0, 1: 0}),
        # fuel is lost with speed, up or down: a fast fall is no worse
        ({"dynamics": {h: w, w: 3 * u - 1, m: -u - w * w}}, {0: 0}),
        # drag makes the fall one of a given speed, and that keeps the speed in
        ({"dynamics": {h: w, w: 3 * u - 1 - w, m: -u}}, {0: 0}),
        ({"minimise": -h * h}, {}),
        ({"minimise": -h - m}, {0: 0, 1: 0}),
    ],
)
def test_what_is_clipped_depends_on_the_order(change: Data, sides: dict[int, int]) -> None:
    assert clipped(CLIMB.with_(**change)) == sides


def _faces(change: Callable[[list[Any]], Any]) -> Callable[[Data], Any]:
    return lambda data: change(data["stages"][0]["value"]["proofs"])


def _more(function: list[Any]) -> None:
    """Let a function of the speed rise by a millionth more of it, above what was left over."""
    term = next(each for each in function if each[0] == [[1, 1]])
    term[1] = str(Fraction(term[1]) * Fraction(100001, 100000))


def _of_dynamics(name: str, to: str) -> Callable[[Data], Any]:
    """Let the rate of a state be that of another."""

    def change(data: Data) -> None:
        data["problem"]["dynamics"][name] = data["problem"]["dynamics"][to]

    return change


CHANGES: dict[str, Callable[[Data], Any]] = {
    "no clips": lambda data: data["stages"][0].update(clipped=[]),
    "clips unsaid": lambda data: data["stages"][0].pop("clipped"),
    "one clip": lambda data: data["stages"][0]["clipped"].pop(),
    "a clip above": lambda data: data["stages"][0].update(clipped=[[0, 1], [1, 0]]),
    "a clip of fuel": lambda data: data["stages"][0]["clipped"].append([2, 0]),
    "a clip of time": lambda data: data["stages"][0]["clipped"].append([3, 0]),
    "no barriers": lambda data: data["stages"][0].update(exits=[]),
    "faces unproved": _faces(lambda proofs: proofs.__delitem__(slice(2, 8))),
    "the fall unproved": _faces(lambda proofs: proofs.pop(8)),
    "a floor higher": lambda data: data["stages"][0]["box"][1].__setitem__(0, "1/10"),
    "speed is fuel": _of_dynamics("w", "m"),
    "height is fuel": _of_dynamics("h", "m"),
    "an end of more fuel": lambda data: data["problem"]["end"].update(m=[-1.0, -1.0]),
    "a better bound": lambda data: data.update(bound=str(Fraction(data["bound"]) + 1)),
    "nothing left over": lambda data: _more(data["stages"][0]["value"]["function"]),
}


@pytest.mark.parametrize("what", CHANGES)
def test_a_changed_certificate_of_a_clipped_region_is_refused(what: str) -> None:
    data = copy.deepcopy(found(CLIMB, "+ -").certificate)
    data["stages"] = data["stages"][:1]
    data["bound"] = None
    assert float(checked(data)) == pytest.approx(-3.0, abs=1e-3)
    data["bound"] = str(checked(data))
    CHANGES[what](data)
    with pytest.raises(SolveError, match=r"not shown|no certificate"):
        checked(data)


def test_no_climb_whatever_its_thrust_is_higher() -> None:
    """With fuel for a second nobody gets higher, though falling in between."""
    draw, bound = np.random.default_rng(3), found(CLIMB, "+ -").bound
    assert bound is not None
    shares = draw.dirichlet(np.ones(8), 1000)  # of the fuel
    thrust, waits = draw.random((1000, 8)) + 1e-3, draw.exponential(0.2, (1000, 8))
    height, speed = np.zeros(1000), np.zeros(1000)
    for k in range(8):
        burn = shares[:, k] / thrust[:, k]
        for rate, span in ((3 * thrust[:, k] - 1, burn), (-1.0, waits[:, k])):
            height, speed = height + speed * span + rate * span**2 / 2, speed + rate * span
    assert np.max(height) <= -bound


def order(problem: Problem) -> list[tuple[int, int]]:
    """Return the order of height and speed above 0, with 1/h in a certificate."""
    data = {"problem": problem.statement, "format": FORMAT, "stages": [], "bound": None}
    check = Check({**data, "functions": [["inv", [[[[0, 1]], "1"]]]]})
    box: Any = [*([(Fraction(0), Fraction(3))] * 3), None]
    beyond = Beyond(check.model, {0: 0, 1: 0}, box, [check.initial(k) for k in range(4)])
    return beyond.require_order(check.vertices, check.running, check.final)


def test_a_function_that_is_nowhere_on_the_way_keeps_no_sign() -> None:
    """Who falls through 0 is thrust up again by h^2, unless 1/h keeps him above."""
    climbs = {h: w, w: 3 * u - 1 + h * h, m: -u}
    problem = CLIMB.with_(dynamics=climbs, start={h: 1, w: 0, m: 1})
    for each in (problem, problem.with_(minimise=-1 / h)):
        with pytest.raises(SolveError, match=r"how the (rate of w|final cost) depends on h"):
            order(each)
    kept = problem.with_(dynamics={**climbs, w: 3 * u - 1 + h * h - 1 / h})
    assert order(kept) == [(0, 1), (1, 0)]


def test_a_late_start_that_pays_is_refused() -> None:
    """The final time is rewarded, and includes a wait before the start that no function sees."""
    late = CLIMB.with_(minimise=-h - 0.1 * final_time, initial_time=(0, 5))
    data = {"problem": late.statement, "format": FORMAT, "stages": [], "bound": None}
    with pytest.raises(SolveError, match="a start at time zero"):
        Check({**data, "functions": []})
    paid = late.with_(minimise=-h + 0.1 * final_time)
    assert Check({**data, "problem": paid.statement, "functions": []}).rate == Fraction(1, 10)

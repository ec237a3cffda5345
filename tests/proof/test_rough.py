"""Lower bounds of problems with moduli, roots, smallest and largest of two."""

import copy
import os
import time
from collections.abc import Callable
from functools import cache
from math import asinh, sqrt
from typing import Any

import casadi
import pytest

from socp import Problem, controls, states
from socp.errors import SolveError
from socp.proof import LowerBound, checked
from socp.proof.bound.checking import Check
from socp.proof.bound.reading import monomial
from socp.proof.bound.searching import Job, bounds

Data = dict[str, Any]

x, y = states("x y")
u = controls("u")

# From x = 1 straight to 0, then there: the integral of 1 - t, 1/2
ROUGH = Problem(
    name="rough",
    running=casadi.fabs(x),
    dynamics={x: u},
    bounds={u: (-1, 1)},
    start={x: 1},
    final_time=2,
)
# The same with the speed sqrt(1 + x^2): x = sinh(asinh 1 - t), whose square is integrated
ROOT = ROUGH.with_(running=x**2, dynamics={x: u * casadi.sqrt(1 + x**2)})
CASES = {
    "modulus": (ROUGH, 0.5),
    "largest": (ROUGH.with_(running=casadi.fmax(x, -x)), 0.5),
    "smallest": (ROUGH.with_(running=-casadi.fmin(x, -x)), 0.5),
    "root": (ROOT, sqrt(0.5) - asinh(1) / 2),
}


@cache
def found(name: str) -> LowerBound:
    problem, best = CASES[name]
    *_, its = bounds(Job(problem, {}, best, 4, time.time() + 200.0, os.getpid()))
    return its


@pytest.mark.parametrize("name", CASES)
def test_what_has_a_kink_or_a_root_is_bounded(name: str) -> None:
    best, bound = CASES[name][1], found(name).bound
    assert bound is not None
    assert 0.85 * best < bound <= best


def _smooth(data: Data) -> None:
    """Let the function of the last region depend on the modulus."""
    data["stages"][-1]["value"]["function"].append([[[2, 1]], "1/1000000"])


CHANGES: dict[str, Callable[[Data], Any]] = {
    "a function of the modulus": _smooth,
    "no modulus": lambda data: data.update(functions=[]),
    "a root for it": lambda data: data["functions"][0].__setitem__(0, "sqrt"),
    "of something else": lambda data: data["functions"][0].__setitem__(1, [[[[0, 1]], "2"]]),
    "a modulus of it": lambda data: data["functions"].append(["fabs", [[[[2, 1]], "1"]]]),
    "a clip": lambda data: data["stages"][0].update(clipped=[[0, 0]]),
}


@pytest.mark.parametrize("what", CHANGES)
def test_a_changed_certificate_with_a_modulus_is_refused(what: str) -> None:
    data = copy.deepcopy(found("modulus").certificate)
    CHANGES[what](data)
    with pytest.raises(SolveError, match=r"not shown|no certificate"):
        checked(data)


# Down to 0 when y is, and on from there at the speed that grows with y: from 1/16 the root falls by
# up to 1/3 in a second, and after it the state is -1/9 at the lowest. Standing at 0 is a motion too
TUNNEL = Problem(
    name="tunnel",
    minimise=x,
    dynamics={x: -u * casadi.sqrt(-x * y), y: 1 + 0 * u},
    bounds={u: (0, 1), y: (-1, 1), x: (None, 1)},
    start={x: 1 / 16, y: -1},
    final_time=2,
)


def told(problem: Problem, degree: int = 2) -> LowerBound:
    *_, its = bounds(Job(problem, {}, None, degree, time.time() + 200.0, os.getpid()))
    return its


def test_where_a_root_vanishes_a_state_that_stands_may_go_on() -> None:
    its = told(TUNNEL)
    assert its.bound is not None
    assert its.bound <= -1 / 9
    forged = copy.deepcopy(its.certificate)
    forged["stages"][0]["box"][0][0] = "0"
    forged["stages"][0]["exits"] = []
    forged["bound"] = None
    with pytest.raises(SolveError, match="that x stays on side 0"):
        checked(forged)


def test_where_what_a_root_is_of_ends_the_states_end() -> None:
    """A tank of height 1 that empties itself, 1 - t / 2 its root."""
    its = told(TUNNEL.with_(dynamics={x: -casadi.sqrt(x) * (1 + 0 * u), y: u}, start={x: 1, y: -1}))
    assert its.bound is not None
    assert -0.01 < its.bound <= 0.0


def test_a_root_says_nothing_where_it_is_not_taken() -> None:
    """From 0 to -1, and back to where the root at the end is one: 1/3 on either way."""
    problem = ROUGH.with_(minimise=casadi.sqrt(x), running=(x + 1) ** 2, start={x: 0}, final_time=4)
    its = told(problem, 4)
    assert its.bound is not None
    assert 0.5 < its.bound <= 2 / 3
    forged = copy.deepcopy(its.certificate)
    forged["functions"].append(["sqrt", [[[[0, 1]], "1"], [[], "-1"]]])
    check = Check(forged)
    assert check.model.lasting == set()
    assert len(check._inside()) == 0
    assert len(check._target()) == 3


@pytest.mark.parametrize("given", [[[0, 0.5]], [[0, -1]], [[-1, 1]], [[2, 1]], [[0, True]]])
def test_powers_are_whole_numbers(given: list[list[Any]]) -> None:
    """The square of x^(1/2) would be x, and no square."""
    with pytest.raises(SolveError, match="a monomial"):
        monomial(given, 2)

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
from socp.proof.bound.searching import Job, bounds

Data = dict[str, Any]

x = states("x")
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

"""Problems with closed forms: certified with residuals near rounding, with the costates of the
formulas.
"""

import math

import numpy as np
import pytest
from socp_problems.double_integrator_time import problem as double_integrator
from socp_problems.dubins_csc import problem as dubins
from socp_problems.fishery_discounted import problem as fishery

from socp import Problem, Solution, controls, default_guess, final_time, run, states
from socp.registry.plugins import Registry

# Residuals come from the digits of the nonlinear programme, 1e-11, and a little arithmetic
ROUNDING = 1e-10


def solved(registry: Registry, problem: Problem, word: str) -> Solution:
    """Solve a word; the judge must certify it with residuals near rounding."""
    solution = run(registry.methods["lgr-multiphase"](word=word), problem, default_guess(problem))
    assert solution.verdict is not None
    assert solution.verdict.extremal, solution.verdict.reasons
    assert solution.verdict.residual < ROUNDING
    return solution


def test_double_integrator(registry: Registry) -> None:
    """From (1, 1): t1 = 1 + sqrt(3/2); lambda_v = lambda_x (t1 - t) and H = -1 give lambda_x =
    sqrt(2/3).
    """
    solution = solved(registry, double_integrator, "- +")
    slope = math.sqrt(2 / 3)
    for arc in solution.arcs:
        assert arc.costate[0] == pytest.approx(np.full(arc.t.size, slope), abs=1e-9)
        assert arc.costate[1] == pytest.approx(slope * (1 + math.sqrt(1.5) - arc.t), abs=1e-9)


def test_oscillator(registry: Registry) -> None:
    """Bring x'' = u - x to rest in minimum time, u = -1 for 1 then +1 for 1.2: both arcs are
    circles around (u, 0).

    lambda_v = A sin(t1 - t) changes sign at the switch t1 = 1; at rest H = lambda_v u = -1 gives A
    = 1 / sin(1.2).
    """
    first, second = 1.0, 1.2
    at_switch = np.array(
        [1 - math.cos(second), -math.sin(second)]
    )  # backwards from rest at the origin with u = +1
    turn = np.array([[math.cos(first), -math.sin(first)], [math.sin(first), math.cos(first)]])
    start = turn @ (at_switch + np.array([1, 0])) - np.array([1, 0])  # backwards with u = -1
    x, v = states("x v")
    u = controls("u")
    problem = Problem(
        name="oscillator",
        minimise=final_time,
        dynamics={x: v, v: u - x},
        bounds={u: (-1, 1)},
        start={x: float(start[0]), v: float(start[1])},
        end={x: 0, v: 0},
    )
    solution = solved(registry, problem, "- +")
    assert solution.switches == pytest.approx([first], abs=1e-9)
    assert solution.objective == pytest.approx(first + second, abs=1e-9)
    for arc in solution.arcs:
        assert arc.costate[1] == pytest.approx(np.sin(first - arc.t) / math.sin(second), abs=1e-8)
        assert arc.costate[0] == pytest.approx(np.cos(first - arc.t) / math.sin(second), abs=1e-8)


def test_fishery(registry: Registry) -> None:
    """On the singular arc sigma = 0 gives lambda = -(0.6 x - 0.8) exp(-0.12 t) / (0.6 x), x the
    golden-rule stock.
    """
    arc = solved(registry, fishery, "- s +").arcs[1]
    x = arc.x[0]
    assert np.ptp(x) < 1e-9
    # golden rule: F' + F c' / (p - c) = discount, with F = 0.71 x (1 - x/8), price p = 1, unit cost
    # c = 0.8 / (0.6 x)
    growth, slope = 0.71 * x[0] * (1 - x[0] / 8), 0.71 * (1 - x[0] / 4)
    assert slope + growth * (4 / 3 / x[0] ** 2) / (1 - 4 / 3 / x[0]) == pytest.approx(
        0.12, abs=1e-9
    )
    assert arc.costate[0] == pytest.approx(
        -(0.6 * x - 0.8) * np.exp(-0.12 * arc.t) / (0.6 * x), abs=1e-9
    )


def test_dubins(registry: Registry) -> None:
    """Along the straight piece, of heading atan(12/5), H = -1 gives (lambda_x, lambda_y) = -(5, 12)
    / 13 throughout.
    """
    solution = solved(registry, dubins, "+ s -")
    heading = math.atan2(12, 5)
    assert solution.arcs[1].x[2] == pytest.approx(
        np.full(solution.arcs[1].t.size, heading), abs=1e-9
    )
    for arc in solution.arcs:
        assert arc.costate[0] == pytest.approx(np.full(arc.t.size, -5 / 13), abs=1e-9)
        assert arc.costate[1] == pytest.approx(np.full(arc.t.size, -12 / 13), abs=1e-9)

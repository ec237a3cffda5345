"""Chains of many states by direct methods, held against bounded least squares on the same grid."""

import casadi
import numpy as np
import pytest
from chains import masses, rod
from scipy.optimize import lsq_linear

from socp import Problem, default_guess, run
from socp.model import Solution
from socp.registry.plugins import Registry

REGISTRY = Registry.load()


def linear(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Return A (nx, nx) and b (nx,) of rates A x + b u, by differences: exact where they are."""
    rate = casadi.Function("rate", [problem.x, problem.u], [problem.rate])
    nx = problem.x.numel()
    columns = [rate(np.eye(nx)[i], 0).full().ravel() for i in range(nx)]
    return np.transpose(columns), rate(np.zeros(nx), 1).full().ravel()


def responses(problem: Problem, steps: int, implicit: float) -> tuple[np.ndarray, np.ndarray]:
    """Return states (nodes, nx) without a control, and their slopes (nodes, nx, controls) in the
    controls where they are collocated: of the implicit Euler (1) or the trapezoidal rule (1/2).
    """
    (A, b), h = linear(problem), problem.final_time_box[0] / steps
    nx, first = b.size, int(implicit == 1.0)
    left, right = np.eye(nx) - h * implicit * A, np.eye(nx) + h * (1.0 - implicit) * A
    x, slope = problem.start_box[0].copy(), np.zeros((nx, steps + 1 - first))
    states, slopes = [x], [slope]
    for k in range(steps):
        x, slope = np.linalg.solve(left, right @ x), right @ slope
        slope[:, k + 1 - first] += h * implicit * b
        if not first:
            slope[:, k] += h * (1.0 - implicit) * b
        slope = np.linalg.solve(left, slope)
        states.append(x)
        slopes.append(slope)
    return np.array(states), np.array(slopes)


def least(problem: Problem, rows: np.ndarray, right: np.ndarray) -> float:
    """Return the least sum of squares of rows u - right over the box of the control."""
    low, high = problem.box[:, 0].tolist()
    found = lsq_linear(rows, right, (low, high), method="bvls", tol=1e-14, max_iter=1000)
    assert found.success
    return float(2.0 * found.cost)


def solved(problem: Problem, kind: str, steps: int) -> Solution:
    found = run(REGISTRY.method(kind)(steps=steps), problem, default_guess(problem))
    assert found.stop.ok
    assert found.effort.iterations < 50  # it is convex: none may take a hundred
    return found


@pytest.mark.slow
@pytest.mark.parametrize("count", [10, 50, 100])
@pytest.mark.parametrize(("kind", "implicit"), [("euler-ipopt", 1.0), ("trapezoidal", 0.5)])
def test_a_rod_is_warmed_as_well_as_can_be(kind: str, implicit: float, count: int) -> None:
    """In a tenth of the time the far end stays cold: the least is not zero."""
    problem, steps = rod(count).with_(final_time=0.1), 200
    states, slopes = responses(problem, steps, implicit)
    best = least(problem, slopes[-1] / np.sqrt(count), (0.3 - states[-1]) / np.sqrt(count))
    assert best > 1e-4
    assert solved(problem, kind, steps).objective == pytest.approx(best, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("count", [5, 50])
@pytest.mark.parametrize(("kind", "implicit"), [("euler-ipopt", 1.0), ("trapezoidal", 0.5)])
def test_masses_are_held_as_well_as_can_be(kind: str, implicit: float, count: int) -> None:
    problem, steps = masses(count), 100
    states, slopes = responses(problem, steps, implicit)
    weights = np.full(steps + 1, problem.final_time_box[0] / steps)
    weights[0] *= 1.0 - implicit
    weights[-1] *= implicit
    root = np.sqrt(weights)[:, None]
    rows = (root[..., None] * slopes[:, :count]).reshape(-1, slopes.shape[-1])
    best = least(problem, rows, -(root * states[:, :count]).ravel())
    found = solved(problem, kind, steps)
    assert found.objective == pytest.approx(best, rel=1e-6)
    verdict = found.verdict
    assert verdict is not None
    if kind == "trapezoidal":  # the far masses are off by any number of their own next to nothing
        assert verdict.grade is not None
        assert verdict.grade.error < verdict.grade.size

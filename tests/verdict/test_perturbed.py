"""No variation of the controls lowers an objective that is claimed to be a strict strong minimum.

Needles, shifts and waves of sizes 1e-1 to 1e-4 change the control, within its box; the lengths of
the arcs then bring the motion back to the end, where they can, and the time taken is compared.
"""

from importlib import import_module

import casadi
import numpy as np
import pytest

from socp import Problem, Solution, Word, default_guess, judge
from socp.methods.solving import Follower
from socp.model.ladder.second_order import Minimum
from socp.verdict.minimum.order import second_order

WORDS = {
    "double_integrator_time": "- +",
    "rayleigh_time": "+ - +",
    "robot_arm": "u_rho: - + + + + -; u_theta: + + + - - -; u_phi: - - + + - -",
}
STEPS = 40  # of an arc: RK4 with a control that is constant on every step is off by 1e-8


def variations(problem: Problem, solution: Solution, count: int) -> np.ndarray:
    """Return controls (nu, arcs * STEPS, count), each step of the word's own with a variation."""
    rng = np.random.default_rng(1)
    low, high = problem.box
    base = np.hstack([np.repeat(arc.u[:, :1], STEPS, axis=1) for arc in solution.arcs])
    found = np.repeat(base[:, :, None], count, axis=2)
    steps, width = base.shape[1], high - low
    for k in range(1, count):
        size = 10.0 ** -rng.uniform(1, 4)
        i, at = rng.integers(len(width)), rng.integers(steps)
        if k % 3 == 0:  # a needle
            until = at + 1 + int(size * steps)
            found[i, at:until, k] = rng.uniform(low[i], high[i])
        elif k % 3 == 1:  # the control of another arc, for a while
            found[i, at : at + 1 + int(size * steps), k] = base[i, rng.integers(steps)]
        else:
            wave = np.sin(rng.uniform(1, 30) * np.arange(steps) / steps + rng.uniform(0, 6))
            found[i, :, k] = np.clip(base[i] + size * width[i] * wave, low[i], high[i])
    return found


def ended(problem: Problem, controls: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Return the final states (nx, k) of controls (nu, steps, k) with arcs of lengths (arcs, k)."""
    count = lengths.shape[1]
    rate = casadi.Function("f", [problem.x, problem.u], [problem.rate]).map(count)
    x = np.repeat(problem.start_box[0][:, None], count, axis=1)
    for step in range(controls.shape[1]):
        h, u = lengths[step // STEPS] / STEPS, controls[:, step]
        a = rate(x, u).full()
        b = rate(x + h / 2 * a, u).full()
        c = rate(x + h / 2 * b, u).full()
        x = x + h / 6 * (a + 2 * b + 2 * c + rate(x + h * c, u).full())
    return x


@pytest.mark.slow
@pytest.mark.parametrize("name", WORDS)
def test_no_variation_is_faster(name: str) -> None:
    count = 200
    problem = import_module(f"socp_problems.{name}").problem
    word = Word.parse(WORDS[name], problem.control_names)
    solution = judge(problem, Follower()(problem, word, default_guess(problem)))
    assert second_order(problem, solution).kind is Minimum.STRONG
    controls = variations(problem, solution, count)
    own = np.diff([0.0, *solution.junctions, solution.final_time])
    lengths = np.repeat(own[:, None], count, axis=1)
    target, h = problem.end_box[0][:, None], 1e-6
    for turn in range(10):
        missed = ended(problem, controls, lengths) - target
        if turn in {0, 3}:
            columns = []
            for j in range(own.size):
                moved = lengths + h * np.eye(own.size)[:, [j]]
                columns.append((ended(problem, controls, moved) - target - missed) / h)
            back = np.linalg.pinv(np.stack(columns, axis=1).transpose(2, 0, 1))
        step = np.einsum("kij,jk->ik", back, missed)
        lengths = np.clip(lengths - step, 0.5 * own[:, None], 2.0 * own[:, None])
    met = (np.abs(ended(problem, controls, lengths) - target) < 1e-9).all(axis=0)
    assert met[0]
    assert met.mean() > 0.5
    taken = lengths.sum(axis=0)
    assert taken[0] == pytest.approx(solution.final_time, abs=1e-5)
    assert (taken[met] >= taken[0] - 1e-9).all()
    assert (taken[met] > taken[0] + 1e-7).mean() > 0.5

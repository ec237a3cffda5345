"""Meshes along words resolve what states do not show: the running cost and the laws."""

import casadi
import numpy as np
import pytest

from socp.methods import Follower, default_guess, guess_of
from socp.model import Mode, Problem, Word, controls, states
from socp.transcription import refined_meshes, unresolved

x, v = states("x v")
a, b = controls("a b")


def hill(eps: float) -> Problem:
    """Return a train over a hill of steepness 1 / eps, that goes 6 in 4.8 for least work."""
    slope = 2 * (casadi.atan((x - 2) / eps) + casadi.atan((x - 4) / eps)) / np.pi
    return Problem(
        name="hill",
        running=a * v,
        dynamics={x: v, v: slope - (0.3 + 0.14 * v + 0.16 * v**2) + a - b},
        bounds={a: (0, 10), b: (0, 2)},
        start={x: 0, v: 0},
        end={x: 6, v: 0},
        final_time=4.8,
    )


def test_a_force_that_balances_a_hill_is_not_resolved_by_a_motion_that_cruises() -> None:
    own = hill(0.3)
    t = np.linspace(0, 4.8, 9)
    motion = np.array([1.25 * t, np.full(9, 1.25)])
    arc = guess_of(own, t, motion, np.array([1.0 + np.tanh(5 * (t - 1.6)), 0 * t])).arcs[0]
    whole = type(arc)(
        t=arc.t,
        x=arc.x,
        u=arc.u,
        costate=arc.costate,
        mesh=np.array([0, 8]),
        side="both",
        modes=arc.modes,
    )
    solution = guess_of(own, t, motion, 0 * motion)
    straight = type(solution)(**{**vars(solution), "arcs": (whole,)})
    rest = unresolved(own, straight)
    assert rest[0][0] > 1e-3
    meshes = refined_meshes((whole,), rest, 8, 1e-7)
    assert meshes is not None
    assert len(meshes[0]) > 1
    smooth = type(arc)(
        t=arc.t,
        x=arc.x,
        u=1.0 + 0 * arc.u,
        costate=arc.costate,
        mesh=np.array([0, 8]),
        side="both",
        modes=arc.modes,
    )
    assert unresolved(own, type(solution)(**{**vars(solution), "arcs": (smooth,)}))[0][0] < 1e-12


@pytest.mark.parametrize(
    ("eps", "truth"),
    [(0.3, 9.24044114), pytest.param(0.05, 12.311977, marks=pytest.mark.slow)],
)
def test_the_work_of_a_train_is_right_along_its_word(eps: float, truth: float) -> None:
    """Truths by explicit Runge-Kutta of order 4 with 2000 constant controls, and 20 intervals an
    arc.
    """
    drive = ("upper", "lower"), ("singular", "lower"), ("lower", "lower"), ("lower", "upper")
    own = hill(eps)
    word = Word(("a", "b"), tuple(tuple(map(Mode, each)) for each in drive))
    found = Follower()(own, word, default_guess(own))
    assert found.stop.ok
    assert found.objective == pytest.approx(truth, rel=2e-9 if eps == 0.3 else 1e-6)

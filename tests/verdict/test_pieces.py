"""What moves states along laws: those that differ in constants alone share it."""

import casadi
import numpy as np
import pytest

from socp import Problem, controls, states
from socp.model import Arc, Mode, numbers
from socp.verdict.simulation.pieces import closed_flow, open_flow, piece_of_law


def problem() -> Problem:
    """Return a motion x' = u + w x with a law w = sin x."""
    x = states("x")
    u, w = controls("u w")
    return Problem(
        name="pieces",
        minimise=x,
        running=u + 2 * w,
        dynamics={x: u + w * x},
        bounds={u: (-1, 2), w: (-1, 1)},
        start={x: 0},
        singular={w: casadi.sin(x)},
        final_time=1,
    )


def arc(modes: str) -> Arc:
    t = np.array([0.0, 1.0])
    return Arc(
        t=t,
        x=np.zeros((1, 2)),
        u=np.zeros((2, 2)),
        costate=np.zeros((1, 2)),
        mesh=np.array([0, 1]),
        side="both",
        modes=tuple(map(Mode.parse, modes)),
    )


@pytest.mark.parametrize(("modes", "u"), [("++", (2, 1)), ("-+", (-1, 1)), ("+-", (2, -1))])
def test_bangs_move_along_the_open_flow_under_their_levels(modes: str, u: tuple[int, int]) -> None:
    known = problem()
    piece = piece_of_law(known, arc(modes))
    assert piece.modes is not None
    assert piece.plan is not None
    assert closed_flow(known, piece.modes) is open_flow(known)
    assert piece.plan[1][:, 0] == pytest.approx(u)
    x, t = np.array([[0.5, -0.3]]), np.zeros(2)
    assert piece.controls(known, t, x, np.empty(0)) == pytest.approx(np.tile(u, (2, 1)).T)


def test_a_law_beside_either_bang_has_one_flow() -> None:
    known = problem()
    up, down = (piece_of_law(known, arc(modes)) for modes in ("+s", "-s"))
    assert up.modes is not None
    assert down.modes is not None
    flow = closed_flow(known, up.modes)
    assert flow is closed_flow(known, down.modes) is not open_flow(known)
    x = np.array([[0.5, -0.3]])
    for piece, level in ((up, 2.0), (down, -1.0)):
        assert piece.plan is not None
        (rates,) = numbers(flow, x, piece.plan[1], 0.0, np.empty(0))
        wanted = np.vstack([level + np.sin(x) * x, level + 2 * np.sin(x)])
        assert rates == pytest.approx(wanted)

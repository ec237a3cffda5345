"""Motions that enlarge what an integrator leaves, by exp(17): that is not held against them, while
what solutions are off by is.
"""

import numpy as np
import pytest
from casadi import cos, sin
from records import built

from socp.model import Arc, Problem, Solution, Stop, controls, final_time, states
from socp.transcription.mesh import table
from socp.transcription.schemes import lgr
from socp.verdict import judge, verify

_RATE, _END = 1.7, 10.0
x, y = states("x y")
u = controls("u")
AWAY = Problem(
    name="away",
    minimise=final_time,
    dynamics={x: u, y: _RATE * (y - cos(x)) - sin(x) * u},
    bounds={u: (-1, 1)},
    start={x: 0, y: 1},
    end={x: _END},
)


def claimed(off: float = 0.0) -> Solution:
    """Return x = t, y = cos t under u = 1, which is the fastest, with a y that is `off` later."""
    joined = table([(1.0, lgr(20))] * 4)
    t = _END * joined.tau
    rows = np.array([t, np.cos(t) + off * np.sin(np.pi * joined.tau)])
    arc = Arc(
        t=t,
        x=rows,
        u=np.ones((1, t.size)),
        costate=np.full_like(rows, np.nan),
        mesh=joined.mesh,
        side=joined.side,
        modes=("+",),
    )
    names = {"state_names": ("x", "y"), "control_names": ("u",)}
    return built(
        problem="away", method="claim", arcs=(arc,), objective=_END, stop=Stop.SOLVED, **names
    )


def test_steps_of_the_integrator_are_not_held_against_an_extremal() -> None:
    assert max(each.drift for each in verify(AWAY, claimed())) > 1e-6
    judged = judge(AWAY, claimed())
    assert judged.extremal
    assert max(each.drift for each in judged.verified) < 1e-7


@pytest.mark.parametrize("off", [5e-4, 1e-3])  # steps leave 6e-5
def test_what_the_states_are_off_by_is(off: float) -> None:
    judged = judge(AWAY, claimed(off))
    assert not judged.extremal
    assert max(each.drift for each in judged.verified) == pytest.approx(off, rel=0.1)

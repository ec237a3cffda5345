"""Controls that are held over every interval of a mesh."""

import numpy as np
import pytest

from socp import (
    Ipopt,
    Problem,
    controls,
    default_guess,
    single_phase,
    solve_collocated,
    states,
    time,
    uniform,
)
from socp.transcription import Scheme, lgr, radau_iia

x, u = states("x"), controls("u")
# x = u t on [0, 1] costs u^2 / 3 - u / 2 + 1 / 5: least at u = 3 / 4
PARABOLA = Problem(
    name="parabola",
    running=(x - time**2) ** 2,
    dynamics={x: u},
    bounds={u: (-5, 5)},
    start={x: 0},
    final_time=1,
)


@pytest.mark.parametrize("scheme", [radau_iia(3), lgr(3)], ids=["right", "left"])
def test_a_held_control_is_the_best_constant_and_reaches_what_it_claims(scheme: Scheme) -> None:
    phased = single_phase(PARABOLA).with_phases(held=True)
    found = solve_collocated(phased, [uniform(scheme, 1)], Ipopt(), default_guess(PARABOLA))
    np.testing.assert_allclose(found.arcs[0].u, 0.75, atol=1e-7)
    assert found.objective == pytest.approx(1 / 5 - 3 / 16, rel=1e-9)


def test_controls_of_different_intervals_are_free_of_each_other() -> None:
    phased = single_phase(PARABOLA).with_phases(held=True)
    found = solve_collocated(phased, [uniform(radau_iia(3), 4)], Ipopt(), default_guess(PARABOLA))
    (arc,) = found.arcs
    means = [arc.u[0, arc.nodes(k, "u")] for k in range(4)]
    assert all(np.ptp(each) < 1e-7 for each in means)
    # the slope of t^2 in the middle of an interval, but for what the ends change
    np.testing.assert_allclose([each[0] for each in means[1:-1]], [0.75, 1.25], atol=0.1)

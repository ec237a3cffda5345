"""Motions that may as well begin later: their times are open, and no minimum is strict."""

from math import inf, sqrt

import pytest
from saddles import along

from socp import Problem, controls, states
from socp.model.ladder.second_order import Minimum
from socp.verdict.minimum.order import second_order

MU, THRUST, LOW, HIGH, TIME = 3.986e14, 0.5, 7.0e6, 7.5e6, 4000.0  # Earth; m, s
LENGTHS = 336.201803816, 258.092936112, 2816.00066983, 253.502189640, 336.20240061

r, radial, tangential = states("r radial tangential")
burn = controls("burn")
# From one circular orbit to another with the least fuel, thrust along the way: wherever on the
# first one the burns begin, they are the same
TRANSFER = Problem(
    name="transfer",
    running=THRUST * burn,
    dynamics={
        r: radial,
        radial: tangential**2 / r - MU / r**2,
        tangential: THRUST * burn - radial * tangential / r,
    },
    bounds={burn: (0, 1)},
    start={r: LOW, radial: 0, tangential: sqrt(MU / LOW)},
    end={r: HIGH, radial: 0, tangential: sqrt(MU / HIGH)},
    final_time=TIME,
)


@pytest.mark.parametrize("longer", [0.0, 400.0])
def test_times_of_burns_on_a_circular_orbit_are_open_and_no_minimum_is_strict(
    longer: float,
) -> None:
    """What time there is to wait, before or after, changes nothing."""
    problem = TRANSFER.with_({"final_time": TIME + longer})
    solution = along(problem, "burn: - + - + -", [*LENGTHS[:-1], LENGTHS[-1] + longer])
    assert solution.extremal
    # Hohmann's two impulses are a lower bound, which long burns miss by little
    ratio = HIGH / LOW
    impulses = sqrt(MU / LOW) * (sqrt(2 * ratio / (1 + ratio)) - 1)
    impulses += sqrt(MU / HIGH) * (1 - sqrt(2 / (1 + ratio)))
    assert 1 < solution.objective / impulses < 1.001
    assert solution.objective == pytest.approx(255.79776, rel=1e-7)
    assert solution.verdict is not None
    assert solution.verdict.digits >= 9
    assert [error for _, error in solution.verdict.switch_errors] == [inf] * 4
    assert second_order(problem, solution).kind is Minimum.DEGENERATE

"""Parameters that state constraints depend on: how high a wall is, how large a store."""

import pytest
from saddles import along

from socp import Problem, controls, parameters, solve, states
from socp.verdict.minimum.order import second_order

x, v = states("x v")
u = controls("u")
size = parameters("size")


def store(price: float, size_at_most: float = 5.0) -> Problem:
    """Fill a store at a rate of 1 and keep it full: minimise price size^2 - integral of x over 2.

    The integral is size^2 / 2 + size (2 - size), so that size = 2 / (1 + 2 price).
    """
    return Problem(
        name="store",
        minimise=price * size**2,
        running=-x,
        dynamics={x: u},
        bounds={u: (-1, 1), size: (0, size_at_most)},
        path={"full": x <= size},
        start={x: 0},
        final_time=2,
    )


@pytest.mark.parametrize("price", [1.0, 3.0])
def test_a_store_is_as_large_as_its_content_is_worth(price: float) -> None:
    solution = along(store(price), "u: + b[full]", [0.5, 1.5])
    best = 2 / (1 + 2 * price)
    assert solution.extremal
    assert solution.parameters["size"] == pytest.approx(best, rel=1e-9)
    assert solution.switches == pytest.approx([best], rel=1e-9)
    assert solution.objective == pytest.approx(-best, rel=1e-9)
    assert second_order(store(price), solution).kind.shown


def test_a_size_that_is_wanted_larger_stays_at_its_limit() -> None:
    """Below its best every unit of size is worth 2 - 3 size."""
    solution = along(store(1.0, 0.5), "u: + b[full]", [0.5, 1.5])
    assert solution.extremal
    assert solution.parameters["size"] == pytest.approx(0.5)
    wrong = along(store(1.0).with_({"bounds.size": (0.5, 0.5)}), "u: + b[full]", [0.5, 1.5])
    assert wrong.extremal  # as it is given


def test_a_ceiling_that_is_touched_is_as_low_as_the_motion_allows() -> None:
    """Thrown up at 1 and held down by 2 at most, a body comes to 1/4, whatever holds it down after:
    the multiplier of the touch is what a ceiling costs.
    """
    problem = Problem(
        name="ceiling",
        minimise=size,
        dynamics={x: v, v: u},
        bounds={u: (-2, 2), size: (0, 5)},
        path={"ceiling": x <= size},
        start={x: 0, v: 1},
        end={x: 0, v: -1},
        final_time=1,
    )
    solution = along(problem, "u: - -", [0.5, 0.5])
    assert solution.verdict is not None
    assert solution.parameters["size"] == pytest.approx(0.25, rel=1e-7)
    stationary = [each for each in solution.verdict.findings if "parameter" in each.condition]
    assert all(each.residual < 1e-6 for each in stationary)


def test_a_store_whose_size_is_chosen_is_found_from_nothing() -> None:
    found = solve(store(1.0))
    assert found.extremal
    assert found.objective == pytest.approx(-2 / 3, rel=1e-9)

"""Tables of prices: problems whose optimum is counted by hand, found without a guess."""

import pytest
from casadi import pw_const, pw_lin

from socp import Problem, Solution, controls, default_guess, run, states, time
from socp.registry import Registry

x = states("x")
u = controls("u")


def stored(price: object, holding: float = 0.0, **more: object) -> Problem:
    """Return a store that is emptied at rate 1 and filled at most at rate 3, over two hours."""
    return Problem(
        name="stored",
        running=price * u + holding * x,
        dynamics={x: u - 1},
        bounds={u: (0, 3), x: (0, None)},
        start={x: 0},
        **{"final_time": 2, **more},
    )


def found(problem: Problem) -> Solution:
    return run(Registry.load().method("auto")(seconds=600.0), problem, default_guess(problem))


@pytest.mark.slow
def test_a_store_is_filled_just_before_the_price_jumps() -> None:
    # the demand of the second hour, 1, is bought in the last half hour of the first: 1/2 + 3/2 for
    # what is bought at price 1, and a store of area 1/4 + 1/2 at 0.1
    solution = found(stored(pw_const(time, [1], [1, 3]), 0.1))
    assert solution.extremal
    assert str(solution.word) == "u: b[x.lower] + -"
    assert solution.objective == pytest.approx(2.075, abs=1e-9)
    assert solution.switches == pytest.approx([0.5, 1.0], abs=1e-8)


@pytest.mark.slow
def test_while_a_price_is_flat_when_to_buy_is_left_open() -> None:
    # all of the demand, 2, is bought in the first hour at price 1, in any order that keeps the
    # store from running empty
    solution = found(stored(pw_const(time, [1], [1, 3])))
    assert solution.extremal
    assert solution.objective == pytest.approx(2, abs=1e-9)
    assert solution.verdict is not None
    assert any("leaves u" in note and "open" in note for note in solution.verdict.notes)


@pytest.mark.slow
def test_a_price_by_straight_lines_is_followed_across_its_knots() -> None:
    solution = found(stored(pw_lin(time, [0, 1, 2], [1, 0.5, 2])))
    assert solution.extremal
    assert solution.objective == pytest.approx(by_hand(), abs=1e-9)


def by_hand() -> float:
    """Return the least cost of the price by straight lines: idle until the store is empty.

    From a to b at rate 3, price equal at both, as what is bought at a waits for b: 1 - a/2 = 1/2 +
    1.5 (b - 1), and 3 (b - a) = 2 - a, the demand from a on. Before a the demand alone is bought.
    """
    # b = 1 + (1 - a/2 - 1/2) / 1.5 = 4/3 - a/3, so 3 (4/3 - 4 a/3) = 2 - a and a = 2/3, b = 10/9
    a, b = 2 / 3, 10 / 9
    before = a - a**2 / 4
    down, up = (1 - a) - (1 - a**2) / 4, 0.5 * (b - 1) + 0.75 * (b - 1) ** 2
    return before + 3 * (down + up)


@pytest.mark.slow
def test_a_battery_by_the_hour_idles_on_its_limits() -> None:
    # filled at rate 2 in the hour at price 1, idle and full for an hour, emptied in the hour at
    # price 5: 2 bought at 1, 1.6 sold at 5 within 0.8 of that hour, whenever
    soc = states("soc")
    buy, sell = controls("buy sell")
    problem = Problem(
        name="idle",
        running=pw_const(time, [1, 2, 3], [1, 3, 5, 2]) * (buy - sell),
        dynamics={soc: buy - 1.25 * sell},
        bounds={buy: (0, 2), sell: (0, 2), soc: (0, 2)},
        start={soc: 0},
        final_time=4,
    )
    solution = found(problem)
    assert solution.extremal
    assert solution.objective == pytest.approx(2 - 8, abs=1e-8)

"""Problems that differ in values only: constants as parameters, and work that all of them share."""

from dataclasses import replace

import numpy as np
import pytest
from ponds import POND, x

from socp.errors import ProblemError
from socp.laws import arc_law
from socp.model import (
    Family,
    Mode,
    Place,
    Problem,
    constants,
    controls,
    final_time,
    numbers,
    rate_function,
    running_function,
    states,
)
from socp.registry import solve

S = (Mode("singular"),)


def cost(problem: Problem, at: float, level: float) -> float:
    """Return the running cost of a pond at a state."""
    given = [at], [0.0], 0.0, [level]
    return float(numbers(running_function(problem), *map(np.array, given))[0][0, 0])


def test_a_constant_of_the_formula_is_a_parameter_that_is_held() -> None:
    family = Family(POND, ("level",))
    one = family.at({"level": 0.25})
    law = arc_law(one, S)
    other = family.at({"level": 0.5})
    assert (one.parameter_names, one.constants) == (("level",), {})
    assert other.parameter_box.tolist() == [[0.5], [0.5]]
    assert one.parameter_box.tolist() == [[0.25], [0.25]]
    assert arc_law(other, S) is law
    assert running_function(other) is running_function(one)
    assert cost(other, 1.0, 0.5) == pytest.approx(0.25)


def test_a_constant_of_the_bounds_moves_them_and_shares_nothing() -> None:
    family = Family(POND, ("rate",))
    one, other = family.at({"rate": 1.0}), family.at({"rate": 2.0})
    assert (one.box.tolist(), other.box.tolist()) == ([[-1.0], [1.0]], [[-2.0], [2.0]])
    assert one.parameter_names == ()
    assert rate_function(other) is not rate_function(one)


def test_a_constant_of_an_end_moves_that_as_well() -> None:
    depth = constants(depth=0.25)
    pond = replace(POND, running=(x - depth) ** 2, end={x: 2 * depth}, formula=None)
    family = Family(pond, ("depth", "start.x"))
    found = family.at({"depth": 0.3, "start.x": 1.5})
    assert (found.end_box.tolist(), found.start_box.tolist()) == ([[0.6]] * 2, [[1.5]] * 2)
    assert found.parameter_box.tolist() == [[0.3], [0.3]]


def test_ends_alone_are_shared() -> None:
    family = Family(POND, ("start.x", "final_time"))
    one = family.at({"start.x": 1.0, "final_time": 4.0})
    law = arc_law(one, S)
    other = family.at({"start.x": 1.2, "final_time": 3.0})
    assert arc_law(other, S) is law
    assert other.start_box.tolist() == [[1.2], [1.2]]
    assert other.fingerprint == POND.with_({"start.x": 1.2, "final_time": 3.0}).fingerprint


def test_a_horizon_that_may_be_held_at_its_least_tells_no_hamiltonian() -> None:
    """The Hamiltonian, 0 where the horizon is free, takes the costates out of the singular law."""
    a, b, c = states("a b c")
    jerk = controls("jerk")
    free = Problem(
        name="jerk",
        running=a**2 + b**2 + c**2,
        dynamics={a: b, b: c - c**3 / 3, c: jerk},
        bounds={jerk: (-3, 3)},
        start={a: 1, b: 0, c: 0},
        end={a: 0},
        final_time=(0, None),
        guess={final_time: 4},
    )
    family = Family(free, ("final_time.lower",))
    assert not arc_law(family.base, S).costate
    held = family.at({"final_time.lower": 2.6})
    assert arc_law(held, S).costate
    assert arc_law(family.at({"final_time.lower": -1.0}), S) is arc_law(family.base, S)


def test_what_is_worked_out_later_is_shared_as_well() -> None:
    family = Family(POND, ("level",))
    one, other = family.at({"level": 0.25}), family.at({"level": 0.5})
    assert arc_law(one, S) is arc_law(other, S)
    assert one.costate is other.costate  # in whose symbols it may be written


def test_solutions_go_in_and_come_out() -> None:
    family = Family(POND, ("level",))
    made = solve(POND, method="lgr-multiphase", word="- s +")
    inside = family.inside(made, family.at({"level": 0.25}))
    assert (inside.parameters, family.outside(inside).parameters) == ({"level": 0.25}, {})


def test_a_verdict_says_nothing_of_a_parameter_that_is_a_constant() -> None:
    family = Family(POND, ("level",))
    inside = solve(family.at({"level": 0.25}), method="lgr-multiphase", word="- s +")
    before, after = inside.verdict, family.outside(inside).verdict
    assert before is not None
    assert after is not None
    assert [each.place for each in set(before.findings) - set(after.findings)] == [
        Place(of="level")
    ]
    assert after.extremal


def test_a_constant_in_an_exponent_is_changed_in_the_problem_itself() -> None:
    power = constants(power=2.0)
    family = Family(replace(POND, running=(x - 0.25) ** 2 + x**power, formula=None), ("power",))
    found = family.at({"power": 2.5})
    assert (found.parameter_names, found.constants["power"].value) == ((), 2.5)
    assert found.fingerprint == family.problem.with_(power=2.5).fingerprint


def test_what_cannot_be_is_named() -> None:
    with pytest.raises(ProblemError, match=r"final_time: -1.0 is not after"):
        Family(POND, ("final_time",)).at({"final_time": -1.0})

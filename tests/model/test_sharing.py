"""Work shared between problems that differ in their ends alone."""

import pytest
from ponds import POND, u, x

from socp.laws import arc_law
from socp.model import Mode, Problem, rate_function, share, states


def pond(**changes: object) -> Problem:
    return POND.with_(**changes)


@pytest.mark.parametrize(
    "changes", [{"start": {x: 1.2}}, {"end": {x: 0.9}}, {"final_time": 3.0}, {"guess": {x: 2}}]
)
def test_problems_of_other_ends_share_laws_and_functions(changes: dict[str, object]) -> None:
    one, other = pond(), pond(**changes)
    law, rate = arc_law(one, (Mode("singular"),)), rate_function(one)
    assert share(one, other)
    assert arc_law(other, (Mode("singular"),)) is law
    assert rate_function(other) is rate
    assert other.start_box.tolist() == pond(**changes).start_box.tolist()
    assert other.final_time_box == pond(**changes).final_time_box
    assert other.statement != one.statement or "guess" in changes


def test_what_is_worked_out_later_both_have() -> None:
    one, other = pond(), pond(final_time=3.0)
    rate_function(one)
    share(one, other)
    law = arc_law(other, (Mode("singular"),))
    third = pond(final_time=5.0)
    share(other, third)
    assert arc_law(third, (Mode("singular"),)) is law


@pytest.mark.parametrize(
    "changes",
    [{"level": 0.3}, {"rate": 2.0}, {"bounds": {u: (-1, 2)}}, {"running": x**2}],
)
def test_problems_that_move_otherwise_share_nothing(changes: dict[str, object]) -> None:
    one, other = pond(), pond(**changes)
    rate = rate_function(one)
    assert not share(one, other)
    assert rate_function(other) is not rate


def test_a_problem_of_other_names_shares_nothing() -> None:
    y = states("y")
    other = Problem(
        name="other", running=y**2, dynamics={y: u}, bounds={u: (-1, 1)}, start={y: 1}, final_time=1
    )
    assert not share(pond(), other)

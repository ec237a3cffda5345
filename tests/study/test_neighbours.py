"""Neighbours of a sweep, corrected by Newton with what is known of the last one, against the same
problems solved by themselves.
"""

from functools import partial

import numpy as np
import pytest
from ponds import POND

from socp import Problem, solve
from socp.model import rung_of, silent
from socp.registry import Registry
from socp.study.sweeping.chain import Job, Task, Walked
from socp.verdict import with_second_order

PROBLEMS = Registry.load()


def walked(problem: Problem, name: str, values: list[float]) -> Walked:
    """Return a chain over values of a number."""
    return walked_through(problem, [{name: value} for value in values])


def walked_through(problem: Problem, points: list[dict[str, float]]) -> Walked:
    """Return a chain over points."""
    job = Job(0, tuple(enumerate(points)), None, frozenset())
    found = Task(partial(lambda p: p, problem), "", "auto", {})(job)
    assert found is not None
    return found


def same_as_cold(problem: Problem, name: str, values: list[float]) -> None:
    rows = walked(problem, name, values).rows
    assert [row["start"] for row in rows.values()] == [None, *range(len(values) - 1)]
    posed = problem.with_({name: values[-1]})
    cold = with_second_order(posed, solve(posed, watch=silent))
    row, horizon = rows[len(values) - 1], cold.final_time - cold.initial_time
    assert row["objective"] == pytest.approx(cold.told, rel=1e-10, abs=1e-10)
    assert row["final_time"] == pytest.approx(cold.final_time, rel=1e-10)
    assert np.allclose(row["switches"], cold.junctions, rtol=0.0, atol=1e-10 * horizon)
    assert (row["word"], row["rung"]) == (cold.word, rung_of(cold).value)


def test_neighbours_of_the_pond_are_in_closed_form() -> None:
    """Down to the level and along it; from 1.5 on there is time for both, before that for none."""
    rows = walked(POND, "level", [0.25, 0.26, 0.27, 0.3]).rows
    assert [row["start"] for row in rows.values()] == [None, 0, 1, 2]
    for level, row in zip((0.25, 0.26, 0.27, 0.3), rows.values(), strict=True):
        assert row["objective"] == pytest.approx(2 / 3 * (1 - level) ** 3, rel=1e-11)
        assert row["switches"] == pytest.approx([1 - level, 3 + level], rel=1e-11)


def test_an_arc_whose_time_has_gone_is_left_out() -> None:
    rows = walked(POND, "final_time", [1.7, 1.6, 1.4]).rows
    assert [row["word"] for row in rows.values()] == ["u: - s +", "u: - s +", "u: - +"]
    assert [row["start"] for row in rows.values()] == [None, 0, 1]
    assert rows[2]["switches"] == pytest.approx([0.7], abs=1e-9)


def test_a_start_beyond_the_level_meets_it_from_the_other_side() -> None:
    """From below the level as from above: a quarter up to it, or three down."""
    rows = walked(POND, "start.x", [1.0, 0.5, 0.0, -0.5]).rows
    assert [row["word"] for row in rows.values()] == ["u: - s +"] * 2 + ["u: + s +"] * 2
    assert [row["start"] for row in rows.values()] == [None, 0, 1, 2]
    for start, row in zip((1.0, 0.5, 0.0, -0.5), rows.values(), strict=True):
        off = abs(start - 0.25)
        assert row["objective"] == pytest.approx((off**3 + 0.75**3) / 3, rel=1e-11)
        assert row["switches"] == pytest.approx([off, 3.25], rel=1e-11)


def test_two_arcs_may_turn_at_once() -> None:
    rows = walked_through(POND, [{"start.x": k, "end.x": k} for k in (1.0, -0.5)]).rows
    assert [row["word"] for row in rows.values()] == ["u: - s +", "u: + s -"]
    assert [row["start"] for row in rows.values()] == [None, 0]
    assert rows[1]["objective"] == pytest.approx(2 / 3 * 0.75**3, rel=1e-11)


def test_where_an_arc_has_come_the_search_finds_it() -> None:
    rows = walked(POND, "final_time", [1.0, 4.0]).rows
    assert [row["word"] for row in rows.values()] == ["u: - +", "u: - s +"]
    assert [row["start"] for row in rows.values()] == [None, None]
    assert rows[1]["switches"] == pytest.approx([0.75, 3.25], abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("start", "end"),
    [
        ((20.0, -0.7), (20.0, 0.7)),  # on finer meshes
        ((20.0, -0.7), (25.0, 5.0)),  # by way of points between
        ((20.0, -2.0), (20.0, -3.6)),  # with the first arc at the other bound
    ],
)
def test_a_vehicle_goes_on_from_afar(start: tuple[float, float], end: tuple[float, float]) -> None:
    points = [{"start.x": a, "start.y": b} for a, b in (start, end)]
    rows = walked_through(PROBLEMS.problem("auv"), points).rows
    posed = PROBLEMS.problem("auv").with_(points[-1])
    cold = solve(posed, watch=silent)
    assert rows[1]["start"] == 0
    assert rows[1]["objective"] == pytest.approx(cold.told, rel=1e-10)
    assert (rows[1]["word"], rows[1]["message"]) == (cold.word, "")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "number", "values"),
    [
        ("auv", "current", [0.8, 0.805, 0.81, 0.82]),
        ("auv", "start.x", [40.0, 40.2, 40.5, 41.0]),
        ("goddard", "end.m", [0.6, 0.601, 0.603, 0.605]),
        ("vdp_regulator", "start.x2", [1.0, 1.005, 1.01, 1.03]),
        ("lotka_fishing", "start.x1", [0.5, 0.502, 0.505, 0.51]),
        ("robot_arm", "end.rho", [4.5, 4.505, 4.51, 4.52]),
        ("double_integrator_vlimit", "end.x", [10.0, 10.05, 10.1, 10.3]),
    ],
)
def test_neighbours_are_those_that_are_solved_by_themselves(
    name: str, number: str, values: list[float]
) -> None:
    same_as_cold(PROBLEMS.problem(name), number, values)

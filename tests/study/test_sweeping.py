"""Sweeps: points on grids and drawn, chains fixed in advance, and rows that do not depend on who
solved them, or when.
"""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ponds import POND

from socp.errors import MethodError, ProblemError
from socp.model import Progress, carried_problem, load
from socp.registry import solve
from socp.study import Kept, Sweep, points, sweep
from socp.study.sweeping.plan import planned, tree
from socp.verdict import judge

AT = points({"final_time": "1.2:2:5"})  # the level is met for 1.5 and longer


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Kept:
    """Return folders in which a sweep is kept."""
    where = tmp_path_factory.mktemp("sweep")
    return Kept(where / "chains", where / "results")


@pytest.fixture(scope="module")
def found(folders: Kept) -> Sweep:
    """Return the pond over times on either side of the one at which its word changes."""
    return sweep(POND, AT, kept=folders)


def same(found: Sweep) -> list[dict[str, Any]]:
    """Return all of the rows but their seconds."""
    return [{k: v for k, v in row.items() if k != "seconds"} for row in found.rows]


# -- points


def test_a_grid_has_every_combination_the_last_one_fastest() -> None:
    grid = points({"a": "0:1:2", "b": [5.0, 6.0, 7.0]})
    assert grid.names == ("a", "b")
    assert grid.values.tolist() == [[0, 5], [0, 6], [0, 7], [1, 5], [1, 6], [1, 7]]


def test_draws_are_those_of_their_distribution_and_of_their_name() -> None:
    one = points({"a": "normal(3,0.5)", "b": "uniform(-1, 2)"}, sample=20_000, seed=7)
    other = points({"b": "uniform(-1,2)"}, sample=20_000, seed=7)
    a, b = one.values.T
    assert np.array_equal(b, other.values[:, 0])  # another number beside it changes none
    assert (a.mean(), a.std()) == pytest.approx((3.0, 0.5), abs=0.02)
    assert (b.mean(), b.std()) == pytest.approx((0.5, 3 / np.sqrt(12)), abs=0.02)
    assert -1 <= b.min() < -0.99
    assert 1.99 < b.max() <= 2


def test_rows_of_a_table_belong_together() -> None:
    found = points({"c": "0:1:2"}, {"a": [1, 2], "b": [3, 4]})
    assert found.values.tolist() == [[1, 3, 0], [1, 3, 1], [2, 4, 0], [2, 4, 1]]


@pytest.mark.parametrize(
    ("numbers", "more", "said"),
    [
        ({"a": "0:1"}, {}, "a=0:1: give lo:hi:n"),
        ({"a": "0:1:0"}, {}, "a=0:1:0: give lo:hi:n"),
        ({"a": "normal(1,-1)"}, {"sample": 3}, "give normal"),
        ({"a": "normal(1,1)"}, {}, "say how many points are drawn"),
        ({"a": "0:1:2"}, {"sample": 3}, "no number is drawn"),
        ({"a": "0:1:2"}, {"table": {"a": [1]}}, "a is given twice"),
        ({"a": "0:1:2000", "b": "0:1:2000"}, {}, "more than 1000000 points"),
        ({"a": [float("nan")]}, {}, "finite numbers"),
        ({}, {}, "needs a number"),
        ({}, {"table": {"a": [1], "b": [1, 2]}}, "columns of numbers of one length"),
    ],
)
def test_what_is_no_set_of_points_is_refused(
    numbers: dict[str, Any], more: dict[str, Any], said: str
) -> None:
    with pytest.raises(MethodError, match=said):
        points(numbers, **more)


# -- chains


@pytest.mark.parametrize("seed", range(4))
def test_chains_hold_every_point_once_and_begin_where_others_have_been(seed: int) -> None:
    values = np.random.default_rng(seed).uniform(-1, 1, (150, 2))
    chains = planned(values, values[17])
    assert chains[0].points[0] == 17
    assert sorted(k for chain in chains for k in chain.points) == list(range(150))
    seen = {-1}
    for number, chain in enumerate(chains):
        assert chain.number == number
        assert chain.start in seen
        seen |= set(chain.points)
    assert [chain.start for chain in chains].count(-1) == 1


def test_on_a_grid_the_tree_goes_from_neighbour_to_neighbour() -> None:
    side = np.arange(7.0)
    values = np.array([[a, b] for a in side for b in side])
    order, parents = tree(values, 24)
    assert sorted(order) == list(range(49))
    steps = [np.abs(values[k] - values[parents[k]]).sum() for k in order[1:]]
    assert steps == [1.0] * 48


def test_a_long_line_is_cut_for_several_workers() -> None:
    values = np.linspace(0, 1, 200)[:, None]
    spine, *others = planned(values, np.array([0.0]))
    assert spine.points == tuple(range(0, 200, 25))
    assert [chain.start for chain in others] == list(spine.points)
    assert [len(chain.points) for chain in others] == [24] * 8


def test_no_piece_is_too_long_however_many_points_there_are() -> None:
    chains = planned(np.linspace(0, 1, 5000)[:, None], np.array([0.5]))
    assert max(len(chain.points) for chain in chains) <= 32
    assert sum(len(chain.points) for chain in chains) == 5000


# -- rows


def test_every_row_is_the_solution_in_closed_form(found: Sweep) -> None:
    assert found.names == ("final_time",)
    assert (found.certified, len(found.rows), found.wanted) == (5, 5, 5)
    for row in found.rows:
        T = row["final_time"]
        # down to the level, 0.75 below, or as far as half of the time allows, and up again
        d = min(0.75, T / 2)
        assert row["objective"] == pytest.approx(2 * (0.75**3 - (0.75 - d) ** 3) / 3, abs=1e-9)
        assert row["word"] == ("u: - s +" if T > 1.5 else "u: - +")
        assert row["switches"] == pytest.approx([0.75, T - 0.75] if T > 1.5 else [T / 2])
        assert "minimum" in row["rung"]
        assert row["message"] == ""
        assert row["fingerprint"] == POND.fingerprint


def test_neighbours_start_from_neighbours(found: Sweep) -> None:
    assert [row["start"] for row in found.rows] == [1, 2, 3, 4, -1]


def test_it_is_taken_up_again_where_it_was_left(found: Sweep, folders: Kept) -> None:
    assert folders.chains is not None
    again = sweep(POND, AT, kept=folders)
    assert again.rows == found.rows  # seconds too: nothing is solved
    for path in folders.chains.iterdir():
        path.write_text("")
    assert same(sweep(POND, AT, kept=folders)) == same(found)


def test_whole_results_are_kept(found: Sweep, folders: Kept) -> None:
    assert folders.results is not None
    files = sorted(folders.results.iterdir())
    kept = [load(path) for path in files]
    assert [each.objective for each in kept] == [row["objective"] for row in found.rows]
    assert all(each.extremal and each.statement for each in kept)


def test_a_constant_of_the_formula_goes_through_files(tmp_path: Path) -> None:
    kept = Kept(tmp_path / "chains", tmp_path / "results")
    pond = POND.with_(final_time=3.0)
    found = sweep(pond, {"level": "0.2:0.4:6"}, kept=kept, method="lgr-multiphase", word="- s +")
    assert found.certified == 6
    assert sum(row["start"] >= 0 for row in found.rows) == 5
    for k, row in enumerate(found.rows):
        assert row["objective"] == pytest.approx(2 / 3 * (1 - row["level"]) ** 3, rel=1e-9)
        whole = load(kept.results / f"point-{k:06d}.socp.json")
        own = carried_problem(whole)
        assert own is not None
        assert (own.constants["level"].value, whole.parameters) == (row["level"], {})
        assert judge(own, whole).extremal


def test_any_executor_does_the_work(found: Sweep) -> None:
    with ThreadPoolExecutor(2) as pool:
        assert same(sweep(POND, AT, workers=pool)) == same(found)


def test_a_failure_is_a_row() -> None:
    found = sweep(POND, {"end.x": [1.0, 9.0], "bounds.u.upper": [1.0, -3.0]})
    good, far = [row for row in found.rows if row["bounds.u.upper"] == 1]
    empty = [row for row in found.rows if row["bounds.u.upper"] == -3]
    assert good["message"] == ""
    assert far["message"]
    assert "minimum" not in far["rung"]
    assert all("ProblemError" in row["message"] for row in empty)
    assert all(np.isnan(row["objective"]) and row["start"] == -1 for row in empty)
    assert found.certified == 1


def test_a_row_tells_what_a_control_reaches_not_what_a_grid_claims() -> None:
    found = sweep(POND, {"final_time": [2.0]}, method="euler-ipopt", steps=20)
    made = solve(POND.with_(final_time=2), method="euler-ipopt", steps=20)
    assert made.overclaimed
    assert found.rows[0]["objective"] == made.told != made.objective


def test_a_watch_ends_it_with_the_rows_so_far() -> None:
    told = list[str]()

    def see(now: Progress) -> bool:
        told.append(now.stage)
        return True

    found = sweep(POND, {"start.x": np.linspace(1, 1.2, 9)}, watch=see)
    assert found.interrupted
    assert told == ["2 of 9 points, 2 certified"]
    assert len(found.rows) == 2


def test_names_and_columns_are_checked_at_once() -> None:
    with pytest.raises(ProblemError, match="did you mean 'level'"):
        sweep(POND, {"levell": [1.0]})
    with pytest.raises(MethodError, match="a number of processes"):
        sweep(POND, {"level": [0.3]}, workers=0)


@pytest.mark.slow
def test_two_workers_find_what_one_does(found: Sweep, tmp_path: Path) -> None:
    two = sweep(POND, AT, workers=2, kept=Kept(tmp_path))
    assert same(two) == same(found)

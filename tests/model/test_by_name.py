"""A solution in Python: its report, its arrays by name, its tables."""

import numpy as np
import pytest
from carts import cart

from socp import Solution, silent, solve


@pytest.fixture(scope="module")
def solution() -> Solution:
    return solve(cart(), method="lgr-multiphase", word="+ -", watch=silent)


def test_printed_it_is_the_report_of_the_command(solution: Solution) -> None:
    name, *lines = str(solution).splitlines()
    assert name == "cart"
    assert "objective    2" in lines
    assert "word         u: + -" in lines
    assert any(line.startswith("verdict      feasible: ") for line in lines)


def test_its_repr_is_one_line(solution: Solution) -> None:
    assert repr(solution) == ("Solution('cart' by lgr-multiphase: objective 2, u: + -, certified)")
    assert repr(solution.verdict).startswith("Verdict(feasible, extremal: off by ")
    assert "\n" not in repr(solution.verdict)


def test_a_verdict_is_printed_condition_by_condition(solution: Solution) -> None:
    text = str(solution.verdict)
    assert text.startswith("verdict")
    assert "conditions" in text
    assert len(text.splitlines()) < 40


def test_arrays_are_had_by_name(solution: Solution) -> None:
    assert np.array_equal(solution["x"], solution.rows("x")[0])
    assert np.array_equal(solution["u"], solution.rows("u")[0])
    assert np.array_equal(solution["time"], solution.t)
    assert np.array_equal(solution["lambda_v"], solution.rows("costate")[1])
    np.testing.assert_allclose(solution["sigma_u"], solution["lambda_v"])
    assert ("x" in solution, "y" in solution) == (True, False)
    with pytest.raises(KeyError, match="no 'y' in the solution; there are time, arc, x, v, u"):
        solution["y"]
    with pytest.raises(TypeError):
        iter(solution)


def test_a_frame_has_a_switch_twice(solution: Solution) -> None:
    frame = solution.to_frame()
    assert list(frame.columns)[:4] == ["arc", "x", "v", "u"]
    assert frame.index.name == "time"
    assert frame.loc[solution.switches[0], "u"].tolist() == [1, -1]
    assert np.array_equal(frame["x"], solution["x"])


def test_a_dataset_selects_by_time(solution: Solution) -> None:
    data = solution.to_xarray()
    assert data.indexes["time"].is_unique
    assert data.indexes["time"].is_monotonic_increasing
    near = data.sel(time=1.0, method="nearest")
    assert float(near.controls.sel(control="u")) == -1
    assert float(data.controls_before.sel(control="u", junction=solution.junctions[0])) == 1
    assert float(near.states.sel(state="x")) == pytest.approx(0.5)
    assert data.states.interp(time=[0.5]).sel(state="v").item() == pytest.approx(0.5)

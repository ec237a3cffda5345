"""Maps and curves of a sweep, and its Dataset: the pond in closed form, no solve."""

from typing import Any

import numpy as np
import pytest

from socp.errors import SolveError
from socp.view import draw_sweep, sweep_to_xarray, to_bytes

FACTS = {"kind": "sweep", "names": ["T", "level"], "problem": "pond"}


def row(T: float, level: float, message: str = "") -> dict[str, Any]:
    """Return what a sweep says of the pond from 1 to 1 in T, down to a level at rate 1."""
    deep, along = 1 - level, 2 * (1 - level) < T
    d = min(deep, T / 2)
    return {
        "T": T,
        "level": level,
        "rung": "" if message else "strict strong local minimum",
        "objective": np.nan if message else 2 * (deep**3 - (deep - d) ** 3) / 3,
        "final_time": T,
        "word": "" if message else "u: - s +" if along else "u: - +",
        "switches": [] if message else [deep, T - deep] if along else [T / 2],
        "start": -1,
        "seconds": 0.1,
        "message": message,
    }


TIMES, LEVELS = np.linspace(1, 2, 6), np.linspace(0.2, 0.6, 5)
GRID = [row(T, level) for T in TIMES for level in LEVELS]


def test_a_grid_becomes_a_dataset_over_its_numbers() -> None:
    found = sweep_to_xarray(GRID, FACTS)
    assert found.objective.dims == ("T", "level")
    assert found.objective.sel(T=2, level=0.6).item() == pytest.approx(2 * 0.4**3 / 3)
    assert found.word.sel(T=1, level=0.2) == "u: - +"
    assert found.switches.sel(T=1, level=0.2).values == pytest.approx([0.5, np.nan], nan_ok=True)
    assert found.certified.all()


def test_points_on_no_grid_keep_their_order_and_failures_are_no_numbers() -> None:
    values = np.random.default_rng(0).uniform(0, 1, (40, 2))
    rows = [row(1 + a, b) for a, b in values] + [row(1.0, 0.5, "it failed")]
    found = sweep_to_xarray(rows, FACTS)
    assert found.objective.dims == ("point",)
    assert found.level.values[:-1] == pytest.approx(values[:, 1])
    assert (found.certified.sum(), np.isnan(found.objective[-1])) == (40, True)


def test_a_place_of_a_grid_without_a_row_is_empty() -> None:
    found = sweep_to_xarray(GRID[:-1], FACTS)
    assert np.isnan(found.objective[-1, -1])
    assert not found.certified[-1, -1]


def test_two_numbers_make_a_map_of_values_and_one_of_words_with_their_border() -> None:
    figure = draw_sweep(GRID, FACTS, width=7.0)
    left, right = figure.axes[:2]
    assert (left.get_xlabel(), left.get_ylabel()) == ("T", "level")
    assert [each.get_text() for each in right.get_legend().get_texts()] == ["u: - +", "u: - s +"]
    words = np.array([[each["word"] for each in GRID]]).reshape(6, 5)
    cuts = (words[1:] != words[:-1]).sum() + (words[:, 1:] != words[:, :-1]).sum()
    borders = [line for line in right.lines if len(line.get_xdata()) == 2]
    assert len(borders) == cuts > 0
    assert to_bytes(figure, "png").startswith(b"\x89PNG")


def test_points_on_no_grid_are_drawn_as_points() -> None:
    values = np.random.default_rng(1).uniform(0, 1, (30, 2))
    figure = draw_sweep([row(1 + a, b) for a, b in values], FACTS, width=7.0)
    assert len(figure.axes[0].collections[0].get_offsets()) == 30


def test_one_number_makes_curves_one_colour_a_word() -> None:
    figure = draw_sweep([row(T, 0.4) for T in TIMES], FACTS, width=7.0)
    above, below = figure.axes
    assert below.get_xlabel() == "T"
    assert len(above.get_legend().get_texts()) == 2


@pytest.mark.parametrize(
    ("rows", "facts", "said"),
    [
        ([], FACTS, "no sweep"),
        ([{"T": 1.0}], FACTS, "no sweep"),
        ([row(1.0, 0.3)], FACTS, "those with several values: none"),
        ([row(1.0, 0.3, "it failed")], FACTS, "nothing certified"),
    ],
)
def test_what_is_no_map_is_refused(
    rows: list[dict[str, Any]], facts: dict[str, Any], said: str
) -> None:
    with pytest.raises(SolveError, match=said):
        draw_sweep(rows, facts, width=7.0)

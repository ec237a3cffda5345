"""Rounding of relaxed controls to modes: against all choices of small cases, its limits, and a real
direct solution.
"""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from socp import default_guess
from socp.errors import SolveError
from socp.laws.modes import arc_modes
from socp.methods.direct import scouts
from socp.registry.plugins import Registry
from socp.search.rounding import Cells, cells, deviation, round_cells, rounded_word


def bangs(relaxed: list[float], lengths: list[float] | None = None) -> Cells:
    """Return cells of one control that is to be rounded to 0 or 1."""
    k = len(relaxed)
    edges = np.append(0.0, np.cumsum(lengths or [1.0 / k] * k))
    offered = np.stack([np.zeros((1, k)), np.ones((1, k))])
    return Cells(edges, np.array([relaxed]), offered, np.ones((2, k), dtype=bool))


def switches(chosen: np.ndarray) -> int:
    return int((np.diff(chosen) != 0).sum())


@settings(max_examples=15)
@given(st.lists(st.floats(0.0, 1.0), min_size=3, max_size=7), st.integers(0, 3))
def test_no_choice_with_as_few_switches_is_much_nearer(relaxed: list[float], most: int) -> None:
    laid = bangs(relaxed)
    found = round_cells(laid, most, price=0.0)
    choices = [
        np.array(c) for c in product((0, 1), repeat=len(relaxed)) if switches(np.array(c)) <= most
    ]

    def cost(chosen: np.ndarray) -> float:
        misfit = laid.misfit[chosen, np.arange(chosen.size)]
        return deviation(laid, chosen) + 0.05 * float(misfit @ laid.lengths)

    assert switches(found.chosen) <= most
    assert found.deviation == deviation(laid, found.chosen)
    assert (
        cost(found.chosen) <= min(map(cost, choices)) + 5e-3 + 1e-6
    )  # the gap that the solver may leave


def test_a_half_is_rounded_to_alternation_or_to_one_switch() -> None:
    laid = bangs([0.5] * 8)
    assert round_cells(laid, 7, price=0.0).deviation == pytest.approx(1 / 16)
    assert round_cells(laid, 1, price=0.0).deviation == pytest.approx(3 / 16)


def test_arcs_dwell() -> None:
    laid = bangs([0.5] * 12)
    chosen = round_cells(laid, 11, dwell=0.25, price=0.0).chosen
    runs = np.diff(np.flatnonzero(np.diff(chosen, prepend=-1, append=-1)))
    assert (runs[1:-1] >= 3).all()


def test_a_price_of_switches_makes_them_fewer() -> None:
    laid = bangs([0.5] * 8)
    assert switches(round_cells(laid, 7, price=1.0).chosen) == 0


def test_a_mode_that_is_not_allowed_is_not_taken() -> None:
    laid = bangs([1.0, 1.0, 1.0, 1.0])
    laid.allowed[1, 2] = False
    assert round_cells(laid, 2, price=0.0).chosen.tolist() == [1, 1, 0, 1]


def test_too_few_switches_are_named() -> None:
    laid = bangs([1.0, 0.0])
    laid.allowed[0, 0] = laid.allowed[1, 1] = False
    with pytest.raises(SolveError, match="no choice of modes has at most 0 switches"):
        round_cells(laid, 0)


@pytest.mark.parametrize(
    ("name", "word"), [("catalyst_mixing", "+ s -"), ("goddard_vlimit", "+ s b[v.upper] -")]
)
def test_a_coarse_solution_shows_its_word(registry: Registry, name: str, word: str) -> None:
    problem = registry.problem(name)
    coarse = scouts(problem, default_guess(problem), 12)[0]
    modes = arc_modes(problem)
    found = rounded_word(problem, coarse, modes, 3)
    assert {str(mode) for (mode,) in found.arcs} <= {*word.split()}
    assert len(found.arcs) <= 4
    laid = cells(problem, coarse, modes)
    assert laid.edges[0] == coarse.initial_time
    assert laid.edges[-1] == coarse.final_time
    assert (np.diff(laid.edges) > 0).all()

"""The reference problem: the figures that the direct methods have to reach on the AUV, and how they
get there.
"""

import casadi
import numpy as np
import pytest
from socp_plugins.collocation import EulerIpopt, HermiteSimpson, Trapezoidal
from socp_plugins.lgr_multiphase import LgrMultiphase
from socp_problems.auv import problem

from socp.methods.contract import Method
from socp.methods.guess import default_guess
from socp.model.result.solution import Solution, Stop
from socp.verdict.reintegration import verify
from socp.verdict.structure import structure_of

WORD = "r: + s s s +; f: + + b - -"
ROUGH = "0.05 0.6 14 0.1 0.2"
# computed independently of all that is tested here: Pontryagin's boundary value problem on two
# meshes, and DOP853
FINAL_TIME = 14.95016178215355
SWITCHES = (0.0490521085926, 0.6456134114460, 14.6238176532765, 14.7241631681594)
COSTATE = (0.358149090457, 0.056625131178, -0.000113703979, -0.144686061526)


_SOLVED: dict[str, Solution] = {}


def solved(method: Method) -> Solution:
    """Return what a method makes of the AUV from the default guess; each is solved once."""
    if repr(method) not in _SOLVED:
        _SOLVED[repr(method)] = method.solve(problem, default_guess(problem))
    assert _SOLVED[repr(method)].stop is Stop.SOLVED
    return _SOLVED[repr(method)]


def along_word(points: int = 0, intervals: int = 0) -> Solution:
    return solved(LgrMultiphase(word=WORD, lengths=ROUGH, points=points, intervals=intervals))


def errors(solution: Solution) -> np.ndarray:
    """Return the errors of the final time and of the four switching times."""
    junctions = [float(arc.t[-1]) for arc in solution.arcs]
    return np.abs(np.array([solution.objective, *junctions[:-1]]) - [FINAL_TIME, *SWITCHES])


def hamiltonian(solution: Solution) -> np.ndarray:
    """Return H at the ends of all intervals, where costates have the order of the scheme."""
    H = casadi.Function("H", [problem.x, problem.u, problem.costate], [problem.hamiltonian])
    found = []
    for arc in solution.arcs:
        at = arc.mesh
        found.append(H.map(at.size)(arc.x[:, at], arc.u[:, at], arc.costate[:, at]).full().ravel())
    return np.concatenate(found)


def test_the_reference_of_the_problem_file_is_the_independent_one() -> None:
    assert problem.reference is not None
    assert problem.reference.objective == pytest.approx(FINAL_TIME, abs=1e-11)
    assert problem.reference.switches == pytest.approx(SWITCHES, abs=1e-11)


def test_the_word_from_a_rough_guess_gives_the_reference() -> None:
    final_time, *early, last = errors(along_word())
    assert final_time <= 1e-9
    assert max(early) <= 1e-8
    assert last <= 2e-6  # the objective is flat in the last switching time


def test_the_word_from_equal_arcs_gives_the_reference_too() -> None:
    assert errors(solved(LgrMultiphase(word=WORD)))[0] <= 1e-9


def test_the_word_leads_where_it_says() -> None:
    solution = along_word()
    as_time, as_feedback = verify(problem, solution)
    assert as_time.worst < 1e-8
    assert as_feedback.worst < 1e-8
    found = structure_of(problem, solution)
    assert {name: [mode for mode, _, _ in row] for name, row in found.items()} == {
        "r": ["+", "s", "+"],
        "f": ["+", "b[u.upper]", "-"],
    }


def test_costates_along_the_word() -> None:
    solution = along_word()
    np.testing.assert_allclose(solution.arcs[0].costate[:, 0], COSTATE, atol=1e-9)
    np.testing.assert_allclose(
        solution.rows("costate")[0], COSTATE[0], atol=1e-9
    )  # x appears in no rate
    np.testing.assert_allclose(hamiltonian(solution), -1.0, atol=1e-8)
    singular = np.hstack([arc.costate[2] for arc in solution.arcs[1:4]])
    np.testing.assert_allclose(singular, 0.0, atol=1e-8)  # the switching function of r


COUNTS = range(6, 31, 2)


@pytest.mark.slow
def test_one_interval_an_arc_converges_spectrally() -> None:
    # the digits grow in proportion to the points, an algebraic order would give ever fewer for each
    digits = np.array([-np.log10(errors(along_word(points, 1))[0]) for points in COUNTS])
    rate, at_none = np.polyfit(COUNTS, digits, 1)
    assert 0.3 < rate < 0.5
    assert np.abs(digits - rate * np.array(COUNTS) - at_none).max() < 1.0
    half = len(digits) // 2
    late, early = (
        np.polyfit(COUNTS[part], digits[part], 1)[0]
        for part in (slice(half, None), slice(half + 1))
    )
    assert late > 0.8 * early


@pytest.mark.slow
def test_the_table_over_points_reaches_nine_digits_at_24() -> None:
    found = {points: errors(along_word(points, 1)) for points in COUNTS}
    assert found[22][0] > 1e-9
    assert all(found[points][0] <= 1e-9 for points in COUNTS if points >= 24)
    assert all(found[points][1:4].max() <= 1e-9 for points in COUNTS if points >= 24)
    assert found[30][0] <= 1e-11


def test_fourteen_points() -> None:
    assert along_word(14, 1).objective == pytest.approx(14.9501607948, abs=1e-10)


def test_implicit_euler_with_1000_steps() -> None:
    solution = solved(EulerIpopt(steps=1000))
    assert solution.objective == pytest.approx(14.957198, abs=2e-6)
    np.testing.assert_allclose(solution.rows("costate")[0], COSTATE[0], atol=1e-4)
    assert np.ptp(solution.rows("costate")[0]) < 1e-9
    r, f = solution.total_variation()
    assert (r, f) == (
        pytest.approx(7.254, abs=2e-3),
        pytest.approx(10.0, abs=2e-3),
    )  # it does not ring


@pytest.mark.slow
def test_the_trapezoid_with_1000_steps() -> None:
    solution = solved(Trapezoidal(steps=1000))
    assert solution.objective == pytest.approx(14.950320, abs=2e-6)
    np.testing.assert_allclose(solution.rows("costate")[0], COSTATE[0], atol=1e-3)
    assert np.ptp(solution.rows("costate")[0]) < 1e-9


def inner(solution: Solution) -> np.ndarray:
    """Return how far H is from -1 between the switching times, away from them by 1/50 of the
    horizon.
    """
    away = 0.02 * FINAL_TIME
    ends = solution.arcs[0].t[solution.arcs[0].mesh]
    far = np.all([np.abs(ends - t) > away for t in (0.0, *SWITCHES, FINAL_TIME)], axis=0)
    return np.abs(hamiltonian(solution) + 1.0)[far]


@pytest.mark.parametrize(
    ("method", "tolerance"),
    [(EulerIpopt(steps=1000), 2e-3), (Trapezoidal(steps=1000), 1e-3), (HermiteSimpson(), 1e-2)],
    ids=["euler", "trapezoid", "hermite-simpson"],
)
def test_the_hamiltonian_of_the_grid_methods(method: Method, tolerance: float) -> None:
    # their grids miss the switches, so that none is better than first order here
    assert inner(solved(method)).max() < tolerance


@pytest.mark.slow
def test_implicit_euler_with_10000_steps_is_solved_and_of_first_order() -> None:
    fine, coarse = solved(EulerIpopt(steps=10000)), solved(EulerIpopt(steps=1000))
    # Euler's error falls tenfold: 14.957197 - 14.950162 leaves 14.9508653, to second order. A solve
    # that ends at a barrier parameter of 2.5e-9 gives 14.950891 instead: 1e4 steps of it add
    # 2.5e-5.
    expected = FINAL_TIME + (coarse.objective - FINAL_TIME) / 10
    assert fine.objective == pytest.approx(expected, abs=2e-6)
    assert sum(fine.seconds.values()) < 60

"""Singular controls that depend on the costate: a case that the direct method leaves open."""

import numpy as np
import pytest
from scipy.integrate import solve_bvp

from socp import Problem, controls, default_guess, run, states
from socp.laws.law import arc_law
from socp.model.word import Word
from socp.registry.plugins import Registry


@pytest.fixture(scope="module")
def chain() -> Problem:
    """Return the triple integrator with quadratic cost in the states: on a singular arc u =
    lambda_x + y.
    """
    x, y, z = states("x y z")
    u = controls("u")
    return Problem(
        name="chain",
        running=(x**2 + y**2 + z**2) / 2,
        dynamics={x: y, y: z, z: u},
        bounds={u: (-1, 1)},
        start={x: 1, y: 0, z: 0},
        final_time=6,
    )


def test_the_law_needs_the_costate(chain: Problem) -> None:
    """Sigma = lambda_z, sigma' = -lambda_y - z, sigma'' = lambda_x + y - u: three states and one
    free costate.
    """
    law = arc_law(chain, Word.parse("s", ("u",)).arcs[0])
    assert law.costate
    assert len(law.costate_entry) == 2


def test_a_word_with_such_an_arc_is_solved_and_certified(
    chain: Problem, registry: Registry
) -> None:
    solution = run(registry.methods["lgr-multiphase"](word="- + s"), chain, default_guess(chain))
    verdict = solution.verdict
    assert verdict is not None
    assert verdict.extremal, verdict.reasons
    assert verdict.residual < 1e-7
    assert verdict.legendre_clebsch["u, stretch 3 (s)"] > 0


def test_it_agrees_with_the_boundary_value_problem(chain: Problem, registry: Registry) -> None:
    """States and costates of the singular arc by scipy's collocation, with the conditions at its
    two ends.
    """
    solution = run(registry.methods["lgr-multiphase"](word="- + s"), chain, default_guess(chain))
    arc = solution.arcs[2]

    def rate(_t: np.ndarray, v: np.ndarray) -> np.ndarray:
        x, y, z, lx, _ = v
        return np.array([y, z, lx + y, -x, -lx - y])

    def ends(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return np.array([a[0] - arc.x[0, 0], a[1] - arc.x[1, 0], a[2] - arc.x[2, 0], b[3], b[4]])

    guess = np.vstack([arc.x, arc.costate[:2]])
    found = solve_bvp(rate, ends, arc.t, guess, tol=1e-10, max_nodes=100_000)
    assert found.success
    assert found.sol(arc.t)[:3] == pytest.approx(arc.x, abs=1e-7)
    assert found.sol(arc.t)[3:] == pytest.approx(arc.costate[:2], abs=1e-6)
    assert found.sol(arc.t)[2, -1] == pytest.approx(
        0.0, abs=1e-7
    )  # lambda_y = -z, which vanishes at the free end

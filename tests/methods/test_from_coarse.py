"""Direct solves that go on from the multipliers of a coarser grid, and starts that are lost."""

from dataclasses import replace

import pytest

from socp import Ipopt, default_guess, single_phase, uniform
from socp.methods import scouted, solve_directly
from socp.model import Stop, Watch, silent
from socp.registry.plugins import Registry
from socp.solvers import NLP, NLPPoint
from socp.transcription import euler, laid_out, push, radau_iia

REGISTRY = Registry.load()
FINE = uniform(radau_iia(2), 50)


def test_a_coarse_grid_leads_to_grids_of_equal_intervals_of_its_scheme() -> None:
    problem = REGISTRY.problem("vdp_regulator")
    coarse = next(iter(scouted(problem, default_guess(problem), 1).coarse.values()))
    assert coarse.leads_to(FINE)
    assert not coarse.leads_to(uniform(euler(), 50))
    assert not coarse.leads_to([(0.4, radau_iia(2)), (0.6, radau_iia(2))])


@pytest.mark.parametrize("name", ["auv", "vdp_regulator", "rayleigh_time"])
def test_from_its_multipliers_a_finer_grid_takes_fewer_iterations_to_the_same(name: str) -> None:
    problem = REGISTRY.problem(name)
    met = scouted(problem, default_guess(problem), 12)
    start = met.solutions[0]
    cold = solve_directly(problem, FINE, Ipopt(), start)
    warm = solve_directly(problem, FINE, Ipopt(), start, silent, met.coarse[start])
    assert warm.stop is Stop.SOLVED
    assert warm.objective == pytest.approx(cold.objective, rel=1e-7)
    assert warm.effort.iterations < 0.8 * cold.effort.iterations


def test_where_that_fails_it_is_solved_from_the_guess_alone() -> None:
    problem = REGISTRY.problem("vdp_regulator")
    met = scouted(problem, default_guess(problem), 1)
    start = met.solutions[0]

    def backend(nlp: NLP, guess: NLPPoint, _: Watch = silent) -> NLPPoint:
        found = Ipopt()(nlp, guess)
        return found if guess.lam_g is None else replace(found, stop=Stop.FAILED)

    found = solve_directly(problem, FINE, backend, start, silent, met.coarse[start])
    cold = solve_directly(problem, FINE, Ipopt(), start)
    assert found.stop is Stop.SOLVED
    assert found.objective == cold.objective
    assert found.effort.iterations > cold.effort.iterations


def test_what_seeks_the_constraints_alone_for_too_long_ends() -> None:
    """From rayleigh_time's own guess no way leads to them: half of its horizon is too short."""
    problem = REGISTRY.problem("rayleigh_time")
    guess, mesh = default_guess(problem), uniform(radau_iia(2), 20)
    nlp, layout = laid_out(single_phase(problem), [mesh], guess)
    rough, start = Ipopt().within(1e-5), push(layout, guess)
    patient, brief = (rough.limited(150, lost)(nlp, start) for lost in (None, 40))
    assert not patient.stop.ok
    assert brief.stop is Stop.INFEASIBLE
    assert brief.message == "Ipopt: it does not find back to the constraints"
    assert brief.iterations < 0.5 * patient.iterations

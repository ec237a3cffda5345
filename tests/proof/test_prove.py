"""Proofs: enclosures contain known values, and what is not an extremal of its word is refused."""

from dataclasses import replace
from functools import cache
from importlib import import_module

import numpy as np
import pytest
from records import revised

from socp import (
    Ipopt,
    Problem,
    Solution,
    Word,
    default_guess,
    judge,
    solve_collocated,
    uniform,
)
from socp.methods import polished
from socp.model.word import Mode
from socp.proof import prove
from socp.transcription import follow, lgr

NAMES = (
    "catalyst_mixing",
    "double_integrator_time",
    "double_integrator_vlimit",
    "dubins_csc",
    "fishery_discounted",
    "goddard",
    "goddard_fixed_time",
    "goddard_vlimit",
    "jacobson_1",
    "rayleigh_time",
    "robot_arm",
    "vdp_regulator",
)
PROBLEMS: dict[str, Problem] = {
    name: import_module(f"socp_problems.{name}").problem for name in NAMES
}
QUICK = ("double_integrator_time", "double_integrator_vlimit", "jacobson_1")


@cache
def solved(name: str) -> Solution:
    problem = PROBLEMS[name]
    assert problem.reference is not None
    phased = follow(problem, Word.parse(problem.reference.word, problem.control_names))
    meshes = [uniform(lgr(8), 3)] * len(phased.phases)
    found = solve_collocated(phased, meshes, Ipopt(), default_guess(problem))
    return judge(problem, polished(problem, found) or found)


def contains(enclosure: tuple[str, str], value: float, off: float) -> bool:
    middle, radius = map(float, enclosure)
    return abs(middle - value) <= radius + off


def holds(name: str) -> None:
    problem = PROBLEMS[name]
    reference = problem.reference
    assert reference is not None
    proof = prove(problem, solved(name))
    assert proof.holds, f"{proof.step}: {proof.reason}"
    off = reference.tolerance * max(1.0, abs(reference.objective))
    assert contains(proof.objective, reference.objective, off)
    for t, its in zip(proof.times, reference.switches, strict=False):
        assert contains(t, its, 1e-10)
    assert all(float(radius) < 1e-15 for _, radius in (proof.objective, *proof.times))


@pytest.mark.parametrize("name", QUICK)
def test_enclosures_contain_the_references(name: str) -> None:
    holds(name)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(NAMES) - set(QUICK)))
def test_enclosures_of_others_contain_the_references(name: str) -> None:
    holds(name)


def corrupted(name: str, seed: int) -> Solution:
    """Return a solution with times moved, a mode of its word changed, or all its signs turned."""
    draw, solution = np.random.default_rng(seed), solved(name)
    arcs = list(solution.arcs)
    k = int(draw.integers(len(arcs)))
    if seed % 3 == 0:
        arcs[k] = replace(arcs[k], modes=(other(arcs[k].modes[0], draw),))
    elif seed % 3 == 1:
        ends = [arc.t[[0, -1]] for arc in arcs]
        moved = np.cumsum([0.0, *(np.ptp(e) * (1 + draw.uniform(0.01, 0.2)) for e in ends)])
        arcs = [
            replace(arc, t=a + (b - a) * (arc.t - arc.t[0]) / np.ptp(arc.t))
            for arc, a, b in zip(arcs, moved[:-1], moved[1:], strict=True)
        ]
    else:
        turned = {"lower": Mode("upper"), "upper": Mode("lower")}
        arcs = [replace(arc, modes=tuple(turned.get(m.kind, m) for m in arc.modes)) for arc in arcs]
    return replace(solution, arcs=tuple(arcs))


def other(mode: Mode, draw: np.random.Generator) -> Mode:
    kinds = [kind for kind in ("lower", "upper", "singular") if kind != mode.kind]
    return Mode(kinds[int(draw.integers(len(kinds)))])


def refused(name: str, seed: int) -> None:
    proof = prove(PROBLEMS[name], corrupted(name, seed))
    assert not proof.holds
    assert proof.step
    assert proof.objective == ("", "")


@pytest.mark.parametrize("seed", range(3))
def test_a_corrupted_result_is_refused(seed: int) -> None:
    refused("double_integrator_time", seed)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*QUICK, "dubins_csc"])
def test_a_hundred_corrupted_results_are_refused(name: str) -> None:
    for seed in range(25):
        refused(name, 100 + seed)


def test_free_parameters_are_said_to_be_none_of_it() -> None:
    from socp import controls, parameters, states

    x, p, u = states("x"), parameters("p"), controls("u")
    problem = Problem(
        name="with-parameter",
        minimise=x + p**2,
        dynamics={x: u + p},
        bounds={u: (-1, 1), p: (-1, 1)},
        start={x: 0},
        final_time=1,
    )
    solution = revised(solved("jacobson_1"), statement=None)
    proof = prove(problem, solution)
    assert proof.step == "the word's equations"
    assert "free parameters" in proof.reason

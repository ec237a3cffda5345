"""Nothing wrong is certified: right solutions of the public problems, spoilt in every way that
comes to mind.
"""

import importlib
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import islice
from typing import Any

import numpy as np
import pytest
from socp_plugins.lgr_multiphase import LgrMultiphase

from socp import (
    Ipopt,
    Problem,
    Solution,
    Word,
    default_guess,
    judge,
    run,
    solve_collocated,
    uniform,
)
from socp.methods.guess import split
from socp.model.result.solution import Stop
from socp.transcription import follow
from socp.transcription.schemes import lgr
from socp.verdict.certify import case

WORDS = {
    "auv": "r: + s s s +; f: + + b[u.upper] - -",
    "auv_reverse": "r: + + s - - -; f: + - - - + -",
    "jacobson_1": "- s",
    "vdp_regulator": "- + s",
    "catalyst_mixing": "+ s -",
    "lotka_fishing": "- + s",
    "goddard": "+ s -",
    "goddard_fixed_time": "+ s -",
    "goddard_vlimit": "+ s b -",
    "robot_arm": "u_rho: - + + + + -; u_theta: + + + - - -; u_phi: - - + + - -",
    "rayleigh_time": "+ - +",
    "double_integrator_time": "- +",
    "double_integrator_vlimit": "+ b -",
    "fishery_discounted": "- s +",
    "dubins_csc": "+ s -",
}
FAST = ("jacobson_1", "catalyst_mixing")
NAMES = [pytest.param(name, marks=[] if name in FAST else pytest.mark.slow) for name in WORDS]
SHARP = Ipopt({"tol": 1e-11, "max_iter": 200})  # words without a solution end soon
# where no solve of a word that has no solution takes long
HEAVY = ("auv_reverse", "robot_arm", "goddard_vlimit")
LONG = ("auv", "auv_reverse", "robot_arm")  # of many arcs: every other spoilt one is judged
LIGHT = [each for each in NAMES if each.values[0] not in HEAVY]


@cache
def right(name: str) -> tuple[Problem, Word, Solution]:
    problem = importlib.import_module(f"socp_problems.{name}").problem
    word = Word.parse(WORDS[name], problem.control_names)
    return problem, word, run(LgrMultiphase(word=WORDS[name]), problem, default_guess(problem))


def lengths(solution: Solution) -> list[float]:
    return [float(arc.t[-1] - arc.t[0]) for arc in solution.arcs]


def held(name: str, word: Word, start: list[float], arc: int, length: float) -> Solution:
    """Solve a word from the right solution with one arc held at a length, and judge it."""
    problem, _, solution = right(name)
    phased = follow(problem, word)
    phases = tuple(
        replace(p, length=(length,) * 2) if k == arc else p for k, p in enumerate(phased.phases)
    )
    whole = sum(start)
    meshes = [uniform(lgr(10), 6 if part > 0.2 * whole else 2) for part in start]
    guess = split(solution, start)
    return judge(
        problem,
        solve_collocated(replace(phased, phases=phases), meshes, SHARP, guess),
    )


def refused(solution: Solution, what: str) -> None:
    assert solution.verdict is not None
    assert not solution.verdict.extremal, what
    assert solution.verdict.reasons, what


@pytest.mark.parametrize("name", NAMES)
def test_the_right_one_is_certified_with_no_more_digits_than_it_has(name: str) -> None:
    problem, _, solution = right(name)
    assert solution.verdict is not None
    assert solution.verdict.extremal, solution.verdict.reasons
    reference = problem.reference
    assert reference is not None
    known = max(reference.tolerance, 1e-12)  # what the reference itself is good for
    error = abs(solution.objective - reference.objective) / abs(reference.objective)
    assert error <= 10.0**-solution.verdict.digits + known
    for t, estimate in solution.verdict.switch_errors:
        true = min(abs(t - each) for each in reference.switches)
        assert true <= estimate + 1e-8 * solution.final_time


@pytest.mark.parametrize("name", LIGHT)
@pytest.mark.parametrize("share", [pytest.param(1e-2, marks=pytest.mark.slow), 1e-4])
def test_a_moved_switch(name: str, share: float) -> None:
    """Every switch moved by a share of the horizon, all else solved for again."""
    _, word, solution = right(name)
    step = share * (solution.final_time - solution.initial_time)
    for arc in range(len(word.arcs) - 1):
        parts = lengths(solution)
        parts[arc], parts[arc + 1] = parts[arc] + step, max(parts[arc + 1] - step, step)
        refused(held(name, word, parts, arc, parts[arc]), f"switch {arc + 1} moved by {step}")


@pytest.mark.parametrize("name", LIGHT)
def test_a_superfluous_arc(name: str) -> None:
    """A bang arc of a thousandth of the horizon between any two, all else solved for again."""
    problem, word, solution = right(name)
    length = 1e-3 * (solution.final_time - solution.initial_time)
    rows = list(zip(*([str(mode) for mode in arc] for arc in word.arcs), strict=True))
    for place in range(len(word.arcs) + 1):
        source = min(place, len(word.arcs) - 1)
        for i, row in enumerate(rows):
            for mode in {"+", "-"} - {*row[max(place - 1, 0) : place + 1]}:
                spelt = [
                    [*each[:place], mode if each is row else each[source], *each[place:]]
                    for each in rows
                ]  # one control is put on the bound, the others go on
                text = "; ".join(
                    f"{c}: {' '.join(r)}" for c, r in zip(problem.control_names, spelt, strict=True)
                )
                parts = lengths(solution)
                parts.insert(place, length)
                what = f"{mode} of control {i} at {place}"
                refused(
                    held(name, Word.parse(text, problem.control_names), parts, place, length), what
                )


def spoilt(problem: Problem, solution: Solution) -> Iterator[tuple[str, Solution]]:
    """Yield a right solution with one thing in it made wrong, and what that is."""
    for factor in (1 + 1e-5, -1.0, np.nan):
        yield f"objective times {factor}", replace(solution, objective=solution.objective * factor)
    size = np.abs(solution.rows("x")).max(axis=1)
    low, high = problem.box

    def change(k: int, new: dict[str, Any]) -> Solution:
        arcs = (*solution.arcs[:k], replace(solution.arcs[k], **new), *solution.arcs[k + 1 :])
        return replace(solution, arcs=arcs)

    for k, arc in enumerate(solution.arcs):
        hump = np.sin(np.pi * (arc.t - arc.t[0]) / (arc.t[-1] - arc.t[0]))
        for i in range(len(size)):
            bump = 1e-3 * (size * np.eye(size.size)[i])[:, None] * hump
            yield f"state {i} off on arc {k + 1}", change(k, {"x": arc.x + bump})
        for i, mode in enumerate(map(str, arc.modes)):
            one = (np.arange(len(arc.modes)) == i)[:, None]
            for sign in (1, -1):
                yield (
                    f"control {i} off on arc {k + 1}",
                    change(k, {"u": arc.u + sign * 1e-3 * (high - low)[i] * one}),
                )
            # with several controls the laws of odd combinations take long to derive
            for other in ({"+", "-", "s", "b"} if len(arc.modes) == 1 else {"+", "-"}) - {mode[0]}:
                modes = tuple(other if j == i else each for j, each in enumerate(arc.modes))
                yield f"{mode} called {other} on arc {k + 1}", change(k, {"modes": modes})
    yield (
        "clock",
        replace(solution, arcs=tuple(replace(arc, t=1.001 * arc.t) for arc in solution.arcs)),
    )
    yield "an arc missing", replace(solution, arcs=solution.arcs[:-1])


@pytest.mark.parametrize("name", NAMES)
def test_a_spoilt_solution(name: str) -> None:
    problem, _, solution = right(name)
    every = 2 if name in LONG else 1
    for what, wrong in islice(spoilt(problem, solution), 0, None, every):
        refused(judge(problem, wrong), what)


def test_what_the_judge_does_not_need_does_not_matter() -> None:
    """Costates of the method and its opinion why it stopped are no part of the judgement."""
    problem, _, solution = right("goddard_vlimit")
    arcs = tuple(replace(arc, costate=np.full_like(arc.costate, np.nan)) for arc in solution.arcs)
    assert judge(problem, replace(solution, arcs=arcs, stop=Stop.FAILED)).extremal


def test_reasons_name_what_is_wrong() -> None:
    problem, _, solution = right("jacobson_1")
    assert solution.verdict is not None
    wrong = judge(problem, replace(solution, objective=1.0)).verdict
    assert wrong is not None
    assert wrong.reasons[0].startswith(
        "the re-integrated control is off by 1.7e+00: objective 0.376992, not"
    )
    assert wrong.reasons[1].startswith("objective is that of the states and controls")
    arc = solution.arcs[1]
    wrong = judge(
        problem, replace(solution, arcs=(solution.arcs[0], replace(arc, modes=("-",))))
    ).verdict
    assert wrong is not None
    # as feedback it goes elsewhere
    assert wrong.reasons[0].startswith("the re-integrated control is off by")
    assert any(
        reason.startswith("control keeps the mode of its arc on u, arc 2 (-)")
        for reason in wrong.reasons
    )


@pytest.mark.slow
def test_ten_thousand_steps_are_judged_at_few_nodes() -> None:
    """A ringing direct solution of many steps is refused, the ringing named, at nodes that do not
    grow with them.
    """
    problem, _, solution = right("jacobson_1")
    t = np.linspace(solution.initial_time, solution.final_time, 10_001)
    first = solution.arcs[0]
    ringing = np.where(np.arange(t.size) % 2 == 0, *problem.box[:, 0])[None, :]
    arc = replace(
        first,
        t=t,
        x=solution.at(t),
        u=ringing,
        costate=np.full((first.x.shape[0], t.size), np.nan),
        mesh=np.arange(t.size),
        side="right",
        modes=("*",),
    )
    judged = judge(problem, replace(solution, arcs=(arc,)))
    refused(judged, "ringing")
    assert judged.verdict is not None
    assert judged.verdict.rings == ("u",)
    assert case(problem, judged).along.samples.t.size < 2000

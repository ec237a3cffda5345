"""What the judge and the report say is true: feasibility, headline, refusals, and never a worse
answer than in hand.
"""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from casadi import cos, exp, fabs, fmax, fmin, sin
from records import revised
from scipy.optimize import linprog

from socp import (
    Ipopt,
    Problem,
    Solution,
    controls,
    default_guess,
    final_time,
    judge,
    run,
    single_phase,
    solve_collocated,
    states,
    time,
    uniform,
)
from socp.cli import main
from socp.cli.show import facts
from socp.model import Mode
from socp.model.data.files import from_json, to_json
from socp.model.result.findings import Condition, Finding, Place, Verdict
from socp.model.result.solution import Stop
from socp.model.tolerances import EXTREMAL, FEASIBLE, SHORTEST
from socp.registry.plugins import Registry
from socp.search.conclusion import better_point, conclude, explanation, foremost, pursue
from socp.search.effort import Ration, Search, clearly, off, precedes
from socp.search.mending import mends
from socp.search.neighbours import word_of
from socp.study.switches.tendency import limit, summary
from socp.transcription.mesh import Mesh
from socp.transcription.schemes import euler, radau_iia
from socp.verdict.certify import case
from socp.verdict.conditions import Rows
from socp.verdict.multipliers import multipliers
from socp.verdict.nodes import POINTS

x, y = states("x y")
u, w = controls("u w")


def posed(**parts: Any) -> Problem:
    """Return x' = x (1 - u), 0 <= u <= 1, from 1 over a time of 2: without control x ends at e^2 =
    7.389.
    """
    given: dict[str, Any] = {
        "name": "growth",
        "running": u,
        "dynamics": {x: x * (1 - u)},
        "bounds": {u: (0, 1)},
        "start": {x: 1},
        "final_time": 2,
    }
    return Problem(**given | parts)


def along(problem: Problem, word: str, **options: Any) -> Solution:
    return run(
        Registry.load().method("lgr-multiphase")(word=word, **options),
        problem,
        default_guess(problem),
    )


def solved(problem: Problem, method: str = "auto", **options: Any) -> Solution:
    return run(Registry.load().method(method)(**options), problem, default_guess(problem))


def verdict_of(solution: Solution) -> Verdict:
    assert solution.verdict is not None
    return solution.verdict


# -- feasible is what the re-integrated motion is


@pytest.mark.parametrize("claimed", [None, 1e4, 1e6, 1e9])
@pytest.mark.parametrize("node", [-1, 3])
def test_a_claimed_state_hides_no_violation(claimed: float | None, node: int) -> None:
    """A limit of 2 passed to 7.39, whatever one node of the claim says."""
    limited = posed(bounds={u: (0, 1), x: (None, 2)})
    made = along(posed(), "-", intervals=2)
    values = made.arcs[0].x.copy()
    if claimed is not None:
        values[0, node] = claimed
    verdict = verdict_of(judge(limited, replace(made, arcs=(replace(made.arcs[0], x=values),))))
    assert not verdict.feasible
    assert verdict.miss >= (np.exp(2) - 2) / np.exp(2) - 1e-5
    (violated, *_) = judge(limited, made).verified
    assert violated.path == pytest.approx(
        (np.exp(2) - 2) / np.exp(2), rel=1e-6
    )  # of the motion's own size


@pytest.mark.parametrize("scale", [0.5, 0.9, 1.1, 1e3])
@pytest.mark.parametrize("place", ["node", "all", "end"])
def test_states_that_are_not_those_of_the_control_are_no_extremal_with_free_ends(
    scale: float, place: str
) -> None:
    made = along(posed(), "-", intervals=2)
    assert verdict_of(made).feasible
    values = made.arcs[0].x.copy()
    where = {"node": slice(5, 6), "all": slice(1, None), "end": slice(-1, None)}[place]
    values[0, where] *= scale
    judged = judge(posed(), replace(made, arcs=(replace(made.arcs[0], x=values),)))
    assert not judged.extremal
    reasons = verdict_of(judged).reasons
    assert any(reason.startswith("the returned states are not those") for reason in reasons)


def test_a_grid_of_some_hundred_steps_is_still_feasible_and_a_coarse_one_is_not() -> None:
    problem = posed(minimise=-x, running=3 * u)
    fine = solved(problem, "trapezoidal", steps=200)
    coarse = solved(problem, "euler-ipopt", steps=5)
    assert verdict_of(fine).feasible
    assert not verdict_of(coarse).feasible
    assert (
        coarse.verified[0].worst == 0.0
    )  # its ends are free: nothing is violated, and nothing is true


# -- the headline is what the control reaches


def test_the_objective_is_integrated_again() -> None:
    """X' = 1 - u with u = 0: x = t, and the integral of x + 2 u from 0 to 2, less 3 x(2), is 2 -
    6.
    """
    problem = posed(dynamics={x: 1 - u}, running=x + 2 * u, start={x: 0}, minimise=-3 * x)
    made = along(problem, "-")
    for seen in made.verified:
        assert seen.objective == pytest.approx(-4.0, rel=1e-10)
        assert seen.gap < 1e-10
    assert made.reached == pytest.approx(-4.0, rel=1e-10)


def test_a_kink_of_the_running_cost_is_integrated_as_sharply_as_the_motion() -> None:
    problem = posed(
        dynamics={x: u}, running=fmax(sin(7 * time), 0.3) + x, start={x: 0}, bounds={u: (-1, 1)}
    )
    assert along(problem, "-").verified[0].gap < EXTREMAL


@pytest.mark.parametrize("claim", [-20.0, 0.0, 8.0, 1e6, np.nan])
def test_a_wrong_objective_is_neither_feasible_nor_the_headline(claim: float) -> None:
    made = along(posed(minimise=-x, running=3 * u), "-")
    truth = -np.exp(2)
    wrong = judge(posed(minimise=-x, running=3 * u), replace(made, objective=claim))
    assert not verdict_of(wrong).feasible
    assert not wrong.extremal
    assert wrong.reached == pytest.approx(truth, rel=1e-9)
    first, second = wrong.headline
    assert first == f"{wrong.reached:.12g} reached by the control, re-integrated"
    assert second == f"{claim:.12g} claimed by the method"
    assert f"{wrong.reached:.12g}" in wrong._repr_html_()
    told_ = facts(posed(), wrong)
    assert told_["objective"] is None  # the point is infeasible
    assert told_["objective_reached"] == wrong.reached
    assert told_["value"] == claim or np.isnan(claim)


def test_a_claim_is_measured_by_what_the_motion_costs() -> None:
    """X = exp(-20 t): its integral is 1/20, of an x of 1 over a time of 10; 0.07 is no rounding."""
    problem = posed(
        dynamics={x: -20 * x, y: u}, running=x, minimise=y, start={x: 1, y: 0}, final_time=10
    )
    made = along(problem, "-")
    wrong = judge(problem, replace(made, objective=0.07))
    assert made.reached == pytest.approx(0.05, rel=1e-8)
    assert wrong.verified[0].gap == pytest.approx(0.02 / 0.05, rel=1e-3)
    assert not verdict_of(wrong).feasible


def test_facts_lead_with_what_the_control_reaches() -> None:
    made = along(posed(minimise=-x, running=3 * u), "-")
    near = judge(posed(minimise=-x, running=3 * u), replace(made, objective=-np.exp(2) - 0.01))
    assert verdict_of(near).feasible
    assert near.overclaimed
    told = facts(posed(), near)
    assert told["objective"] == near.told == near.reached == pytest.approx(-np.exp(2), rel=1e-9)
    assert told["value"] == -np.exp(2) - 0.01


def test_a_right_objective_is_told_once() -> None:
    made = along(posed(minimise=-x, running=3 * u), "-")
    assert made.headline == (f"{made.objective:.12g}",)
    again = from_json(to_json(made))
    assert again.reached == made.reached
    assert again.verified == made.verified


def test_a_result_without_the_new_figures_is_still_read() -> None:
    made = along(posed(), "-")
    document = json.loads(to_json(made))
    for each in document["judgement"]["verified"]:
        del each["objective"], each["gap"]
    del document["judgement"]["verdict"]["miss_at"]
    old = from_json(json.dumps(document))
    assert old.headline == (f"{made.objective:.12g}",)


def test_a_cost_that_vanishes_is_not_measured_by_its_rounding() -> None:
    """X stays at 0, where x^2 is best: an objective of 1e-13 is as good as none."""
    problem = posed(dynamics={x: u}, running=x**2, minimise=x**2, bounds={u: (0, 1)}, start={x: 0})
    made = along(problem, "-")
    assert verdict_of(judge(problem, replace(made, objective=1e-13))).miss < EXTREMAL


def test_the_report_says_what_the_control_reaches(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Five steps of implicit Euler for growth by e^2 claim (1 / 0.6)^5; the report says that it is
    no answer, and what is reached.
    """
    path = tmp_path / "growth.py"
    path.write_text(
        "from socp import Problem, controls, states\nx = states('x'); u = controls('u')\nproblem "
        "= Problem(name='growth', minimise=-x, running=3 * u, dynamics={x: x * (1 - u)}, "
        "bounds={u: (0, 1)}, start={x: 1}, final_time=2)\n"
    )
    given = [
        "solve",
        str(path),
        "-m",
        "euler-ipopt",
        "-o",
        "steps=5",
        "--quiet",
        "--out",
        str(tmp_path / "out.json"),
    ]
    assert main(given) == 1  # the objective is part of what is claimed, and it is not reached
    text = capsys.readouterr().out
    claimed = (1 / 0.6) ** 5
    first = next(
        line for line in text.splitlines() if line.endswith("reached by the control, re-integrated")
    )
    assert float(first.split()[0]) == pytest.approx(-np.exp(2), rel=1e-6)
    said = next(line for line in text.splitlines() if line.startswith("objective"))
    assert said.startswith("objective    none: the point is infeasible (its value ")
    assert float(said.rstrip(")").split()[-1]) == pytest.approx(-claimed, rel=1e-6)
    assert "not feasible" in text


# -- right solutions are not refused

KINKED = {
    "time": Problem(
        name="time",
        minimise=-x,
        running=0.5 * u,
        dynamics={x: fmax(0, sin(time)) * (0.2 + u) - 0.3 * x},
        bounds={u: (0, 1)},
        start={x: 0},
        final_time=12,
    ),
    "state": Problem(
        name="state",
        minimise=-y,
        running=0.001 * u,
        dynamics={y: fmax(x - 10, 0), x: u - 0.27 * x},
        bounds={u: (0, 100), x: (None, 50)},
        start={y: 0, x: 0},
        final_time=5,
    ),
    "start": Problem(
        name="start",
        minimise=final_time,
        dynamics={x: fmax(y, 0) + 2 * fmin(y, 0), y: u},
        bounds={u: (-1, 1)},
        start={x: 0, y: 0},
        end={x: 1, y: 0},
    ),
    "backwards": Problem(
        name="backwards",
        minimise=-x,
        running=0.1 * u,
        dynamics={x: fabs(time - 1) * (u - 0.2)},
        bounds={u: (0, 1)},
        start={x: 0},
        initial_time=-1,
        final_time=1,
    ),
}


@pytest.mark.parametrize(
    ("name", "word", "objective"),
    [
        ("time", "-", None),
        ("state", "+ b[x.upper] -", -187.28675582),
        ("start", "+ -", 2),
        ("backwards", "+ -", None),
    ],
)
def test_a_right_solution_with_nodes_on_a_kink_is_certified(
    name: str, word: str, objective: float | None
) -> None:
    found = along(KINKED[name], word)
    assert found.extremal, verdict_of(found).reasons
    assert verdict_of(found).residual < 1e-6
    if objective is not None:
        assert found.objective == pytest.approx(objective, rel=1e-9)


def test_smooth_dynamics_are_judged_at_the_nodes_themselves() -> None:
    problem = posed(dynamics={x: exp(cos(x)) * (1 - u)})
    samples = case(problem, along(problem, "- +")).along.samples
    np.testing.assert_array_equal(samples.values["L"], samples.u[0])
    np.testing.assert_allclose(
        samples.values["f"][0], np.exp(np.cos(samples.x[0])) * (1 - samples.u[0]), rtol=1e-15
    )


def test_a_condition_whose_terms_are_not_finite_is_named_with_its_time() -> None:
    problem = posed(dynamics={x: u}, bounds={u: (-1, 1)}, start={x: 0}, end={x: 0}, final_time=2)
    laid = case(problem, along(problem, "- +"))
    first = next(each for each in laid.rows if each.equation and each.decisive and each.t.size)
    broken = np.where(first.t[:, None] == first.t[-1], np.nan, first.matrix)
    lost = replace(laid, rows=(replace(first, matrix=broken), *laid.rows))
    text = rf"{first.kind.value}: its terms are not finite at t = {first.t[-1]:.6g}"
    with pytest.raises(ArithmeticError, match=text):
        multipliers(lost)


def test_signs_that_are_not_finite_prove_no_distance() -> None:
    problem = posed(dynamics={x: u}, bounds={u: (-1, 1)}, start={x: 0}, end={x: 0}, final_time=2)
    laid = case(problem, along(problem, "+ -"))
    lost = [
        each if each.equation else replace(each, matrix=np.full_like(each.matrix, np.nan))
        for each in laid.rows
    ]
    z, distance = multipliers(replace(laid, rows=tuple(lost)))
    assert np.isfinite(z).all()
    assert distance is None


@pytest.mark.parametrize("seed", range(6))
def test_no_sign_is_left_out_of_a_verdict(seed: int) -> None:
    """Signs at many nodes: what no multipliers can do better is what the multipliers found do, to
    the last node.
    """
    problem = posed(
        dynamics={x: u, y: x},
        bounds={u: (-1, 1)},
        start={x: 0, y: 0},
        end={x: 0, y: -1},
        final_time=3,
        running=x**2,
    )
    laid = case(problem, along(problem, "- + -"))
    random, count = np.random.default_rng(seed), 40 * (POINTS + 1)
    size = laid.magnitude(np.zeros(laid.along.unknowns.size))
    signs = Rows(
        Condition.SIGN,
        size * random.normal(size=(count, laid.along.unknowns.size)),
        size * (random.normal(size=count) - (4.0 if seed % 2 else -0.5)),
        np.linspace(0, 3, count),
        [Place(control="u", stretch=1, mode=Mode("upper"))] * count,
        equation=False,
        decisive=False,
        pointwise=False,
    )
    only = replace(laid, rows=(*(r for r in laid.rows if r.equation), signs))
    z, distance = multipliers(only)
    worst = max(finding.residual for finding in only.findings(z))
    if distance is None or distance <= EXTREMAL:
        assert worst <= EXTREMAL
        return
    matrix = np.vstack(
        [each for r in only.rows for each in ([r.matrix, -r.matrix] if r.equation else [r.matrix])]
    )
    offset = np.concatenate(
        [e for r in only.rows for e in ([r.offset, -r.offset] if r.equation else [r.offset])]
    )
    cost = np.append(np.zeros(z.size), 1.0)
    best = linprog(
        cost,
        np.column_stack([matrix, -np.ones(len(offset))]),
        -offset,
        bounds=[(None, None)] * len(cost),
    )
    assert distance == pytest.approx(best.fun / only.magnitude(best.x[:-1]), rel=1e-3)
    assert worst >= distance * (1 - 1e-3) * min(
        only.magnitude(best.x[:-1]) / only.magnitude(z), 1.0
    )


# -- arcs that are none


@pytest.mark.parametrize("share", [1e-4, 9e-7, 1e-8, 1e-10])
def test_an_arc_that_changes_nothing_is_not_certified(share: float) -> None:
    """X'' = u in least time is + -; a third arc at the end, however short, is one too many."""
    problem = Problem(
        name="rest",
        minimise=final_time,
        dynamics={x: y, y: u},
        bounds={u: (-1, 1)},
        start={x: 0, y: 0},
        end={x: 1, y: 0},
    )
    found = along(problem, "+ -")
    assert found.extremal
    assert found.objective == pytest.approx(2.0, rel=1e-10)
    first, second = found.arcs
    cut = second.t[-1] - share * found.final_time
    stub = np.linspace(cut, second.t[-1], second.t.size)
    t = second.t[0] + (cut - second.t[0]) * (second.t - second.t[0]) / np.ptp(second.t)
    parts = [replace(second, t=each, x=second.at(each)) for each in (t, stub)]
    extra = replace(parts[1], modes=("+",), u=-parts[1].u)
    judged = judge(problem, replace(found, arcs=(first, parts[0], extra)))
    assert not judged.extremal
    short = any("without length" in reason for reason in verdict_of(judged).reasons)
    assert short == (share <= SHORTEST)


def test_the_search_drops_the_arcs_that_the_judge_calls_none() -> None:
    found = along(KINKED["start"], "+ -")
    first, second = found.arcs
    cut = first.t[0] + 0.5 * SHORTEST * found.final_time
    stub = replace(first, t=np.linspace(first.t[0], cut, first.t.size), modes=("-",))
    rest = replace(first, t=cut + (first.t - first.t[0]) * (first.t[-1] - cut) / np.ptp(first.t))
    judged = judge(KINKED["start"], replace(found, arcs=(stub, rest, second)))
    assert any("without length" in reason for reason in verdict_of(judged).reasons)
    assert "0: + -" in {each.key for each in mends(KINKED["start"], word_of(judged), judged)}


# -- extrapolations


def sequence(*values: float) -> list[Solution]:
    made = along(posed(), "-")
    return [replace(made, objective=value) for value in values]


def test_differences_that_are_not_geometric_have_no_limit() -> None:
    chatters = sequence(
        1.59998, 1.57518, 1.55768, 1.52418, 1.51527877
    )  # both ends chatter: one arc more helps one
    assert limit(chatters) is None
    assert "Aitken" not in summary(chatters)


@pytest.mark.parametrize("ratio", [0.9, 0.5, 0.1, 1e-3])
def test_a_geometric_sequence_has_its_limit(ratio: float) -> None:
    assert limit(sequence(*(1 + ratio**k for k in range(5)))) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize(
    "steps", [(1, 0.9, 0.2), (1, 0.1, 0.05), (1, 2, 1), (1, -0.5, 0.25), (1, 0.5), (1, 0.5, 0.5)]
)
def test_steps_whose_ratios_differ_tell_nothing(steps: tuple[float, ...]) -> None:
    assert limit(sequence(*(5 - np.cumsum((0, *steps))))) is None


# -- never worse than what is in hand

GROWTH = posed(
    minimise=-x, running=3 * u
)  # without control x grows to e^2, with it the answer is 6 - 1


@cache
def growth(word: str) -> Solution:
    return along(GROWTH, word)


@cache
def direct(steps: int = 200) -> Solution:
    return solve_collocated(
        single_phase(GROWTH), [uniform(euler(), steps)], Ipopt(), default_guess(GROWTH)
    )


@pytest.mark.slow
def test_a_better_direct_solution_goes_before_a_word() -> None:
    word = growth("+")
    assert not word.extremal
    found = conclude(GROWTH, Search(best=word, count=7), [direct(50), direct()])
    assert found.reached == pytest.approx(-np.exp(2), rel=1e-2)
    assert verdict_of(found).feasible
    assert "7 tried" in found.message
    assert "this is a direct solution; the best word tried, u: +, reaches 5" in found.message


@pytest.mark.slow
def test_an_infeasible_word_is_not_better_whatever_it_claims() -> None:
    lie = judge(GROWTH, replace(growth("+"), objective=-1e3))
    found = conclude(GROWTH, Search(best=lie), [direct()])
    assert found.reached == pytest.approx(-np.exp(2), rel=1e-2)
    assert "reaches 5, its re-integration off by" in found.message


def test_a_worse_direct_solution_does_not_go_before_a_word() -> None:
    worse = solve_collocated(
        single_phase(posed(minimise=-x, running=3 * u, bounds={u: (0.5, 1)})),
        [uniform(euler(), 200)],
        Ipopt(),
        default_guess(GROWTH),
    )
    half = judge(GROWTH, revised(growth("-"), structure={}, verdict=None))
    word = revised(
        half, verdict=replace(verdict_of(half), findings=())
    )  # the best there is, by nobody certified
    chosen, text = foremost(GROWTH, word, [worse])
    assert chosen is word
    assert text.startswith("this is the best word tried; the best direct solution reaches")


def test_no_word_at_all() -> None:
    chosen, text = foremost(GROWTH, None, [direct()])
    assert chosen is not None
    assert (verdict_of(chosen).feasible, text) == (True, "this is a direct solution")


@pytest.mark.parametrize("swapped", [False, True])
def test_the_order_of_solutions(swapped: bool) -> None:
    certified, word, grid = growth("-"), growth("+"), judge(GROWTH, direct(400))
    coarse = judge(GROWTH, direct(20))
    assert off(grid) <= FEASIBLE < off(coarse)
    pairs = [(certified, word), (certified, grid), (grid, word), (word, coarse)]
    for better, worse in pairs:
        assert precedes(*((worse, better) if swapped else (better, worse))) is not swapped
    assert clearly(grid, word)
    assert not clearly(word, grid)
    assert not clearly(grid, certified)


@pytest.mark.parametrize("mesh", [uniform(euler(), 400), uniform(radau_iia(2), 20)])
@pytest.mark.slow
def test_a_certified_extremal_is_not_the_last_word_where_a_better_point_is_known(
    mesh: Mesh,
) -> None:
    """In a dead zone no control is an extremal at 0; -187.29 is to be had beyond it."""
    problem = KINKED["state"]
    idle = along(problem, "-")
    assert idle.extremal
    assert idle.objective == pytest.approx(0.0, abs=1e-9)
    arcs = tuple(
        replace(arc, x=np.vstack([150 * arc.t / 5, 50 + 0 * arc.t]))
        for arc in default_guess(problem).arcs
    )  # the states in the order of the dynamics
    start = replace(default_guess(problem), arcs=arcs)
    grid = solve_collocated(single_phase(problem), [mesh], Ipopt(), start)
    assert grid.stop is Stop.SOLVED
    assert grid.objective < -180
    search, hand = Search(best=idle), [grid]
    pursue(problem, search, hand)
    assert search.best is not None
    assert search.best.extremal
    assert search.best.objective == pytest.approx(-187.28675582, rel=1e-9)
    assert better_point(problem, search, hand) is None
    said = conclude(problem, Search(best=idle), hand)  # as if nothing had come of it
    assert said.extremal
    assert "an extremal, but not the best: a feasible point with the objective -18" in said.message


def test_a_certified_best_is_left_alone() -> None:
    search = Search(best=growth("-"), backend=Ration(0.0))
    before = search.best
    pursue(GROWTH, search, [direct()])
    assert search.best is before
    assert conclude(GROWTH, search, [direct()]) is before


# -- what the switching function asks for


@pytest.mark.slow
def test_the_judge_says_what_the_switching_function_asks_for() -> None:
    """X' = u cos t from 0 to pi, as far as it goes: + until pi / 2, then -."""
    problem = posed(
        dynamics={x: u * cos(time)},
        bounds={u: (-1, 1)},
        minimise=-x,
        running=0,
        start={x: 0},
        final_time=float(np.pi),
    )
    right = along(problem, "+ -")
    assert right.extremal
    assert right.objective == pytest.approx(-2.0, rel=1e-12)
    assert Mode("lower") in {f.wants for f in verdict_of(along(problem, "+")).findings}
    for word, wanted in (("+", "lower"), ("-", "upper")):
        wrong = along(problem, word)
        (asked,) = [f for f in verdict_of(wrong).findings if f.kind is Condition.SIGN]
        assert not asked.holds
        assert asked.wants == Mode(wanted)
        assert asked.place == Place(control="u", stretch=1, mode=Mode.parse(word))
        assert (asked.condition, asked.where) == (
            "switching function sign",
            f"u, stretch 1 ({word})",
        )
        assert {"0: + -", "0: - + -", "0: + - +"} & {
            each.key for each in mends(problem, word_of(wrong), wrong)
        }
    told_ = solved(problem, "mboc", switches="0", starts=1)
    assert "an arc is missing, u: " in told_.message


def test_an_arc_that_the_switching_function_asks_for_is_found() -> None:
    found = solved(KINKED["state"], starts=4)
    assert found.extremal
    assert found.word == "u: + b[x.upper] -"
    assert found.objective == pytest.approx(-187.28675582, rel=1e-9)


def test_explained_tells_the_worst_reason() -> None:
    finding = Finding(kind=Condition.OTHER, text="a", residual=0.1, place=Place(of="b"))
    word = revised(growth("+"), verdict=Verdict(miss=0.0, findings=(finding,)))
    said = explanation(GROWTH, Search(best=word, count=3))
    best = "no word of the 3 tried is certified; the best one leaves: a on b: 1.0e-01"
    assert said == best


@pytest.mark.slow
def test_implicit_euler_rings_on_a_fine_grid_of_a_flat_singular_arc_and_the_verdict_says_so() -> (
    None
):
    """A fed-batch reactor: calm with a hundred steps, not with a thousand."""
    biomass, substrate, volume = states("biomass substrate volume")
    growth_ = 0.53 * substrate / (0.12 + substrate + substrate**2 / 5) * biomass
    problem = posed(
        minimise=-biomass * volume,
        running=0.5 * u,
        final_time=15,
        start={biomass: 1, substrate: 0.5, volume: 2},
        dynamics={
            biomass: growth_ - u / volume * biomass,
            substrate: -growth_ / 0.4 + u / volume * (30 - substrate),
            volume: u,
        },
        bounds={u: (0, 1), volume: (None, 20), substrate: (0, None), biomass: (0, None)},
    )
    assert verdict_of(solved(problem, "euler-ipopt", steps=100)).rings == ()
    assert verdict_of(solved(problem, "euler-ipopt", steps=1000)).rings == ("u",)

"""Words read off solutions and mended, on solutions made by hand; the search's ration of work."""

import importlib
from dataclasses import replace

import casadi
import numpy as np
import pytest
from records import built, revised

from socp import (
    Problem,
    Solution,
    controls,
    default_guess,
    silent,
    solve,
    solve_collocated,
    states,
)
from socp.model.result.arc import Arc
from socp.model.result.findings import Condition, Feasibility, Finding, Node, Place, Verdict
from socp.model.result.solution import Stop
from socp.model.symbols import final_time
from socp.model.word import Mode
from socp.process import time_limit
from socp.search import refinement
from socp.search.candidate import Candidate, insert, merged
from socp.search.conclusion import explanation
from socp.search.effort import Ration, Search
from socp.search.mending import mends
from socp.search.reading import candidate, read, with_hidden_bangs
from socp.solvers import default_backend
from socp.solvers.contract import NLP, NLPPoint
from socp.transcription import euler, radau_iia, single_phase, uniform
from socp.transcription.cutting import between, part
from socp.verdict import tested as held_against_conditions
from socp.verdict.junctions import chattering

x, y = states("x y")
u, w = controls("u w")
problem = Problem(
    name="made by hand",
    minimise=final_time,
    dynamics={x: u, y: w},
    bounds={u: (-1, 1), w: (0, 2), x: (None, 3)},
    start={x: 0, y: 0},
    end={x: 1},
)


def held(first: list[float], second: list[float]) -> Solution:
    """Return a solution whose controls are constant on intervals of length 1."""
    t = np.arange(len(first) + 1.0)
    rows = np.array([first, second])
    arc = Arc(
        t=t,
        x=np.zeros((2, t.size)) - 1.0,
        u=np.hstack([rows[:, :1], rows]),
        costate=np.full((2, t.size), np.nan),
        mesh=np.arange(t.size),
        side="right",
        modes=("*", "*"),
    )
    names = {"state_names": problem.state_names, "control_names": problem.control_names}
    return built(
        problem=problem.name, method="m", arcs=(arc,), objective=0.0, stop=Stop.SOLVED, **names
    )


def made(*arcs: str, edges: tuple[float, ...] | None = None) -> Candidate:
    """Return a candidate over [0, 12] from arcs such as `+ s`, of equal lengths unless edges are
    given.
    """
    modes = tuple(tuple(Mode.parse(mode) for mode in arc.split()) for arc in arcs)
    return Candidate(
        modes,
        edges or tuple(np.linspace(0, 12, len(arcs) + 1).tolist()),
        held([0.0] * 12, [1.0] * 12),
    )


def spelt(given: Candidate) -> list[str]:
    return [" ".join(map(str, arc)) for arc in given.arcs]


def test_short_stretches_along_a_limit_count_where_limits_are_read() -> None:
    solution = held([0] * 10 + [0, -0.5], [2] * 12)
    (arc,) = solution.arcs
    states_at_limit = arc.x.copy()
    states_at_limit[0, 10:12] = 3.0
    solution = replace(solution, arcs=(replace(arc, x=states_at_limit),))
    assert spelt(read(problem, solution)) == ["s +"]
    limits = read(problem, solution, limits=True)
    assert spelt(limits) == ["s +", "b[x.upper] +", "- +"]
    assert limits.edges == (0.0, 10.0, 11.0, 12.0)


def test_reading_joins_the_switches_of_all_controls() -> None:
    found = read(problem, held([1] * 6 + [-1] * 6, [2] * 3 + [0] * 9))
    assert spelt(found) == ["+ +", "+ -", "- -"]
    assert found.edges == pytest.approx((0, 3, 6, 12))


def test_reading_takes_back_a_switch_smeared_over_two_steps() -> None:
    found = read(problem, held([1] * 5 + [0.5, -0.5] + [-1] * 5, [2] * 12))
    assert spelt(found) == ["+ +", "- +"]
    assert found.edges[1] == pytest.approx(6.0)


def test_reading_keeps_a_long_stretch_inside_the_box() -> None:
    assert spelt(read(problem, held([1] * 4 + [0.3] * 4 + [-1] * 4, [2] * 12))) == [
        "+ +",
        "s +",
        "- +",
    ]


def test_a_solution_whose_structure_is_not_known_is_not_called_chattering() -> None:
    assert chattering(problem, held([1] * 12, [2] * 12)) == []


def test_a_burst_shorter_than_a_step_is_read_from_its_integral() -> None:
    found = read(problem, held([-1] * 5 + [0.4] + [-1] * 6, [2] * 11 + [0.5]))
    assert spelt(found) == ["- +", "+ +", "- +", "- -"]
    assert np.allclose(found.edges, [0, 5.15, 5.85, 11.25, 12])


def test_a_burst_at_the_start_is_read_from_its_integral() -> None:
    found = read(problem, held([-0.5] + [-1] * 11, [2] * 12))
    assert spelt(found) == ["+ +", "- +"]
    assert np.allclose(found.edges, [0, 0.25, 12])


def test_what_a_solver_leaves_off_a_bound_is_no_burst() -> None:
    assert spelt(read(problem, held([-1] * 5 + [-0.99] + [-1] * 6, [2] * 12))) == ["- +"]


def test_a_bang_shorter_than_a_step_is_found_before_a_boundary_arc() -> None:
    """With v' = 40 u the limit 1 is 0.025 away from rest, a quarter of a step, in which a grid's
    control is a quarter of its bound.
    """
    x, v, u = *states("x v"), controls("u")
    problem = Problem(
        name="limit",
        minimise=-x,
        dynamics={x: v, v: 40 * u},
        bounds={u: (-1, 1), v: (None, 1)},
        start={x: 0, v: 0},
        final_time=2,
    )
    direct = solve_collocated(
        single_phase(problem), [uniform(euler(), 20)], default_backend(), default_guess(problem)
    )
    found = with_hidden_bangs(problem, read(problem, direct))
    assert spelt(found) == ["+", "b[v.upper]"]
    assert found.edges[1] == pytest.approx(0.025, rel=1e-3)


@pytest.mark.parametrize("first", [0.2, 1.0, 5.0])
@pytest.mark.parametrize("edge", [0.003, 0.006, 0.015])
def test_a_hidden_bang_stands_over_switches_of_others_and_on_any_grid(
    first: float, edge: float
) -> None:
    """From 0.01 u brings x to zero, beside w, which switches at an edge before that or after."""
    x, y = states("x y")
    u, w = controls("u w")
    problem = Problem(
        name="two",
        running=x**2 / 2 + y**2 / 2,
        dynamics={x: u, y: w},
        bounds={u: (-1, 1), w: (-1, 1)},
        start={x: 0.01, y: 0.9},
        final_time=1.0,
    )
    mesh = [(first if k == 0 else 1.0, radau_iia(2)) for k in range(25)]
    direct = solve_collocated(
        single_phase(problem), [mesh], default_backend(), default_guess(problem)
    )
    arcs = tuple((Mode("singular"), Mode(each)) for each in ("upper", "lower"))
    found = with_hidden_bangs(problem, Candidate(arcs, (0.0, edge, 1.0), direct))
    assert spelt(found) == (["- +", "- -", "s -"] if edge < 0.01 else ["- +", "s +", "s -"])
    assert found.edges[1 + (edge < 0.01)] == pytest.approx(0.01, rel=1e-2)


def test_reading_takes_fast_flutter_for_a_singular_arc() -> None:
    assert spelt(read(problem, held([1] * 20 + [-1, 1] * 10 + [-1] * 20, [2] * 60))) == [
        "+ +",
        "s +",
        "- +",
    ]


def test_a_few_short_bangs_are_no_flutter() -> None:
    assert spelt(read(problem, held([1] * 20 + [-1] * 4 + [1] * 20, [2] * 44))) == [
        "+ +",
        "- +",
        "+ +",
    ]


def test_switches_that_differ_by_rounding_are_one() -> None:
    stretches = {
        "u": (("+", 0, 4.0), ("-", 4.0, 12)),
        "w": (("-", 0, 4.0 + 1e-13), ("+", 4.0 + 1e-13, 12)),
    }
    assert spelt(candidate(held([0] * 12, [1] * 12), stretches)) == ["+ -", "- +"]


def test_equal_neighbours_are_merged() -> None:
    found = merged(made("+ s", "+ s", "- s"))
    assert spelt(found) == ["+ s", "- s"]
    assert found.edges == (0, 8, 12)


@pytest.mark.parametrize(
    ("t", "arcs"),
    [(6.0, ["s +", "- +", "s +"]), (0.0, ["- +", "s +"]), (12.0, ["s +", "- +"])],
)
def test_an_arc_is_inserted_around_a_time_or_at_an_end(t: float, arcs: list[str]) -> None:
    found = insert(made("s +"), 0, Mode("lower"), t)
    assert spelt(found) == arcs
    assert all(np.diff(found.edges) > 0)
    k = arcs.index("- +")
    assert found.edges[k] <= t <= found.edges[k + 1]


def test_inserting_what_is_there_already_changes_nothing() -> None:
    assert spelt(insert(made("+ +", "- +"), 0, Mode("upper"), 1.0)) == ["+ +", "- +"]


def solved(tried: Candidate, verdict: Verdict | None = None, **more: object) -> Solution:
    """Return a solution with the arcs and edges of a candidate, its structure spelt out."""
    arcs, rows = [], {name: [] for name in problem.control_names}
    values = {"+": (1.0, 2.0), "-": (-1.0, 0.0), "s": (0.0, 1.0)}
    for modes, a, b in zip(tried.arcs, tried.edges, tried.edges[1:], strict=False):
        t = np.linspace(a, b, 3)
        level = np.array([values[str(mode)][i] for i, mode in enumerate(modes)])
        names = tuple(map(str, modes))
        arcs.append(
            Arc(
                t=t,
                x=np.zeros((2, 3)),
                u=np.repeat(level[:, None], 3, axis=1),
                costate=np.full((2, 3), np.nan),
                mesh=np.array([0, 2]),
                side="both",
                modes=names,
            )
        )
        for row, mode in zip(rows.values(), names, strict=True):
            if row and row[-1][0] == mode:
                row[-1] = (mode, row[-1][1], b)
            else:
                row.append((mode, a, b))
    structure = {name: tuple(row) for name, row in rows.items()}
    return revised(tried.source, arcs=tuple(arcs), structure=structure, verdict=verdict, **more)  # type: ignore[arg-type]


def test_an_arc_without_length_is_dropped_or_its_switches_swapped() -> None:
    tried = made("+ -", "- -", "- +", edges=(0.0, 6.0, 6.0 + 1e-9, 12.0))
    found = [spelt(each) for each in mends(problem, tried, solved(tried))]
    assert found == [["+ -", "- +"], ["+ -", "+ +", "- +"]]


def wanting(control: str, mode: Mode, wants: Mode, t: float) -> Finding:
    """Return the finding that a first stretch of a control has a sign which asks for another."""
    place = Place(control=control, stretch=1, mode=mode)
    return Finding(kind=Condition.SIGN, residual=1e-2, place=place, t=t, wants=wants)


def test_a_switching_function_of_the_wrong_sign_asks_for_an_arc_there() -> None:
    finding = wanting("u", Mode("upper"), Mode("lower"), 6.0)
    tried = made("+ -")
    found = [
        spelt(each)
        for each in mends(problem, tried, solved(tried, Verdict(miss=0.0, findings=(finding,))))
    ]
    assert found == [["+ -", "- -", "+ -"], ["+ -", "s -", "+ -"]]


def test_a_stretch_without_a_strict_sign_is_dropped() -> None:
    tried = made("+ -", "- -", "s -")
    stretches = (("u", 1, "+", 0.1), ("u", 2, "-", -1e-9), ("w", 1, "-", 0.1))
    margins = {
        Place(control=name, stretch=number, mode=Mode.parse(mode)): margin
        for name, number, mode, margin in stretches
    }
    finding = Finding(kind=Condition.SWITCH, residual=1e-8)
    verdict = Verdict(miss=0.0, margins=margins, findings=(finding,))
    assert [spelt(each) for each in mends(problem, tried, solved(tried, verdict))] == [
        ["+ -", "s -"]
    ]


def test_stretches_without_strict_signs_are_dropped_at_once_and_then_one_by_one() -> None:
    tried = made("+ -", "s -", "- -", "+ -")
    signs = (("+", 0.1), ("s", 0.1), ("-", 0.0), ("+", 0.0))
    margins = {
        Place(control="u", stretch=number, mode=Mode.parse(mode)): margin
        for number, (mode, margin) in enumerate(signs, start=1)
    }
    finding = Finding(kind=Condition.SWITCH, residual=1e-8)
    verdict = Verdict(miss=0.0, margins=margins, findings=(finding,))
    assert [spelt(each) for each in mends(problem, tried, solved(tried, verdict))] == [
        ["+ -", "s -"],
        ["+ -", "s -", "+ -"],
        ["+ -", "s -", "- -"],
    ]


def test_bangs_without_strict_signs_stand_for_a_singular_arc_where_the_principle_fails() -> None:
    tried = made("- -", "+ -", "- -", "+ -")
    margins = {
        Place(control="u", stretch=number, mode=Mode.parse(mode)): margin
        for number, (mode, margin) in enumerate(zip("-+-+", (0.1, 0.0, 0.0, 0.1), strict=True), 1)
    }
    finding = Finding(kind=Condition.SIGN, residual=0.3)
    verdict = Verdict(miss=0.0, margins=margins, findings=(finding,))
    first = next(mends(problem, tried, solved(tried, verdict)))
    assert spelt(first) == ["- -", "s -", "+ -"]


@pytest.mark.parametrize(
    ("residuals", "drift", "asked"),
    [
        ({Condition.SWITCH: 1e-7}, 0.0, False),  # all holds: an arc is slack
        ({Condition.INSIDE: 1e-5, Condition.SWITCH: 1e-12}, 0.0, False),  # no root is off
        ({Condition.INSIDE: 1e-5, Condition.SWITCH: 1e-6}, 0.0, True),
        ({Condition.SWITCH: 1e-7}, 1e-5, True),
        ({Condition.SWITCH: 1e-3}, 0.0, False),  # too far
    ],
)
def test_newton_is_asked_where_what_it_solves_is_amiss(
    residuals: dict[Condition, float], drift: float, asked: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = list[Solution]()
    monkeypatch.setattr(refinement, "polished", lambda _, each: calls.append(each))
    findings = tuple(Finding(kind=kind, residual=each) for kind, each in residuals.items())
    margins = {Place(control="u", stretch=1, mode=Mode("upper")): 0.0}
    verdict = Verdict(miss=0.0, drift=drift, findings=findings, margins=margins)
    given = solved(made("+ -"), verdict)
    assert refinement._settled(problem, given) is given
    assert bool(calls) is asked


@pytest.mark.parametrize(("top", "found"), [(3.0, [["+ -", "b[x.upper] -", "- -"]]), (2.5, [])])
def test_a_contact_where_arcs_join_opens_into_an_arc(top: float, found: list[list[str]]) -> None:
    tried = made("+ -", "- -")
    rows = np.array([[0.0, 1.5, top], [top, 2.0, 1.0]])
    touching = solved(tried, Verdict(miss=0.0))
    arcs = tuple(
        replace(arc, x=np.array([row, [0.0, 0.0, 0.0]]))
        for arc, row in zip(touching.arcs, rows, strict=True)
    )
    assert [spelt(each) for each in mends(problem, tried, revised(touching, arcs=arcs))] == found


def test_what_the_judge_wants_goes_before_contacts_that_may_open() -> None:
    tried = made("+ -", "- -")
    finding = wanting("w", Mode("lower"), Mode("upper"), 9.0)
    touching = solved(tried, Verdict(miss=0.0, findings=(finding,)))
    rows = np.array([[0.0, 1.5, 3.0], [3.0, 2.0, 1.0]])
    arcs = tuple(
        replace(arc, x=np.array([row, [0.0, 0.0, 0.0]]))
        for arc, row in zip(touching.arcs, rows, strict=True)
    )
    assert [spelt(each) for each in mends(problem, tried, revised(touching, arcs=arcs))] == [
        ["+ -", "- -", "- +", "- -"],
        ["+ -", "b[x.upper] -", "- -"],
        ["+ -", "- -", "- s", "- -"],
    ]


def test_a_violated_state_constraint_is_followed_where_it_is_worst() -> None:
    tried = made("+ -")
    solution = solved(tried)
    arc = replace(solution.arcs[0], x=np.array([[0.0, 4.0, 1.0], [0.0, 0.0, 0.0]]))
    broken = Feasibility(
        miss=0.0, miss_at="x", path=0.3, path_at="x.upper", box=0.0, drift=0.0, feedback=False
    )
    (found,) = mends(problem, tried, revised(solution, arcs=(arc,), verified=(broken,)))
    assert spelt(found) == ["+ -", "b[x.upper] -", "+ -"]
    unknown = replace(broken, path=np.inf, path_at="")  # its motion was cut off by the time
    assert not list(mends(problem, tried, revised(solution, arcs=(arc,), verified=(unknown,))))


def test_a_ration_ends_with_the_work_and_says_so() -> None:
    v = casadi.SX.sym("v", 4)
    nlp = NLP.of(
        v=v,
        f=casadi.sumsqr(v - 1) ** 2 + casadi.exp(v[0]),
        g=casadi.SX(0, 1),
        v_box=np.array([[-5.0] * 4, [5.0] * 4]),
        g_box=np.zeros((2, 0)),
        binary=np.zeros(4, dtype=bool),
    )
    guess = NLPPoint(v=np.full(4, 4.0))
    assert Ration(left=1e4)(nlp, guess).stop.ok
    short = Ration(left=4 * 12.5)
    assert short(nlp, guess).stop is Stop.LIMIT
    assert short.left < 4 * 10
    refused = short(nlp, guess)
    assert refused.stop is Stop.LIMIT
    assert "work allowed" in refused.message
    assert refused.v == pytest.approx(guess.v)


def fuller(order: int) -> Problem:
    """Return x1^2 over a chain of integrators: singular arcs of that order."""
    chain = list(states("f1 f2 f3"))[:order]
    rates = dict(zip(chain, [*chain[1:], u], strict=True))
    return Problem(
        name="chain",
        running=chain[0] ** 2,
        dynamics=rates,
        bounds={u: (-1, 1)},
        start=dict.fromkeys(chain, 1),
        final_time=5,
    )


@pytest.mark.parametrize(("order", "names"), [(1, []), (2, ["u"]), (3, [])])
def test_a_jump_onto_a_singular_arc_of_even_order_is_chattering(
    order: int, names: list[str]
) -> None:
    tried = solved(made("- +", "s +"))
    only = revised(tried, structure={"u": (("-", 0.0, 6.0), ("s", 6.0, 12.0))})
    assert chattering(fuller(order), only) == names


def test_a_bang_bang_word_is_no_chattering() -> None:
    only = revised(solved(made("- +", "+ +")), structure={"u": (("-", 0.0, 6.0), ("+", 6.0, 12.0))})
    assert chattering(fuller(2), only) == []


def test_a_search_that_fails_names_the_worst_that_is_left() -> None:
    verdict = Verdict(
        miss=0.0,
        findings=(
            Finding(kind=Condition.INSIDE, residual=1e-3),
            Finding(kind=Condition.SIGN, residual=0.1),
        ),
    )
    search = Search(count=7, best=solved(made("+ -"), verdict))
    assert "7 tried" in explanation(problem, search)
    assert "switching function sign: 1.0e-01" in explanation(problem, search)


def test_what_was_late_says_so() -> None:
    text = explanation(problem, Search(late=True, seconds=60.0))
    late = "and the search's part of the 60 s allowed is over"
    assert text == f"no word was tried, {late}"


def test_words_that_were_cut_off_are_not_called_tried_in_vain() -> None:
    cut = [Node(word=word, stop=Stop.LIMIT.name) for word in ("u: +", "u: + -", "u: +")]
    shown = "all 2 words tried were cut off before converging"
    assert explanation(problem, Search(count=3, nodes=cut)) == shown
    ended = "no word of the 4 tried is certified, 2 more cut off before they converged"
    assert explanation(problem, Search(count=7, nodes=cut)) == ended
    alone = "the one word tried was cut off before converging"
    assert explanation(problem, Search(count=1, nodes=cut[:1])) == alone


def test_what_ended_a_search_is_told_as_it_is() -> None:
    worked = Search(backend=Ration(left=0.0))
    with time_limit(0.0):  # what concludes has no time left; the search had
        assert explanation(problem, Search()) == "no word was tried"
        assert explanation(problem, worked).endswith(
            ", and the work allowed for the search is done"
        )
        assert explanation(problem, Search(words=0)).endswith(", and no more words are allowed")


def test_an_arc_without_length_is_dropped_where_nothing_else_is_amiss() -> None:
    """Rest to rest under a limit of speed: the boundary arc in two, an arc of no length between."""
    own = importlib.import_module("socp_problems.double_integrator_vlimit").problem
    right = solve(own, watch=silent)
    first, along, last = right.arcs
    middle = float(along.t[0] + along.t[-1]) / 2.0
    halves = [
        part(along, span, between(along, span, 10))
        for span in ((float(along.t[0]), middle), (middle, float(along.t[-1])))
    ]
    at = along.at(np.array([middle])) + np.zeros_like(first.x)
    none = replace(
        first,
        t=np.full_like(first.t, middle),
        x=at,
        costate=along.at(np.array([middle]), "costate") + np.zeros_like(at),
    )
    longer = replace(right, arcs=(first, halves[0], none, halves[1], last))
    judged = held_against_conditions(own, longer)
    assert judged.verdict is not None
    amiss = {each.kind for each in judged.verdict.findings if not each.holds}
    assert amiss == {Condition.NO_LENGTH}
    found = refinement._settled(own, judged)
    assert found.extremal
    assert [arc.modes for arc in found.arcs] == [arc.modes for arc in right.arcs]
    assert found.objective == pytest.approx(right.objective, rel=1e-12)

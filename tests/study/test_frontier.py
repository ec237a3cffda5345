"""The frontier: the best objective for every number of switches, on problems whose answers are
known in closed form.
"""

import json
import math
from concurrent.futures import BrokenExecutor, Executor, Future
from pathlib import Path
from typing import Any

import carts
import pytest
from test_refine import made, solved
from test_refine import spelt as text

from socp import Ipopt, Problem, Solution, single_phase, solve_collocated, uniform
from socp.cli import main
from socp.errors import MethodError
from socp.methods import Follower, guess_along
from socp.methods.guess import default_guess
from socp.model import Progress
from socp.model.data.files import load
from socp.model.word import Word
from socp.registry.plugins import Registry
from socp.search.neighbours import (
    arc_insertions,
    arc_removals,
    mode_changes,
    shortened,
    without_arc,
    word_of,
)
from socp.study.census import explore
from socp.study.switches.frontier import (
    Frontier,
    best_by_switches,
    distinct_rows,
    limit_switches,
)
from socp.study.switches.tendency import length_ratios, limit, summary
from socp.study.workers import pool
from socp.transcription.schemes import euler
from socp.verdict import judge

cart = carts.cart()


def rough(problem: Problem) -> Solution:
    """Return a direct solution."""
    return solve_collocated(
        single_phase(problem), [uniform(euler(), 60)], Ipopt(), default_guess(problem)
    )


@pytest.fixture(scope="module")
def certified() -> Solution:
    return explore(cart, 0).solution


@pytest.fixture(scope="module")
def fuller() -> tuple[Problem, Frontier]:
    problem = Registry.load(only=()).problem("fuller")
    return problem, best_by_switches(problem, 3, rough(problem))


# -- words next to a word


def test_an_arc_left_out_leaves_its_time_to_its_neighbours() -> None:
    given = made("+ +", "- +", "+ -")
    assert [text(each) for each in arc_removals(given)] == [
        ["- +", "+ -"],
        ["+ +", "+ -"],
        ["+ +", "- +"],
    ]
    assert without_arc(given, 1).edges == (0, 6, 12)
    assert without_arc(given, 0).edges == (0, 8, 12)
    assert without_arc(given, 2).edges == (0, 4, 12)


def test_arcs_without_length_go() -> None:
    given = made("+ +", "- +", "+ +", edges=(0.0, 6.0, 6.0, 12.0))
    assert (text(shortened(given, 1e-6)), shortened(given, 1e-6).edges) == (["+ +"], (0, 12))
    first = made("+ +", "- +", edges=(0.0, 0.0, 12.0))
    assert (text(shortened(first, 1e-6)), shortened(first, 1e-6).edges) == (["- +"], (0, 12))


def test_arcs_put_in_are_near_their_neighbours_and_short() -> None:
    modes = [tuple(made(each).arcs[0]) for each in ("+ +", "- +", "+ -", "- -", "s +")]
    found = list(arc_insertions(made("+ +", "- +"), modes))
    assert [text(each) for each in found] == [
        ["- +", "+ +", "- +"],
        ["+ -", "+ +", "- +"],
        ["s +", "+ +", "- +"],
        ["+ +", "+ -", "- +"],
        ["+ +", "- -", "- +"],
        ["+ +", "s +", "- +"],
        ["+ +", "- +", "+ +"],
        ["+ +", "- +", "- -"],
        ["+ +", "- +", "s +"],
    ]
    for each in found:
        assert (each.edges[0], each.edges[-1], len(each.edges)) == (0, 12, 4)
        assert min(
            b - a for a, b in zip(each.edges, each.edges[1:], strict=False)
        ) == pytest.approx(0.6)


def test_one_control_is_changed_on_one_arc() -> None:
    modes = [tuple(made(each).arcs[0]) for each in ("+ +", "- +", "- -")]
    assert [text(each) for each in mode_changes(made("+ +", "- +"), modes)] == [
        ["- +"],
        ["+ +"],
        ["+ +", "- -"],
    ]


def test_a_solution_spells_the_word_of_its_arcs() -> None:
    given = made("+ s", "- +", edges=(0.0, 5.0, 12.0))
    assert (text(word_of(solved(given))), word_of(solved(given)).edges) == (
        ["+ s", "- +"],
        (0, 5, 12),
    )


# -- the frontier


@pytest.mark.slow
def test_too_few_switches_are_infeasible_and_more_do_no_better(certified: Solution) -> None:
    found = best_by_switches(cart, 2, certified)
    assert found.every
    assert found.words == 2 + 2 + 2  # no singular arcs: two modes
    assert found.rows[0] is None
    assert found.rows[1].objective == pytest.approx(2.0, abs=1e-9)
    assert found.rows[1].extremal
    assert found.rows[2] is found.rows[1]
    assert [each.word for each in distinct_rows(found)] == ["u: + -"]


def test_dwell_times_hold_arcs_apart(certified: Solution) -> None:
    longer = best_by_switches(cart, 1, certified, dwell=1.2)
    assert longer.rows[1] is None  # two arcs of 1.2 overshoot: the way is (T/2)^2
    assert best_by_switches(cart, 1, certified, dwell=0.9).rows[1].objective == pytest.approx(
        2.0, abs=1e-9
    )


@pytest.mark.slow
def test_dwell_times_cost_where_they_bind() -> None:
    problem = Registry.load(only=()).problem("fuller")
    found = best_by_switches(problem, 2, rough(problem), dwell=0.8)
    free = best_by_switches(problem, 2, rough(problem))
    assert free.rows[2].objective < found.rows[2].objective
    for row in found.rows:
        assert min(arc.t[-1] - arc.t[0] for arc in row.arcs) >= 0.8 - 1e-9


@pytest.mark.slow
def test_fuller_with_one_switch_is_a_parabola_brought_to_rest(
    fuller: tuple[Problem, Frontier],
) -> None:
    _, found = fuller
    objectives = [row.objective for row in found.rows]
    assert found.every
    assert objectives == sorted(objectives, reverse=True)
    assert objectives[0] == pytest.approx(5.0**3 / 6.0, rel=1e-10)  # no force: x = t
    assert [row.word for row in found.rows][2:] == ["u: - + s", "u: - + - s"]
    assert not any(row.extremal for row in found.rows)


@pytest.mark.slow
def test_the_objectives_of_fuller_tend_to_the_closed_form(fuller: tuple[Problem, Frontier]) -> None:
    problem, found = fuller
    rows = [row for row in found.rows if row is not None]
    end = limit(rows)
    assert end == pytest.approx(problem.reference.objective, rel=1e-5)
    assert abs(end - problem.reference.objective) < 0.5 * abs(
        rows[-1].objective - problem.reference.objective
    )
    assert f"3: {rows[-1].objective:.12g}" in summary(rows)
    assert "Aitken" in summary(rows)


@pytest.mark.slow
def test_the_arcs_of_fuller_shorten_by_the_ratio_of_the_closed_form(
    fuller: tuple[Problem, Frontier],
) -> None:
    _, found = fuller
    (ratio,) = length_ratios(
        found.rows[3]
    )  # the last arc has to come to rest, which shortens it further
    assert 0.15 < ratio < 0.24212137
    assert length_ratios(found.rows[2]) == []


@pytest.mark.slow
def test_no_limit_without_a_geometric_sequence(fuller: tuple[Problem, Frontier]) -> None:
    _, found = fuller
    assert limit(found.rows[:2]) is None
    assert limit([found.rows[2], found.rows[1], found.rows[0]]) is None
    assert limit([found.rows[0]] * 4) is None


def test_many_words_are_found_next_to_the_best_ones(
    certified: Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("socp.study.switches.frontier._ALL", 1)
    found = best_by_switches(cart, 2, certified)
    assert not found.every
    assert (found.rows[0], found.rows[1].word) == (None, "u: + -")
    assert found.rows[2] is found.rows[1]


def test_a_watch_that_has_seen_enough_ends_it(certified: Solution) -> None:
    words: list[str] = []

    def watch(now: object, /) -> bool:
        words.append(now.word)
        return now.word == "u: + -"

    found = best_by_switches(cart, 2, certified, watch=watch)
    assert found.interrupted
    assert not found.every
    assert found.rows[2] is None
    assert words[-1] == "u: + -"


class Here(Executor):
    """An executor of this process, whose workers die after so many jobs."""

    def __init__(self, most: int = 1000) -> None:
        self.left = most

    def submit(self, job: Any, /, *given: Any, **named: Any) -> Future[Any]:
        if not self.left:
            raise BrokenExecutor
        self.left -= 1
        found: Future[Any] = Future()
        found.set_result(job(*given, **named))
        return found


@pytest.mark.parametrize("most", [1000, 3])
@pytest.mark.parametrize("every", [200, 1])
def test_an_executor_finds_the_same_words(
    most: int, every: int, certified: Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("socp.study.switches.frontier._ALL", every)
    alone = best_by_switches(cart, 2, certified)
    told: list[str] = []

    def watch(now: Progress, /) -> bool:
        told.append(now.stage)
        return False

    found = best_by_switches(cart, 2, certified, watch=watch, workers=(Here(most), carts.cart))
    assert [row and row.word for row in found.rows] == [row and row.word for row in alone.rows]
    assert found.best.objective == pytest.approx(alone.best.objective, rel=1e-9)
    assert found.every == alone.every
    assert any(" of " in stage for stage in told)


def test_a_watch_ends_the_work_of_an_executor(certified: Solution) -> None:
    found = best_by_switches(
        cart, 2, certified, watch=lambda now: now.stage > "", workers=(Here(), carts.cart)
    )
    assert found.interrupted
    assert not found.every


@pytest.mark.slow
def test_processes_find_the_same_words(certified: Solution) -> None:
    alone = best_by_switches(cart, 2, certified)
    with pool(2) as two:
        found = best_by_switches(cart, 2, certified, workers=(two, carts.cart))
    assert [row and row.word for row in found.rows] == [row and row.word for row in alone.rows]
    assert found.words == alone.words


@pytest.mark.parametrize(("most", "dwell"), [(-1, 0.0), (2, -0.5), (2, math.nan)])
def test_numbers_out_of_range_are_refused(certified: Solution, most: int, dwell: float) -> None:
    with pytest.raises(MethodError, match="must be at least 0"):
        best_by_switches(cart, most, certified, dwell)


# -- the command


@pytest.mark.slow
def test_frontier_prints_a_table_and_writes_the_best(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    name = "double_integrator_time"
    assert main(["frontier", name, "--max-switches", "2", "--quiet"]) == 0
    said = capsys.readouterr()
    assert "no feasible word found" in said.out
    assert "extremal" in said.out
    assert "all there are" in said.out
    assert said.err == ""
    best = load(f"{name}.socp.json")
    assert (best.method, best.options["max_switches"]) == ("frontier", 2)
    assert (
        main(["frontier", name, "--max-switches", "0", "--json", "--quiet", "--out", "f.json"]) == 1
    )
    told_ = json.loads(capsys.readouterr().out)
    assert told_["rows"] == [{"switches": 0, "objective": None}]
    assert told_["result"] is None
    assert not Path("f.json").exists()


BOTH_ENDS = Problem(
    name="both_ends",
    running=carts.x**2 / 2,
    dynamics={carts.x: carts.v, carts.v: carts.u},
    bounds={carts.u: (-1, 1)},
    start={carts.x: 2, carts.v: -2},
    end={carts.x: 2, carts.v: 2},
    final_time=8,
)


@pytest.mark.slow
def test_switches_are_allowed_for_each_end_of_a_singular_arc_that_chatters() -> None:
    found = judge(
        BOTH_ENDS,
        solve_collocated(
            single_phase(BOTH_ENDS), [uniform(euler(), 60)], Ipopt(), default_guess(BOTH_ENDS)
        ),
    )
    best = limit_switches(BOTH_ENDS, found, 2)
    assert 2 < len(best.switches) <= 4  # two for each end
    assert best.objective == pytest.approx(1.55763990474, rel=1e-9)


def test_a_word_that_chatters_at_both_ends_and_is_near_enough_is_returned_at_once() -> None:
    word = Word.parse("- + - + s + - + -", ["u"])
    start = guess_along(BOTH_ENDS, rough(BOTH_ENDS), word)
    found = judge(BOTH_ENDS, Follower()(BOTH_ENDS, word, start))
    assert found.stop.ok
    assert limit_switches(BOTH_ENDS, found, 4) is found

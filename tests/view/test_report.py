"""A report is written once: terminal, notebook and recording tell the same facts of a solution."""

import html
import io
import math
import re
from collections.abc import Callable
from dataclasses import replace

import pytest
from records import revised

from socp import Problem, Solution, default_guess, judge, run
from socp import final_time as end
from socp import time as now
from socp.cli.consoles import console
from socp.cli.outcome import code, outcome
from socp.cli.session import Exit
from socp.cli.show import facts, report
from socp.model import (
    Agreement,
    Grade,
    Met,
    Proof,
    Rung,
    Starts,
    Stop,
    Verdict,
    from_json,
    to_json,
)
from socp.registry import Registry
from socp.view import Outcome, gap_bar, outcome_of, solution_rows, to_page, verdict_rows
from socp.view.recording.summary import summary
from socp.view.report import judgement, stated_error

STEERING = "\x1b]0;pwn\x07 [red]a[/red] <script>b</script> *c* | d & e"
PATH = "found.socp.json"


def on_terminal(problem: Problem, solution: Solution) -> str:
    file = io.StringIO()
    console(file, 1000).print(report(problem, solution, PATH))
    return file.getvalue()


def in_notebook(_: Problem, solution: Solution) -> str:
    text = re.sub(r"<svg.*</svg>", "", solution._repr_html_(), flags=re.DOTALL)
    return html.unescape(re.sub(r"<[^>]*>", " ", text.replace("</span>", "")))


def in_recording(problem: Problem, solution: Solution) -> str:
    return re.sub(r"\\([\\`*_\[\]<>|&~$#])", r"\1", summary(problem, solution))


RENDERED = (on_terminal, in_notebook, in_recording)


@pytest.fixture(scope="module")
def problem(registry: Registry) -> Problem:
    return registry.problem("jacobson_1")


@pytest.fixture(scope="module")
def rough(problem: Problem, registry: Registry) -> Solution:
    """Return a solution on a grid too rough for its objective to be reached: not feasible."""
    return run(registry.method("euler-ipopt")(steps=20), problem, default_guess(problem))


@pytest.fixture(scope="module")
def exact(problem: Problem, registry: Registry) -> Solution:
    assert problem.reference is not None
    method = registry.method("lgr-multiphase")(word=problem.reference.word)
    found = run(method, problem, default_guess(problem))
    return revised(found, agreement=Agreement(objective=1e-9, switches=1e-7))


def graded(error: float, curvature: float = 0.0) -> Grade:
    """Return a grade of an objective whose terms are of size 1."""
    return Grade(
        objective=0.3,
        error=error,
        gain=1e-4,
        dynamics=0.0,
        ends=0.0,
        path=0.0,
        size=1.0,
        curvature=curvature,
    )


def near(solution: Solution) -> Solution:
    return revised(solution, verdict=Verdict(miss=1e-4, grade=graded(2.34e-4)))


def kept(solution: Solution) -> Solution:
    return solution


def ringing(solution: Solution) -> Solution:
    arcs = tuple(("+-"[k % 2], k / 20, (k + 1) / 20) for k in range(20))
    return revised(solution, structure={"u": arcs}, parameters={"mass": 1 / 3})


def overclaimed(solution: Solution) -> Solution:
    """Return a solution that claims more than its control reaches, within what is feasible."""
    (found, *others) = solution.verified
    return revised(solution, verified=(replace(found, gap=1e-3), *others))


def stopped(solution: Solution) -> Solution:
    return replace(solution, stop=Stop.LIMIT, message="a message of the solver")


@pytest.mark.parametrize("changed", [kept, near, ringing, overclaimed, stopped])
@pytest.mark.parametrize("which", ["rough", "exact"])
def test_the_three_renderers_tell_the_same_facts(
    which: str,
    changed: Callable[[Solution], Solution],
    problem: Problem,
    request: pytest.FixtureRequest,
) -> None:
    solution = changed(request.getfixturevalue(which))
    rows = solution_rows(problem, solution)
    labels = {row.label for row in rows}
    assert {"method", "outcome", "objective", "word", "verdict", "feasibility"} <= labels
    assert ("digits" in labels) == (which == "exact")
    for render in RENDERED:
        shown = re.sub(r"\s+", " ", render(problem, solution))
        for row in rows:
            assert row.label in shown
            for text in row.texts:
                assert re.sub(r"\s+", " ", text.strip()) in shown, (render, row.label)


@pytest.mark.parametrize(
    ("grade", "told"),
    [
        (
            graded(2.34e-4),
            (
                "approximately extremal: objective within 2.3e-04 of the nearby extremal's "
                "(allowed 1.0e-03)"
            ),
        ),
        (
            graded(0.2),
            (
                "not approximately extremal: objective up to 2.0e-01 off the nearby extremal's "
                "(allowed 1.0e-03)"
            ),
        ),
        (
            graded(2.34e-4, curvature=-0.5),
            (
                "not approximately extremal: objective up to 2.3e-04 off the nearby extremal's "
                "(allowed 1.0e-03), Legendre-Clebsch condition -5.0e-01"
            ),
        ),
    ],
)
def test_a_verdict_tells_its_grade(grade: Grade, told: str) -> None:
    verdict = Verdict(miss=1e-4, grade=grade)
    assert told in verdict_rows(verdict)[0].texts
    near_one = "approximately extremal, objective within 2e-04 of the nearby extremal's"
    assert (judgement(verdict) == near_one) == verdict.approximate
    stated = stated_error(verdict)
    assert stated == 2.34e-4 if verdict.approximate else math.isnan(stated)


def test_a_grade_that_would_do_tells_what_else_does_not() -> None:
    verdict = Verdict(miss=1e-4, drift=5.2e-2, grade=graded(2.34e-4))
    assert not verdict.approximate
    told = verdict_rows(verdict)[0].texts
    assert any(
        each.endswith("(allowed 1.0e-03), states off by 5.2e-02 (allowed 1e-02)") for each in told
    )


def test_an_infeasible_point_has_no_objective_no_word_and_no_reference(
    problem: Problem, rough: Solution
) -> None:
    told = {row.label: row.texts for row in solution_rows(problem, rough)}
    own, reached = told["objective"]
    assert own == f"none: the point is infeasible (its value {rough.objective:.12g})"
    assert reached == f"{rough.reached:.12g} reached by the control, re-integrated"
    assert told["word"] == ["none: the point is infeasible"]
    assert not {"switches", "reference"} & set(told)
    assert told["outcome"] == [Outcome.MISSED.value]
    assert facts(problem, rough)["objective"] is None


def test_what_is_reached_is_told_before_what_is_claimed(problem: Problem, exact: Solution) -> None:
    told = {row.label: row.texts for row in solution_rows(problem, overclaimed(exact))}
    assert [line.split(" ", 1)[1] for line in told["objective"]] == [
        "reached by the control, re-integrated",
        "claimed by the method",
    ]


def test_the_path_stands_where_there_is_a_result(problem: Problem, exact: Solution) -> None:
    assert solution_rows(problem, exact, path=PATH)[-1].texts == [PATH]
    assert "result" not in {row.label for row in solution_rows(problem, exact)}


@pytest.mark.parametrize(
    ("change", "came_to", "exit_code", "strict"),
    [
        ({}, Outcome.EXTREMAL, Exit.SOLVED, Exit.SOLVED),
        ({"verdict": Verdict(miss=1e-4)}, Outcome.FEASIBLE, Exit.SOLVED, Exit.UNSOLVED),
        (
            {"verdict": Verdict(miss=1e-4, grade=graded(9e-4))},
            Outcome.APPROXIMATE,
            Exit.SOLVED,
            Exit.UNSOLVED,
        ),
        (
            {"verdict": Verdict(miss=1e-4, drift=0.02, grade=graded(9e-4))},
            Outcome.FEASIBLE,
            Exit.SOLVED,
            Exit.UNSOLVED,
        ),
        (
            {"verdict": Verdict(miss=1e-4, grade=graded(2e-3))},
            Outcome.FEASIBLE,
            Exit.SOLVED,
            Exit.UNSOLVED,
        ),
        (
            {"verdict": Verdict(miss=1e-4, grade=graded(9e-4, curvature=-0.5))},
            Outcome.FEASIBLE,
            Exit.SOLVED,
            Exit.UNSOLVED,
        ),
        (
            {"verdict": Verdict(miss=1e-4, grade=graded(9e-4)), "stop": Stop.LIMIT},
            Outcome.LIMIT,
            Exit.UNSOLVED,
            Exit.UNSOLVED,
        ),
        ({"verdict": Verdict(miss=0.5)}, Outcome.MISSED, Exit.UNSOLVED, Exit.UNSOLVED),
        (
            {"verdict": Verdict(miss=0.5), "stop": Stop.LIMIT},
            Outcome.LIMIT,
            Exit.UNSOLVED,
            Exit.UNSOLVED,
        ),
        (
            {"verdict": Verdict(miss=0.5), "stop": Stop.INFEASIBLE},
            Outcome.INFEASIBLE,
            Exit.UNSOLVED,
            Exit.UNSOLVED,
        ),
        (
            {"verdict": Verdict(miss=0.5), "stop": Stop.FAILED},
            Outcome.FAILED,
            Exit.UNSOLVED,
            Exit.UNSOLVED,
        ),
        ({"stop": Stop.INTERRUPTED}, Outcome.INTERRUPTED, Exit.INTERRUPTED, Exit.INTERRUPTED),
    ],
)
def test_outcomes_and_their_exit_codes(
    exact: Solution, change: dict[str, object], came_to: Outcome, exit_code: Exit, strict: Exit
) -> None:
    solution = revised(exact, **change)
    assert outcome_of(solution) is outcome(solution) is came_to
    assert (code(solution), code(solution, strict=True)) == (exit_code, strict)


def test_a_solution_that_nobody_judged_is_interrupted_for_a_command_alone(
    problem: Problem, exact: Solution
) -> None:
    bare = revised(exact, verdict=None, verified=())
    assert outcome_of(bare) is None
    assert Outcome.INTERRUPTED.value in on_terminal(problem, bare)
    for render in (in_notebook, in_recording):
        assert "not judged" in render(problem, bare)
        assert "interrupted" not in render(problem, bare)


def test_a_solution_without_its_problem_is_shown_all_the_same(
    problem: Problem, exact: Solution, rough: Solution
) -> None:
    for statement in (None, {"format": "of another time"}):
        text = in_notebook(problem, revised(exact, statement=statement))
        assert f"{exact.objective:.12g}" in text
        assert "reference" not in text
    told = {row.label: row.texts for row in solution_rows(None, rough)}
    assert told["final time"] == ["none: the point is infeasible (its value 5)"]


def test_no_text_steers_a_renderer(problem: Problem, exact: Solution) -> None:
    assert exact.verdict is not None
    solution = revised(
        exact,
        message=STEERING,
        structure={STEERING: (("+", 0.0, 1.0),)},
        parameters={STEERING: 1.0},
        verdict=replace(exact.verdict, notes=(STEERING,), ringing={STEERING: 9.0}),
    )
    shown = on_terminal(problem, solution)
    assert (
        shown.count(STEERING.replace("\x1b", r"\x1b").replace("\x07", "")) == 6
    )  # rich drops bells
    page = solution._repr_html_()
    assert "&lt;script&gt;b&lt;/script&gt;" in page
    assert "<script" not in page
    text = summary(problem, solution)
    assert r"\*c\* \| d \& e" in text
    assert not re.search(r"(?<!\\)<script", text)
    for each in (shown, page, text):
        assert not re.search("[\x07\x1b]", each)


@pytest.mark.parametrize(
    ("verdict", "said"),
    [
        (Verdict(miss=0.5), ["not feasible: re-integration off by 5.0e-01 (allowed 1e-02)"]),
        (Verdict(miss=1e-9), ["feasible: re-integration off by 1.0e-09 (allowed 1e-02)"]),
    ],
)
def test_a_verdict_says_how_far_off(verdict: Verdict, said: list[str]) -> None:
    assert verdict_rows(verdict)[0].texts[: len(said)] == said


# -- units


@pytest.mark.parametrize("given", [now, end])
def test_a_unit_is_found_by_name(given: object, problem: Problem) -> None:
    (first, *_) = problem.dynamics
    posed = replace(problem, units={first: "m", given: "s"})
    assert posed.unit(first.name()) == "m"
    assert posed.labelled(first.name()) == f"{first.name()} (m)"
    assert {posed.unit(name) for name in ("time", "t", "tf")} == {"s"}
    assert (posed.unit("u"), posed.labelled("u")) == ("", "u")


def test_a_report_says_from_how_many_starts_it_is_the_best(
    problem: Problem, exact: Solution
) -> None:
    coarse = tuple(Met(objective=0.25 * k, starts=7 - k) for k in range(1, 6))
    other = Met(objective=0.5, word="u: + s")
    several = Starts(tried=21, coarse=coarse, extremals=(other,))
    for render in RENDERED:
        told = " ".join(render(problem, revised(exact, starts=several)).split())
        assert "best of 21 starts; 20 of them ended in 5 local solutions" in told
        assert "0.25 (6), 0.5 (5), 0.75 (4), 1 (3) and 1 more" in told
        assert "another extremal was certified at 0.5: u: + s" in told
    single = Starts(tried=1, coarse=(Met(objective=0.375),))
    (row,) = (
        r for r in solution_rows(problem, revised(exact, starts=single)) if r.label == "starts"
    )
    assert row.texts == [
        "best of 1 start; it ended in a local solution, on a coarse grid at 0.375 (1)",
        "no other extremal was certified",
    ]
    none = revised(exact, starts=Starts(tried=3))
    (row,) = (r for r in solution_rows(problem, none) if r.label == "starts")
    assert row.texts[0] == "none of 3 ended in a local solution of the coarse grid"
    assert not any(row.label == "starts" for row in solution_rows(problem, exact))
    assert from_json(to_json(revised(exact, starts=several))).starts == several


def test_what_is_no_extremal_is_not_called_the_best_of_its_starts(
    problem: Problem, rough: Solution
) -> None:
    assert not rough.extremal
    starts = Starts(tried=3, coarse=(Met(objective=0.25, starts=2), Met(objective=0.5)))
    (row,) = (
        r for r in solution_rows(problem, revised(rough, starts=starts)) if r.label == "starts"
    )
    assert row.texts == [
        "3 starts; all ended in 2 local solutions, on a coarse grid at 0.25 (2), 0.5 (1)",
        "no extremal was certified",
    ]


def test_the_highest_rungs_are_among_the_first_lines(problem: Problem, exact: Solution) -> None:
    proofs = (
        Proof(rung=Rung.EXISTS, margin=3e-17, statement="in balls"),
        Proof(rung=Rung.GLOBAL, margin=0.023, statement="by a subsolution"),
    )
    starts = Starts(tried=4, coarse=(Met(objective=0.375, starts=4),))
    found = revised(exact, starts=starts, proofs=proofs)
    assert [row.label for row in solution_rows(problem, found)][1:3] == ["outcome", "rung"]
    top = (
        "extremal",
        "best of 4 starts",
        "an extremal exists beside it, proved",
        "within 2.3 % of",
    )
    for render in RENDERED:
        text = render(problem, found)
        assert all(said in text for said in top), text
    for render in (in_notebook, in_recording):  # these have the whole ladder
        assert "by a subsolution" in render(problem, found)
    again = from_json(to_json(found))
    assert (again.starts, again.proofs) == (starts, proofs)
    assert facts(problem, found)["verdict"]["ladder"][-1]["rung"] == "GLOBAL"
    assert facts(problem, found)["verdict"]["rung"] == "WORD"


def test_no_proof_outlives_a_judgement(problem: Problem, exact: Solution) -> None:
    proof = Proof(rung=Rung.EXISTS, margin=0.0, statement="")
    assert judge(problem, revised(exact, proofs=(proof,))).proofs == ()


@pytest.mark.parametrize(
    ("objective", "gap", "bar"),
    [
        (2.0, 0.25, f"1.5 |{'█' * 30}{' ' * 10}| 2"),
        (-5.0, 0.01, f"-5.05 |{'█' * 39}▌| -5"),
        (3.0, 0.0, f"3 |{'█' * 40}| 3"),
        (1.0, 2.5, f"-1.5 |{' ' * 40}| 1"),
    ],
)
def test_a_gap_is_a_bar(objective: float, gap: float, bar: str) -> None:
    """Of 40 characters the gap stays open: of 1 % four tenths of one, rounded up to an eighth."""
    assert gap_bar(objective, gap) == bar


def test_what_is_proved_stands_in_report_page_and_json(problem: Problem, exact: Solution) -> None:
    bound = Proof(rung=Rung.GLOBAL, margin=0.25, statement="no control is below")
    there = Proof(rung=Rung.EXISTS, margin=1e-9, statement="exactly one")
    solution = exact.with_judgement(proofs=(there, bound))
    rows = {row.label: row.texts for row in solution_rows(problem, solution)}
    assert rows["proved"] == ["exactly one", "no control is below", gap_bar(exact.objective, 0.25)]
    assert "an extremal exists beside it, proved" in rows["rung"][0]
    assert "within 25 % of the global optimum, proved" in rows["rung"][0]
    page = to_page(solution, problem)
    assert "exactly one" in page
    assert gap_bar(exact.objective, 0.25) in page
    held = {
        step["rung"] for step in facts(problem, solution)["verdict"]["ladder"] if step["proved"]
    }
    assert held == {"EXISTS", "GLOBAL"}

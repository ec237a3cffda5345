"""What is said after a solve that certified nothing: three lines, the last one a command."""

import json
import shlex
from pathlib import Path
from typing import Any

import pytest
from records import revised

from socp import Problem, Solution, controls, default_guess, run, states
from socp.cli import main
from socp.cli.commands.advising import advice
from socp.cli.commands.solving import solve
from socp.model.result.findings import Verdict
from socp.model.result.solution import Stop
from socp.registry import Registry, load_problem

x = states("x")
u = controls("u")
FILE = """
from socp import Problem, controls, states

x, v = states("x v")
u = controls("u")
problem = Problem(
    name="rest",
    running=x**2,
    dynamics={x: v, v: u},
    bounds={u: (-1, 1)},
    start={x: 1, v: 0},
    final_time=4,
)
"""
OPTIONS = {"steps": 100, "seconds": 60.0, "max_switches": 6}


@pytest.fixture(scope="module")
def rough(tmp_path_factory: pytest.TempPathFactory) -> Solution:
    path = tmp_path_factory.mktemp("rough") / "rest.py"
    path.write_text(FILE)
    registry = Registry.load()
    problem = load_problem(str(path), registry)
    return run(registry.method("euler-ipopt")(steps=40), problem, default_guess(problem))


def by_auto(solution: Solution, verdict: Verdict, seconds: float = 5.0) -> Solution:
    spent = {"search": seconds}
    return revised(solution, method="auto", options=OPTIONS, seconds=spent, verdict=verdict)


def test_a_command_says_what_why_and_what_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("my rest.py").write_text(FILE)
    call = ["solve", "my rest.py", "-m", "euler-ipopt", "-o", "steps=40", "--set", "final_time=5"]
    main([*call, "--quiet"])
    *_, what, why, following = capsys.readouterr().out.splitlines()
    assert what.startswith("what: ")
    assert why.startswith("why:  ")
    assert following.startswith("next: socp solve 'my rest.py' --set final_time=5")
    main([*call, "--quiet", "--json"])
    assert json.loads(capsys.readouterr().out)["advice"][2] == following


@pytest.mark.parametrize(
    ("verdict", "seconds", "following"),
    [
        (Verdict(miss=1e-9, chattering=("u",)), 5.0, "--max-switches 12"),
        (Verdict(miss=1e-9, chattering=("u",)), 58.0, "--seconds 240"),
        (Verdict(miss=1e-9), 58.0, "--seconds 240"),
        (Verdict(miss=0.5, miss_at="end condition x"), 5.0, "-o steps=400"),
        (Verdict(miss=1e-9), 5.0, "-m mboc -o switches="),
    ],
)
def test_what_was_found_decides_what_is_next(
    rough: Solution, verdict: Verdict, seconds: float, following: str
) -> None:
    told = advice(by_auto(rough, verdict, seconds), ["rest.py"], "rest.socp.json")
    assert len(told) == 3
    assert following in told[2]
    words = shlex.split(told[2].removeprefix("next: "))
    assert words[:3] == ["socp", "solve", "rest.py"]
    taken: dict[str, Any] = solve.make_context("solve", words[2:]).params  # it can be pasted
    assert taken["problem"] == "rest.py"


def test_a_grid_proves_no_chattering(rough: Solution) -> None:
    why = advice(by_auto(rough, Verdict(miss=1e-9, chattering=("u", "w"))), ["a.py"], "a.json")[1]
    assert why == "why:  u, w: chattering, as far as a grid shows it, which no finite word ends"


@pytest.mark.parametrize(
    ("switches", "seconds", "following"),
    [
        ("3", 5.0, "-m mboc -o switches=6"),
        ("0", 5.0, "-m mboc -o switches=2"),
        ("3", 58.0, "-m mboc -o switches=3 -o time=240"),
        ("auto", 5.0, "-m mboc -o time=240"),
    ],
)
def test_after_a_search_over_words_comes_a_wider_one_and_never_a_circle(
    rough: Solution, switches: str, seconds: float, following: str
) -> None:
    options = {"switches": switches, "time": 60.0}
    by_words = revised(by_auto(rough, Verdict(miss=1e-9), seconds), method="mboc", options=options)
    told = advice(by_words, ["rest.py"], "rest.socp.json")
    assert told[2] == f"next: socp solve rest.py {following}"
    assert solve.make_context("solve", [*shlex.split(following), "rest.py"])


@pytest.mark.parametrize(
    ("conditions", "following"),
    [
        ({"end": {"x": (0.0, 0.0)}}, "--set final_time=free"),
        ({"target": {"x": 0}}, "--set final_time=free"),
        ({}, "-o steps=400"),  # a longer horizon meets no more
        ({"end": {"x": (0.0, 0.0)}, "final_time": (1.0, 4.0)}, "-o steps=400"),
    ],
)
def test_an_end_that_cannot_be_reached_in_time_is_tried_at_a_free_time(
    rough: Solution, conditions: dict[str, Any], following: str
) -> None:
    assert rough.statement is not None
    stated = {**rough.statement, **conditions}
    lost = by_auto(rough, Verdict(miss=0.5, miss_at="x"))
    lost = revised(lost, stop=Stop.INFEASIBLE, statement=stated)
    told = advice(lost, ["rest.py", "--set", "k=2"], "rest.socp.json")
    assert told[2] == f"next: socp solve rest.py --set k=2 {following}"


def test_a_final_time_that_was_set_is_set_free_alone(rough: Solution) -> None:
    assert rough.statement is not None
    lost = by_auto(rough, Verdict(miss=0.5, miss_at="x"))
    stated = {**rough.statement, "end": {"x": (0.0, 0.0)}}
    lost = revised(lost, stop=Stop.INFEASIBLE, statement=stated)
    told = advice(lost, ["rest.py", "--set", "final_time=1", "--set", "k=2"], "rest.socp.json")
    assert told[2] == "next: socp solve rest.py --set k=2 --set final_time=free"


def test_an_answer_that_is_certified_needs_no_advice() -> None:
    problem = Problem(
        name="quick",
        minimise=-x,
        dynamics={x: u},
        bounds={u: (-1, 1)},
        start={x: 0},
        final_time=1,
    )
    made = run(Registry.load().method("lgr-multiphase")(word="+"), problem, default_guess(problem))
    assert made.extremal
    assert advice(made, ["quick.py"], "quick.socp.json") == ()

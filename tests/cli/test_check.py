"""`socp check`: the verdict of a saved result, worked out anew, as a person asks for it."""

import json
import re
from pathlib import Path

import pytest
from carts import FILE
from records import older

from socp.cli import main


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("cart.py").write_text(FILE)


def test_a_certified_result_is_exit_0(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["solve", "cart.py", "-m", "lgr-multiphase", "-o", "word=+ -"]) == 0
    assert "extremal: residual" in capsys.readouterr().out
    assert main(["check", "cart.socp.json", "--problem", "cart.py"]) == 0
    out = capsys.readouterr().out
    for text in (
        "feasible: ",
        "extremal: ",
        "switching function sign on u, stretch 1 (+)",
        "bang margins",
        "digits",
    ):
        assert text in out
    assert "not extremal" not in out


def test_what_is_not_certified_is_exit_1_with_its_reasons(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["solve", "cart.py", "-m", "euler-ipopt", "-o", "steps=20"]) == 0
    capsys.readouterr()
    assert main(["check", "cart.socp.json", "--problem", "cart.py"]) == 1
    assert "not extremal" in capsys.readouterr().out


def test_a_verdict_in_the_file_is_not_believed(capsys: pytest.CaptureFixture[str]) -> None:
    """A forged file: the states of a solved one, the switch moved, the verdict left in place."""
    main(["solve", "cart.py", "-m", "lgr-multiphase", "-o", "word=+ -", "-o", "intervals=1"])
    document = json.loads(Path("cart.socp.json").read_text())
    document["arcs"][0]["u"] = [[0.9 for _ in row] for row in document["arcs"][0]["u"]]
    Path("cart.socp.json").write_text(json.dumps(document))
    capsys.readouterr()
    assert main(["check", "cart.socp.json", "--problem", "cart.py"]) == 1
    assert "not extremal" in capsys.readouterr().out


def test_json(capsys: pytest.CaptureFixture[str]) -> None:
    main(["solve", "cart.py", "-m", "lgr-multiphase", "-o", "word=+ -"])
    capsys.readouterr()
    assert main(["check", "cart.socp.json", "--problem", "cart.py", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["extremal"] is True
    assert found["residual"] == max(each["residual"] for each in found["findings"])


@pytest.mark.parametrize(
    ("arguments", "code", "text"),
    [
        (["check", "none.json"], 1, "none.json: No such file"),
        (["check", "cart.py"], 1, "cart.py: this is a problem, and the command takes its result"),
        (
            ["check", "old.json"],
            3,
            "old.json: the result carries no statement of its problem 'cart', and no such",
        ),
        (["check", "cart.socp.json", "--problem", "auv"], 1, "cart.socp.json"),
        (["check", "cart.socp.json", "--problem", "none.py"], 3, "none.py: No such file"),
    ],
)
def test_refusals(
    arguments: list[str], code: int, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["solve", "cart.py", "-m", "euler-ipopt", "-o", "steps=10"])
    document = json.loads(Path("cart.socp.json").read_text())
    Path("old.json").write_text(json.dumps(older(document)))
    capsys.readouterr()
    assert main(arguments) == code
    err = capsys.readouterr().err
    assert text in err
    assert "Traceback" not in err


def test_a_certified_result_says_which_minimum_it_is(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["solve", "cart.py", "-m", "lgr-multiphase", "-o", "word=+ -"]) == 0
    assert "strict strong local minimum: no direction is free" in capsys.readouterr().out
    assert main(["check", "cart.socp.json", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["second_order"]
    assert found["kind"] == "STRONG"
    assert found["theorem"].startswith("Agrachev, Stefani, Zezza")
    assert found["word"]["free"] == 0


def test_derivatives_of_a_certified_result(capsys: pytest.CaptureFixture[str]) -> None:
    """Over a distance d the time is 2 sqrt d, the switch in its half: 1 and 1/2 by d at d = 1."""
    assert main(["solve", "cart.py", "-m", "lgr-multiphase", "-o", "word=+ -"]) == 0
    capsys.readouterr()
    assert main(["sensitivity", "cart.socp.json", "--to", "end.x", "--at", "0.5"]) == 0
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert float(next(row for row in rows if row[:1] == ["objective"])[-1]) == pytest.approx(1.0)
    assert float(next(row for row in rows if row[:1] == ["switch"])[-1]) == pytest.approx(0.5)
    assert main(["sensitivity", "cart.socp.json", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [each["to"] for each in found["derivatives"]] == [
        *("start.x", "start.v", "end.x", "end.v", "initial_time"),
        *("u.lower", "u.upper"),
    ]
    assert main(["sensitivity", "cart.socp.json", "--to", "mass"]) == 2
    assert "'mass' is no datum of the problem; there are start.x" in capsys.readouterr().err


def test_a_proof_of_a_saved_result(capsys: pytest.CaptureFixture[str]) -> None:
    """The cart takes 2 seconds and turns at 1; moved by a tenth, nothing is proved of it."""
    assert main(["solve", "cart.py", "-m", "lgr-multiphase", "-o", "word=+ -"]) == 0
    capsys.readouterr()
    assert main(["prove", "cart.socp.json"]) == 0
    told = capsys.readouterr().out
    assert "an extremal of Pontryagin's principle exists" in told
    assert "an extremal exists beside it, proved" in told
    assert main(["prove", "cart.socp.json", "--bits", "96", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["proved"]
    assert found["bits"] == 96
    (rung,) = (each for each in found["ladder"] if each["rung"] == "EXISTS")
    assert rung["holds"]
    assert 0 <= rung["figure"] < 1e-9  # what the solver left
    for (middle, radius), value in zip(found["times"], (1.0, 2.0), strict=True):
        assert abs(float(middle) - value) <= float(radius) < 1e-15
    text = Path("cart.socp.json").read_text(encoding="utf-8")
    document = json.loads(text)
    document["arcs"][0]["t"] = [1.1 * t for t in document["arcs"][0]["t"]]
    document["arcs"][1]["t"] = [0.1 + t for t in document["arcs"][1]["t"]]
    Path("moved.socp.json").write_text(json.dumps(document), encoding="utf-8")
    assert main(["prove", "moved.socp.json"]) == 1
    told = capsys.readouterr().out
    assert "comparison with the result" in told
    assert "exists beside it" not in told


@pytest.mark.slow
def test_a_rung_that_is_required_sets_the_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    along = ["solve", "cart.py", "-m", "lgr-multiphase", "-o", "word=+ -"]
    assert main([*along, "--require", "strong"]) == 0
    assert main(["check", "cart.socp.json", "--require", "strong"]) == 0
    told = capsys.readouterr().out
    assert re.search(r"yes strict strong local minimum: [\d.e+]+, above 1.0e\+00; Agrachev", told)
    assert main(["check", "cart.socp.json", "--require", "best"]) == 1  # there were no starts
    grid = ["solve", "cart.py", "-m", "trapezoidal", "-o", "steps=40", "--out", "grid.json"]
    assert main([*grid, "--require", "feasible"]) == 0
    assert main(["check", "grid.json", "--require", "extremal"]) == 1
    assert main(["check", "grid.json", "--require", "feasible"]) == 0
    capsys.readouterr()
    assert main(["check", "grid.json", "--require", "perfect"]) == 2
    assert "'perfect' is not one of 'feasible', 'approximate'" in capsys.readouterr().err

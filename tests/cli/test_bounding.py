"""`socp bound` and the check of its certificate, as commands."""

import json
from functools import partial
from pathlib import Path

import pytest

from socp.cli import main, proofs
from socp.model import load


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_a_bound_its_rung_and_its_certificate(capsys: pytest.CaptureFixture[str]) -> None:
    """The golden-rule fishery earns 5.18473166; no effort earns 1 % more."""
    assert main(["bound", "fishery_discounted", "--degree", "4", "-o", "found.json"]) == 0
    told = capsys.readouterr().out
    assert "no admissible control has a lower objective than -5.2" in told
    assert "of the global optimum, proved" in told
    assert main(["check", "found.json"]) == 0
    assert "no admissible control has a lower objective than -5.2" in capsys.readouterr().out
    assert main(["check", "found.json", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["proved"]
    assert -5.184731660678 * 1.01 < found["bound"] <= -5.184731660678
    assert main(["check", "found.json", "--problem", "jacobson_1"]) == 3
    capsys.readouterr()
    data = json.loads(Path("found.json").read_text(encoding="utf-8"))
    data["bound"] = "-5"
    Path("found.json").write_text(json.dumps(data), encoding="utf-8")
    assert main(["check", "found.json"]) == 1
    assert "not shown: the bound that is stated" in capsys.readouterr().out


def test_what_has_no_bound_says_why(capsys: pytest.CaptureFixture[str]) -> None:
    Path("bent.py").write_text(
        "from casadi import atan\n"
        "from socp import Problem, controls, states\n"
        "x, y = states('x y')\n"
        "u = controls('u')\n"
        "problem = Problem(name='bent', running=x**2, dynamics={x: atan(y), y: u},"
        " bounds={u: (-1, 1)}, start={x: 1, y: 0}, final_time=2)\n",
        encoding="utf-8",
    )
    assert main(["bound", "bent.py", "--degree", "2"]) == 1
    assert "no bound   'atan' has no polynomial rate here" in capsys.readouterr().out
    assert not Path("bent.bound.json").exists()


def rest() -> None:
    """Write a problem: from 1 straight to 0, then there, costs 1/3."""
    Path("rest.py").write_text(
        "from socp import Problem, controls, states\n"
        "x, u = states('x'), controls('u')\n"
        "problem = Problem(name='rest', running=x**2, dynamics={x: u}, bounds={u: (-1, 1)},"
        " start={x: 1}, final_time=2)\n",
        encoding="utf-8",
    )


def test_a_result_is_proved_where_it_is_solved(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file carries what is proved, and the certificate beside it is one."""
    rest()
    monkeypatch.setattr(proofs, "searched", partial(proofs.searched, degree=4))
    assert main(["solve", "rest.py", "--quiet", "--prove", "--bound", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["proofs"]["existence"]["proved"]
    assert found["proofs"]["existence"]["objective"][0].startswith("0.33333333333333333")
    assert 0.32 < found["proofs"]["bound"]["bound"] <= 1 / 3
    held = {step["rung"] for step in found["verdict"]["ladder"] if step["holds"]}
    assert held >= {"EXISTS", "WORD", "GLOBAL"}
    names = [each.rung.name for each in load("rest.socp.json").proofs]
    assert names == ["EXISTS", "WORD", "GLOBAL"]
    assert main(["check", "rest.bound.json"]) == 0


def test_a_result_is_taken_as_well_as_its_problem(capsys: pytest.CaptureFixture[str]) -> None:
    rest()
    assert main(["solve", "rest.py", "--quiet"]) == 0
    capsys.readouterr()
    assert main(["bound", "rest.socp.json", "--degree", "4", "--quiet", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert 0.32 < found["bound"] <= 1 / 3
    assert main(["bound", "rest.socp.json", "--set", "final_time=3"]) == 2
    assert "is a result" in capsys.readouterr().err

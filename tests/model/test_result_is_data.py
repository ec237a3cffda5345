"""What a result says of itself opens no file and runs no code; its problem is the one that it
carries.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from records import older

from socp import run
from socp.cli import main
from socp.methods.guess import default_guess
from socp.model.data import stated
from socp.model.data.files import load, save, to_json
from socp.model.problem import Problem
from socp.registry.plugins import Registry

ROOT = Path(__file__).parents[2]
EVIL_FILE = "quux_evil.py"  # no package has the word
EVIL = """import pathlib
pathlib.Path(__file__).with_name("ran").touch()
from socp import Problem, controls, final_time, states
x, v = states("x v")
u = controls("u")
problem = Problem(name="evil.py", minimise=final_time, dynamics={x: v, v: u}, bounds={u: (-1, 1)},
                  start={x: 0, v: 0}, end={x: 1, v: 0})
"""
CART = EVIL.replace('pathlib.Path(__file__).with_name("ran").touch()\n', "").replace(
    "evil.py", "cart"
)

# -- watched by Python itself

WATCHED = """
import json, os, sys
seen = []
def watch(event, arguments):
    if event == "open":
        seen.append(("open", os.fspath(arguments[0]) if not isinstance(arguments[0], int) else ""))
    elif event == "exec":
        seen.append(("exec", arguments[0].co_filename))
    elif event == "compile":
        seen.extend([("source", arguments[0] or ""), ("compile", str(arguments[1]))])
    elif event == "import":
        seen.append(("import", f"{arguments[0]} {arguments[1]}"))
    elif event in {
        "os.system", "os.exec", "os.posix_spawn", "subprocess.Popen", "os.listdir", "os.scandir",
    }:
        seen.append((event, str(arguments)))
sys.addaudithook(watch)
from socp.cli import main
codes = [main(each) for each in json.loads(sys.argv[1])]
text = lambda each: each.decode(errors="replace") if isinstance(each, bytes) else str(each)
found = [(event, text(what)) for event, what in seen]
json.dump({"codes": codes, "path": [each for each in sys.path if each], "seen": found}, sys.stderr)
"""


def claimed(document: dict[str, Any], text: str) -> None:
    """Put a text wherever a result may hold one that is a name or a remark."""
    document |= {"problem": text, "message": text, "word": text}
    document["origin"] |= {"method": text, "options": {text: text}, "versions": {text: text}}
    document["effort"] |= {"seconds": {text: 1.0}, "trace": {text: [1.0]}}
    document["judgement"]["verdict"] |= {"notes": [text], "chattering": [text]}
    document["judgement"]["verified"][0] |= {"miss_at": text, "error": text}
    document["effort"]["nodes"] = [
        {"word": text, "stop": text} | dict.fromkeys(("objective", "bound", "miss", "residual"))
    ]
    document["origin"]["statement"]["name"] = text
    document["origin"]["statement"]["about"] |= {
        "title": text,
        "source": text,
        "units": {"x": text},
    }


@pytest.fixture(scope="module")
def genuine(registry: Registry) -> str:
    """Return a certified result of the cart as text."""
    names: dict[str, Any] = {}
    exec(CART, names)  # noqa: S102 - the text stands above
    method = registry.method("lgr-multiphase")(word="+ -")
    return to_json(run(method, names["problem"], default_guess(names["problem"])))


@pytest.mark.slow
def test_no_other_file_is_opened_and_nothing_of_it_is_run(genuine: str, tmp_path: Path) -> None:
    here, there, cache = (tmp_path / name for name in ("here", "there", "cache"))
    for folder in (here, there, cache):
        folder.mkdir()
    for decoy in (
        here / EVIL_FILE,
        there / EVIL_FILE,
        here / "auv.py",
        here / "cart.py",
        here / "problem.py",
    ):
        decoy.write_text(EVIL)
    commands = []
    names = (
        EVIL_FILE,
        f"{there}/{EVIL_FILE}",
        f"{EVIL_FILE}:problem",
        "__import__('quux_evil')",
        f"file://{EVIL_FILE}",
    )
    for k, text in enumerate(names):
        document = json.loads(genuine)
        claimed(document, text)
        (here / f"r{k}.json").write_text(json.dumps(document))
        commands += [["check", f"r{k}.json"], ["check", f"r{k}.json", "--json"]]
        commands += [["export", f"r{k}.json", "--format", "csv", "-o", f"r{k}.csv"]]
        (here / f"old{k}.json").write_text(json.dumps(older(document)))
        commands += [["check", f"old{k}.json"]]
    commands += [["plot", "r0.json", "-o", "r0.svg"], ["plot", "old0.json", "-o", "old0.svg"]]
    environment = {**os.environ, "MPLCONFIGDIR": str(cache), "PYTHONDONTWRITEBYTECODE": "1"}
    done = subprocess.run(
        [sys.executable, "-c", WATCHED, json.dumps(commands)],
        cwd=here,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    told = json.loads(done.stderr[done.stderr.index('{"codes"') :])
    # a name with a slash is none, and its statement therefore no problem's
    codes = [code for name in names for code in ([1, 1, 1, 3] if "/" in name else [0, 0, 0, 3])]
    assert told["codes"] == [*codes, 0, 0], done.stderr[:2000]
    asked = {name for command in commands for name in command}
    roots = _roots(told["path"])
    looked = [event for event, _ in told["seen"]]
    assert {"open", "exec", "compile", "import"} <= set(looked)  # it was watched at all
    for event, what in told["seen"]:
        assert "quux_evil" not in what, (event, what)
        if event in {"exec", "compile", "import"}:
            assert str(tmp_path) not in what
            assert Path(what).name not in {"auv.py", "cart.py"} or str(ROOT) in what
        elif (
            event == "open" and what not in told["path"]
        ):  # an editable install puts a name there that is no folder
            path = Path(os.path.abspath(here / what)) if what else here / "r0.json"  # noqa: PTH100 - links stay
            if path.is_relative_to(here):
                written = path.name.startswith(".socp-") and path.suffix == ".part"  # and renamed
                assert path.name in asked or written
                assert path.suffix != ".py"
            else:
                assert path.is_relative_to(cache) or any(
                    path.is_relative_to(root) for root in roots
                ), what
    assert not list(tmp_path.rglob("ran"))


SYSTEM = ("/usr", "/lib", "/proc", "/sys", "/dev", "/etc")


def _roots(path: list[str]) -> list[Path]:
    """Return where Python, its packages and the system keep their own files."""
    own = [sys.prefix, sys.base_prefix, sys.exec_prefix, str(ROOT), *path]
    return [*(Path(each).resolve() for each in own), *map(Path, [*own, *SYSTEM])]


# -- whose problem it is


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, genuine: str) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("cart.socp.json").write_text(genuine)
    Path("cart.py").write_text(CART)
    return tmp_path


@pytest.mark.slow
def test_an_own_problem_needs_no_file_afterwards(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("cart.py").unlink()
    for command in (
        ["check"],
        ["plot"],
        ["export", "--format", "csv"],
        ["export", "--format", "mat"],
        ["record"],
    ):
        assert main([*command, "cart.socp.json"]) == 0
        assert capsys.readouterr().err == ""
    assert "sigma_u" in (folder / "cart.csv").read_text()
    assert {each.name for each in folder.iterdir()} == {
        "cart.socp.json",
        "cart.svg",
        "cart.csv",
        "cart.mat",
        "cart.rrd",
    }


@pytest.mark.slow
def test_a_changed_copy_of_a_registered_problem_is_judged_as_itself(
    registry: Registry,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    source = (ROOT / "problems" / "double_integrator_vlimit.py").read_text()
    problem = registry.problem("double_integrator_vlimit")
    start = next(line for line in source.splitlines() if "start=" in line)
    Path("mine.py").write_text(
        source.replace(start, start.replace("x: 0", "x: -1").replace("x: 0.0", "x: -1.0"))
    )
    assert (
        main(["solve", "mine.py", "-m", "lgr-multiphase", "-o", "word=+ b -", "--out", "mine.json"])
        == 0
    )
    capsys.readouterr()
    told = (
        f"warning: the result's own problem is used; the registered '{problem.name}' differs in: "
        "start.x\n"
    )
    for command in (["check"], ["plot"], ["export", "--format", "csv"], ["record"]):
        assert main([*command, "mine.json"]) == 0
        assert capsys.readouterr().err == told
    assert main(["check", "mine.json", "--problem", problem.name]) == 1
    said = capsys.readouterr()
    assert said.err == (
        f"warning: problem '{problem.name}' is used; that of the result differs in: start.x\n"
    )
    assert "not feasible" in said.out
    assert main(["check", "mine.json", "--problem", "mine.py"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.slow
def test_the_users_problem_wins_and_what_differs_is_said(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("wide.py").write_text(CART.replace("(-1, 1)", "(-2, 2)").replace("x: 1, v: 0", "x: 1"))
    assert main(["check", "cart.socp.json", "--problem", "wide.py"]) == 1
    said = capsys.readouterr()
    assert (
        said.err
        == "warning: problem 'wide.py' is used; that of the result differs in: bounds.u, end.v\n"
    )
    assert main(["check", "cart.socp.json", "--problem", "cart.py"]) == 0
    assert capsys.readouterr().err == ""
    Path("walled.py").write_text(CART.replace("end=", 'path={"wall": v <= 9}, end='))
    document = json.loads(Path("cart.socp.json").read_text())
    assert folder.is_dir()
    assert main(["check", "cart.socp.json", "--problem", "walled.py"]) == 0
    assert "differs in: path.wall" in capsys.readouterr().err
    assert document["origin"]["statement"]["path"] == {}


def test_what_follows_a_constraint_is_no_result_of_a_problem_without_it(
    folder: Path, registry: Registry, capsys: pytest.CaptureFixture[str]
) -> None:
    problem = registry.problem("double_integrator_vlimit")
    solution = run(registry.method("lgr-multiphase")(word="+ b -"), problem, default_guess(problem))
    save(solution, folder / "limit.json")
    assert main(["check", "limit.json", "--problem", "cart.py"]) == 1
    assert (
        "limit.json: arcs[0].multipliers: no state constraint 'v.upper'; there are none"
        in capsys.readouterr().err
    )


# -- results of before


@pytest.mark.slow
def test_an_old_result_is_of_the_registered_problem_of_its_name(
    folder: Path, registry: Registry, capsys: pytest.CaptureFixture[str]
) -> None:
    problem = registry.problem("jacobson_1")
    solution = run(
        registry.method("lgr-multiphase")(word="u: - s"), problem, default_guess(problem)
    )
    (folder / "old.json").write_text(json.dumps(older(json.loads(to_json(solution)))))
    assert main(["check", "old.json"]) == 0
    told = (
        "warning: old.json carries no statement of its problem: the registered 'jacobson_1' is "
        "used\n"
    )
    assert capsys.readouterr().err == told
    assert main(["check", "old.json", "--problem", "jacobson_1"]) == 0
    assert capsys.readouterr().err == ""
    assert main(["solve", "jacobson_1", "-m", "trapezoidal", "--guess", "old.json", "--quiet"]) == 0
    assert load("jacobson_1.socp.json").statement == problem.statement


@pytest.mark.parametrize("name", ["cart", "cart.py", "./cart.py", "cart.py:problem", "auv"])
def test_an_old_result_of_an_unregistered_problem_says_what_to_do(
    name: str, folder: Path, genuine: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also where the name is that of a file that is there, or of a registered problem with other
    states.
    """
    (folder / "old.json").write_text(json.dumps(older(json.loads(genuine) | {"problem": name})))
    assert main(["check", "old.json"]) == 3
    said = capsys.readouterr()
    assert f"carries no statement of its problem '{name}'" in said.err
    assert "give --problem FILE" in said.err
    assert main(["record", "old.json"]) == 3
    for command in (["plot"], ["export", "--format", "csv"]):
        assert main([*command, "old.json"]) == 0
        assert "give --problem FILE" in capsys.readouterr().err
    assert main(["check", "old.json", "--problem", "cart.py"]) == 0


def test_a_result_says_why_it_carries_no_statement(
    folder: Path, genuine: str, capsys: pytest.CaptureFixture[str]
) -> None:
    document = json.loads(genuine)
    why = "the operation 'call' cannot be written"
    document["origin"] |= {"statement": None, "unstated": why}
    (folder / "bare.json").write_text(json.dumps(document))
    assert main(["check", "bare.json"]) == 3
    assert "'cart' (the operation 'call' cannot be written), and no such problem is registered" in (
        capsys.readouterr().err
    )


# -- guesses


def test_a_guess_needs_no_problem_and_has_to_be_finite(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("copy.py").write_text(CART.replace("(-1, 1)", "(-1, 2)"))
    arguments = ["solve", "copy.py", "-m", "trapezoidal", "--quiet", "--guess"]
    assert main([*arguments, "cart.socp.json", "--out", "next.json"]) == 0
    document = json.loads((folder / "cart.socp.json").read_text())
    document["arcs"][0]["x"][0][2] = None
    (folder / "torn.json").write_text(json.dumps(document))
    capsys.readouterr()
    assert main([*arguments, "torn.json", "--out", "next.json"]) == 2
    assert "--guess torn.json: states or controls in it are not finite" in capsys.readouterr().err


def test_what_is_solved_carries_its_problem(folder: Path) -> None:
    assert main(["census", "cart.py", "--starts", "1", "--quiet", "--out", "census.json"]) == 0
    assert (
        main(["frontier", "cart.py", "--max-switches", "1", "--quiet", "--out", "frontier.json"])
        == 0
    )
    for name in ("census.json", "frontier.json", "cart.socp.json"):
        solution = load(folder / name)
        assert solution.statement is not None
        assert (
            stated.fingerprint(solution.statement)
            == Problem.from_statement(solution.statement).fingerprint
        )
        assert main(["check", name]) == 0

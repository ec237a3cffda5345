"""The command line: what it says, where it says it, and its exit codes."""

import contextlib
import json
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import casadi
import pytest
from carts import FILE, Command, Said
from conftest import PLUGIN, Install
from records import revised

from socp import controls, states
from socp.cli import main
from socp.cli.commands.comparing import Row, best_of
from socp.cli.options import build, options_by_method
from socp.errors import MethodError
from socp.methods.guess import default_guess
from socp.model.data.files import load, save
from socp.model.symbols import time
from socp.registry.plugins import Registry
from socp.view.statement import formula, number

AUV = str(Path(__file__).parents[2] / "problems" / "auv.py")
HEAVY = ("casadi", "pyomo", "cvxpy", "rerun", "matplotlib")


@pytest.fixture
def socp(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Command:
    """Run the command line in this process, in an empty directory with the file cart.py."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("SOCP_PLUGINS", raising=False)
    Path("cart.py").write_text(FILE)

    def run(*arguments: str) -> Said:
        code = main(arguments)
        return Said(code, *capsys.readouterr())

    return run


# -- solve


def test_solve_reports_on_stdout_and_writes_the_result(socp: Command) -> None:
    """From rest to rest over a unit of distance with |u| <= 1: tf = 2, one switch at 1 (implicit
    Euler: order 1).
    """
    said = socp("solve", "cart.py", "-m", "euler-ipopt", "-o", "steps=100")
    assert said.code == 0
    for label in "method objective final word switches stop feasibility iterations seconds".split():  # noqa: SIM905
        assert f"\n{label} " in said.out
    assert "euler-ipopt (steps=100, backend=ipopt)" in said.out
    assert "the solver met its tolerances" in said.out
    assert "reference" not in said.out
    assert not said.err
    saved = load("cart.socp.json")
    assert saved.objective == pytest.approx(2.0, rel=2e-2)
    assert saved.options["steps"] == 100
    assert f"{saved.objective:.12g}" in said.out
    assert f"u: {saved.switches[0]:.12g}" in said.out


@pytest.mark.slow
def test_solve_compares_with_the_reference(socp: Command) -> None:
    said = socp(
        "solve", "auv", "-m", "trapezoidal", "-o", "steps=200", "--json"
    )  # coarser ones miss the conditions
    found = json.loads(said.out)
    assert said.code == 0
    assert found["reference"]["error"] == found["objective"] - found["reference"]["objective"]
    assert found["result"] == "auv.socp.json"
    assert "objective +" in socp("solve", AUV, "-m", "trapezoidal", "-o", "steps=200").out


@pytest.mark.slow
def test_a_point_that_misses_its_conditions_is_no_answer(socp: Command) -> None:
    """Sixty steps of implicit Euler: the solver is content, but the control, re-integrated, ends
    one tenth away.
    """
    said = socp("solve", "auv", "-m", "euler-ipopt", "-o", "steps=60")
    assert said.code == 1
    for text in (
        "no answer: re-integrated, the control misses the problem's conditions",
        "word         none: the point is",
        "objective    none: the point is infeasible (its value 1",
    ):
        assert text in said.out
    assert "reference" not in said.out
    found = json.loads(socp("solve", "auv", "-m", "euler-ipopt", "-o", "steps=60", "--json").out)
    assert (found["outcome"], found["objective"], found["word"]) == ("MISSED", None, None)
    assert found["value"] > 1


@pytest.mark.slow
def test_strict_takes_an_extremal_alone(socp: Command) -> None:
    grid = ["solve", "cart.py", "-m", "euler-ipopt", "-o", "steps=40"]
    assert "an answer: a feasible point, not certified" in socp(*grid).out
    assert (socp(*grid).code, socp(*grid, "--strict").code) == (0, 1)
    exact = ["solve", "cart.py", "-m", "lgr-multiphase", "-o", "word=+ -", "--strict"]
    assert socp(*exact).code == 0
    assert "an answer: an extremal, certified" in socp(*exact).out


@pytest.mark.slow
def test_solve_takes_a_guess_an_output_and_a_name_in_a_file(socp: Command) -> None:
    Path("two.py").write_text(FILE.replace("problem = ", "other = "))
    assert (
        socp(
            "solve", "two.py:other", "-m", "euler-ipopt", "-o", "steps=20", "--out", "first.json"
        ).code
        == 0
    )
    said = socp(
        "solve",
        "two.py:other",
        "-m",
        "trapezoidal",
        "--guess",
        "first.json",
        "--out",
        "second.json",
        "--json",
    )
    assert (said.code, json.loads(said.out)["result"]) == (0, "second.json")
    assert load("second.json").method == "trapezoidal"


@pytest.mark.slow
def test_no_acceptable_solution_is_exit_1_and_still_written(socp: Command) -> None:
    said = socp("solve", "cart.py", "-m", "euler-ipopt", "-o", "ipopt.max_iter=1")
    assert said.code == 1
    assert "the solver reached its limit of iterations or time" in said.out
    assert load("cart.socp.json").options["ipopt.max_iter"] == 1


def test_progress_is_occasional_plain_and_on_stderr(
    socp: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("socp.cli.progress._OCCASIONAL", 0.0)
    loud = socp("solve", "cart.py", "-m", "euler-ipopt", "-o", "steps=10")
    assert loud.err.startswith("cart, euler-ipopt: iteration 0 ")
    assert "infeasibility" in loud.err
    assert "infeasibility" not in loud.out
    assert not socp("solve", "cart.py", "-m", "euler-ipopt", "-o", "steps=10", "--quiet").err


def test_progress_is_one_live_line_on_a_terminal(
    socp: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setattr("socp.cli.progress._LIVE", 0.0)
    said = socp("solve", "cart.py", "-m", "euler-ipopt", "-o", "steps=10")
    assert "cart, euler-ipopt: building" in said.err
    assert "\x1b[2K" in said.err  # the line is erased when it is done


def test_many_switching_times_are_counted(socp: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("socp.view.report.MANY", 0)
    assert "u: 1 switches" in socp("solve", "cart.py", "-m", "euler-ipopt", "-o", "steps=40").out


# -- refusals


FILES = {
    "raises.py": (
        "import math\n\nfoo = 1 / 0\n",
        "raises.py, line 3: ZeroDivisionError: division by zero\n  3 | foo = 1 / 0",
    ),
    "affine.py": (
        FILE.replace("v: u}", "v: u**2}"),
        "affine.py, line 5: problem 'cart': dynamics of 'v' is not affine",
    ),
    "none.py": ("a = 3\n", "none.py: defines no 'problem'; assign one: problem = Problem(...)"),
    "other.py": (
        FILE.replace("problem = ", "mine = "),
        "other.py: defines no 'problem' (it has mine); write other.py:mine",
    ),
    "int.py": ("problem = 3\n", "int.py: 'problem' is an int, not a Problem"),
    "syntax.py": (
        "x = 1\ndef (:\n",
        "syntax.py, line 2: SyntaxError: invalid syntax\n  2 | def (:",
    ),
    "exits.py": ("raise SystemExit(3)\n", "exits.py, line 1: the file calls exit(3)"),
    "latin.py": ("# \udce9\n", "latin.py: not a Python file: "),
    "result.json": (
        "{}",
        "result.json is no problem file; to start from a result, give --guess result.json",
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_a_bad_problem_file_is_one_message_with_its_line(socp: Command, name: str) -> None:
    source, message = FILES[name]
    Path(name).write_text(source, encoding="utf-8", errors="surrogateescape")
    said = socp("solve", name)
    assert said.code == 3
    assert said.err.startswith(f"error: {message}")
    assert "Traceback" not in said.err
    assert not said.out
    assert not Path("cart.socp.json").exists()
    debug = socp("--debug", "solve", name)
    assert "Traceback" in debug.err
    assert debug.code == 3


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        ("solve carts.py", 3, "carts.py: No such file or directory; did you mean 'cart.py'?"),
        ("solve no/such", 3, "no/such: No such file or directory"),
        ("solve .", 3, ". is a directory; give a problem file inside it"),
        ("solve avu", 3, "unknown problem 'avu'; did you mean 'auv'?"),
        ("solve cart.py:probelm", 3, "cart.py: defines no 'probelm'; did you mean 'problem'?"),
        ("solve cart.py -m euler", 2, "unknown method 'euler'; did you mean 'euler-ipopt'?"),
        (
            "solve cart.py -m euler-ipopt -o stpes=3",
            2,
            "euler-ipopt has no option 'stpes'; did you mean 'steps'?",
        ),
        (
            "solve cart.py -m euler-ipopt -o steps=abc",
            2,
            "euler-ipopt: steps='abc', but it should be a whole number",
        ),
        (
            "solve cart.py -m euler-ipopt -o steps=1.5",
            2,
            "euler-ipopt: steps='1.5', but it should be a whole number",
        ),
        (
            "solve cart.py -m euler-ipopt -o steps=0",
            2,
            "euler-ipopt: steps=0, but it must be at least 1",
        ),
        (
            "solve cart.py -m euler-ipopt -o steps",
            2,
            "-o steps: write KEY=VALUE, such as -o steps=400",
        ),
        (
            "solve cart.py -m euler-ipopt -o backend=3",
            2,
            "euler-ipopt: backend: no backend '3'; there are ipopt, uno",
        ),
        (
            "solve cart.py -m euler-ipopt -o ipopt.tolll=3",
            2,
            "ipopt has no option 'tolll'; did you mean 'tol'?",
        ),
        (
            "solve cart.py -m euler-ipopt -o ipop.tol=3",
            2,
            "euler-ipopt has no backend 'ipop'; did you mean 'ipopt'?",
        ),
        ("solve cart.py --out no/x.json", 2, "--out no/x.json: there is no directory no"),
        ("solve cart.py --out .", 2, "--out .: is a directory; name a file in it"),
        ("solve cart.py --guess no.json", 2, "--guess no.json: No such file or directory"),
        ("solve cart.py --guess cart.py", 2, "--guess cart.py: not a socp result"),
        ("solve cart.py -m lgr-multiphase -o 'word=+ ?'", 2, "word: '?' is no kind of arc"),
        ("solve", 2, "Missing argument 'FILE_OR_NAME'."),
        ("slove", 2, "No such command 'slove'; did you mean 'solve'?"),
        ("compare cart.py -m lgr -o steps=3", 2, "no method here has an option 'steps'"),
        (
            "describe eulr-ipopt",
            2,
            "no method or problem 'eulr-ipopt'; did you mean 'euler-ipopt'?",
        ),
        ("describe x.py", 3, "x.py: No such file or directory"),
        ("--no-plugin mbocc methods", 2, "--no-plugin mbocc: no such plugin; did you mean 'mboc'?"),
        (
            "--no-plugin mboc solve cart.py -m mboc",
            2,
            "method 'mboc': plugin 'mboc' is off: left out by",
        ),
    ],
)
def test_a_refusal_is_one_message(socp: Command, words: str, code: int, message: str) -> None:
    said = socp(*shlex.split(words))
    assert said.err.startswith(f"error: {message}")
    assert "Traceback" not in said.err
    assert said.code == code
    assert not said.out


def test_a_guess_must_fit_the_problem(socp: Command, registry: Registry) -> None:
    save(default_guess(registry.problem("auv")), "auv.json")
    said = socp("solve", "cart.py", "--guess", "auv.json")
    assert (
        said.err
        == "error: --guess auv.json: its states are x, y, phi, u, but those of problem 'cart' "
        "are x, v\n"
    )
    assert said.code == 2


def test_a_bug_is_one_line_and_a_hint(socp: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: Any) -> None:
        raise RuntimeError("impossible\nthing")

    monkeypatch.setattr("socp.cli.posing.load_problem", broken)
    said = socp("solve", "cart.py")
    hint = "this is a bug; see where with: socp --debug solve cart.py\n"
    assert said == (4, "", f"error: internal error: RuntimeError: impossible thing\n{hint}")
    assert "Traceback" in socp("--debug", "solve", "cart.py").err


# -- numbers set by name


def test_numbers_are_set_on_the_command_line(socp: Command) -> None:
    """From rest to rest with |a| <= 1: tf = 2 sqrt(distance); the report has what was set."""
    text = FILE.replace("import ", "import constants, ", 1).replace("x: 1", "x: far", 1)
    Path("far.py").write_text(text.replace("problem =", "far = constants(far=4)\nproblem =", 1))
    for asked, wanted in ((), 4.0), (("--set", "far=9"), 6.0), (("--set", "start.x=3"), 2.0):
        word = ("-m", "lgr-multiphase", "-o", "word=+ -")
        said = socp("solve", "far.py", *word, *asked, "--json")
        assert json.loads(said.out)["objective"] == pytest.approx(wanted)
        assert json.loads(said.out)["constants"] == {"far": 9.0 if "far=9" in asked else 4.0}
    assert "\nconstant      far = 9\n" in socp("describe", "far.py", "--set", "far=9").out


NOTHING = "problem 'cart': there is no"


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("star.x=1", f"--set: {NOTHING} 'star.x' to change; did you mean 'start.x'?"),
        ("start.x=a", "--set start.x=a: give a number, LOWER,UPPER or free"),
        ("start.x=1,2,3", "--set start.x=1,2,3: give a number, LOWER,UPPER or free"),
        ("start.x", "--set start.x: write KEY=VALUE, such as --set start.x=30"),
        ("bounds.u=1,-1", "--set: problem 'cart': bounds of 'u': lower 1.0 > upper -1.0"),
    ],
)
@pytest.mark.parametrize("command", ["solve", "census", "describe"])
def test_what_cannot_be_set_is_a_matter_of_usage(
    socp: Command, command: str, change: str, said: str
) -> None:
    assert socp(command, "cart.py", "--set", change) == (2, "", f"error: {said}\n")


def test_a_method_has_no_numbers_to_set(socp: Command) -> None:
    assert socp("describe", "auto", "--set", "steps=4").code == 2


def test_a_result_is_the_guess_of_its_neighbour(socp: Command) -> None:
    assert socp("solve", "cart.py", "--out", "first.json").code == 0
    said = socp("solve", "cart.py", "--set", "end.x=1.2", "--guess", "first.json")
    assert said.code == 0
    assert "Newton on the conditions of the guess's word" in said.out


def test_results_of_other_numbers_are_other_files_and_are_told_apart(socp: Command) -> None:
    method = ("-m", "lgr-multiphase", "-o", "word=r: + s s s +; f: + + b[u.upper] - -")
    lengths = ("-o", "lengths=0.05 0.6 14 0.1 0.2", "--quiet")
    said = socp("solve", "auv", *method, *lengths)
    assert said.out.split()[-1] == "auv.socp.json"
    more = socp("solve", "auv", "--set", "current=0.9", "--set", "start.x=41", *method, *lengths)
    name = "auv.current_0.9.start.x_41"
    assert f"{name}.socp.json" in more.out
    assert Path("auv.socp.json").is_file()
    drawn = socp("plot", "auv.socp.json", f"{name}.socp.json", "-o", "both.svg")
    told = f"{name} is of other numbers: current = 0.9 in place of 0.8, start.x\n"
    assert (drawn.code, told in drawn.err) == (0, True)


# -- plugins


def test_a_broken_plugin_is_shown_and_stops_nothing(socp: Command, install: Install) -> None:
    install("broken", "1 / 0\n", plugin="broken")
    listed = socp("plugins", "list", "--json")
    assert listed.code == 0
    row = next(row for row in json.loads(listed.out) if row["name"] == "broken")
    assert (row["status"], row["reason"]) == (
        "failed",
        "ZeroDivisionError: division by zero (broken.py, line 1)",
    )
    assert "failed" in socp("plugins").out
    solved = socp("solve", "cart.py", "-m", "euler-ipopt", "-o", "steps=10")
    assert solved.code == 0
    assert solved.err.startswith("warning: broken of broken 1.0 is left out: ZeroDivisionError")
    assert socp("solve", "cart.py", "-m", "broken").code == 3
    assert not socp(
        "--no-plugin", "broken", "solve", "cart.py", "-m", "euler-ipopt", "-o", "steps=10"
    ).err


def test_a_listener_that_raises_is_a_warning(socp: Command, install: Install) -> None:
    hook = (
        "from socp import hookimpl\n@hookimpl\ndef socp_solved(problem, solution):\n    raise "
        "OSError('disk full')\n"
    )
    install("recorder", hook, plugin="recorder")
    said = socp("solve", "cart.py", "-m", "euler-ipopt", "-o", "steps=10")
    assert said.code == 0
    fault = "OSError: disk full (recorder.py, line 4)"
    assert said.err == f"warning: plugin 'recorder' (recorder 1.0): socp_solved: {fault}\n"


def test_options_take_the_types_of_their_fields(install: Install) -> None:
    install("mine", PLUGIN.format(name="mine"), plugin="mine")
    method = Registry.load().methods["mine"]
    own = [("steps", "1e3"), ("bold", "yes"), ("rate", "1e-2"), ("note", "3")]
    inner = [("ipopt.tol", "1e-7"), ("ipopt.max_iter", "9"), ("ipopt.mu_strategy", "adaptive")]
    built: Any = build(method, own + inner)
    assert (built.steps, built.bold, built.rate, built.note) == (1000, True, 0.01, "3")
    assert built.backend.options == {"tol": 1e-7, "max_iter": 9, "mu_strategy": "adaptive"}
    for key, text, wanted in (("bold", "maybe", "true or false"), ("rate", "fast", "a number")):
        with pytest.raises(MethodError, match=f"mine: {key}='{text}', but it should be {wanted}"):
            build(method, [(key, text)])


# -- lists and descriptions


def test_lists(socp: Command, registry: Registry) -> None:
    assert [row["name"] for row in json.loads(socp("list", "--json").out)] == list(
        registry.problems
    )
    assert {row["name"] for row in json.loads(socp("methods", "--json").out)} == set(
        registry.methods
    )
    for command in ("list", "methods", "plugins"):
        said = socp(command)
        assert (said.code, said.err) == (0, "")
        assert all(line == line.rstrip() for line in said.out.splitlines())


def test_describe_a_method(socp: Command) -> None:
    said = socp("describe", "euler-ipopt")
    assert said.code == 0
    assert "source: doi:10.3934/dcdsb.2019092" in said.out
    assert "steps     int       1000      steps of equal length; at least 1" in said.out
    assert "ipopt.NAME=VALUE sets any of its own options" in said.out


@pytest.mark.slow
def test_describe_a_problem_in_its_own_symbols(socp: Command) -> None:
    said = socp("describe", "auv")
    for text in (
        "x' = u*cos(phi) + 0.8*tanh(y)",
        "u' = f - u*fabs(u)",
        "-pi <= r <= pi",
        "0 <= u <= 2",
        "disc: x**2 + y**2 <= 0.05",
        "x = 40, y = -2, phi = pi, u = 0",
        "t0 = 0, tf free",
        "objective 14.950161782153",
    ):
        assert text in said.out


def test_formulas_are_python_and_mean_the_expression() -> None:
    """What is printed, read back as Python, is the expression again: at random points to
    rounding.
    """
    a, b = states("a b")
    u = controls("u")
    cases = [
        a - (b - u),
        a - b + u,
        a / (b / u),
        a * b / u,
        (a + b) * u,
        -(a + b),
        -a * b,
        (-a) ** 2,
        a**b**u,
        (a**b) ** u,
        a + a,
        1 / (a * b),
        casadi.sqrt(a) * casadi.exp(-b),
        (a + b) ** 2,
        a ** (-1),
        2**a,
        -3 * a,
        a * -3,
        a - (-3),
        casadi.fmax(a, b - u),
        casadi.atan2(a, b),
        (a - b) / 3,
        casadi.fabs(-a),
        casadi.pi * a,
        a / casadi.pi,
        2 * a * time,
    ]
    calls = {name: getattr(casadi, name) for name in ("sqrt", "exp", "fmax", "atan2", "fabs", "pi")}
    names = {"a": a, "b": b, "u": u, "t": time, **calls}
    for case in cases:
        again = eval(formula(case), names)  # noqa: S307
        pair = casadi.Function("pair", [a, b, u, time], [case, again])
        left, right = pair(0.7, 1.3, 1.9, 0.4)
        assert float(left) == pytest.approx(float(right), rel=1e-11), formula(case)
    named = {
        casadi.pi: "pi",
        -casadi.pi / 2: "-pi/2",
        2 * casadi.pi / 3: "2*pi/3",
        0.0: "0",
        3.0: "3",
    }
    assert {value: number(value) for value in named} == named


# -- compare


def test_compare_keeps_results_and_has_rows_for_kept_ones(socp: Command) -> None:
    first = ("compare", "cart.py", "-m", "euler-ipopt", "-o", "steps=30", "--keep", "kept")
    assert socp(*first).code == 0
    kept = "kept/cart.euler-ipopt.socp.json"
    found = load(kept)
    second = ("compare", "cart.py", "-m", "trapezoidal", "-o", "steps=40", "--with", kept)
    said = socp(*second, "--json")
    assert said.code == 0
    new, old = json.loads(said.out)["rows"]
    assert (new["row"], old["row"]) == ("trapezoidal", "cart.euler-ipopt")
    assert (old["method"], old["objective"]) == ("euler-ipopt", found.told)
    assert old["to_best"] == old["objective"] - json.loads(said.out)["best"]
    refused = socp("compare", "auv", "-m", "euler-ipopt", "--with", kept)
    assert refused.code == 1
    assert "its states are" in refused.err
    assert "compare" not in refused.out
    Path("taken").write_text("")
    in_vain = socp("compare", "cart.py", "-m", "euler-ipopt", "--keep", "taken")
    assert in_vain.code == 2
    assert in_vain.err.startswith("error: --keep taken: ")


def test_compare_prints_one_table(socp: Command) -> None:
    options = ["-o", "steps=30", "-o", "trapezoidal.steps=40", "-o", "ipopt.tol=1e-8"]
    said = socp("compare", "cart.py", "-m", "euler-ipopt", "-m", "trapezoidal", *options, "--json")
    assert said.code == 0
    euler, trapezoidal = json.loads(said.out)["rows"]
    assert (euler["options"]["steps"], trapezoidal["options"]["steps"]) == (30, 40)
    assert euler["options"]["ipopt.tol"] == trapezoidal["options"]["ipopt.tol"] == 1e-8
    assert euler["to_best"] == euler["objective"] - json.loads(said.out)["best"]
    table = socp(
        "compare", "auv", "-m", "euler-ipopt", "-m", "lgr", "-o", "steps=30", "-o", "intervals=5"
    ).out
    heads = (
        "N",
        "objective",
        "to best",
        "to reference",
        "switching times",
        "TV(r)",
        "TV(f)",
        "feasibility",
        "seconds",
    )
    assert all(head in table for head in heads)
    assert table.index("euler-ipopt") < table.index("lgr")


def test_what_was_set_is_told(socp: Command) -> None:
    method = ("-m", "euler-ipopt", "-o", "steps=20")
    changed = ("--set", "start.x=2", "--set", "final_time=3")
    told = socp("compare", "double_integrator_time", *method, *changed[:2])
    assert told.out.splitlines()[0] == "set  start.x=2"
    said = json.loads(socp("compare", "double_integrator_time", *method, *changed, "--json").out)
    assert said["set"] == {"start.x": "2", "final_time": "3"}


def test_follow_writes_a_table_that_plot_draws(socp: Command) -> None:
    far = ("--set", "end.x=1:1.1", "--steps", "1", "--quiet", "--json")
    said = socp("follow", "double_integrator_time", *far, "--out", "d.parquet")
    assert said.code == 0
    rows = json.loads(said.out)["rows"]
    assert [row["value"] for row in rows] == [1.0, 1.1]
    assert socp("plot", "d.parquet").out == "d.svg\n"
    assert Path("d.svg").read_text().startswith("<?xml")


def test_sweep_writes_a_table_that_plot_draws_and_goes_on_from(socp: Command) -> None:
    Path("more.csv").write_text("end.x\n1\n1.1\n")
    held = ("--set", "bounds.u.upper=1", "--quiet", "--json")
    how = ("--seconds", "30", "-o", "s.parquet")
    asked = ("double_integrator_time", "--from", "more.csv", *held, *how)
    said = socp("sweep", *asked, "--keep", "whole")
    assert said.code == 0
    found = json.loads(said.out)
    assert [row["end.x"] for row in found["rows"]] == [1.0, 1.1]
    assert found["certified"] == 2
    assert [row["start"] for row in found["rows"]] == [-1, 0]
    assert load(Path("whole/point-000000.socp.json")).options["seconds"] == 30
    assert socp("plot", "s.parquet").out == "s.svg\n"
    assert socp("check", "whole/point-000001.socp.json").code == 0
    again = json.loads(socp("sweep", *asked, "--keep", "whole").out)
    assert again["rows"] == found["rows"]


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--set", "start.x=2"), "a sweep needs a number with several values"),
        (("--set", "start.x=2:3"), "start.x=2:3: give lo:hi:n, or a distribution"),
        (("--set", "start.x~normal(2,1)"), "start.x: say how many points are drawn"),
        (("--from", "none.csv"), "none.csv: it is no table of numbers"),
    ],
)
def test_what_cannot_be_swept_is_named(socp: Command, given: tuple[str, ...], said: str) -> None:
    found = socp("sweep", "double_integrator_time", *given)
    assert (found.code != 0, found.out) == (True, "")
    assert found.err.startswith(f"error: {said}")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ("start.x=2", "--set NAME=FROM:TO: 0 numbers have a range; give one, such as"),
        ("start.x=2:b", "--set start.x=2:b: give FROM:TO, two numbers"),
        ("start.x=2:3:4", "--set start.x=2:3:4: give FROM:TO, two numbers"),
    ],
)
def test_what_cannot_be_followed_is_named(socp: Command, change: str, said: str) -> None:
    found = socp("follow", "double_integrator_time", "--set", change)
    assert (found.code, found.out) == (2, "")
    assert found.err.startswith(f"error: {said}")


def test_a_number_is_set_once(socp: Command) -> None:
    said = socp("solve", "double_integrator_time", "--set", "start.x=2", "--set", "start.x=3")
    assert (said.code, said.err) == (2, "error: --set start.x is given twice\n")


@pytest.mark.slow
def test_a_registered_problem_of_other_constants_is_no_other_problem(socp: Command) -> None:
    method = ("-m", "euler-ipopt", "-o", "steps=20", "--quiet", "--out", "r.socp.json")
    socp("solve", "auv", *method, "--set", "current=1")
    assert "differs" not in socp("check", "r.socp.json").err
    socp("solve", "auv", *method, "--set", "start.x=30")
    assert "differs in: start.x" in socp("check", "r.socp.json").err


def test_compare_goes_on_where_one_method_cannot(socp: Command) -> None:
    said = socp(
        "compare",
        "cart.py",
        "-m",
        "lgr-multiphase",
        "-m",
        "euler-ipopt",
        "-o",
        "word=u: s",
        "-o",
        "steps=20",
    )
    assert said.code == 1
    assert "not solved" in said.out
    assert "warning: lgr-multiphase: " in said.err


@pytest.mark.slow
def test_a_narrow_terminal_gets_the_table_turned(
    socp: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("socp.cli.session._PIPED", 60)
    said = socp("compare", "cart.py", "-m", "euler-ipopt", "-m", "trapezoidal", "-o", "steps=20")
    assert any(line.split()[:1] == ["objective"] for line in said.out.splitlines())
    assert all(len(line) <= 60 for line in said.out.splitlines())


def test_the_best_is_the_lowest_of_the_feasible_or_else_the_most_feasible() -> None:
    from dataclasses import replace

    from socp.model.result.findings import Feasibility
    from socp.model.result.solution import Stop
    from socp.registry.standard import regulator

    guess = replace(default_guess(regulator().problem), stop=Stop.SOLVED)

    def row(objective: float, miss: float) -> Row:
        found = Feasibility(
            miss=miss, miss_at="x", path=0.0, path_at="", box=0.0, drift=0.0, feedback=False
        )
        return Row("m", revised(guess, objective=objective, verified=(found,)))

    assert best_of([row(1.0, 1e-3), row(3.0, 1e-9), row(2.0, 1e-8)]) == 2.0
    assert best_of([row(1.0, 1e-2), row(3.0, 1e-4)]) == 3.0
    assert best_of([Row("m", error="no")]) != best_of([Row("m", error="no")])


def test_shared_options_of_a_method_not_compared_are_refused(registry: Registry) -> None:
    with pytest.raises(MethodError, match=r"no method here has an option 'trapezoidal\.steps'"):
        options_by_method([registry.methods["euler-ipopt"]], ["trapezoidal.steps=3"])


# -- the process


def _python(code: str, *arguments: str, cwd: Path | None = None) -> subprocess.Popen[str]:
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=cwd
    )


@pytest.mark.parametrize(
    ("arguments", "allowed"),
    [
        ("--help", ()),
        ("--version", ()),
        ("list", ()),
        ("plugins list", ("casadi",)),
        ("methods", ("casadi",)),
    ],
)
def test_heavy_packages_stay_out(arguments: str, allowed: tuple[str, ...]) -> None:
    code = (
        "import sys; from socp.cli import main; c = main(sys.argv[1:]); "
        "print(c, *sys.modules, file=sys.stderr)"
    )
    _, err = _python(code, *arguments.split()).communicate(timeout=60)
    code_, *modules = err.split()
    assert code_ == "0"
    assert not set(modules) & (set(HEAVY) - set(allowed))


SLOW = """
import socp.cli.progress, sys
socp.cli.progress._OCCASIONAL = 0.0
from socp.cli import main
sys.exit(main(sys.argv[1:]))
"""


def test_ctrl_c_ends_the_solver_and_writes_its_last_iterate(tmp_path: Path) -> None:
    process = _python(
        SLOW,
        "solve",
        AUV,
        "-m",
        "euler-ipopt",
        "-o",
        "steps=3000",
        "-o",
        "ipopt.tol=1e-13",
        cwd=tmp_path,
    )
    assert process.stderr is not None
    for line in process.stderr:
        if "iteration 3 " in line:
            break
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert "the solve was interrupted; this is its last iterate" in out
    assert err.endswith("interrupted: the last iterate is in auv.socp.json\n")
    assert load(tmp_path / "auv.socp.json").effort.iterations < 20


@pytest.mark.parametrize("moment", ["socp.cli.app.socp.main", "socp.methods.run"])
def test_ctrl_c_elsewhere_is_130_without_a_traceback(
    socp: Command, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(moment, interrupted)
    said = socp("solve", "cart.py")
    assert (said.code, said.out, said.err.strip()) == (130, "", "interrupted; nothing was written")


def test_ctrl_c_that_breaks_an_import_off_is_no_bug(
    socp: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def half_imported(*_given: Any) -> None:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        raise NameError("name '_api' is not defined")

    monkeypatch.setattr("socp.methods.run", half_imported)
    said = socp("solve", "double_integrator_time")
    assert said.code == 130
    assert said.err.splitlines()[-1] == "interrupted; nothing was written"


def test_ctrl_c_while_judging_keeps_what_was_solved(
    socp: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("socp.methods.chain.judge", interrupted)
    said = socp("solve", "cart.py", "-m", "euler-ipopt", "-o", "steps=10")
    assert said.code == 130
    assert said.err == "interrupted before it was verified: the result is in cart.socp.json\n"
    assert load("cart.socp.json").stop.ok


def test_a_reader_that_leaves_early_is_no_error() -> None:
    process = _python("import sys; from socp.cli import main; sys.exit(main(['--help']))")
    assert process.stdout is not None
    process.stdout.close()
    assert process.wait(timeout=30) == 141
    assert process.stderr is not None
    assert "Traceback" not in process.stderr.read()
    process.stderr.close()


def test_help_states_the_exit_codes(socp: Command) -> None:
    said = socp("--help")
    assert said.code == 0
    table = said.out.partition("Exit codes:")[2].partition("Examples:")[0].splitlines()
    codes = [line.split()[0] for line in table if line[:4].strip() == "" and line[4:5].isdigit()]
    assert codes == ["0", "1", "2", "3", "4", "5", "130", "143"]
    assert socp("--version").out.startswith("socp ")
    assert socp().out == said.out


@pytest.mark.parametrize(
    ("words", "answer"),
    [
        ("socp sol", ["plain,solve"]),
        ("socp solve robot", ["plain,robot_arm", "file,robot"]),
        ("socp solve auv -m euler", ["plain,euler-ipopt"]),
        ("socp solve auv -o st", ["plain,steps=", "plain,starts="]),
        ("socp solve auv -m lgr-multiphase -o w", ["plain,word="]),
        ("socp plot au", ["file,au"]),
        ("socp sensitivity au", ["file,au"]),
    ],
)
def test_a_shell_completes_commands_problems_methods_options_and_files(
    words: str,
    answer: list[str],
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("_SOCP_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
    assert main([]) == 0
    assert capsys.readouterr().out.split() == answer

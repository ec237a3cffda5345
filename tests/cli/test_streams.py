"""Standard output belongs to the report, whatever else is printed, closed or full; no text steers a
terminal.
"""

import ctypes
import io
import json
import os
import re
import stat
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pytest
import scipy.optimize
from carts import FILE, Said
from hypothesis import given
from hypothesis import strategies as st
from records import revised

from socp import Ipopt, Problem, controls, final_time, states
from socp.cli import main
from socp.cli.consoles import console
from socp.cli.posing import named_after
from socp.cli.session import writable
from socp.cli.streams import Descriptor, parted
from socp.errors import MethodError, ProblemError, SolveError
from socp.model.data.files import load
from socp.model.result.findings import Condition, Node, Place
from socp.model.result.solution import Stop
from socp.process import ended_after, write_atomic
from socp.process.text import file_stem, markdown, markdown_code, one_line, printable
from socp.solvers.contract import NLP, NLPPoint
from socp.view.figures import style
from socp.view.recording.summary import comparison, search, summary

FULL = Path("/dev/full")
PRINTING = """import atexit, ctypes, os, sys, warnings
print("printed")
os.write(1, b"written\\n")
ctypes.CDLL(None).printf(b"by C\\n")
sys.stdout.buffer.write(b"bytes\\n")
os.system("echo by a child")
sys.__stdout__.write("past sys.stdout\\n")
"""
STEERING = (
    "T\x1b]0;pwn\x07 \x9b31m \u202eevil\u202c\r\n[bold]verdict[/bold] "
    "<script>alert(1)</script>\x7f\u2028"
)
RAW = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u2028-\u202e\u2066-\u2069]")
ROUGH = ("solve", "cart.py", "-m", "trapezoidal", "-o", "steps=20")
SOLVE = ("solve", "cart.py", "-m", "euler-ipopt", "-o", "steps=20")


Command = Callable[..., Said]


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Work in a folder inside an empty one, with the file cart.py."""
    folder = tmp_path / "inner"
    folder.mkdir()
    monkeypatch.chdir(folder)
    Path("cart.py").write_text(FILE)
    return folder


@pytest.fixture
def socp(capfd: pytest.CaptureFixture[str]) -> Command:
    """Run the command line in this process; what is said on the descriptors counts, not on Python's
    streams alone.
    """

    def run(*arguments: str) -> Said:
        code = main(arguments)
        sys.stdout.flush()
        ctypes.CDLL(None).fflush(None)
        return Said(code, *capfd.readouterr())

    return run


def apart_from_here(command: str, **environment: str) -> "subprocess.CompletedProcess[bytes]":
    """Run `socp` in a shell's line, where `socp` stands for it."""
    line = command.replace("socp", f"{sys.executable} -m socp.cli", 1)
    given = {**os.environ, **environment}
    return subprocess.run(
        ["/bin/bash", "-c", line], capture_output=True, check=False, env=given, timeout=120
    )


# -- the report and nothing else


@pytest.fixture
def loud(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Have every linear programme print to descriptor 1, as solvers do whatever their options say;
    returns the calls.
    """
    calls = list[str]()

    def printing(where: Any, name: str) -> None:
        plain = getattr(where, name)

        def solve(*given: Any, **named: Any) -> Any:
            calls.append(name)
            os.write(1, b"Running a solver\n")
            ctypes.CDLL(None).printf(b"Copyright\n")
            return plain(*given, **named)

        monkeypatch.setattr(where, name, solve)

    printing(casadi, "conic")
    printing(scipy.optimize, "milp")
    return calls


PRINTS = (
    "-o",
    "ipopt.print_level=5",
    "-o",
    "ipopt.print_user_options=yes",
    "-o",
    "ipopt.print_timing_statistics=yes",
)


@pytest.mark.parametrize(
    ("arguments", "runs"),
    [
        (("list",), False),
        (("methods",), False),
        (("plugins", "list"), False),
        (ROUGH, True),
        ((*ROUGH, *PRINTS, "--quiet"), True),
        (
            (
                "compare",
                "cart.py",
                "-m",
                "euler-ipopt",
                "-m",
                "trapezoidal",
                "-o",
                "steps=20",
                *PRINTS,
            ),
            True,
        ),
        (("census", "cart.py", "--starts", "1"), False),
        (("frontier", "cart.py", "--max-switches", "1"), False),
        (("solve", "cart.py", "-m", "mboc", "-o", "switches=1"), True),
    ],
    ids=str,
)
def test_json_and_nothing_else(
    socp: Command, loud: list[str], arguments: tuple[str, ...], runs: bool
) -> None:
    said = socp(*arguments, "--json")
    assert said.code == 0
    json.loads(said.out)
    assert bool(loud) >= runs
    if PRINTS[1] in arguments:
        assert "Number of nonzeros in equality constraint" in said.err


@pytest.mark.slow
def test_check_of_what_is_not_certified(socp: Command, loud: list[str]) -> None:
    socp(*ROUGH)
    loud.clear()
    said = socp("check", "cart.socp.json", "--problem", "cart.py", "--json")
    assert said.code == 1
    assert json.loads(said.out)["extremal"] is False
    assert loud


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["bonmin", "scip", "gdpopt", "mindtpy"])
def test_json_beside_mixed_integer_solvers(socp: Command, solver: str) -> None:
    """Files of options that lie about would stop bonmin at once."""
    for name in ("bonmin.opt", "ipopt.opt"):
        Path(name).write_text("no_such_option 1\n")
    options = [f"-o{each}" for each in ("switches=1", f"solver={solver}", "time=20")]
    said = socp("solve", "cart.py", "-m", "mboc", *options, "--json")
    found = json.loads(said.out)
    assert solver in found["message"]
    assert said.code == 0
    assert found["word"] == "u: + -"


def test_a_problem_file_that_prints(socp: Command) -> None:
    Path("loud.py").write_text(PRINTING + FILE)
    said = socp("solve", "loud.py", "-m", "euler-ipopt", "-o", "steps=20", "--json")
    json.loads(said.out)
    for text in ("printed", "written", "by C", "bytes", "by a child"):
        assert f"{text}\n" in said.err


CLOSING = {
    "prints": PRINTING
    + 'atexit.register(print, "last")\natexit.register(os.write, 1, b"the very last\\n")',
    "closes": "import sys; sys.stdout.close(); sys.stderr.close()",
    "closes the first ones": "import sys; sys.__stdout__.close(); sys.__stderr__.close(); "
    "sys.stdout = None",
    "replaces": "import io, sys; sys.stdout = sys.stderr = io.StringIO()",
    "closes 1": "import os; os.close(1)",
    "closes both": "import os; os.close(1); os.close(2)",
    "turns 1 away": "import os; os.dup2(os.open('spilt.txt', os.O_WRONLY | os.O_CREAT), 1)",
}


_FEW = ("prints", "closes", "closes both")  # the others take as long, and find the same


@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=[] if k in _FEW else pytest.mark.slow) for k in CLOSING]
)
@pytest.mark.slow
def test_a_problem_file_cannot_take_standard_output_away(kind: str) -> None:
    Path("own.py").write_text(f"{CLOSING[kind]}\n{FILE}")
    done = apart_from_here("socp solve own.py -m euler-ipopt -o steps=20 --json")
    assert json.loads(done.stdout)["problem"] == "cart"
    assert done.returncode == 0
    assert b"Traceback" not in done.stderr
    if kind == "prints":
        assert {b"printed", b"past sys.stdout", b"last", b"the very last"} <= set(
            done.stderr.splitlines()
        )


# -- standard output and standard error that cannot be written


@pytest.mark.skipif(not FULL.exists(), reason="there is no /dev/full")
@pytest.mark.parametrize(
    ("line", "code"),
    [
        ("socp list > /dev/full", 5),
        ("socp list --json >&-", 5),
        ("socp list >&- 2>&-", 5),
        ("socp list <&- >&- 2>&-", 5),
        ("socp list > /dev/full 2> /dev/full", 5),
        ("socp --help > /dev/full", 5),
        ("socp --version >&-", 5),
        ("socp list 2>&-", 0),
        ("socp list 2> /dev/full", 0),
        ("socp nothing > /dev/full", 2),
        ("socp nothing 2>&-", 2),
        ("socp nothing 2> /dev/full", 2),
        ("socp list | true; exit ${PIPESTATUS[0]}", 141),
        ("socp list 2>&1 >&- | grep -c 'cannot be written to standard output'", 0),
    ],
)
def test_streams_that_are_closed_or_full(line: str, code: int) -> None:
    done = apart_from_here(line)
    assert done.returncode == code, done
    assert b"Traceback" not in done.stderr
    if code == 5:
        assert b"the report cannot be written" in done.stderr or "2>" in line


class Failing(io.StringIO):
    """A stream that fails when it is flushed, as one on a full disk."""

    def flush(self) -> None:
        raise OSError(28, "No space left on device")


def test_the_result_is_kept_and_named_where_the_report_is_lost(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", Failing())
        code = main(SOLVE)
    assert code == 5
    assert load("cart.socp.json").stop.ok
    err = capfd.readouterr().err
    assert "error: the report cannot be written to standard output: No space left on device" in err
    assert "written: cart.socp.json" in err


def descriptors() -> int:
    """Return how many descriptors are open."""
    return sum(1 for number in range(256) if Path(f"/dev/fd/{number}").exists())


def test_streams_are_what_they_were_afterwards(capfd: pytest.CaptureFixture[str]) -> None:
    before = sys.stdout, sys.stderr, descriptors()
    for _ in range(3):
        main(["list", "--json"])
    assert (sys.stdout, sys.stderr, descriptors()) == before
    capfd.readouterr()
    os.write(1, b"still there\n")
    assert capfd.readouterr().out == "still there\n"


def test_what_was_printed_before_comes_first() -> None:
    code = (
        "import sys; print('before'); from socp.cli import main; main(['--version']); "
        "print('after')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True)
    first, middle, last = done.stdout.splitlines()
    assert (first, middle[:4], last) == (b"before", b"socp", b"after")


def test_a_descriptor_keeps_its_first_failure() -> None:
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    stream, got = Descriptor(writing), list[bytes]()
    reader = threading.Thread(
        target=lambda: got.extend(iter(lambda: os.read(reading, 1 << 16), b""))
    )
    reader.start()
    assert (
        stream.write(b"x" * 1_000_000) == 1_000_000
    )  # more than a pipe holds: it waits for the reader
    os.close(writing)
    reader.join()
    assert sum(map(len, got)) == 1_000_000
    assert stream.failure is None
    assert stream.write(b"more") == 4
    assert isinstance(stream.failure, OSError)
    os.close(reading)


# -- the environment


@pytest.mark.parametrize(
    "environment",
    [
        {"TERM": "dumb"},
        {"NO_COLOR": "1"},
        {"FORCE_COLOR": "1"},
        {"COLUMNS": "\u00b2", "LINES": "-1"},
        {"MPLBACKEND": "nonsense"},
        {"LANG": "nonsense"},
        {"PYTHONIOENCODING": "utf-8:strict"},
    ],
    ids=str,
)
def test_any_environment(environment: dict[str, str]) -> None:
    done = apart_from_here("socp list", **environment)
    assert (done.returncode, done.stderr) == (0, b"")
    assert (b"\x1b[" in done.stdout) == ("FORCE_COLOR" in environment)
    assert b"rayleigh_time" in done.stdout


@pytest.mark.parametrize(
    "environment",
    [
        {"PYTHONIOENCODING": "latin-1:strict"},
        {"PYTHONIOENCODING": ":nonsense"},
        {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    ],
    ids=str,
)
def test_any_encoding(environment: dict[str, str]) -> None:
    Path("wide.py").write_text(
        FILE.replace('name="cart"', 'name="cart", title="Wagen f\u00fcr \u03bb \u2192 [0, 1]"')
    )
    done = apart_from_here("socp describe wide.py", **environment)
    assert (done.returncode, done.stderr) == (0, b"")
    encoding = environment.get("PYTHONIOENCODING", "utf-8").partition(":")[0] or "utf-8"
    shown = done.stdout.decode("ascii" if "LC_ALL" in environment else encoding)
    assert "[0, 1]" in shown
    assert ("\\u03bb" in shown) == (encoding != "utf-8" or "LC_ALL" in environment)


class Terminal(io.StringIO):
    """A stream that says that it is a terminal."""

    encoding = "utf-8"

    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize("columns", ["0", "1", "-5", "abc", "", "\u00b2", "9" * 30, "80"])
def test_width_of_a_terminal(monkeypatch: pytest.MonkeyPatch, columns: str) -> None:
    monkeypatch.setenv("COLUMNS", columns)
    assert 20 <= console(Terminal()).width <= 1000


def test_figures_need_no_backend() -> None:
    code = (
        "import os; from socp import errors; m = errors.load('matplotlib', 'plot', 'a figure');"
        "print(os.environ['MPLBACKEND'], m.rcParams._get('backend'))"
    )
    for backend in ("nonsense", "pdf"):
        given = {**os.environ, "MPLBACKEND": backend}
        done = subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=given
        )
        shown, used = done.stdout.split(maxsplit=1)
        assert shown == backend
        assert (used.strip() == backend) == (backend == "pdf")


# -- solvers in a process of their own


def parabola() -> tuple[NLP, NLPPoint]:
    """Return (v - 1)^2 over the reals, and a start."""
    v = casadi.SX.sym("v", 2)
    free, none = np.array([[-np.inf] * 2, [np.inf] * 2]), np.zeros((2, 0))
    nlp = NLP.of(
        v=v,
        f=casadi.sumsqr(v - 1),
        g=casadi.SX(0, 1),
        v_box=free,
        g_box=none,
        binary=np.zeros(2, bool),
    )
    return nlp, NLPPoint(v=np.zeros(2), objective=0.0, stop=Stop.LIMIT)


def test_a_stray_file_of_options_is_not_read() -> None:
    """It counts where it is asked for by name, which shows that it would have made a difference."""
    Path("ipopt.opt").write_text("max_wall_time 1e-9\n")
    nlp, start = parabola()
    assert Ipopt(options={"tol": 1e-8})(nlp, start).stop is Stop.SOLVED
    assert Ipopt(options={"option_file_name": "ipopt.opt"})(nlp, start).stop is not Stop.SOLVED


def test_solvers_in_processes_of_their_own_run_in_their_job_s_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYTHONPATH", f"one{os.pathsep}{tmp_path}")
    code = "import os; print(os.getcwd(), os.environ['PYTHONPATH'])"
    with (
        Path("log").open("wb") as log,
        ended_after([sys.executable, "-c", code], tmp_path, stdout=log) as process,
    ):
        process.wait()
    folder, search_path = Path("log").read_text().split()
    assert Path(folder).samefile(tmp_path)
    assert search_path.split(os.pathsep) == [str(Path("one").absolute()), str(tmp_path)]


# -- text that steers


@given(st.text())
def test_printable_text_has_no_control_characters(text: str) -> None:
    assert not RAW.search(printable(text))
    assert not re.search("[\n\t]", one_line(text))
    one_line(text).encode()  # no lone surrogates either


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain \u03bb \u65e5\u672c [x]", "plain \u03bb \u65e5\u672c [x]"),
        ("a\x1b[2J", "a\\x1b[2J"),
        ("\r", "\\r"),
        ("\x9b1m", "\\x9b1m"),
        ("\u202ex", "\\u202ex"),
        ("\udce9", "\\udce9"),
        ("\U000e0041", "\\U000e0041"),
        ("two\nlines\t", "two\nlines\t"),
    ],
)
def test_printable(text: str, shown: str) -> None:
    assert printable(text) == shown
    assert one_line(text) == shown.replace("\n", "\\n").replace("\t", "\\t")


def test_markdown_shows_text_as_it_is() -> None:
    assert markdown("a|b *c* <b> [d](http://e) `f`\n# g") == (
        r"a\|b \*c\* \<b\> \[d\](http://e) \`f\`" + r"\\n\# g"
    )
    assert markdown_code("u: + `|\x1b") == r"`u: + '\|\x1b`"


def posed(name: str = "cart", title: str = "") -> Problem:
    """Return the cart of the file, with texts of all kinds that steer."""
    x, v = states("x v")
    u = controls("u")
    return Problem(
        name=name,
        title=title,
        minimise=final_time,
        dynamics={x: v, v: u},
        bounds={u: (-1, 1)},
        start={x: 0, v: 0},
        end={v: 0},
        target={f"end {STEERING}": x == 1},
        units={x: STEERING},
        source=STEERING,
    )


HOSTILE = f"""from socp import Problem, controls, final_time, states
x, v = states("x v")
u = controls("u")
text = {STEERING!r}
problem = Problem(
    name="[bold]cart[bold]", title=text, minimise=final_time, dynamics={{x: v, v: u}},
    bounds={{u: (-1, 1)}}, start={{x: 0, v: 0}}, end={{v: 0}}, target={{"end " + text: x == 1}},
    units={{x: text}}, source=text,
)
"""


@pytest.fixture
def hostile(here: Path) -> Path:
    """Put down a problem file whose texts all steer, and that would leave the folder; returns the
    outer folder.
    """
    Path("a[red]b.py").write_text(HOSTILE)
    return here.parent


@pytest.mark.slow
def test_no_text_of_a_problem_steers(socp: Command, hostile: Path) -> None:
    said = socp("solve", "a[red]b.py", "-m", "trapezoidal", "-o", "steps=20")
    (result,) = Path().glob("*.socp.json")
    assert [path.name for path in hostile.iterdir()] == ["inner"]
    assert "[bold]verdict[/bold]" in said.out.splitlines()[0]
    assert f"result       {result}" in said.out.splitlines()
    commands: list[tuple[str, ...]] = [
        ("check", str(result), "--problem", "a[red]b.py"),
        ("check", str(result)),
        ("describe", "a[red]b.py"),
        ("compare", "a[red]b.py", "-m", "euler-ipopt", "-m", "hermite-simpson", "-o", "steps=10"),
        ("export", str(result), "--format", "csv"),
        ("solve", f"no\x1b[31m{STEERING}.py"),
        ("solve", "a[red]b.py", "-o", f"x{STEERING}=1"),
        ("solve", "a[red]b.py:\x1b[31m"),
        ("plot", "no\x1b[31m.json"),
        ("export", "a[red]b.py", "-o", "p.pyomo.py", "--switches", "1", "--points", "3"),
    ]
    for each in (said, *(socp(*command) for command in commands)):
        assert not RAW.search(each.out + each.err)
        assert "internal error" not in each.err
    compile(Path("p.pyomo.py").read_text(), "p", "exec")
    assert "[red]" in socp("solve", "none[red].py").err


def test_a_terminal_gets_colours_and_nothing_else(
    monkeypatch: pytest.MonkeyPatch, hostile: Path
) -> None:
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    out, err = Terminal(), Terminal()
    with monkeypatch.context() as patch:
        patch.setattr(sys, "stdout", out)
        patch.setattr(sys, "stderr", err)
        code = main(["solve", "a[red]b.py", "-m", "trapezoidal", "-o", "steps=20"])
    assert code == 0
    assert "\x1b[1;36m" in out.getvalue()
    ours = re.compile(
        r"\x1b\[(\d+(;\d+)*m|\?25[lh]|\d*[AK])|\r"
    )  # colours, the cursor, what progress wipes
    assert not RAW.search(ours.sub("", out.getvalue()))
    assert not RAW.search(ours.sub("", err.getvalue()))
    assert hostile.exists()


def test_recordings_and_notebooks_show_text_as_it_is(socp: Command) -> None:
    socp(*SOLVE)
    problem = posed(title=STEERING)
    plain = load("cart.socp.json")
    assert plain.verdict is not None
    finding = replace(
        plain.verdict.findings[0],
        kind=Condition.OTHER,
        text=STEERING,
        place=Place(of=STEERING),
    )
    verdict = replace(plain.verdict, findings=(finding,), notes=(STEERING,))
    node = Node(word=STEERING, stop=STEERING, objective=1.0, bound=0.0, miss=0.0, residual=0.0)
    solution = revised(
        plain,
        problem=STEERING,
        method=STEERING,
        message=STEERING,
        verdict=verdict,
        nodes=(node,),
        parameters={STEERING: 1.0},
        structure={STEERING: ((STEERING, 0.0, 1.0),)},
        versions={STEERING: STEERING},
    )
    for page in (summary(problem, solution), search(solution), comparison(problem, [solution])):
        assert not RAW.search(page)
        assert not re.search(r"(?<!\\)<script", re.sub(r"`[^`\n]*`", "", page))
        rows = [line for line in page.splitlines() if line.startswith("|")]
        assert all(line.endswith("|") for line in rows)
    for shown in (solution._repr_html_(), problem._repr_html_(), verdict._repr_html_()):
        assert not RAW.search(shown)
        assert "<script" not in shown
    assert style.plain("$\x1b") == r"\$\x1b"


# -- files


@pytest.mark.parametrize("mask", [0o077, 0o022, 0o002, 0o027])
def test_the_umask_is_honoured(mask: int) -> None:
    before = os.umask(mask)
    try:
        write_atomic(Path("new"), "text")
        Path("old").write_text("")
        Path("old").chmod(0o640)
        write_atomic(Path("old"), b"bytes")
    finally:
        os.umask(before)
    assert stat.S_IMODE(Path("new").stat().st_mode) == 0o666 & ~mask
    assert stat.S_IMODE(Path("old").stat().st_mode) == 0o640
    assert (Path("new").read_text(), Path("old").read_text()) == ("text", "bytes")
    assert sorted(path.name for path in Path().iterdir()) == ["cart.py", "new", "old"]


def test_devices_and_pipes_are_not_replaced() -> None:
    os.mkfifo("pipe")
    with pytest.raises(MethodError, match="--out pipe: is no regular file"):
        writable(Path("pipe"))
    with pytest.raises(SolveError, match="pipe: is no regular file"):
        write_atomic(Path("pipe"), "text")
    assert stat.S_ISFIFO(Path("pipe").stat().st_mode)
    with pytest.raises(MethodError, match="name too long"):
        writable(Path("x" * 300))
    with pytest.raises(SolveError, match="name too long"):
        write_atomic(Path("x" * 300), "text")


@pytest.mark.parametrize(
    ("name", "stem"),
    [
        ("auv", "auv"),
        ("b\u00fccher 2", "b\u00fccher 2"),
        ("../../x", "__.._x"),
        ("/etc/passwd", "_etc_passwd"),
        ("..", "_"),
        (".hidden", "_hidden"),
        ("C:\\x", "C__x"),
        ("a\x00b\n", "a_b_"),
        ("", "_"),
        ("\u202ex", "_x"),
    ],
)
def test_names_of_problems_as_names_of_files(name: str, stem: str) -> None:
    assert file_stem(name) == stem
    assert named_after(name, ".socp.json").name == f"{stem}.socp.json"


@given(st.text())
def test_no_name_leaves_the_folder(name: str) -> None:
    path = named_after(name, ".socp.json")
    assert path.parent == Path()
    assert not path.name.startswith(".")
    assert len(path.name.encode()) <= 255


def test_a_long_name_is_cut() -> None:
    assert file_stem("\u00e4" * 400) == "\u00e4" * 100


def test_a_result_names_no_file_to_run(socp: Command) -> None:
    socp(*SOLVE)
    Path("evil.py").write_text("open('ran', 'w')\n" + FILE)
    document = json.loads(Path("cart.socp.json").read_text())
    del document["origin"]["statement"]  # as in results of version 0.1
    text = json.dumps(document)
    for name in ("evil.py", "evil.py:problem", "./evil.py", str(Path("evil.py").absolute())):
        Path("cart.socp.json").write_text(text.replace('"cart"', json.dumps(name)))
        for command in (["check"], ["export", "--format", "csv"]):
            assert socp(command[0], "cart.socp.json", *command[1:]).code == (
                3 if command == ["check"] else 0
            )
    assert not Path("ran").exists()


def test_parted_streams_nest() -> None:
    with parted() as outer, parted() as inner:
        assert inner is outer


def test_exits_of_others_are_errors(socp: Command) -> None:
    Path("leaves.py").write_text("raise SystemExit(0)\n")
    assert socp("solve", "leaves.py").code == 3
    with pytest.raises(ProblemError):
        posed(name=" ")

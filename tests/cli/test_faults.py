"""Faults from outside, each with what is documented of it: the exit code, what is on the disk, and
who is blamed.
"""

import contextlib
import errno
import json
import operator
import os
import re
import resource
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from importlib import import_module
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from carts import FILE, Command, Said, cart, u
from conftest import PLUGIN, Install
from records import revised

from socp import Method, Problem, Solution, default_guess, run, single_phase
from socp.cli import main
from socp.cli.keeping import keep
from socp.cli.locking import locked
from socp.errors import ContractError
from socp.methods import Scouted
from socp.model.data.files import load, save, to_json
from socp.model.result.solution import Stop
from socp.process import interruption
from socp.registry.loading import load_file
from socp.registry.plugins import Registry
from socp.registry.recorder import read_only
from socp.solvers.bonmin import Bonmin
from socp.study.clusters import Outcome
from socp.study.store import Store
from socp.study.workers import results_of
from socp.transcription.collocation import collocate
from socp.transcription.mesh import uniform
from socp.transcription.schemes import euler
from socp.verdict.certify import judge

QUICK = ("solve", "cart.py", "-m", "euler-ipopt", "-o", "steps=10")
HOOK = "from socp import hookimpl\n\n@hookimpl\n"
NAMES = (
    "signal",
    "json",
    "random",
    "numpy",
    "casadi",
    "socket",
    "typing",
    "logging",
    "tempfile",
    "ctypes",
)
SIGNALS = {signal.SIGINT: 130, signal.SIGTERM: 143, signal.SIGHUP: 129}


@pytest.fixture
def command(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Command:
    """Run the command line in this process, in a folder with the file cart.py; nothing ends in a
    traceback.
    """
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.delenv("SOCP_PLUGINS", raising=False)
    Path("cart.py").write_text(FILE)

    def go(*arguments: str) -> Said:
        before = [signal.getsignal(each) for each in interruption.ASKING]
        said = Said(main(arguments), *capsys.readouterr())
        assert "Traceback" not in said.err
        assert [signal.getsignal(each) for each in interruption.ASKING] == before
        assert not list(Path.cwd().glob("*.part"))
        return said

    return go


@pytest.fixture(scope="module")
def certified() -> Solution:
    """Return the cart's extremal."""
    found = run(Registry.load().method("auto")(), cart(), default_guess(cart()))
    assert found.extremal
    return found


# -- signals: commands, moments, one press or five


def pressed(patch: pytest.MonkeyPatch, target: str, number: int, times: int, call: int = 1) -> None:
    """Have signals arrive at the beginning of a call of a function, the first or a later one."""
    module, _, rest = target.partition(":")
    *path, name = rest.split(".")
    place: Any = import_module(module)
    for each in path:
        place = getattr(place, each)
    act, calls = getattr(place, name), iter(range(1, 1_000_000))

    def wrapped(*given: Any, **named: Any) -> Any:
        if next(calls) == call:
            for _ in range(times):
                signal.raise_signal(number)
        return act(*given, **named)

    patch.setattr(place, name, wrapped)


ITERATING = "socp.solvers.backends.observer:Observer.eval_buffer"
SOLVING = {
    "while the guess is made": ("socp.methods:default_guess", 1, None),
    "at the first iteration": (ITERATING, 1, "INTERRUPTED"),
    "at a later iteration": (ITERATING, 3, "INTERRUPTED"),
    "while it is judged": ("socp.methods.chain:judge", 1, "unverified"),
    "while the result is written": ("socp.model:save", 1, "SOLVED"),
    "while it is reported": ("socp.cli.commands.solving:_show", 1, "SOLVED"),
}


@pytest.mark.parametrize("times", [1, 5])
@pytest.mark.parametrize("number", SIGNALS, ids=lambda number: number.name)
@pytest.mark.parametrize("moment", SOLVING)
@pytest.mark.slow
def test_a_solve_that_is_interrupted_keeps_what_it_has(
    moment: str,
    number: signal.Signals,
    times: int,
    command: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    target, call, kept = SOLVING[moment]
    pressed(monkeypatch, target, number, times, call)
    said = command(*QUICK)
    assert said.code == SIGNALS[number]
    assert Path("cart.socp.json").exists() == (kept is not None)
    if kept is None:
        assert said.err.splitlines()[-1] == "interrupted; nothing was written"
        return
    found = load("cart.socp.json")
    assert (found.verdict is None) == (kept == "unverified")
    assert kept in {found.stop.name, "unverified"}
    assert ["result", "cart.socp.json"] in [line.split() for line in said.out.splitlines()]


# Command: where signals arrive, at which call, what is said last, and whether there is a result
OTHERS = {
    "census, at its second start": (
        ("census", "cart.py", "--starts", "3"),
        "socp.study.census:explore",
        2,
        "1 of 3 starts are kept",
        True,
    ),
    "census, while a start is kept": (
        ("census", "cart.py", "--starts", "3"),
        "socp.study.store:Store.write",
        1,
        "1 of 3 starts are kept",
        True,
    ),
    "census, at its first iteration": (
        ("census", "cart.py", "--starts", "3"),
        ITERATING,
        1,
        "0 of 3 starts are kept",
        False,
    ),
    "census, while the best is written": (
        ("census", "cart.py", "--starts", "1"),
        "socp.model:save",
        1,
        "",
        True,
    ),
    "frontier, before its words": (
        ("frontier", "cart.py", "--max-switches", "1"),
        ITERATING,
        1,
        "nothing was written",
        False,
    ),
    "frontier, between its words": (
        ("frontier", "cart.py", "--max-switches", "1"),
        "socp.study.switches.frontier:_everything",
        1,
        "solved before",
        False,
    ),
    "frontier, while the best is written": (
        ("frontier", "cart.py", "--max-switches", "1"),
        "socp.model:save",
        1,
        "",
        True,
    ),
    "compare, at the second method": (
        ("compare", "cart.py", "-m", "euler-ipopt", "-m", "lgr", "-o", "steps=10"),
        "socp.cli.commands.comparing:run_method",
        2,
        "the table is of 1 of 2 methods",
        False,
    ),
    "compare, inside the first method": (
        ("compare", "cart.py", "-m", "euler-ipopt", "-m", "lgr", "-o", "steps=10"),
        ITERATING,
        1,
        "the table is of 1 of 2 methods",
        False,
    ),
}


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda number: number.name)
@pytest.mark.parametrize("case", OTHERS)
@pytest.mark.slow
def test_other_commands_that_are_interrupted_keep_what_they_have(
    case: str, number: signal.Signals, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    words, target, call, last, result = OTHERS[case]
    pressed(monkeypatch, target, number, 5, call)
    said = command(*words)
    assert said.code == SIGNALS[number]
    assert last in (said.err.splitlines() or [""])[-1]
    assert Path("cart.socp.json").exists() == result
    if result:
        assert load("cart.socp.json").extremal


def test_an_interruption_that_is_lost_on_its_way_ends_the_next_solve(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A package that drops the exception in the middle of something does not make the command go on
    for ever.
    """

    def dropping(*_: Any) -> Any:
        with contextlib.suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        return Scouted((), 0)

    monkeypatch.setattr("socp_plugins.auto.scouted", dropping)
    said = command("solve", "cart.py")
    assert (said.code, said.err.strip()) == (130, "interrupted; nothing was written")


def test_signals_that_are_ignored_stay_ignored(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As for a command that a shell runs behind `nohup` or `&`."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        pressed(monkeypatch, ITERATING, signal.SIGHUP, 5, 2)
        assert command(*QUICK).code == 0
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_later_press_is_heard_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("socp.process.interruption._BURST", 0.05)
    raised = []
    with interruption.listening():
        for _ in range(3):
            try:
                signal.raise_signal(signal.SIGINT)
                signal.raise_signal(signal.SIGINT)
            except KeyboardInterrupt:
                signal.raise_signal(
                    signal.SIGINT
                )  # never a second one while the first is dealt with
                raised.append(interruption.heard())
            time.sleep(0.06)
    assert raised == [signal.SIGINT] * 3
    assert interruption.heard() == 0


# -- results: a better one is never replaced by a worse one


def other(certified: Solution, kind: str) -> Solution:
    """Return another result of the cart."""
    rough = revised(certified, verdict=replace(certified.verdict, miss=0.5))
    return {
        "interrupted": replace(rough, stop=Stop.INTERRUPTED),
        "uncertified": rough,
        "unverified": revised(certified, verdict=None),
        "worse": replace(certified, objective=certified.objective + 1.0),
        "equal": certified,
        "better": replace(certified, objective=certified.objective - 1.0),
    }[kind]


@pytest.mark.parametrize(
    "kind", ["interrupted", "uncertified", "unverified", "worse", "equal", "better"]
)
def test_a_certified_result_is_replaced_only_by_one_that_is_as_good(
    kind: str, certified: Solution, tmp_path: Path
) -> None:
    path = tmp_path / "cart.socp.json"
    save(certified, path)
    new = other(certified, kind)
    place = keep(cart(), new, path)
    beside = kind not in {"equal", "better"}
    assert place.path == (tmp_path / f"cart.{kind}.socp.json" if beside else path)
    assert load(place.path).objective == new.objective
    assert bool(place.said) == beside
    assert to_json(load(path)) == to_json(certified if beside else new)


THERE = ["uncertified", "of another problem", "of the problem as it was", "no result", "claims"]


@pytest.mark.parametrize("there", THERE)
def test_what_is_not_better_is_replaced(there: str, certified: Solution, tmp_path: Path) -> None:
    path, problem = tmp_path / "cart.socp.json", cart()
    new = other(certified, "uncertified")
    if there == "no result":
        path.write_text("{}")
    elif there == "of the problem as it was":
        save(certified, path)
        problem = cart(bounds={u: (-2, 2)})
    elif there == "claims":  # a verdict that says more than the judge does
        arc = certified.arcs[0]
        bent = replace(arc, x=arc.x + 0.1 * np.sin(arc.t))
        save(replace(certified, arcs=(bent, *certified.arcs[1:])), path)
    else:
        stranger = there == "of another problem"
        save(
            replace(certified, problem="other") if stranger else other(certified, "uncertified"),
            path,
        )
    place = keep(problem, new, path)
    assert (place.path, place.said) == (path, "")
    assert not load(path).extremal


def test_an_interrupted_solve_leaves_the_certified_result_and_says_where_the_other_is(
    command: Command, certified: Solution, monkeypatch: pytest.MonkeyPatch
) -> None:
    save(certified, "cart.socp.json")
    pressed(monkeypatch, ITERATING, signal.SIGINT, 1)
    said = command(*QUICK)
    assert said.code == 130
    assert (
        "cart.socp.json holds a better certified result and stays as it is; this one is in"
        in said.err
    )
    assert "result       cart.interrupted.socp.json" in said.out
    assert load("cart.socp.json").extremal
    assert load("cart.interrupted.socp.json").stop is Stop.INTERRUPTED


# -- disks


def failing(patch: pytest.MonkeyPatch, folders: list[Path], number: int) -> None:
    """Have every new file in some folders fail, as on a disk that is full or has turned
    read-only.
    """
    made = os.open

    def make(path: Any, flags: int, *given: Any, **named: Any) -> int:
        if flags & os.O_CREAT and Path(os.fsdecode(path)).parent.resolve() in folders:
            raise OSError(number, os.strerror(number))
        return made(path, flags, *given, **named)

    patch.setattr("os.open", make)


DISKS = {
    "full": errno.ENOSPC,
    "read-only": errno.EROFS,
    "out of quota": errno.EDQUOT,
    "broken": errno.EIO,
}
RUNS = {
    "solve": QUICK,
    "frontier": ("frontier", "cart.py", "--max-switches", "1"),
}


@pytest.mark.parametrize("run_", RUNS)
@pytest.mark.parametrize("disk", DISKS)
def test_a_result_that_cannot_be_written_is_kept_elsewhere(
    disk: str, run_: str, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "spare").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "spare"))
    failing(monkeypatch, [Path.cwd()], DISKS[disk])
    said = command(*RUNS[run_])
    assert said.code == 5
    (rescued,) = (tmp_path / "spare").iterdir()
    assert said.err.splitlines()[-1] == (
        f"error: cart.socp.json: cannot be written: {os.strerror(DISKS[disk])}; the result is in "
        f"{rescued}"
    )
    assert load(rescued).problem == "cart"
    assert str(rescued) in said.out


def test_a_folder_that_turns_up_where_the_result_goes_is_left_alone(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    judged = judge

    def judging(problem: Problem, solution: Solution) -> Solution:
        Path("cart.socp.json").mkdir(exist_ok=True)
        return judged(problem, solution)

    monkeypatch.setattr("socp.methods.chain.judge", judging)
    said = command(*QUICK)
    assert said.code == 5
    assert Path("cart.socp.json").is_dir()
    (rescued,) = Path.cwd().glob("cart.rescued-*.socp.json")
    assert f"the result is in {rescued.name}" in said.err
    assert load(rescued).stop is Stop.SOLVED


def test_a_result_that_can_be_written_nowhere_is_said_to_be_lost(
    command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    failing(monkeypatch, [Path.cwd(), tmp_path], errno.ENOSPC)
    said = command(*QUICK)
    assert said.code == 5
    assert "No space left on device; nor can it be written anywhere else, and is lost" in said.err


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EIO], ids=os.strerror)
def test_a_report_that_cannot_be_written_says_where_the_result_is(
    number: int, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any, **__: Any) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("socp.cli.streams.Streams.deliver", full)
    said = command(*QUICK)
    assert said.code == 5
    text = (
        "error: the report cannot be written to standard output: "
        f"{os.strerror(number)}\nwritten: cart.socp.json\n"
    )
    assert said.err == text
    assert load("cart.socp.json").stop is Stop.SOLVED


@pytest.mark.parametrize("what", ["full", "missing", "not writable"])
def test_a_folder_for_temporary_files_that_fails_is_named(
    what: str, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    number = {"full": errno.ENOSPC, "missing": errno.ENOENT, "not writable": errno.EACCES}[what]

    def make(*_: Any, **__: Any) -> str:
        raise OSError(number, os.strerror(number), "/gone/socp-x")

    monkeypatch.setattr("tempfile.mkdtemp", make)
    said = command(
        "solve",
        "cart.py",
        "-m",
        "mboc",
        "-o",
        "solver=bonmin",
        "-o",
        "switches=1",
        "-o",
        "starts=1",
    )
    assert said.code == 5
    assert said.err.splitlines()[-1] == f"error: /gone/socp-x: {os.strerror(number)}"
    assert "bug" not in said.err


def test_a_start_that_cannot_be_kept_counts_all_the_same(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = Path("cart.census").resolve()
    failing(monkeypatch, [folder], errno.ENOSPC)
    said = command("census", "cart.py", "--starts", "1")
    assert said.code == 5
    assert "1 of 1 starts finished" in said.out
    assert re.fullmatch(
        r"error: cart\.census/start-0000-[0-9a-f]{8}\.json: cannot be written: No space left on "
        "device; the table counts them, but another census begins anew\n",
        said.err,
    )
    assert load("cart.socp.json").extremal


@pytest.mark.slow
def test_standard_output_on_a_full_disk_is_no_success(tmp_path: Path) -> None:
    (tmp_path / "cart.py").write_text(FILE)
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "socp.cli", *QUICK],
            cwd=tmp_path,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
            timeout=120,
        )
    assert (done.returncode, "Traceback" in done.stderr) == (5, False)
    assert "written to standard output: No space left on device\n" in done.stderr
    assert done.stderr.endswith("written: cart.socp.json\n")
    assert load(tmp_path / "cart.socp.json").stop is Stop.SOLVED


# -- memory


def test_a_limit_of_memory_that_is_too_tight_is_said_before_anything_is_begun(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resource, "getrlimit", lambda _: (400 * 2**20, -1))
    said = command("list")
    assert said.code == 5
    assert said.err.startswith("error: memory: the address space is limited to 400 MiB")


@pytest.mark.parametrize(
    "error", [MemoryError(), RuntimeError("std::bad_alloc")], ids=["Python's", "casadi's"]
)
@pytest.mark.parametrize("words", [QUICK, RUNS["frontier"]], ids=lambda words: words[0])
def test_memory_that_gives_out_is_no_bug(
    words: tuple[str, ...], error: Exception, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def give_out(*_: Any, **__: Any) -> None:
        raise error

    monkeypatch.setattr("socp.methods.contract.laid_out", give_out)
    said = command(*words)
    assert said.code == 5
    assert said.err == "error: the memory gave out; give it more, or solve on a coarser grid\n"


@pytest.mark.slow
def test_standard_output_that_is_closed_is_no_bug(tmp_path: Path) -> None:
    (tmp_path / "cart.py").write_text(FILE)
    done = subprocess.run(
        ["bash", "-c", f"exec {sys.executable} -m socp.cli {' '.join(QUICK)} >&-"],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 5
    assert done.stderr.endswith("standard output: it is closed\nwritten: cart.socp.json\n")
    assert load(tmp_path / "cart.socp.json").stop is Stop.SOLVED


@pytest.mark.slow
def test_a_limit_of_memory_ends_with_a_message(tmp_path: Path) -> None:
    (tmp_path / "cart.py").write_text(FILE)
    done = subprocess.run(
        ["bash", "-c", f"ulimit -v 400000; exec {sys.executable} -m socp.cli solve cart.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert (done.returncode, "Traceback" in done.stderr) == (5, False)
    assert "address space is limited to 390 MiB" in done.stderr


# -- kept starts of a census


ALTERED: dict[str, Callable[[dict[str, Any]], object]] = {
    "the objective": lambda kept: kept["result"].update(objective=1.0),
    "the verdict": lambda kept: kept["result"]["judgement"]["verdict"].update(
        miss=0.0, findings=[]
    ),
    "a state": lambda kept: kept["result"]["arcs"][0]["x"][0].__setitem__(1, 0.125),
    "the number of the start": lambda kept: kept.update(start=1),
    "the error": lambda kept: kept.update(error="", result=None),
    "the checksum": lambda kept: kept.update(checksum="0" * 64),
    "no checksum": lambda kept: kept.pop("checksum"),
    "a list": lambda kept: kept.update(result=[]),
}


@pytest.mark.parametrize("what", ALTERED)
def test_a_kept_start_that_was_altered_is_not_believed(
    what: str, certified: Solution, tmp_path: Path
) -> None:
    kept = Store(tmp_path / "cart.census", "key")
    for number in range(2):
        kept.write(Outcome(number, "default guess", certified, ""))
    (path,) = kept.folder.glob("start-0000-*.json")
    assert sorted(kept.read()) == [0, 1]
    document = json.loads(path.read_text())
    ALTERED[what](document)
    path.write_text(json.dumps(document))
    assert sorted(kept.read()) == [1]


def test_a_kept_start_that_was_cut_off_is_not_believed(certified: Solution, tmp_path: Path) -> None:
    kept = Store(tmp_path / "cart.census", "key")
    kept.write(Outcome(0, "default guess", certified, ""))
    (path,) = kept.folder.glob("start-0000-*.json")
    for text in ("", "null", "[1]", path.read_text()[:-20], "[" * 5000):
        path.write_text(text)
        assert kept.read() == {}


# -- files beside the problem that have the names of packages


def shadowed(folder: Path) -> None:
    folder.mkdir(exist_ok=True)
    for name in NAMES:
        (folder / f"{name}.py").write_text(f"raise SystemExit('{name}.py was imported')\n")
    (folder / "helper.py").write_text("speed = 0.5\n")
    (folder / "cart.py").write_text(
        "import json, random, signal\n\nfrom helper import speed\n\n" + FILE
    )


def test_a_problem_beside_such_files_loads_and_has_its_neighbours(tmp_path: Path) -> None:
    shadowed(tmp_path / "beside")
    before = list(sys.path)
    assert load_file(tmp_path / "beside" / "cart.py").name == "cart"
    assert sys.path == before
    sys.modules.pop("helper")


def test_a_solver_s_process_imports_nothing_from_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shadowed(tmp_path)
    monkeypatch.chdir(tmp_path)
    reduced = collocate(single_phase(cart()), [uniform(euler(), 5)])
    found = Bonmin()(reduced.problem, [reduced.push(default_guess(cart()))], 20.0)
    assert found.found, found.point.message


def test_workers_import_nothing_from_the_current_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shadowed(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("PYTHONSAFEPATH", raising=False)
    assert dict(results_of(operator.neg, deque([2]), 1)) == {2: -2}
    assert "PYTHONSAFEPATH" not in os.environ


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        ("solve", "cart.py"),
        (
            "solve",
            "cart.py",
            "-m",
            "mboc",
            "-o",
            "solver=bonmin",
            "-o",
            "switches=1",
            "-o",
            "starts=1",
        ),
        ("census", "cart.py", "--starts", "2", "-j", "2"),
    ],
    ids=["solve", "mboc", "census"],
)
def test_commands_among_such_files_work(words: tuple[str, ...], tmp_path: Path) -> None:
    shadowed(tmp_path)
    done = subprocess.run(
        [Path(sys.executable).with_name("socp"), *words, "--quiet"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert load(tmp_path / "cart.socp.json").extremal


# -- plugins


IMPORTED = {
    "exits": ("raise SystemExit(3)\n", "SystemExit: 3"),
    "presses Ctrl-C": ("raise KeyboardInterrupt\n", "KeyboardInterrupt"),
    "raises a base exception": ("raise BaseException('odd')\n", "BaseException: odd"),
    "hangs": (
        "import time\ntime.sleep(60)\n",
        "it did not return within 0.5 seconds and was left behind",
    ),
    "closes its output": ("import os\nos.close(1)\n", "it closed standard output"),
    "offers methods for ever": (
        HOOK + "def socp_methods():\n    while True:\n        yield int\n",
        "offers more than 1000 methods",
    ),
    "waits among its methods": (
        HOOK + "def socp_methods():\n    import time\n    yield time.sleep(60)\n",
        "it did not return within",
    ),
    "exits in its hook": (HOOK + "def socp_methods():\n    raise SystemExit(4)\n", "SystemExit: 4"),
    "offers what raises": (
        HOOK + "def socp_methods():\n    class M(type):\n        __subclasscheck__ = 1\n    "
        "return [M]\n",
        "Method",
    ),
}


NUMBERS = count()


@pytest.fixture
def bad(install: Install) -> Callable[[str], str]:
    """Install a plugin from its source, before all others, under a name that no module had before;
    returns it.
    """

    def put(source: str) -> str:
        name = f"aa_bad{next(NUMBERS)}"
        install(name, source, plugin=name)
        return name

    return put


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait half a second for plugins."""
    monkeypatch.setattr("socp.registry.calls.LIMIT", 0.5)


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize("case", IMPORTED)
def test_a_plugin_that_fails_to_load_is_named_and_stops_nothing(
    case: str, bad: Callable[[str], str], command: Command
) -> None:
    source, reason = IMPORTED[case]
    name = bad(source)
    said = command(*QUICK)
    assert said.code == 0
    assert said.err.startswith(f"warning: {name} of {name} 1.0 is left out: ")
    assert reason in said.err
    assert load("cart.socp.json").stop is Stop.SOLVED


def test_what_a_plugin_prints_is_kept_out_of_the_output(
    bad: Callable[[str], str], command: Command
) -> None:
    listener = (
        "def socp_solved(problem, solution):\n    print('in the hook')\n    import sys\n    "
        "sys.stdout.close()\n"
    )
    bad("print('at import')\n" + HOOK + listener)
    said = command(*QUICK, "--json")
    assert said.code == 0
    assert json.loads(said.out)["problem"] == "cart"
    assert said.err.split() == ["at", "import", "in", "the", "hook"]


LISTENERS = {
    "raises": ("raise ValueError('no disk')", "ValueError: no disk"),
    "exits": ("raise SystemExit(2)", "SystemExit: 2"),
    "presses Ctrl-C": ("raise KeyboardInterrupt", "KeyboardInterrupt"),
    "raises a base exception": ("raise GeneratorExit", "GeneratorExit"),
    "hangs": (
        "import time\n    time.sleep(60)",
        "it did not return within 0.5 seconds and was left behind",
    ),
    "alters the solution": ("solution.arcs[0].x[:] = 7.0", "read-only"),
    "alters its fields": ("solution.arcs = ()", "FrozenInstanceError"),
    "closes its output": ("import os\n    os.close(1)", "it closed standard output"),
}


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize("case", LISTENERS)
def test_a_listener_that_fails_is_named_and_stops_no_other(
    case: str, bad: Callable[[str], str], command: Command
) -> None:
    body, reason = LISTENERS[case]
    name = bad(HOOK + f"def socp_solved(problem, solution):\n    {body}\n")
    bad(HOOK + "def socp_solved(problem):\n    print('heard')\n")
    said = command(*QUICK)
    assert said.code == 0
    assert f"warning: plugin '{name}' ({name} 1.0): socp_solved: " in said.err
    assert reason in said.err
    assert "heard" in said.err


def test_a_listener_cannot_alter_the_solution(certified: Solution) -> None:
    text, copied = to_json(certified), read_only(certified)
    assert to_json(copied) == text
    for values in (copied.arcs[0].x, copied.arcs[0].t, copied.arcs[0].u, copied.arcs[0].costate):
        with pytest.raises(ValueError, match="read-only"):
            values[...] = 0.0
    copied.seconds["solve"] = 1e9  # type: ignore[index]
    copied.effort.trace.clear()  # type: ignore[attr-defined]
    assert to_json(certified) == text


SOLVES = {
    "raises": ("raise ZeroDivisionError('by nothing')", "ZeroDivisionError: by nothing"),
    "exits": ("raise SystemExit(0)", "SystemExit: 0"),
    "presses Ctrl-C": ("raise KeyboardInterrupt", "KeyboardInterrupt"),
    "ends as a generator does": ("raise GeneratorExit", "GeneratorExit"),
    "returns nothing": ("return None", "solve returned nothing, where a Solution is needed"),
    "returns a text": ("return 'solved'", "solve returned a str, where a Solution is needed"),
    "returns a class": ("return type(guess)", "where a Solution is needed"),
    "returns no arcs": (
        "return replace(guess, arcs=())",
        "its arcs are no tuple of at least one Arc",
    ),
    "returns odd arcs": ("return replace(guess, arcs=(1,))", "among its arcs is an int"),
    "returns too few states": (
        "return replace(guess, arcs=tuple(replace(a, x=a.x[:1]) for a in guess.arcs))",
        "x of an arc has shape (1, ",
    ),
    "returns a text as its objective": (
        "return replace(guess, objective='2')",
        "its objective is a str, not a number",
    ),
    "returns no stop": ("return replace(guess, stop=True)", "its stop is True, not a Stop"),
    "returns other names": (
        "return replace(guess, state_names=('a', 'b'))",
        "its states and controls are ('a', 'b')",
    ),
    "tells a text": (
        "watch('halfway')",
        "it told its watch of 'halfway', where a Progress is needed",
    ),
    "tells nothing": ("watch(None)", "it told its watch of None"),
    "tells odd progress": (
        "watch(Progress('a', 'b', 1.0, 1.0))",
        "a Progress whose iteration is 'b'",
    ),
    "tells an odd objective": (
        "watch(Progress('a', 1, None, 1.0))",
        "a Progress whose objective is None",
    ),
    "closes its output": ("import os; os.close(1); return guess", "it closed standard output"),
}


def broken(*bodies: str) -> str:
    """Return a plugin of methods that fail, each in its way."""
    head, _, tail = PLUGIN.partition("@final")
    body, _, hook = tail.partition("        return solve_collocated")
    names = [f"Mine{k}" for k in range(len(bodies))]
    made = [
        "@final"
        + body.format(name=f"aa-bad{k}").replace("class Mine", f"class {names[k]}")
        + f"        {each}\n\n"
        for k, each in enumerate(bodies)
    ]
    own = "from dataclasses import replace\nfrom socp.model import Progress\n"
    return (
        own
        + head
        + "".join(made)
        + hook[hook.index("\n@hookimpl") :].replace("[Mine]", f"[{', '.join(names)}]")
    )


@pytest.mark.parametrize("case", SOLVES)
def test_a_method_that_fails_is_named(
    case: str, bad: Callable[[str], str], command: Command
) -> None:
    body, reason = SOLVES[case]
    name = bad(broken(body))
    said = command("solve", "cart.py", "-m", "aa-bad0")
    assert said.code == 3
    assert said.err.startswith(f"error: plugin '{name}' ({name} 1.0): method 'aa-bad0': ")
    assert reason in said.err
    assert "bug" not in said.err
    assert not Path("cart.socp.json").exists()


def test_methods_that_fail_cost_their_own_rows_alone(
    bad: Callable[[str], str], command: Command
) -> None:
    bad(broken(*(body for body, _ in SOLVES.values())))
    names = [f"aa-bad{k}" for k in range(len(SOLVES))]
    words = [word for name in (*names, "euler-ipopt") for word in ("-m", name)]
    said = command("compare", "cart.py", *words, "-o", "euler-ipopt.steps=10", "--json")
    assert said.code == 1
    *rows, last = json.loads(said.out)["rows"]
    assert [row["method"] for row in rows] == names
    assert [
        reason
        for row, (_, reason) in zip(rows, SOLVES.values(), strict=True)
        if reason not in row["error"]
    ] == []
    assert last["stop"] == "SOLVED"


def test_a_method_that_cannot_be_made_is_named(bad: Callable[[str], str], command: Command) -> None:
    source = PLUGIN.format(name="aa-bad").replace(
        "    def solve",
        "    def __post_init__(self):\n        raise OSError('no licence')\n\n    def solve",
    )
    name = bad(source)
    said = command("solve", "cart.py", "-m", "aa-bad")
    assert said.code == 3
    assert said.err.startswith(
        f"error: plugin '{name}' ({name} 1.0): method 'aa-bad': OSError: no licence"
    )


def test_a_bug_of_socp_s_own_method_costs_its_own_row_alone(
    command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def bug(*_: Any, **__: Any) -> None:
        raise AttributeError("a bug")

    monkeypatch.setattr("socp_plugins.collocation.Lgr.solve", bug)
    said = command(
        "compare", "cart.py", "-m", "lgr", "-m", "euler-ipopt", "-o", "steps=10", "--json"
    )
    assert said.code == 4
    first, second = json.loads(said.out)["rows"]
    assert first["error"] == "internal error: AttributeError: a bug"
    assert second["stop"] == "SOLVED"


def test_run_refuses_what_is_no_solution() -> None:
    @dataclass(frozen=True)
    class Nothing(Method):
        name = "nothing"
        source = "no paper"

        def solve(self, *_: Any) -> Any:
            return 3

    with pytest.raises(
        ContractError, match="method 'nothing': solve returned an int, where a Solution is needed"
    ):
        run(Nothing(), cart(), default_guess(cart()))


RECORDERS = {
    "cannot be opened": ("raise RuntimeError('no')", "", "RuntimeError: no"),
    "is nothing that records": ("return 3", "", "TypeError"),
    "hangs when it is opened": (
        "import time; time.sleep(60)",
        "",
        "did not return within 0.5 seconds",
    ),
    "hangs at an iteration": (
        "return Mine()",
        "time.sleep(60)",
        "did not return within 0.5 seconds",
    ),
    "exits at an iteration": ("return Mine()", "raise SystemExit(1)", "SystemExit: 1"),
    "presses Ctrl-C at an iteration": (
        "return Mine()",
        "raise KeyboardInterrupt",
        "KeyboardInterrupt",
    ),
}


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize("case", RECORDERS)
def test_a_recorder_that_fails_is_named_and_the_solve_goes_on(
    case: str, bad: Callable[[str], str], command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened, told, reason = RECORDERS[case]
    own = f"import time\n\nclass Mine:\n    def __call__(self, now):\n        {told or 'pass'}\n\n"
    own += (
        "    def finish(self, problem, solution):\n        pass\n\n    def close(self):\n        "
        "pass\n\n"
    )
    hook = f"def socp_recorder(problem, path, live, runs):\n    {opened}\n"
    name = bad(own + HOOK + hook)
    monkeypatch.setenv("SOCP_PLUGINS", f"{name},collocation")
    said = command(*QUICK, "--record", "cart.rrd")
    assert said.code == 0
    assert f"warning: plugin '{name}' ({name} 1.0): " in said.err
    assert reason in said.err
    assert not Path("cart.rrd").exists()
    assert load("cart.socp.json").stop is Stop.SOLVED


def test_two_recordings_into_one_file_are_refused(command: Command) -> None:
    Path("cart.rrd").write_bytes(b"one")
    with locked(Path("cart.rrd")):
        said = command(*QUICK, "--record", "cart.rrd")
    assert said.code == 2
    assert said.err == (
        "error: cart.rrd: another command is recording into this file; name another one\n"
    )
    assert Path("cart.rrd").read_bytes() == b"one"
    assert not Path("cart.socp.json").exists()


# -- processes


def spawned(*words: str, cwd: Path) -> "subprocess.Popen[str]":
    command = [sys.executable, "-m", "socp.cli", *words]
    return subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=cwd,
        start_new_session=True,
    )


def members(session: int) -> set[int]:
    """Return the processes of a session that live."""
    found = set()
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            state, _, _, own = path.read_text().rpartition(")")[2].split()[:4]
            if int(own) == session and state != "Z":
                found.add(int(path.parent.name))
    return found


def until(condition: Callable[[], object], seconds: float) -> bool:
    last = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > last:
            return False
        time.sleep(0.05)
    return True


@pytest.mark.slow
@pytest.mark.parametrize(
    "number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL], ids=lambda number: number.name
)
def test_a_census_ends_within_seconds_with_all_its_workers(
    number: signal.Signals, tmp_path: Path
) -> None:
    (tmp_path / "cart.py").write_text(FILE)
    process = spawned("census", "cart.py", "--starts", "500", "-j", "2", cwd=tmp_path)
    assert until(lambda: any(tmp_path.glob("cart.census/start-*.json")), 60)
    assert len(members(process.pid)) > 2
    began = time.monotonic()
    for _ in range(5):
        if number == signal.SIGINT:
            os.killpg(process.pid, number)  # as a terminal does
        else:
            process.send_signal(number)
        time.sleep(0.02)
    out, err = process.communicate(timeout=60)
    assert time.monotonic() - began < 15  # a second where nothing else runs
    assert "Traceback" not in err
    assert until(lambda: not members(process.pid), 5)
    assert all(
        json.loads(path.read_text())["start"] >= 0
        for path in tmp_path.glob("cart.census/start-*.json")
    )
    assert process.returncode == (-9 if number == signal.SIGKILL else SIGNALS[number])
    if number != signal.SIGKILL:
        assert "u: 1" in out
        assert "starts are kept in cart.census" in err
        assert load(tmp_path / "cart.socp.json").extremal


@pytest.mark.slow
@pytest.mark.parametrize("gap", [0.0, 0.3])
def test_ctrl_c_five_times_is_130_and_no_traceback(gap: float, tmp_path: Path) -> None:
    process = spawned(
        "solve",
        "auv",
        "-m",
        "euler-ipopt",
        "-o",
        "steps=60000",  # longer than the five seconds until a line of progress, on any machine
        "-o",
        "ipopt.tol=1e-13",
        cwd=tmp_path,
    )
    assert process.stderr is not None
    assert any("iteration" in line for line in process.stderr)
    for _ in range(5):
        process.send_signal(signal.SIGINT)
        time.sleep(gap)
    out, err = process.communicate(timeout=60)
    assert (process.returncode, "Traceback" in err) == (130, False)
    assert ["result", "auv.socp.json"] in [line.split() for line in out.splitlines()]
    assert load(tmp_path / "auv.socp.json").stop is Stop.INTERRUPTED


def test_outside_the_main_thread_signals_are_left_alone() -> None:
    found = []

    def work() -> None:
        with (
            interruption.listening(),
            interruption.signals_held(),
            interruption.requesting(lambda: None),
        ):
            found.append(interruption.listens())

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert found == [False]
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler

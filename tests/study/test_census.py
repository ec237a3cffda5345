"""The census: starts that do not depend on how many there are, workers that die, interruption,
resumption.
"""

import json
import math
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from carts import FILE, cart, u, v, x
from records import built

from socp import Problem, Solution
from socp.cli import main
from socp.model.data.files import load, to_json
from socp.model.progress import Progress, Watch
from socp.model.result.arc import Arc
from socp.model.result.findings import Condition, Finding, Verdict
from socp.model.result.solution import Stop
from socp.model.symbols import final_time
from socp.process import listening, signals_held
from socp.registry.plugins import Registry
from socp.study.census import Tally, explore, recipe, survey
from socp.study.clusters import Census, Outcome, clusters
from socp.study.starts import motion, start
from socp.study.store import Store, fingerprint
from socp.study.workers import results_of


@dataclass(frozen=True)
class Cart:
    """Loads the cart in a worker."""

    def __call__(self) -> Problem:
        return cart()


# -- starts


def values(number: int) -> np.ndarray:
    here = start(cart(), number)
    return np.vstack([here.guess.t, here.guess.rows("x"), here.guess.rows("u")])


@pytest.mark.slow
def test_starts_differ_and_come_out_the_same_again() -> None:
    found = [values(number) for number in range(9)]
    for number, each in enumerate(found):
        assert (values(number) == each).all()
        assert not any(
            each.shape == other.shape and np.allclose(each, other) for other in found[:number]
        )
    assert {start(cart(), number).about.split(";")[0] for number in range(9)} == {
        "default guess",
        "random word",
        "scattered guess",
    }


def test_random_words_move_as_the_dynamics_say_within_bounds() -> None:
    problem = cart(bounds={u: (-1, 1), v: (None, 0.4)})
    for seed in range(1, 12, 2):
        moved = motion(problem, start(problem, 0).guess, seed)
        t, (_, speed), (force,) = moved.t, moved.rows("x"), moved.rows("u")
        assert (moved.rows("x")[:, 0] == 0).all()
        assert speed.max() <= 0.4
        assert np.abs(force).max() <= 1.0
        inner = (speed[1:] < 0.4 - 1e-9) & (np.abs(speed[1:]) < 2.9) & (np.diff(force) == 0)
        assert np.diff(speed)[inner] == pytest.approx((np.diff(t) * force[:-1])[inner], abs=1e-12)


# -- one start, many starts


def test_a_start_ends_in_a_certified_word() -> None:
    found = explore(cart(), 0)
    assert found.certified
    assert found.solution.objective == pytest.approx(2.0, abs=1e-9)
    assert (found.solution.word, found.solution.method) == ("u: + -", "census")
    assert [node.stop for node in found.solution.nodes][-1] == "SOLVED"


def test_a_start_that_leads_nowhere_says_why() -> None:
    found = explore(cart(final_time=0.5), 0)
    assert found.solution is None
    assert "Infeasible" in found.error


def kept(folder: Path, number: int) -> Path:
    """Return the file of a start that was kept."""
    (path,) = folder.glob(f"start-{number:04d}-*.json")
    return path


def test_a_survey_counts_starts_in_clusters_and_keeps_them(tmp_path: Path) -> None:
    problem = cart()
    store = Store(tmp_path / "cart.census", fingerprint(problem, recipe()))
    seen: list[Progress] = []

    def watch(now: Progress, /) -> bool:
        seen.append(now)
        return False

    first = survey(problem, 2, store, watch)
    (extremal,) = first.extremals
    assert extremal.starts == (0, 1)
    assert (first.others, first.failed, first.interrupted) == ((), (), False)
    assert seen[0].stage == "0 of 2 starts, ipopt"
    assert math.isnan(seen[0].best)
    assert seen[-1].stage == "2 of 2 starts"
    assert seen[-1].best == pytest.approx(2.0)
    assert sorted(path.name for path in store.folder.iterdir()) == [
        f"start-{k:04d}-{store.key[:8]}.json" for k in range(2)
    ]

    stamp = kept(store.folder, 0).stat().st_mtime_ns
    again = survey(problem, 1, store)
    assert [each.number for each in again.outcomes] == [0]
    assert to_json(again.best) == to_json(first.outcomes[0].solution)
    assert kept(store.folder, 0).stat().st_mtime_ns == stamp


@pytest.mark.slow
def test_workers_find_what_this_process_finds(tmp_path: Path) -> None:
    store = Store(tmp_path / "cart.census", "key")
    here, there = survey(cart(), 2), survey(cart(), 2, store, workers=(2, Cart()))
    assert [each.about for each in there.outcomes] == [each.about for each in here.outcomes]
    for a, b in zip(here.outcomes, there.outcomes, strict=True):
        assert a.solution.objective == b.solution.objective
        assert (a.solution.rows("x") == b.solution.rows("x")).all()
    assert set(store.read()) == {0, 1}


def test_a_watch_that_has_seen_enough_ends_it() -> None:
    found = survey(cart(), 3, watch=lambda now: now.stage == "1 of 3 starts")
    assert found.interrupted
    assert [each.number for each in found.outcomes] == [0]


# -- clusters


def made(
    objective: float, switch: float = 0.5, residual: float = 1e-9, modes: str = "+-"
) -> Solution:
    t = np.linspace(0, 1, 3)
    arc = Arc(
        t=t,
        x=np.zeros((2, 3)),
        u=np.zeros((1, 3)),
        costate=np.zeros((2, 3)),
        mesh=np.array([0, 2]),
        side="both",
        modes=("*",),
    )
    verdict = Verdict(miss=0.0, findings=(Finding(kind=Condition.SIGN, residual=residual),))
    structure = {"u": ((modes[0], 0.0, switch), (modes[1], switch, 1.0))}
    return built(
        problem="p",
        method="m",
        arcs=(arc,),
        objective=objective,
        stop=Stop.SOLVED,
        state_names=("x", "v"),
        control_names=("u",),
        structure=structure,
        verdict=verdict,
    )


def test_extremals_are_apart_by_objective_and_by_word() -> None:
    rows = [
        made(2.0),
        made(1.0),
        made(1.0 + 1e-9, residual=1e-12),
        made(1.0, modes="-+"),
        made(1.0001),
    ]
    found = clusters([Outcome(k, "", each) for k, each in enumerate(rows)])
    assert [(each.starts, round(each.solution.objective, 6)) for each in found] == [
        ((1, 2), 1.0),
        ((3,), 1.0),
        ((4,), 1.0001),
        ((0,), 2.0),
    ]
    assert found[0].solution is rows[2]  # of the least residual


def test_what_is_not_certified_is_apart_by_objective_alone_and_never_the_best() -> None:
    doubtful = [
        made(0.5, residual=1e-2),
        made(0.5002, residual=1e-3, modes="-+"),
        made(0.6, residual=1.0),
    ]
    census = Census(
        5,
        (
            *(Outcome(k, "", each) for k, each in enumerate(doubtful)),
            Outcome(3, "", made(1.0)),
            Outcome(4, "", None, "no"),
        ),
    )
    assert [each.starts for each in census.others] == [(0, 1), (2,)]
    assert [each.starts for each in census.extremals] == [(3,)]
    assert census.best is census.outcomes[3].solution
    assert [each.number for each in census.failed] == [4]


def test_a_tally_without_a_solution_has_no_best() -> None:
    tally = Tally(2, lambda _now: False)
    assert not tally.add(0, Outcome(0, "", None, "no"))
    assert not tally.add(1, None)
    assert (tally.best, tally.census().died) == (None, (1,))


# -- kept starts


def test_kept_starts_of_another_formula_or_in_pieces_count_for_nothing(tmp_path: Path) -> None:
    store = Store(tmp_path / "c", "key")
    store.write(Outcome(0, "about", made(1.0)))
    store.write(Outcome(1, "about", None, "why"))
    assert {k: (each.about, each.error) for k, each in store.read().items()} == {
        0: ("about", ""),
        1: ("about", "why"),
    }
    assert to_json(store.read()[0].solution) == to_json(made(1.0))
    assert Store(tmp_path / "c", "other").read() == {}
    text = kept(tmp_path / "c", 0).read_text()
    json.loads(text)
    kept(tmp_path / "c", 0).write_text(text[:-20])
    kept(tmp_path / "c", 1).write_bytes(b"\xff\xfe")
    assert store.read() == {}


def test_the_fingerprint_is_of_the_formula_not_of_its_title() -> None:
    base = fingerprint(cart(), "r")
    assert base == fingerprint(cart(title="t", source="s"), "r")
    others = [
        cart(bounds={u: (-1, 2)}),
        cart(dynamics={x: v, v: 1.00000001 * u}),
        cart(end={x: 1}),
        cart(final_time=(1, 3)),
        cart(guess={final_time: 3.0}),
        cart(minimise=final_time + v**2),
        cart(bounds={u: (-1, 1), v: (None, 1)}),
        cart(target={"t": x <= 2}),
        cart(target={"t": x == 2}),
    ]
    assert len(
        {base, fingerprint(cart(), "other"), *(fingerprint(each, "r") for each in others)}
    ) == 2 + len(others)


# -- workers


@dataclass(frozen=True)
class Deadly:
    """A task that kills its worker at one number, always or only the first time."""

    folder: str
    at: int
    always: bool

    def __call__(self, number: int) -> int:
        flag = Path(self.folder) / "died"
        if number == self.at and (self.always or not flag.exists()):
            flag.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return number**2


@pytest.mark.parametrize(
    ("always", "lost"), [(True, None), pytest.param(False, 1, marks=pytest.mark.slow)]
)
def test_a_worker_that_dies_costs_its_job_alone(
    tmp_path: Path, always: bool, lost: int | None
) -> None:
    found = dict(results_of(Deadly(str(tmp_path), 1, always), deque(range(4)), 2))
    assert found == {0: 0, 1: lost, 2: 4, 3: 9}


def test_workers_are_there_before_there_is_a_job_for_each() -> None:
    jobs = deque([-1])
    found = results_of(abs, jobs, 2)
    assert next(found) == (-1, 1)
    assert len(multiprocessing.active_children()) == 2
    jobs.append(-3)
    assert list(found) == [(-3, 3)]


def test_dead_workers_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    outcome = Outcome(0, "", made(1.0))
    monkeypatch.setattr("socp.study.census.results_of", lambda *_: iter([(0, outcome), (1, None)]))
    found = survey(cart(), 2, workers=(2, Cart()))
    assert (found.died, [each.number for each in found.outcomes]) == ((1,), [0])


# -- the command


@pytest.fixture
def socp(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Callable[..., tuple]:
    (tmp_path / "cart.py").write_text(FILE)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "160")

    def call(*words: str) -> tuple[int, str, str]:
        code = main(list(words))
        said = capsys.readouterr()
        return code, said.out, said.err

    return call


def test_census_prints_a_table_and_writes_the_best(socp: Callable[..., tuple]) -> None:
    code, out, err = socp("census", "cart.py", "--starts", "2", "--quiet")
    assert (code, err) == (0, "")
    assert "Certified extremals" in out
    assert "Not certified" not in out
    assert "2 of 2 starts finished, 2 of them in a certified extremal" in out
    best = load("cart.socp.json")
    assert (best.method, best.options["starts"], best.word) == ("census", 2, "u: + -")
    code, out, _ = socp("census", "cart.py", "--starts", "2", "--json", "--out", "other.json")
    told = json.loads(out)
    (row,) = told["extremals"]
    assert (row["starts"], row["word"], told["finished"], told["result"]) == (
        [0, 1],
        "u: + -",
        2,
        "other.json",
    )
    assert row["switching_times"]["u"] == pytest.approx([1.0], abs=1e-6)


def test_census_without_an_extremal_is_exit_1(
    socp: Callable[..., tuple], monkeypatch: pytest.MonkeyPatch
) -> None:
    doubtful = replace(made(1.0, residual=1e-2), problem="cart")
    monkeypatch.setattr(
        "socp.study.census.explore", lambda _problem, number, _watch: Outcome(number, "", doubtful)
    )
    code, out, _ = socp("census", "cart.py", "--starts", "1", "--quiet")
    assert code == 1
    assert "Not certified" in out
    assert "Certified extremals" not in out


def _spawned(*words: str, cwd: Path) -> subprocess.Popen[str]:
    code = "import sys; from socp.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, *words]
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=cwd
    )


def _interrupted(process: subprocess.Popen[str]) -> tuple[str, str]:
    """Press Ctrl-C until it is heard: a single one may meet a moment in which Python drops
    exceptions.
    """
    for _ in range(12):
        process.send_signal(signal.SIGINT)
        try:
            return process.communicate(timeout=5)
        except subprocess.TimeoutExpired:
            continue
    raise AssertionError("not heard")


def test_what_ctrl_c_breaks_in_another_way_keeps_what_is_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Other code may turn an interrupt into an error of its own."""

    def broken(problem: Problem, number: int, watch: Watch) -> Outcome:
        if number == 0:
            return explore(problem, number, watch)
        with signals_held():
            os.kill(os.getpid(), signal.SIGINT)
        raise SystemError("a callback failed")

    monkeypatch.setattr("socp.study.census.explore", broken)
    with listening():
        found = survey(cart(), 3)
    assert found.interrupted
    assert len(found.outcomes) == 1


def _some_kept(folder: Path, process: subprocess.Popen[str]) -> None:
    for _ in range(600):  # more than there are workers: one at least is known to the command too
        if len(list(folder.glob("start-*.json"))) > 2 or process.poll() is not None:
            break
        time.sleep(0.1)


@pytest.mark.slow
@pytest.mark.parametrize("jobs", ["1", "2"])
def test_ctrl_c_keeps_what_is_there_and_the_next_run_goes_on(tmp_path: Path, jobs: str) -> None:
    (tmp_path / "cart.py").write_text(FILE)
    process = _spawned("census", "cart.py", "--starts", "500", "-j", jobs, cwd=tmp_path)
    _some_kept(tmp_path / "cart.census", process)
    out, err = _interrupted(process)
    assert process.returncode == 130
    assert "u: 1" in out, err
    assert "interrupted: " in err
    count = len(list((tmp_path / "cart.census").iterdir()))
    assert 0 < count < 500
    assert load(tmp_path / "cart.socp.json").extremal
    stamp = kept(tmp_path / "cart.census", 0).stat().st_mtime_ns
    process = _spawned("census", "cart.py", "--starts", "1", "--json", cwd=tmp_path)
    out, _ = process.communicate(timeout=60)
    assert json.loads(out)["finished"] == 1
    assert kept(tmp_path / "cart.census", 0).stat().st_mtime_ns == stamp


@pytest.mark.slow
def test_killed_workers_do_not_outlive_their_parent(tmp_path: Path) -> None:
    (tmp_path / "cart.py").write_text(FILE)
    process = _spawned("census", "cart.py", "--starts", "500", "-j", "2", "--quiet", cwd=tmp_path)
    _some_kept(tmp_path / "cart.census", process)
    listed = subprocess.run(
        ["ps", "-o", "pid=", "--ppid", str(process.pid)], capture_output=True, text=True, check=True
    )
    workers = [int(pid) for pid in listed.stdout.split()]
    process.kill()
    process.communicate(timeout=60)
    assert workers
    for _ in range(100):
        alive = [pid for pid in workers if Path(f"/proc/{pid}").exists()]
        if not alive:
            break
        time.sleep(0.1)
    assert not alive


@pytest.mark.slow
def test_census_of_the_reversing_vehicle() -> None:
    found = survey(Registry.load(only=()).problem("auv_reverse"), 6)
    objectives = [each.solution.objective for each in found.extremals]
    words = [each.solution.word for each in found.extremals]
    assert objectives[:2] == pytest.approx([14.4909772288644, 14.6202229437], abs=1e-8)
    assert words[:2] == ["r: + s -; f: + - + -", "r: - s +; f: + - + -"]
    assert any(each == pytest.approx(14.950161782153554, abs=1e-8) for each in objectives)

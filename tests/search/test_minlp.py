"""Mixed-integer solvers: what they say is checked, time limits hold, and the best verified point is
kept.
"""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path

import casadi
import numpy as np
import pytest
from socp_plugins.mboc import Mboc
from socp_problems.auv import problem as auv
from socp_problems.double_integrator_time import problem as integrator

from socp.errors import MethodError
from socp.methods.contract import options
from socp.methods.guess import default_guess
from socp.model import Mode
from socp.model.progress import Progress, silent
from socp.model.result.solution import Stop
from socp.search.integer.minlp import SOLVERS, available, minlp
from socp.search.integer.starts import starts
from socp.solvers.contract import NLP, NLPPoint
from socp.solvers.process import Job, Outcome, evaluated_point, solved_apart

x, z = casadi.SX.sym("x"), casadi.SX.sym("z")
# minimise x + z with x >= 1 - z: the best point is x = 1, z = 0, and x = 0, z = 1 is as good; z =
# 0.5 would cheat
TOY = NLP.of(
    v=casadi.vertcat(x, z),
    f=x + 2 * z,
    g=x + z,
    v_box=np.array([[0.0, 0.0], [9.0, 1.0]]),
    g_box=np.array([[1.0], [np.inf]]),
    binary=np.array([False, True]),
)
GUESS = NLPPoint(v=np.array([5.0, 0.5]))
TIME = 30.0  # more than a fake needs that ends by itself, on a busy machine

Fake = Callable[..., Outcome]


@pytest.fixture
def fake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Fake:
    """Run the body of a solver's `work(job, tell)` on the toy programme."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    def run(
        body: str, seconds: float = TIME, watch: Callable[[Progress], bool] = silent
    ) -> Outcome:
        lines = "\n".join(f"    {line}" for line in body.splitlines())
        (tmp_path / "fake_solver.py").write_text(
            f"import os, sys, time\ndef work(job, tell):\n{lines}\n"
        )
        return solved_apart(
            TOY, GUESS, Job("fake_solver", "fake", seconds, lambda _folder: {}), watch
        )

    return run


def test_an_honest_solver_is_believed_with_its_bound(fake: Fake) -> None:
    found = fake('tell({"v": [1.0, 0.0], "bound": 0.9, "status": "optimal", "nodes": 7})')
    assert found.point.stop is Stop.SOLVED
    assert found.point.objective == 1.0
    assert (found.bound, found.gap, found.nodes) == (0.9, pytest.approx(0.1), 7)
    assert (found.violation, found.integrality) == (0.0, 0.0)


def test_its_objective_is_not_taken_from_it(fake: Fake) -> None:
    assert (
        fake('tell({"v": [3.0, 0.0], "objective": -5.0, "status": "optimal"})').point.objective
        == 3.0
    )


@pytest.mark.parametrize(
    ("v", "said"),
    [
        ("[0.2, 0.0]", "its point violates the constraints by 0.8"),
        ("[0.5, 0.5]", "a binary of its point is 0.5 from 0 or 1"),
        ("[-1.0, 1.0]", "its point violates the constraints by 1"),
        ("[1.0]", "its point is not one of this problem"),
        ("[float('nan'), 0.0]", "its point is not one of this problem"),
    ],
)
def test_a_false_point_called_optimal_is_not_believed(v: str, said: str, fake: Fake) -> None:
    found = fake(f'tell({{"v": {v}, "status": "optimal", "bound": 0.2}})')
    assert not found.found
    assert found.point.stop is Stop.FAILED
    assert said in found.point.message
    assert "no feasible point" in found.point.message
    assert np.isnan(found.gap)
    assert found.point.v.tolist() == GUESS.v.tolist()


def test_the_best_verified_point_is_kept_beside_false_ones(fake: Fake) -> None:
    found = fake("""for v in ([4.0, 0.0], [1.5, 0.0], [2.0, 0.0], [0.0, 0.0]):
    tell({"v": v, "status": "optimal"})""")
    assert found.point.objective == 1.5
    assert "not believed: its point violates" in found.point.message


def test_garbage_is_passed_over(fake: Fake) -> None:
    found = fake("""tell({"v": [2.0, 0.0]})
with open(os.path.join(job["folder"], "told.jsonl"), "a") as file:
    file.write('\\x00\\xff not json\\n[1, 2]\\n{"v": "what"}\\n{"bound": []}\\n')
print("garbage " * 1000)
tell({"status": "limit"})""")
    assert found.point.objective == 2.0
    assert "cannot be read" in found.point.message


def test_a_solver_that_hangs_is_ended_with_its_children_and_its_point_kept(
    fake: Fake, tmp_path: Path
) -> None:
    found = fake(
        f"""import subprocess
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
open({str(tmp_path / "pid")!r}, "w").write(str(child.pid))
tell({{"v": [2.0, 0.0], "bound": 0.5}})
while True:
    time.sleep(1)""",
        seconds=3.0,
    )
    assert found.point.stop is Stop.LIMIT
    assert found.point.objective == 2.0
    assert found.bound == 0.5
    assert "did not keep its time limit and was ended" in found.point.message
    state, until = Path(f"/proc/{(tmp_path / 'pid').read_text()}/status"), time.time() + TIME
    while state.exists() and "zombie" not in state.read_text() and time.time() < until:
        time.sleep(0.02)  # a signal that was sent is not yet one that has arrived
    assert not state.exists() or "zombie" in state.read_text()


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("os.abort()", "it died with signal SIGABRT"),
        ("os._exit(3)", "it died with exit code 3"),
        ('raise ValueError("no licence")', "ValueError: no licence"),
        ("pass", "it ended without a word"),
    ],
)
def test_a_solver_that_dies_is_reported(body: str, said: str, fake: Fake) -> None:
    found = fake(body)
    assert found.point.stop is Stop.FAILED
    assert said in found.point.message


def test_a_point_outlives_a_solver_that_dies_after_it(fake: Fake) -> None:
    found = fake('tell({"v": [1.0, 0.0], "status": "optimal"})\nos.abort()')
    assert found.point.objective == 1.0
    assert found.point.stop is Stop.LIMIT  # it called the point optimal, and then died


def test_infeasible_is_a_status_of_its_own(fake: Fake) -> None:
    assert fake('tell({"status": "infeasible"})').point.stop is Stop.INFEASIBLE


def test_a_bound_above_a_feasible_point_is_none(fake: Fake) -> None:
    found = fake('tell({"v": [1.0, 0.0], "bound": 1.5, "status": "optimal"})')
    assert np.isnan(found.bound)
    assert "bound 1.5 lies above the objective of a feasible point" in found.point.message


def test_a_watch_that_answers_true_stops_it(fake: Fake) -> None:
    found = fake('tell({"v": [2.0, 0.0]})\ntime.sleep(600)', watch=lambda now: now.best == 2.0)
    assert found.point.stop is Stop.INTERRUPTED
    assert found.point.objective == 2.0


def test_ctrl_c_stops_it_with_its_best_point(fake: Fake) -> None:
    def press(_now: Progress) -> bool:
        threading.Timer(0.1, signal.raise_signal, [signal.SIGINT]).start()
        return False

    found = fake('tell({"v": [2.0, 0.0]})\ntime.sleep(600)', watch=press)
    assert found.point.stop is Stop.INTERRUPTED
    assert found.point.objective == 2.0


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the limit of processor time ends it")
def test_a_solver_ends_with_the_process_that_asked_for_it(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    (tmp_path / "fake_solver.py").write_text(
        f"import os, time\ndef work(job, tell):\n    open({str(tmp_path / 'pid')!r}, "
        "'w').write(str(os.getpid()))\n    time.sleep(600)\n"
    )
    asking = (
        "import json, os, pathlib, subprocess, sys, time\n"
        f"folder = pathlib.Path({str(folder)!r})\n"
        "(folder / 'job.json').write_text(json.dumps({'killed_after': 600, 'parent': "
        "os.getpid()}))\n"
        "subprocess.Popen([sys.executable, '-m', 'socp.solvers.worker', 'fake_solver', "
        "str(folder)],"
        " start_new_session=True)\n"
        "time.sleep(600)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    with subprocess.Popen([sys.executable, "-c", asking], env=environment) as parent:
        told = tmp_path / "pid"
        until = time.time() + TIME
        while not (told.exists() and told.read_text()) and time.time() < until:
            time.sleep(0.02)
        parent.kill()
    state = Path(f"/proc/{told.read_text()}/status")
    while state.exists() and "zombie" not in state.read_text() and time.time() < until:
        time.sleep(0.02)
    assert not state.exists() or "zombie" in state.read_text()


def test_optimal_is_a_word_that_is_not_repeated(fake: Fake) -> None:
    """A local branch and bound calls its point optimal: it has finished, and proves no more than
    its bound.
    """
    assert fake('tell({"v": [1.0, 0.0], "status": "optimal"})').point.message == "fake: finished"


def test_checking_rounds_binaries_and_looks_at_the_rounded_point() -> None:
    found = evaluated_point(TOY, np.array([0.99995, 0.00005]))
    assert found.point.v.tolist() == [0.99995, 0.0]
    assert found.integrality == pytest.approx(5e-5)
    assert found.violation == pytest.approx(5e-5)


def test_the_better_of_two_outcomes_keeps_the_bound_and_says_whose_point_it_is(fake: Fake) -> None:
    first = Outcome(
        point=NLPPoint(v=np.array([1.0, 0.0]), objective=1.0, message="bonmin: optimal"),
        violation=0.0,
    )
    later = fake('tell({"v": [2.0, 0.0], "bound": 0.5, "status": "limit"})').or_better(first)
    assert (later.point.objective, later.bound, later.gap) == (1.0, 0.5, 0.5)
    assert "the point is an earlier one, bonmin: optimal" in later.point.message


# -- the door


def test_an_unknown_solver_is_refused_with_those_there_are() -> None:
    with pytest.raises(
        MethodError, match="no mixed-integer solver 'baron'; available here: bonmin, gdpopt"
    ):
        minlp(auv, "baron", 4, 8, 1.0, default_guess(auv))


def test_a_solver_without_its_library_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("KNITRODIR", raising=False)
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    for name, missing in (("knitro", "no KNITRODIR"), ("gurobi", "'gurobipy'")):
        with pytest.raises(
            MethodError,
            match=f"solver '{name}' is not available: .*{missing}.*available here: bonmin",
        ):
            available(name)


def test_every_solver_says_in_a_sentence_what_it_is() -> None:
    (option,) = (each for each in options(Mboc) if each.name == "solver")
    named = option.metadata["doc"].removeprefix("search over words, or ").split(", ")
    assert set(named) == set(SOLVERS)
    assert all(each.about and "optimal" not in each.about for each in SOLVERS.values())


def test_layouts_hold_what_a_direct_solution_shows_and_short_arcs() -> None:
    found = starts(auv, 4, default_guess(auv))
    assert len(found) >= 2
    assert all(len(layout.arcs) == 5 for layout in found)
    modes = [tuple(map(str, arc.modes)) for arc in found[0].arcs]
    assert modes == [("*", "*"), ("s", "+"), ("s", "b[u.upper]"), ("s", "-"), ("*", "*")]
    assert all(arc.t[-1] > arc.t[0] for layout in found for arc in layout.arcs)
    (few,) = starts(auv, 0, default_guess(auv))
    assert len(few.arcs) == 1


def test_bonmin_finds_the_switch_of_the_double_integrator() -> None:
    found = minlp(integrator, "bonmin", 1, 4, 60.0, default_guess(integrator))
    assert found.stop is Stop.SOLVED
    assert found.objective == pytest.approx(integrator.reference.objective, abs=1e-5)
    assert {arc.modes for arc in found.arcs} == {(Mode("lower"),), (Mode("upper"),)}
    assert "feasible to" in found.message
    assert found.nodes[0].objective == found.objective
    assert np.isnan(found.nodes[0].bound)


@pytest.mark.slow
def test_bonmin_finds_the_word_of_the_auv() -> None:
    found = minlp(auv, "bonmin", 4, 14, 60.0, default_guess(auv))
    assert found.stop is Stop.SOLVED
    assert found.nodes[0].word == "r: + s s s +; f: + + b[u.upper] - -"
    assert found.objective == pytest.approx(14.950161782, abs=1e-5)


@pytest.mark.slow
def test_scip_proves_a_bound_of_the_auv() -> None:
    found = minlp(auv, "scip", 4, 4, 25.0, default_guess(auv))
    bound = found.nodes[0].bound
    assert 0.0 <= (found.objective - bound) / found.objective <= 0.08
    assert f"proved lower bound of the discretised problem {bound:.9g}" in found.message


@pytest.mark.slow
def test_scip_closes_the_gap_of_the_double_integrator() -> None:
    found = minlp(integrator, "scip", 1, 2, 60.0, default_guess(integrator))
    assert found.stop is Stop.SOLVED
    assert found.nodes[0].bound == pytest.approx(found.objective, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("solver", ["gdpopt", "mindtpy"])
def test_decompositions_end_with_their_status(solver: str) -> None:
    found = minlp(integrator, solver, 1, 3, 40.0, default_guess(integrator))
    assert found.message.startswith(f"{solver}: ")
    assert found.stop in {Stop.SOLVED, Stop.LIMIT}
    assert found.objective == pytest.approx(integrator.reference.objective, abs=1e-4)


@pytest.mark.slow
def test_gdpopt_ends_with_a_point_of_the_auv() -> None:
    found = minlp(auv, "gdpopt", 4, 8, 45.0, default_guess(auv))
    assert found.nodes[0].word
    assert found.objective < 15.0

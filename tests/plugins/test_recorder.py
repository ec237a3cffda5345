"""Recordings: what is in them is what is in the result, and nothing that happens to one costs a
solve.
"""

import os
import signal
import socket
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from records import revised
from socp_plugins.rerun import viewer

from socp.cli import main
from socp.errors import MethodError, SolveError
from socp.methods.chain import run
from socp.methods.guess import default_guess
from socp.model.data.files import load, save
from socp.model.problem import Problem
from socp.model.progress import Progress
from socp.model.result.solution import Solution
from socp.registry.plugins import Registry
from socp.view.picture import picture_of
from socp.view.recording.contents import Run, control, items
from socp.view.recording.items import Bars, Drawing, Lane, Note, Panel, Series
from socp.view.recording.iterates import control_lines, rows_window
from socp.view.recording.page import layout, panels, visible
from socp.view.recording.plane import ground, together
from socp.view.traces import traces

RERUN = Path(sys.executable).with_name("rerun")


@dataclass(frozen=True)
class Rows:
    """What a recording holds, read back: entity and timeline -> (times or counts, values); static
    texts by entity.
    """

    series: dict[tuple[str, str], tuple[np.ndarray, np.ndarray]]
    texts: dict[str, str]
    states: dict[str, list[str]]
    entities: set[str] = field(default_factory=set)


def read(path: Path) -> Rows:
    """Read a recording, whole or not, by rerun's own reader."""
    from rerun.chunk import RrdReader

    parts: dict[tuple[str, str], list[tuple[np.ndarray, np.ndarray]]] = {}
    rows = Rows({}, {}, {})
    for chunk in RrdReader(str(path)).stream():
        batch, entity = chunk.to_record_batch(), str(chunk.entity_path)
        rows.entities.add(entity)
        names = batch.schema.names
        if "TextDocument:text" in names:
            rows.texts[entity] = batch.column("TextDocument:text").to_pylist()[0][0]
        for timeline in {"t", "iteration", "refinement", "progress"} & set(names):
            at = batch.column(timeline).cast("int64").to_numpy() / (1e9 if timeline == "t" else 1)
            if "Scalars:scalars" in names:
                values = np.array([each[0] for each in batch.column("Scalars:scalars").to_pylist()])
                parts.setdefault((entity, timeline), []).append((at, values))
            if "StateChange:state" in names:
                rows.states[entity] = [
                    each[0] for each in batch.column("StateChange:state").to_pylist()
                ]
    for key, found in parts.items():
        at, values = (np.concatenate(column) for column in zip(*found, strict=True))
        order = np.argsort(at, kind="stable")
        rows.series[key] = (at[order], values[order])
    return rows


@dataclass(frozen=True)
class Recorded:
    problem: Problem
    solution: Solution
    path: Path
    rows: Rows
    said: str


@pytest.fixture(scope="module")
def auv(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Solve and record the vehicle by the command line, and read both files back."""
    import contextlib
    import io

    folder = tmp_path_factory.mktemp("auv")
    path, result = folder / "auv.rrd", folder / "auv.socp.json"
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        assert main(["solve", "auv", "--record", str(path), "--out", str(result)]) == 0
    return Recorded(Registry.load().problem("auv"), load(result), path, read(path), said.getvalue())


def equal(rows: Rows, entity: str, timeline: str, at: np.ndarray, values: np.ndarray) -> None:
    found_at, found = rows.series[entity, timeline]
    np.testing.assert_array_equal(found, values, err_msg=entity)
    np.testing.assert_allclose(found_at, at, rtol=0, atol=2e-9)  # whole nanoseconds


def test_states_costates_and_what_follows_are_those_of_the_result_bit_for_bit(
    auv: Recorded,
) -> None:
    values = traces(auv.problem, auv.solution)
    equal(auv.rows, "/time", "t", values.t, auv.solution.t)
    for k, name in enumerate(auv.problem.state_names):
        equal(auv.rows, f"/states/{name}", "t", values.t, auv.solution.rows("x")[k])
        equal(auv.rows, f"/costates/{name}", "t", values.t, auv.solution.rows("costate")[k])
    for k, name in enumerate(auv.problem.control_names):
        equal(auv.rows, f"/switching/{name}", "t", values.t, values.switching[k])
    equal(auv.rows, "/hamiltonian", "t", values.t, values.hamiltonian)
    for name, density in values.multipliers.items():
        known = np.isfinite(density)
        equal(auv.rows, f"/multipliers/{name}", "t", values.t[known], density[known])


def test_controls_jump_where_the_arcs_meet_and_hold_every_node_of_the_result(auv: Recorded) -> None:
    for k, name in enumerate(auv.problem.control_names):
        at, values = control(auv.solution, k)
        equal(auv.rows, f"/controls/{name}", "t", at, values)
        nodes = set(zip(auv.solution.t.tolist(), auv.solution.rows("u")[k].tolist(), strict=True))
        assert nodes <= set(zip(at.tolist(), values.tolist(), strict=True))
        for t in (end for _, _, end in auv.solution.structure[name][:-1]):
            before, after = values[np.abs(at - t) < 1e-12][[0, -1]]
            assert abs(after - before) > 0.1


def test_a_piecewise_constant_control_is_drawn_as_steps() -> None:
    registry = Registry.load()
    problem = registry.problem("double_integrator_time")
    solution = run(registry.method("euler-ipopt")(steps=20), problem, default_guess(problem))
    at, values = control(solution, 0)
    middle = 0.5 * (solution.arcs[0].t[1:] + solution.arcs[0].t[:-1])
    drawn = np.interp(middle, at, values)
    np.testing.assert_allclose(drawn, solution.at(middle, "u")[0], atol=1e-12)
    assert (np.diff(at) == 0).any()


def test_lanes_spell_the_word(auv: Recorded) -> None:
    for name, row in auv.solution.structure.items():
        assert auv.rows.states[f"/arcs/{name}"] == [*(mode for mode, _, _ in row), ""]


def test_the_solvers_trace_the_search_and_the_meshes_are_those_of_the_result(auv: Recorded) -> None:
    for name, values in auv.solution.effort.trace.items():
        equal(auv.rows, f"/solver/{name}", "iteration", np.arange(len(values)), np.array(values))
    objectives = np.array([node.objective for node in auv.solution.nodes])
    equal(auv.rows, "/search/objective", "refinement", np.arange(objectives.size), objectives)
    for k, mesh in enumerate((*auv.solution.effort.meshes, auv.solution.corners)):
        equal(auv.rows, f"/mesh/{k}", "t", np.array(mesh), np.full(len(mesh), float(k)))
    assert all(node.word in auv.rows.texts["/search/words"] for node in auv.solution.nodes)


def test_the_iterations_of_the_search_are_recorded_while_it_runs(auv: Recorded) -> None:
    count, objective = auv.rows.series["/progress/objective", "progress"]
    assert count.size > auv.solution.effort.iterations
    np.testing.assert_array_equal(count, np.arange(count.size))
    assert abs(objective[-1] - auv.solution.objective) < 1e-6
    assert "/progress/plan/iterate" in auv.rows.entities


def test_the_summary_and_the_properties_say_what_it_is(auv: Recorded) -> None:
    from rerun.chunk import RrdReader

    text = auv.rows.texts["/summary"]
    assert f"{auv.solution.objective:.12g}" in text
    assert "Verdict: extremal" in text
    (about,) = [
        c.to_record_batch()
        for c in RrdReader(str(auv.path)).stream()
        if str(c.entity_path).endswith("/socp")
    ]
    values = {name.split(":")[-1]: about.column(name).to_pylist()[0] for name in about.schema.names}
    assert values["schema"] == [1]
    assert values["problem"] == ["auv"]
    assert values["objective"] == [auv.solution.objective]


def test_the_scene_is_recorded(auv: Recorded) -> None:
    wanted = {"path", "start", "target", "flow", "switches", "now", "heading"}
    assert {f"/plan/{each}" for each in wanted} <= auv.rows.entities


def test_the_file_is_whole_and_small(auv: Recorded) -> None:
    done = subprocess.run(
        [RERUN, "rrd", "verify", auv.path], capture_output=True, text=True, check=True, env=quiet()
    )
    assert "1 file verified" in done.stdout + done.stderr
    assert auv.path.stat().st_size < 2_000_000
    assert f"socp view {auv.path}" in auv.said.replace("\n", "")


def quiet() -> dict[str, str]:
    return {**os.environ, "CI": "1"}


# -- what is laid out, for any problem


@pytest.fixture(scope="module")
def rough() -> tuple[Problem, Solution]:
    registry = Registry.load()
    problem = registry.problem("jacobson_1")
    return problem, run(registry.method("trapezoidal")(steps=40), problem, default_guess(problem))


def test_every_item_is_seen_in_a_panel_and_every_panel_shows_something(
    rough: tuple[Problem, Solution],
) -> None:
    found = items(*rough)
    shown = layout(*rough, found)
    seen = {id(each) for panel in panels(shown) for each in visible(found, panel)}
    hidden = {each.path for each in found if id(each) not in seen}
    kept = {"", "/solver", "/solver/log10", "/mesh", "/search"}  # beside the bars of the same
    assert {path.rsplit("/", 1)[0] for path in hidden} <= kept
    dark = [p.name for p in panels(shown) if p.contents[0].startswith(("/progress", "/help"))]
    assert [p.name for p in panels(shown) if not visible(found, p) and p.name not in dark] == []


def test_controls_of_an_iterate_stand_between_their_bounds(
    rough: tuple[Problem, Solution],
) -> None:
    problem, solution = rough
    (line,) = control_lines(problem, solution)
    (left, right), (low, high) = rows_window(1)
    assert (line[0, 0], line[-1, 0]) == (0.0, 2.5)
    assert left < line[0, 0] < line[-1, 0] < right
    assert low <= -line[:, 1].max()
    assert -line[:, 1].min() <= high, "y points down in a view"
    assert line[:, 1] == pytest.approx(0.8 * (control(solution, 0)[1] + 1) / 2, abs=1e-12)


def test_what_a_solver_did_shows_on_every_timeline(rough: tuple[Problem, Solution]) -> None:
    found = items(*rough)
    _, solver, _ = layout(*rough, found).parts
    assert {each.kind for each in panels(solver)} == {"bars", "plane", "text"}
    (plane,) = (each for each in panels(solver) if each.kind == "plane")
    rows = [each for each in visible(found, plane) if isinstance(each, Drawing)]
    assert len(rows) == len(rough[1].effort.meshes) + 1
    assert all(each.at is None for each in rows), "on no timeline, and so on all"
    assert plane.box is not None
    for row, mesh in zip(rows, (*rough[1].effort.meshes, rough[1].corners), strict=True):
        assert len(row.points) == len(mesh)
        low, high = np.sort(plane.box, axis=1).T
        assert ((low < row.points * [1, -1]) & (row.points * [1, -1] < high)).all()
    bars = {each.path: each for each in found if isinstance(each, Bars)}
    objective = np.array(rough[1].effort.trace["objective"])
    apart = bars["/solver/bars/objective"].values[0]
    assert apart == pytest.approx(np.log10(abs(objective[0] - objective[-1])), abs=1e-12)


def test_series_of_a_panel_differ_in_colour(rough: tuple[Problem, Solution]) -> None:
    found = items(*rough)
    for panel in panels(layout(*rough, found)):
        lines = [
            each for each in visible(found, panel) if isinstance(each, Series) and each.width == 1.5
        ]
        colours = [each.colour for each in lines]
        assert len(set(colours)) == len(colours) or len(colours) > 8, panel.name


def test_a_constant_is_not_shown_as_its_rounding(rough: tuple[Problem, Solution]) -> None:
    problem, solution = rough
    noisy = [
        Series(
            path="/hamiltonian",
            timeline="t",
            at=np.arange(3.0),
            values=-1 + 1e-12 * np.arange(3),
            name="H",
            colour=(1, 2, 3),
        )
    ]
    (panel,) = [p for p in panels(layout(problem, solution, noisy)) if p.name == "Hamiltonian"]
    assert panel.span is not None
    assert panel.span[1] - panel.span[0] > 0.1


def test_legends_stand_where_the_curves_are_not(rough: tuple[Problem, Solution]) -> None:
    t = np.linspace(0, 1, 11)
    rising = [
        Series(
            path=f"/costates/{k}",
            timeline="t",
            at=t,
            values=t + 0.01 * k,
            name=str(k),
            colour=(k, 2, 3),
        )
        for k in (0, 1)
    ]
    (panel,) = [p for p in panels(layout(*rough, rising)) if p.name == "Costates"]
    assert panel.legend in {"LeftTop", "RightBottom"}


def test_a_result_without_structure_and_verdict_is_shown_as_far_as_it_goes(
    rough: tuple[Problem, Solution],
) -> None:

    problem, solution = rough
    bare = revised(solution, structure={}, verdict=None, trace={}, nodes=(), meshes=())
    found = items(problem, bare)
    assert not [each for each in found if isinstance(each, Lane)]
    (text,) = [each.text for each in found if isinstance(each, Note)]
    assert "not judged" in text
    assert [each for each in found if isinstance(each, Drawing)]
    assert all(isinstance(each, Panel) for each in panels(layout(problem, bare, found)))


# -- commands


def test_record_writes_what_solve_records(
    auv: Recorded, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result, path = tmp_path / "auv.socp.json", tmp_path / "again.rrd"
    save(auv.solution, result)
    assert main(["record", str(result), "-o", str(path)]) == 0
    assert capsys.readouterr().out.strip() == str(path)
    again = read(path)
    for key, (at, values) in auv.rows.series.items():
        if not key[0].startswith("/progress"):
            np.testing.assert_array_equal(again.series[key][1], values)
            np.testing.assert_array_equal(again.series[key][0], at)


def test_compare_puts_the_runs_side_by_side(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "both.rrd"
    names = ["euler-ipopt", "trapezoidal"]
    arguments = [word for name in names for word in ("-m", name)]
    assert (
        main(
            [
                "compare",
                "jacobson_1",
                *arguments,
                "-o",
                "steps=20",
                "--record",
                str(path),
                "--quiet",
            ]
        )
        == 0
    )
    rows = read(path)
    for name in names:
        assert rows.series[f"/runs/{name}/states/x1", "t"][1].size >= 21
        assert name in rows.texts["/summary"]
    capsys.readouterr()


def test_runs_stand_on_one_ground_that_holds_them_all(rough: tuple[Problem, Solution]) -> None:
    from dataclasses import replace

    problem, solution = rough
    wide = replace(solution, arcs=tuple(replace(arc, x=2.0 * arc.x) for arc in solution.arcs))
    pictures = [picture_of(problem, each) for each in (solution, wide)]
    (box,) = [
        each for each in ground(together(pictures), "/plan") if each.path == "/plan/frame/box"
    ]
    assert isinstance(box, Drawing)
    for each in pictures:
        assert (box.points.min(axis=0) < each.path.T).all()
        assert (box.points.max(axis=0) > each.path.T).all()


def test_the_legend_of_several_runs_names_every_curve_once(rough: tuple[Problem, Solution]) -> None:
    first = picture_of(*rough)
    found = [
        each
        for label, among in (("a", None), ("b", first))
        for each in items(*rough, Run(f"/runs/{label}", (1, 2, 3), label, among))
    ]
    (panel,) = [
        p for p in panels(layout(*rough, found, ["/runs/a", "/runs/b"])) if p.name == "Control u"
    ]
    assert {each.name for each in visible(found, panel) if isinstance(each, Series)} == {
        "a u",
        "b u",
        "bound",
    }


def test_what_is_no_recording_is_not_opened_and_results_are_not_overwritten(
    rough: tuple[Problem, Solution], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    junk, result = tmp_path / "junk.rrd", tmp_path / "a.socp.json"
    junk.write_text("junk")
    assert main(["view", str(junk)]) == 1
    assert "is no recording" in capsys.readouterr().err
    save(rough[1], result)
    assert main(["solve", "jacobson_1", "--record", str(result)]) == 2
    assert "recordings end with .rrd" in capsys.readouterr().err
    assert load(result).stop.ok


def test_view_opens_the_native_viewer_on_this_computer_alone(
    auv: Recorded, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[list[str]] = []

    def started(command: list[str], **_more: Any) -> subprocess.CompletedProcess[str]:
        assert Path(command[-1]).stat().st_size > 1000
        calls.append(command)
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(viewer.subprocess, "run", started)
    monkeypatch.setenv("DISPLAY", ":0")
    result = tmp_path / "auv.socp.json"
    save(auv.solution, result)
    assert main(["view", str(auv.path)]) == 0
    assert main(["view", str(result)]) == 0
    for command in calls:
        assert command[command.index("--bind") + 1] == "127.0.0.1"
        assert "--web-viewer" not in command
    assert not Path(calls[1][-1]).exists()  # the recording of a result is temporary


# -- what may go wrong


def solved(folder: Path, *more: str, problem: str = "double_integrator_time") -> tuple[int, Path]:
    result = folder / "result.json"
    return main(
        ["solve", problem, "-m", "trapezoidal", "-o", "steps=20", "--out", str(result), *more]
    ), result


def one_line(said: str) -> str:
    (line,) = [line for line in said.splitlines() if line.startswith("warning:")]
    assert "Traceback" not in said
    return line


def test_a_missing_directory_is_refused_before_anything_is_solved(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, result = solved(tmp_path, "--record", str(tmp_path / "none" / "a.rrd"))
    assert code == 2
    assert "--record" in (said := capsys.readouterr().err)
    assert "there is no directory" in said
    assert not result.exists()
    assert solved(tmp_path, "--record", str(tmp_path))[0] == 2
    assert "is a directory" in capsys.readouterr().err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
@pytest.mark.slow
def test_a_full_disk_is_one_line_and_the_result_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, result = solved(tmp_path, "--record", "/dev/full")
    assert code == 0
    assert "No space left" in one_line(capsys.readouterr().err)
    assert load(result).stop.ok


FILLING = """
import resource, signal, sys
from socp.cli import main
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (150_000, 150_000))
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
def test_a_disk_that_fills_up_meanwhile_is_one_line_and_the_result_is_kept(tmp_path: Path) -> None:
    result, path = tmp_path / "result.json", tmp_path / "a.rrd"
    words = [
        "solve",
        "double_integrator_time",
        "-m",
        "trapezoidal",
        "-o",
        "steps=20",
        "--out",
        result,
        "--record",
        path,
    ]
    done = subprocess.run(
        [sys.executable, "-c", FILLING, *words],
        capture_output=True,
        text=True,
        check=False,
        env=quiet(),
    )
    assert done.returncode == 0, done.stderr
    assert "is the disk full?" in one_line(done.stderr)
    assert load(result).stop.ok


def test_a_missing_rerun_is_one_line_and_the_result_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    code, result = solved(tmp_path, "--record", str(tmp_path / "a.rrd"))
    assert code == 0
    assert "plugin 'rerun'" in one_line(capsys.readouterr().err)
    assert load(result).stop.ok


@pytest.mark.slow
def test_a_missing_viewer_is_one_line_and_the_file_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(viewer.sys, "executable", "/nowhere/python")
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setattr(viewer, "PORT", 1)
    monkeypatch.setattr(viewer.ready, "__defaults__", (1, 1.0))
    path = tmp_path / "a.rrd"
    code, result = solved(tmp_path, "--live", "--record", str(path))
    assert code == 0
    assert "there is no viewer 'rerun'" in one_line(capsys.readouterr().err)
    assert load(result).stop.ok
    assert ("/states/x", "t") in read(path).series


def test_a_viewer_that_ends_at_once_is_explained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = tmp_path / "rerun"
    broken.write_text("#!/bin/sh\necho starting >&2\necho 'Error: no display' >&2\nexit 7\n")
    broken.chmod(0o755)
    monkeypatch.setattr(viewer, "executable", lambda: str(broken))
    monkeypatch.setenv("DISPLAY", ":0")
    with pytest.raises(SolveError, match="ended with code 7: Error: no display"):
        viewer.ready(port=1)
    with pytest.raises(SolveError, match="ended with code 7: Error: no display"):
        viewer.show(tmp_path / "a.rrd")


@pytest.mark.slow
def test_a_computer_without_a_display_is_one_line_and_the_file_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(viewer.sys, "platform", "linux")
    monkeypatch.setattr(viewer.ready, "__defaults__", (1, 1.0))
    path = tmp_path / "a.rrd"
    code, _ = solved(tmp_path, "--live", "--record", str(path))
    assert code == 0
    assert "there is no display" in one_line(capsys.readouterr().err)
    assert ("/states/x", "t") in read(path).series


def test_a_viewer_that_ends_after_its_port_opened_is_explained(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    late = tmp_path / "rerun"
    late.write_text(
        "#!/bin/sh\nsleep 0.2\necho 'Error: os error at /x/y.rs:7: no screen' >&2\nexit 1\n"
    )
    late.chmod(0o755)
    monkeypatch.setattr(viewer, "executable", lambda: str(late))
    monkeypatch.setenv("DISPLAY", ":0")
    heard = iter([False])
    monkeypatch.setattr(viewer, "_listens", lambda _port: next(heard, True))
    with pytest.raises(SolveError, match="ended with code 1: Error: no screen"):
        viewer.ready()


def test_a_program_that_is_no_viewer_is_not_taken_for_one() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        assert not viewer.answers(other.getsockname()[1], patience=0.2)
        with pytest.raises(SolveError, match="no viewer"):
            viewer.ready(other.getsockname()[1])


@pytest.mark.slow
def test_rerun_turned_off_is_one_line(tmp_path: Path) -> None:
    words = [
        "solve",
        "double_integrator_time",
        "-m",
        "trapezoidal",
        "-o",
        "steps=20",
        "--record",
        tmp_path / "a.rrd",
        "--out",
        tmp_path / "result.json",
    ]
    command = [
        sys.executable,
        "-c",
        "import sys; from socp.cli import main; sys.exit(main(sys.argv[1:]))",
        *words,
    ]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env={**quiet(), "RERUN": "off"}
    )
    assert done.returncode == 0
    assert "turns rerun off" in one_line(done.stderr)


KILLED = """
import os, signal, sys, time
from pathlib import Path
from socp import default_guess, run
from socp.registry import Registry
registry = Registry.load()
problem = registry.problem("auv")
recorder = registry.recorder(problem, Path(sys.argv[1]))
count = 0
def watch(now):
    global count
    recorder(now)
    count += 1
    if count in (10, 11):
        time.sleep(0.6)
    if count == 15:
        os.kill(os.getpid(), signal.SIGKILL)
    return False
run(registry.method("euler-ipopt")(steps=100), problem, default_guess(problem), watch)
"""


@pytest.mark.slow
def test_a_solve_that_is_killed_leaves_a_recording_that_can_be_read(tmp_path: Path) -> None:
    path = tmp_path / "killed.rrd"
    done = subprocess.run(
        [sys.executable, "-c", KILLED, str(path)], capture_output=True, check=False, env=quiet()
    )
    assert done.returncode == -signal.SIGKILL, done.stderr
    with pytest.warns(Warning, match="no footer"):
        rows = read(path)
    count, objective = rows.series["/progress/objective", "progress"]
    assert count.size >= 10
    assert np.isfinite(objective).all()
    assert "/progress/plan/iterate" in rows.entities


STRANGER = """
from socp import hookimpl

class Recorder:
    def __init__(self, fails): self.fails, self.seen = fails, []
    def _do(self, what):
        self.seen.append(what)
        if what == self.fails: raise RuntimeError(f"{what} is broken")
    def __call__(self, now): self._do("call")
    def finish(self, problem, solution): self._do("finish")
    def close(self): self._do("close")

@hookimpl
def socp_recorder(problem, path, live, runs):
    recorder = Recorder(path.name)
    recorders.append(recorder)
    return recorder

recorders = []
"""


@pytest.mark.parametrize("fails", ["call", "finish", "close"])
def test_a_recorder_that_fails_is_one_line_and_is_left_alone(
    fails: str, install: Any, capsys: Any, tmp_path: Path
) -> None:
    module = f"stranger_{fails}"
    install(module, STRANGER, plugin="aa_stranger")
    result = tmp_path / "result.json"
    words = [
        "solve",
        "double_integrator_time",
        "-m",
        "trapezoidal",
        "-o",
        "steps=20",
        "--out",
        str(result),
    ]
    assert main(["--no-plugin", "rerun", *words, "--record", str(tmp_path / fails)]) == 0
    who, said = f"plugin 'aa_stranger' (stranger_{fails} 1.0)", one_line(capsys.readouterr().err)
    assert f"{who}: not recorded: RuntimeError: {fails} is broken" in said
    (recorder,) = sys.modules[module].recorders
    assert recorder.seen.count(fails) == 1
    assert recorder.seen[-1] == fails
    assert load(result).stop.ok


def test_without_a_recorder_it_is_said_how_to_find_out(tmp_path: Path) -> None:
    registry = Registry.load(without=["rerun"])
    with pytest.raises(MethodError, match="no plugin records"):
        registry.recorder(registry.problem("auv"), tmp_path / "a.rrd")


@pytest.mark.slow
def test_many_iterations_are_written_in_batches(tmp_path: Path) -> None:
    registry = Registry.load()
    path = tmp_path / "many.rrd"
    recorder = registry.recorder(registry.problem("jacobson_1"), path)
    for k in range(20_000):
        recorder(Progress("ipopt", k, float(k), 1.0))
    assert recorder.close()
    count, objective = read(path).series["/progress/objective", "progress"]
    np.testing.assert_array_equal(objective, np.arange(20_000.0))
    np.testing.assert_array_equal(count, np.arange(20_000))
    assert path.stat().st_size < 2_000_000


@pytest.mark.slow
def test_four_thousand_steps(tmp_path: Path) -> None:
    registry = Registry.load()
    problem = registry.problem("jacobson_1")
    solution = run(registry.method("euler-ipopt")(steps=4_000), problem, default_guess(problem))
    path = tmp_path / "long.rrd"
    recorder = registry.recorder(problem, path)
    recorder.finish(problem, solution)
    assert recorder.close()
    assert path.stat().st_size < 4_000_000
    equal(read(path), "/states/x1", "t", solution.t, solution.rows("x")[0])

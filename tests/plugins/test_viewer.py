"""What a person sees: recordings opened in rerun's viewer without a display, looked at view by
view.

Screenshots go to the folder that the environment variable SOCP_SCREENSHOTS names.
"""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from headless import Viewer, near, viewer, vulkan

from socp.cli import main
from socp.methods.chain import run
from socp.methods.guess import default_guess
from socp.model.problem import Problem
from socp.model.result.solution import Solution
from socp.registry.plugins import Registry
from socp.view.recording.contents import items
from socp.view.recording.items import Bars, Colour, Drawing, Group, Item, Lane, Panel, Series
from socp.view.recording.page import layout, panels, visible

pytestmark = [
    pytest.mark.viewer,
    pytest.mark.skipif(
        not vulkan(), reason="no Vulkan driver: apt-get install mesa-vulkan-drivers libvulkan1"
    ),
]
TABS = ("Solution", "Solver", "Progress")
SEEN = 6  # pixels of its colour that a curve shows at least: most of it may lie under another


@dataclass(frozen=True)
class Shown:
    problem: Problem
    solution: Solution
    path: Path
    items: list[Item]
    tabs: Group
    iterations: int


@pytest.fixture(scope="module")
def screen(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Viewer]:
    with viewer(tmp_path_factory.mktemp("home")) as found:
        yield found


@pytest.fixture(scope="module", params=["auv", "goddard_vlimit"])
def shown(request: Any, screen: Viewer, tmp_path_factory: pytest.TempPathFactory) -> Shown:
    """Open a recording of a solve in the viewer."""
    registry = Registry.load()
    problem, path = (
        registry.problem(request.param),
        tmp_path_factory.mktemp("recordings") / f"{request.param}.rrd",
    )
    recorder = registry.recorder(problem, path)
    solution = run(
        registry.method("auto")(), problem, default_guess(problem), lambda now: bool(recorder(now))
    )
    iterations = recorder.recorder.count
    recorder.finish(problem, solution)
    assert recorder.close(), recorder.complaints
    screen.open(path)
    found = items(problem, solution)
    return Shown(problem, solution, path, found, layout(problem, solution, found), iterations)


def save(screen: Viewer, name: str) -> None:
    """Save what the whole window shows, where that is asked for: it takes a second each."""
    from PIL import Image

    if given := os.environ.get("SOCP_SCREENSHOTS"):
        (folder := Path(given)).mkdir(parents=True, exist_ok=True)
        Image.fromarray(screen.picture()).save(folder / f"{name}.png")


def look(screen: Viewer, shown: Shown, tab: int, timeline: str, at: float) -> dict[str, np.ndarray]:
    """Return the picture of every view of a tab by name."""
    screen.tab(tab)
    screen.at(timeline, at)
    save(screen, f"{shown.problem.name}-{TABS[tab].lower()}-{timeline}")
    views = screen.views()
    group = shown.tabs.parts[tab]
    assert isinstance(group, Group)
    wanted = [panel.name for panel in panels(group)]
    assert set(wanted) <= set(views)
    assert {name: views[name].reports for name in wanted if views[name].reports} == {}
    return {name: screen.picture(views[name]) for name in wanted}


def panel(shown: Shown, name: str) -> Panel:
    return next(each for each in panels(shown.tabs) if each.name == name)


def unseen(shown: Shown, pictures: dict[str, np.ndarray], timeline: str) -> list[str]:
    """Return the items that should show on a timeline but whose colour is not in the picture of
    their view.
    """
    found = []
    for name, image in pictures.items():
        for each in visible(shown.items, panel(shown, name)):
            if (
                isinstance(each, Series)
                and each.timeline == timeline
                and np.isfinite(each.values).any()
            ):
                colours = (
                    []
                    if each.points and covered(each, visible(shown.items, panel(shown, name)))
                    else [each.colour]
                )
            elif isinstance(each, Lane) and timeline == "t":
                long = [
                    state
                    for state, length in zip(each.states, np.diff(each.at), strict=False)
                    if length > 0.02 * (each.at[-1] - each.at[0])
                ]
                colours = [dimmed(each.colours[state]) for state in long]
            elif isinstance(each, Bars) or (
                isinstance(each, Drawing)
                and each.kind != "arrows"
                and (each.at is None or timeline == "t")
            ):
                colours = [each.colour]
            else:
                continue
            found += [
                f"{name}: {each.path}" for colour in colours if near(image, colour, 45) < SEEN
            ]
    return found


def covered(marks: Series, others: list[Item]) -> bool:
    """Tell whether all marks of a series may lie under those of others: nearer than a mark is
    wide.
    """
    known = np.isfinite(marks.values)
    rest = [
        each for each in others if isinstance(each, Series) and each.points and each is not marks
    ]
    at, values = (
        np.concatenate([getattr(each, part) for each in rest] or [np.empty(0)])
        for part in ("at", "values")
    )
    wide, high = (
        np.ptp([*at, *marks.at]),
        np.ptp([v for v in (*values, *marks.values) if np.isfinite(v)]),
    )
    near_t = np.abs(at[:, None] - marks.at[known]) <= 0.02 * wide
    near_v = np.abs(values[:, None] - marks.values[known]) <= 0.06 * high
    return bool((near_t & near_v).any(axis=0).all())


def dimmed(colour: Colour) -> Colour:
    """Return the colour in which the viewer draws a lane of a given one."""
    red, green, blue = (round(0.785 * part) for part in colour)
    return red, green, blue


def test_the_solution_is_seen(screen: Viewer, shown: Shown) -> None:
    pictures = look(screen, shown, 0, "t", 0.3 * shown.solution.final_time)
    assert unseen(shown, pictures, "t") == []
    assert near(pictures["Summary"], (255, 255, 255), 60) > 500  # there is text


def test_the_solver_is_seen(screen: Viewer, shown: Shown) -> None:
    pictures = look(screen, shown, 1, "iteration", 3)
    assert unseen(shown, pictures, "iteration") == []
    pictures = look(screen, shown, 1, "t", 0.3 * shown.solution.final_time)
    assert unseen(shown, pictures, "t") == []


def test_the_solve_as_it_ran_is_seen(screen: Viewer, shown: Shown) -> None:
    pictures = look(screen, shown, 2, "progress", shown.iterations)
    for name, image in pictures.items():
        assert int((image.max(axis=2) > 90).sum()) > 100, name
    blue = near(pictures["Iterates in the plane"], (70, 140, 215), 45)
    assert blue > 50


def test_the_viewer_has_no_errors_to_report(screen: Viewer, shown: Shown) -> None:
    assert shown.path.exists()
    assert screen.errors() == []


def test_a_solve_is_streamed_to_the_viewer_and_to_the_file_at_once(
    screen: Viewer, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from socp_plugins.rerun import viewer as native

    monkeypatch.setattr(native.ready, "__defaults__", (screen.port, 1.0))
    path = tmp_path / "live.rrd"
    words = [
        "-m",
        "trapezoidal",
        "-o",
        "steps=40",
        "--quiet",
        "--out",
        str(tmp_path / "result.json"),
    ]
    assert main(["solve", "double_integrator_vlimit", *words, "--live", "--record", str(path)]) == 0
    assert path.stat().st_size > 10_000
    found = screen.recordings("socp-double_integrator_vlimit")
    assert [sorted(each.name for each in one.timelines) for one in found] == [
        ["iteration", "progress", "refinement", "t"]
    ]


def test_a_viewer_that_is_closed_meanwhile_costs_a_line_and_the_recording_is_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from socp_plugins.rerun import viewer as native

    path, registry = tmp_path / "a.rrd", Registry.load()
    problem = registry.problem("double_integrator_vlimit")
    (home := tmp_path / "home").mkdir()
    with viewer(home) as closed:
        monkeypatch.setattr(native.ready, "__defaults__", (closed.port, 1.0))
        recorder = registry.recorder(problem, path, native.ready())
    solution = run(registry.method("trapezoidal")(steps=20), problem, default_guess(problem))
    recorder.finish(problem, solution)
    assert not recorder.close()
    (line,) = recorder.complaints
    assert "the viewer is gone" in line
    assert "is whole" in line


def test_runs_side_by_side_are_seen(screen: Viewer, tmp_path: Path) -> None:
    path = tmp_path / "both.rrd"
    words = [
        "-m",
        "euler-ipopt",
        "-m",
        "trapezoidal",
        "-o",
        "steps=40",
        "--quiet",
        "--record",
        str(path),
    ]
    assert main(["compare", "jacobson_1", *words]) == 0
    screen.open(path)
    screen.at("t", 1.0)
    save(screen, "compare")
    views = screen.views()
    image = screen.picture(views["State x1"])
    assert near(image, (70, 140, 215), 45) >= SEEN
    assert near(image, (225, 115, 50), 45) >= SEEN
    assert not any(view.reports for view in views.values())

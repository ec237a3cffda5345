"""Recordings of branches: objective, times and trajectories over the number, read back and seen."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from headless import near, viewer, vulkan
from ponds import POND
from socp_plugins.rerun.recorder import written

from socp.cli import main
from socp.registry import solve
from socp.study import Branch, Event, Point
from socp.view import PALETTE, Page, Series, branch_page


@pytest.fixture(scope="module")
def branch() -> Branch:
    """Return a branch that turns back: twice the same values, the second time from 0.4 to 0.2."""
    up = [
        Point(each, solve(POND.with_(level=each), method="lgr-multiphase", word="- s +"))
        for each in (0.2, 0.3, 0.4)
    ]
    fold = Event(0.45, 1e-9, "fold", "level", float("nan"), "u: - s +", "u: - s +", 3)
    return Branch("pond", "level", (*up, *up[::-1]), (fold,))


def page(found: Branch, factor: float = 1.0) -> Page:
    rows = [{**row, "value": factor * row["value"]} for row in found.rows]
    return branch_page(found.name, [each.solution for each in found.points], rows)


def chunks(path: Path) -> list[Any]:
    from rerun.chunk import RrdReader

    return [(str(c.entity_path), c.to_record_batch()) for c in RrdReader(str(path)).stream()]


def test_curves_are_over_the_number_piece_by_piece(branch: Branch) -> None:
    found = page(branch)
    series = {each.path: each for each in found.items if isinstance(each, Series)}
    assert found.timeline == "level"
    for k in (0, 1):
        assert series[f"/objective/{k}"].at == pytest.approx([0.2, 0.3, 0.4])
        exact = [2 / 3 * (1 - level) ** 3 for level in (0.2, 0.3, 0.4)]
        assert series[f"/objective/{k}"].values == pytest.approx(exact, rel=1e-8)
        assert series[f"/times/0/{k}"].values == pytest.approx([0.8, 0.7, 0.6], abs=1e-8)
    assert np.array_equal(series["/objective/1"].along, [5, 4, 3])


@pytest.mark.parametrize(
    ("factor", "called"), [(1e-6, "level / 1e-9"), (1e9, "level / 1e6"), (-2.0, "level")]
)
def test_a_timeline_counts_in_units_that_fit(branch: Branch, factor: float, called: str) -> None:
    found = page(branch, factor)
    assert found.timeline == called
    first = next(each for each in found.items if isinstance(each, Series))
    assert 0.1 <= np.abs(first.at).max() < 1000


def test_a_recording_holds_the_branch(branch: Branch, tmp_path: Path) -> None:
    path = tmp_path / "pond.rrd"
    written(path, "pond", page(branch))
    frames = [
        (batch.column("level").cast("int64").to_pylist(), batch.column("point").to_pylist())
        for entity, batch in chunks(path)
        if entity.startswith("/rows/piece") and "level" in batch.schema.names
    ]
    seen = sorted((p, t) for ts, ps in frames for t, p in zip(ts, ps, strict=True))
    billion = [200_000_000, 300_000_000, 400_000_000, 400_000_001]
    assert [t for _, t in seen if _ in {0, 1, 2}] == billion[:3]
    assert {t for _, t in seen} == set(billion)
    texts = [b.column("TextDocument:text").to_pylist() for e, b in chunks(path) if e == "/summary"]
    assert "| 0.45 | nan | fold: level |" in texts[0][0][0]


def test_follow_records(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import socp.cli.commands.following as command

    monkeypatch.chdir(tmp_path)
    file = f"{Path(__file__).parents[1] / 'ponds.py'}:POND"
    start = solve(POND.with_(level=0.3), method="lgr-multiphase", word="- s +")
    monkeypatch.setattr(command, "_start", lambda *_: start)
    words = ["follow", file, "--set", "level=0.3:0.31", "--steps", "1", "--quiet"]
    assert main([*words, "--record", "pond.rrd"]) == 0
    assert {entity for entity, _ in chunks(tmp_path / "pond.rrd")} >= {"/objective/0", "/times/0/0"}
    assert main([*words, "--record", "pond.json"]) == 2


@pytest.mark.viewer
@pytest.mark.skipif(
    not vulkan(), reason="no Vulkan driver: apt-get install mesa-vulkan-drivers libvulkan1"
)
def test_a_branch_is_seen(branch: Branch, tmp_path: Path) -> None:
    path = tmp_path / "pond.rrd"
    turned = [replace(each, value=0.6 - each.value) for each in branch.points[3:]]
    found = replace(branch, points=(*branch.points[:3], *turned))
    written(path, "pond", page(found))
    (home := tmp_path / "home").mkdir()
    with viewer(home) as screen:
        screen.open(path)
        screen.client.set_time("level", duration=0.3, play_state="paused")
        views = screen.views()
        assert not any(each.reports for each in views.values())
        for name in ("Objective", "Times between arcs, and the last"):
            image = screen.picture(views[name])
            assert near(image, PALETTE[0], 45) > 5
            assert near(image, PALETTE[1], 45) > 5
        moving = screen.picture(views["States and controls over time"])
        assert near(moving, PALETTE[0], 45) > 50
        assert screen.errors() == []

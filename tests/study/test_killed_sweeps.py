"""A sweep that is killed again and again ends in the table that it would have ended in."""

import json
import os
import signal
import subprocess
import sys
import time
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import ponds
import pytest
from ponds import POND

from socp.study import points, sweep
from socp.view import rows_from_parquet

KILLS = 8  # in turn of the command, and of one of its workers with the command asked to stop
RANGE = "1.6:3.1:24"


@cache
def uninterrupted() -> list[dict[str, Any]]:
    return same(sweep(POND, points({"final_time": RANGE})).rows)


def same(rows: Any) -> list[dict[str, Any]]:
    return [{k: v for k, v in row.items() if k != "seconds"} for row in rows]


@pytest.mark.slow
def test_killed_at_random_it_ends_in_the_same_table(tmp_path: Path) -> None:
    file = f"{ponds.__file__}:POND"
    words = ("sweep", file, "--set", f"final_time={RANGE}", "-j", "2", "--quiet")
    command = [sys.executable, "-m", "socp.cli", *words]
    random = np.random.default_rng(0)
    for kill in range(KILLS):
        process = subprocess.Popen(command, cwd=tmp_path, stdout=subprocess.DEVNULL)
        time.sleep(random.uniform(0.5, 4.5))
        if kill % 2:
            process.kill()
            process.wait()
        else:
            _kill_a_child(process.pid)
            process.send_signal(signal.SIGTERM)
            process.wait(timeout=120)
    assert subprocess.run(command, cwd=tmp_path, check=False, capture_output=True).returncode == 0
    rows, facts = rows_from_parquet(tmp_path / "pond.sweep.parquet")
    assert facts["certified"] == 24
    assert same(rows) == uninterrupted()


def _kill_a_child(pid: int) -> None:
    listed = subprocess.run(
        ["ps", "-o", "pid=", "--ppid", str(pid)], capture_output=True, text=True, check=False
    )
    children = [int(each) for each in listed.stdout.split()]
    if children:
        os.kill(children[-1], signal.SIGKILL)


@pytest.mark.slow
def test_a_scheduler_that_is_killed_costs_what_is_under_way(tmp_path: Path) -> None:
    file, told = f"{ponds.__file__}:POND", tmp_path / "scheduler.json"
    sweeping = ("sweep", file, "--set", f"final_time={RANGE}", "--quiet")
    command = [sys.executable, "-m", "socp.cli", *sweeping]
    quiet: Any = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "cwd": tmp_path}

    def started(part: str, *words: str) -> Any:
        code = f"from distributed.cli.dask_{part} import main; main()"
        return subprocess.Popen([sys.executable, "-c", code, *words, "--no-dashboard"], **quiet)

    def until(ready: Any) -> None:
        last = time.monotonic() + 120
        while not ready():
            assert time.monotonic() < last
            time.sleep(0.1)

    parts = [
        started("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(told))
    ]
    try:
        until(told.exists)
        address = json.loads(told.read_text())["address"]
        parts.append(started("worker", address, "--nthreads", "1"))
        process = subprocess.Popen([*command, "--dask", address], **quiet)
        parts.append(process)
        until(lambda: [*(tmp_path / "pond.sweep").rglob("*.json")])
        parts[0].kill()
        assert process.wait(timeout=120) == 0
        rows, facts = rows_from_parquet(tmp_path / "pond.sweep.parquet")
        assert 0 < facts["certified"] < 24
        assert {row["message"] for row in rows} == {"", "its worker died"}
    finally:
        for each in parts:
            each.kill()
            each.wait()
    assert subprocess.run(command, check=False, **quiet).returncode == 0
    rows, facts = rows_from_parquet(tmp_path / "pond.sweep.parquet")
    assert facts["certified"] == 24
    assert same(rows) == uninterrupted()

"""Solve a folder of problem files cold, each in a process of its own, and hold what comes out
against known values.

`python benchmarks/field.py FOLDER [NAME ...] [--seconds S]` runs `socp solve FILE` for every file
of the folder, with no option, and prints rung, objective, distance from the value in
FOLDER/truth.json, seconds and word, then one of four classes:

- certified: an extremal, and as good as known to six digits or all that are trusted;
- near: not certified, approximately extremal, and as good as known to four digits;
- honest: nothing certified, nothing claimed that is not so;
- wrong: certified and worse than known, a crash, or no answer within the time.

truth.json: {"name": {"objective": value, "digits": trusted digits, ...}, ...}.
"""

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

CERTIFIED, NEAR = 1e-6, 1e-4  # relative to the known objective
CLASSES = ("certified", "near", "honest", "wrong")


@final
@dataclass(frozen=True)
class Row:
    """What one file came to."""

    name: str
    rung: str
    objective: float
    known: float
    seconds: float
    word: str
    kind: str

    def __str__(self) -> str:
        off = (
            (self.objective - self.known) / max(abs(self.known), 1e-12)
            if math.isfinite(self.known)
            else math.nan
        )
        return (
            f"{self.name:24} {self.rung:10} {self.objective:16.10g} {off:10.1e} {self.seconds:7.1f}"
            f"  {self.kind:9}  {self.word[:70]}"
        )


def solved(file: Path, seconds: float) -> tuple[dict[str, Any], int | None, float]:
    """Return the answer of `socp solve` as data, its exit code (None where it took too long), and
    its seconds.
    """
    command = [sys.executable, "-m", "socp.cli", "solve", str(file.resolve()), "--json", "--quiet"]
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        try:
            done = subprocess.run(  # noqa: S603 - our own command
                command,
                cwd=folder,
                env=environment,
                capture_output=True,
                text=True,
                timeout=seconds,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return {}, None, time.perf_counter() - began
    took = time.perf_counter() - began
    try:
        return json.loads(done.stdout), done.returncode, took
    except json.JSONDecodeError:
        return {}, done.returncode, took


def judged(
    name: str, truth: dict[str, Any], answer: dict[str, Any], code: int | None, took: float
) -> Row:
    """Sort an answer into its class."""
    verdict = answer.get("verdict") or {}
    objective = answer.get("objective")
    value = math.nan if objective is None else float(objective)
    known = float(truth.get("objective", math.nan))
    size = max(abs(known), 1e-9)
    worse = (value - known) / size if math.isfinite(known) else 0.0
    trusted = 10.0 ** (1 - truth.get("digits", 6))
    rung = "time" if code is None else "crash" if not answer else "none"
    if answer:
        rung = (
            "extremal"
            if verdict.get("extremal")
            else "approx"
            if verdict.get("approximate")
            else "feasible"
            if verdict.get("feasible")
            else "infeasible"
        )
    if rung in {"time", "crash"}:
        kind = "wrong"
    elif rung == "extremal":
        kind = "certified" if worse <= max(CERTIFIED, trusted) else "wrong"
    else:
        kind = "near" if rung == "approx" and abs(worse) <= max(NEAR, trusted) else "honest"
    return Row(name, rung, value, known, took, answer.get("word") or "", kind)


def main() -> None:
    """Run the files and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "names", nargs="*", help="files of the folder, without their ending; all of them by default"
    )
    parser.add_argument("--seconds", type=float, default=120.0, help="allowed for one file")
    given = parser.parse_args()
    path = given.folder / "truth.json"
    truth = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    files = [
        file
        for file in sorted(given.folder.glob("*.py"))
        if not given.names or file.stem in given.names
    ]
    print(f"{'name':24} {'rung':10} {'objective':>16} {'off':>10} {'seconds':>7}  class      word")
    rows = []
    for file in files:
        rows.append(judged(file.stem, truth.get(file.stem, {}), *solved(file, given.seconds)))
        print(rows[-1], flush=True)
    counted = {kind: sum(row.kind == kind for row in rows) for kind in CLASSES}
    print(", ".join(f"{kind} {number}" for kind, number in counted.items()), f"of {len(rows)}")
    times = [row.seconds for row in rows]
    print(f"median {statistics.median(times):.1f} s, longest {max(times):.1f} s")


if __name__ == "__main__":
    main()

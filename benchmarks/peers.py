"""Solve a few problems with other programs, as their documentation recommends, beside `auto`.

`python benchmarks/peers.py FOLDER` makes an environment for every peer in a folder, where it is not
there yet, gives all of them the same statements and straight lines as guesses, allows each run
120 s, and writes docs/peers.md. Runs that FOLDER has already are kept: remove its `runs` to
measure again. What every peer is told is in benchmarks/peers/with_PEER.py.
"""

import ast
import json
import os
import platform
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from socp import Problem
from socp.registry import Registry
from socp.view import formula

ROOT = Path(__file__).parents[1]
HERE = ROOT / "benchmarks" / "peers"
# The package of every peer, which pip is asked for; none for ours, which runs as it is installed
PEERS = {
    "socp": "",
    "casadi": "casadi",
    "rockit": "rockit-meco",
    "yapss": "yapss",
    "maptor": "maptor",
    "gekko": "gekko",
    "dymos": "dymos",
    "opty": "opty",
}
PROBLEMS = (
    "auv", "double_integrator_time", "rayleigh_time", "vdp_regulator", "catalyst_mixing",
    "lotka_fishing", "goddard_vlimit", "robot_arm",
)  # fmt: skip
LIMIT = 120  # seconds of the processor that a run has
_PATIENCE = 8 * LIMIT  # seconds on the clock, where others use the machine too
_ROOM = 10.0  # how many times shorter and longer than its guess a free final time may be
_LATE = f"not done after {LIMIT} s"
_MARK = 5  # characters of a line that is no more than a mark
_MESSAGE = 150  # characters of a failure's message that are shown


def statement(problem: Problem) -> dict[str, Any]:
    """Return a problem as `peers/common.py` takes it, a running cost as a state `cost`."""
    states = list(problem.state_names)
    dynamics = [formula(rate) for rate in problem.dynamics.values()]
    parts = [] if problem.minimise is None else [formula(problem.minimise)]
    boxes = {"box": problem.state_box, "start": problem.start_box, "end": problem.end_box}
    if problem.running is not None:
        states, dynamics = [*states, "cost"], [*dynamics, formula(problem.running)]
        parts.append("cost")
        column = {"box": [-np.inf, np.inf], "start": [0.0, 0.0], "end": [-np.inf, np.inf]}
        boxes = {name: np.column_stack([box, column[name]]) for name, box in boxes.items()}
    relations = [formula(each).split(" <= ") for each in problem.target.values()]
    horizon = problem.final_time_box
    return {
        "states": states,
        "controls": list(problem.control_names),
        "dynamics": dynamics,
        "objective": " + ".join(parts),
        "relations": [f"{left} - ({right})" for left, right in relations],
        **{name: _rows(box) for name, box in boxes.items()},
        "control_box": _rows(problem.box),
        "horizon": _rows(np.array(horizon)[:, None]),
    }


def guessed(name: str, problem: Problem, folder: Path) -> None:
    """Write a statement for all peers, with bounds on a free final time, which several need, and
    one to begin from: the true one in one digit. `auto`, run first, does not see these.
    """
    given, path = statement(problem), folder / f"{name}.json"
    path.write_text(json.dumps(given))
    found = measured("socp", Path(sys.executable), name, folder)
    guess = float(f"{found['final_time']:.1g}")
    low, high = problem.final_time_box
    if low < high:
        given["horizon"] = [[guess / _ROOM], [guess * _ROOM]]
    path.write_text(json.dumps({**given, "guess": guess}))


def _rows(box: np.ndarray) -> list[list[float | None]]:
    return [[float(each) if np.isfinite(each) else None for each in row] for row in box]


def interpreter(peer: str, folder: Path) -> tuple[Path | None, str]:
    """Return the Python of a peer's own environment and what is said of it; None where pip did not
    install it, and the last line that pip wrote.
    """
    package = PEERS[peer]
    if not package:
        return Path(sys.executable), version("socp")
    home = folder / peer
    python, log = home / "bin" / "python", home / "pip.log"
    if not log.exists():
        subprocess.run([sys.executable, "-m", "venv", str(home)], check=True)  # noqa: S603
        made = [python, "-m", "pip", "install", "-q", "--prefer-binary", package]
        done = subprocess.run(  # noqa: S603
            list(map(str, made)), capture_output=True, text=True, check=False
        )
        log.write_text("" if done.returncode == 0 else done.stderr + done.stdout)
    wrong = [line for line in log.read_text().splitlines() if "Error" in line]
    if log.read_text():
        return None, wrong[-1].strip() if wrong else "pip did not install it"
    ask = f"from importlib.metadata import version; print(version({package!r}))"
    said = subprocess.run([str(python), "-c", ask], capture_output=True, text=True, check=True)  # noqa: S603
    return python, said.stdout.strip()


def measured(peer: str, python: Path, name: str, folder: Path) -> dict[str, Any]:
    """Return what a run of a peer gave, kept in a file of the folder; `failure` where it gave
    nothing.
    """
    kept = folder / "runs" / f"{name}-{peer}.json"
    if kept.exists():
        found: dict[str, Any] = json.loads(kept.read_text())
        return found
    script = [str(python), str(HERE / f"with_{peer}.py"), str(folder / f"{name}.json")]
    alone = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
    work = folder / "work" / peer
    work.mkdir(parents=True, exist_ok=True)
    begin = time.perf_counter()
    try:
        done = subprocess.run(  # noqa: S603
            script, capture_output=True, text=True, timeout=_PATIENCE, check=False, cwd=work,
            env=alone, preexec_fn=_limited
        )  # fmt: skip
        lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
        found = json.loads(lines[-1]) if done.returncode == 0 and lines else _failure(done)
    except subprocess.TimeoutExpired:
        found = {"failure": _LATE}
    found.setdefault("seconds", time.perf_counter() - begin)
    kept.parent.mkdir(parents=True, exist_ok=True)
    kept.write_text(json.dumps(found))
    return found


def _limited() -> None:
    resource.setrlimit(resource.RLIMIT_CPU, (LIMIT, LIMIT + 1))


def _failure(done: subprocess.CompletedProcess[str]) -> dict[str, str]:
    """Return the last line of an error that says something."""
    if done.returncode in {-signal.SIGXCPU, -signal.SIGKILL}:
        return {"failure": _LATE}
    written = done.stderr
    lines = [line.strip() for line in written.splitlines() if len(line.strip()) > _MARK]
    return {"failure": lines[-1] if lines else "no message"}


def variation(found: dict[str, Any]) -> float:
    """Return the total variation of all controls, of their values along time."""
    if "variation" in found:
        return float(sum(found["variation"]))
    return float(sum(np.abs(np.diff(row)).sum() for row in found["u"]))


def code_lines(peer: str) -> int:
    """Return the lines of code of a peer's script, without docstrings, imports and its last two."""
    tree = ast.parse((HERE / f"with_{peer}.py").read_text())
    kept = [node for node in ast.walk(tree) if isinstance(node, ast.stmt) and not _aside(node)]
    lines = {line for node in kept for line in _lines_of(node)}
    return len(lines)


def _aside(node: ast.stmt) -> bool:
    text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    main = isinstance(node, ast.If) and "__main__" in ast.dump(node.test)
    call = isinstance(node, ast.Expr) and ast.unparse(node) == "main(solve)"
    return text or main or call or isinstance(node, (ast.Import, ast.ImportFrom))


def _lines_of(node: ast.stmt) -> range:
    """Return the lines of a statement; of one with a body its head."""
    body = getattr(node, "body", None)
    last = body[0].lineno - 1 if body else node.end_lineno
    return range(node.lineno, max(last or node.lineno, node.lineno) + 1)


def about(peer: str) -> str:
    """Return how a peer is used: the docstring of its script."""
    said = ast.get_docstring(ast.parse((HERE / f"with_{peer}.py").read_text())) or ""
    return " ".join(said.split()).partition(": ")[2]


def page(folder: Path) -> Iterator[str]:
    """Yield the lines of the page."""
    registry = Registry.load()
    problems = {name: registry.problem(name) for name in PROBLEMS}
    for name, problem in problems.items():
        guessed(name, problem, folder)
    homes = {peer: interpreter(peer, folder) for peer in PEERS}
    yield from _head()
    yield "| program | version | how it is used | lines |"
    yield "|---|---|---|---|"
    for peer, (python, said) in homes.items():
        if python is None:
            yield f"| {peer} | none | pip did not install it: `{said[:_MESSAGE]}` | |"
        else:
            yield f"| {peer} | {said} | {about(peer)} | {code_lines(peer)} |"
    for name, problem in problems.items():
        rows = {
            peer: measured(peer, python, name, folder)
            for peer, (python, _) in homes.items()
            if python is not None
        }
        yield from _table(name, problem, rows)


def _table(name: str, problem: Problem, rows: dict[str, dict[str, Any]]) -> Iterator[str]:
    """Yield what all programs made of a problem."""
    reference = problem.reference
    assert reference is not None
    truth = variation(rows["socp"]) if rows["socp"].get("certified") else np.nan
    yield f"\n## {name}\n"
    yield f"{problem.title}. Objective {reference.objective:.12g}"
    yield f"({reference.source}), total variation {truth:.4g}.\n" if np.isfinite(truth) else ".\n"
    yield "| program | seconds | error of the objective | variation | switching times | says |"
    yield "|---|---|---|---|---|---|"
    for peer, found in rows.items():
        if "failure" in found:
            said = found["failure"].replace("|", "/").replace("`", "'")[:_MESSAGE]
            yield f"| {peer} | {found['seconds']:.1f} | none | | | `{said}` |"
            continue
        error = found["objective"] - reference.objective
        ratio = f"{variation(found) / truth:.3g}" if np.isfinite(truth) else ""
        times = str(len(found["switches"])) if "switches" in found else "no"
        said = "certified as an extremal" if found.get("certified") else f"`{found['status']}`"
        yield (f"| {peer} | {found['seconds']:.1f} | {error:+.1e} | {ratio} | {times} | {said} |")


def _head() -> Iterator[str]:
    yield "# Beside other programs\n"
    yield "<!-- written by benchmarks/peers.py: nothing on this page is written by hand -->\n"
    yield (
        "The same problems, given as the same formulas to programs that pip installs, each used as "
        "its own documentation shows; everybody but socp starts from the same straight line from "
        "start to end, and from the true final time rounded to one digit, which is bounded by a "
        "tenth and ten times of it. "
        f"A run has {LIMIT} s.\n"
    )
    yield (
        "They are made for more than this page asks: several phases, other constraints, real time, "
        "large models. What it asks is what singular and bang-bang controls need. *Error* is that "
        "of the objective which a program states, to the reference: one that is much too small "
        "was reached by a control that the grid's motion flatters. *Variation* is the total "
        "variation of all controls, as a multiple of the true one: 1 is right, more is ringing, "
        "less is a control that is smeared. *Lines*: the code that states, guesses, discretises "
        "and solves any of the problems, the formulas aside. *Says*: what the program says of its "
        "result; the others' words are about their grids' programmes, not about the control.\n"
    )
    yield (
        f"Measured with Python {platform.python_version()} on {platform.machine()}, one thread "
        "each. Seconds are of the processor, from the statement to the result, without imports; "
        "of a program that failed or was stopped, on the clock.\n"
    )


def main() -> None:
    """Measure what is not yet measured, and write the page."""
    folder = Path(sys.argv[1]).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    text = "\n".join(page(folder)) + "\n"
    (ROOT / "docs" / "peers.md").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()

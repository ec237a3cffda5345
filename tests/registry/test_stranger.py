"""A stranger's package, a page of code and seven lines of packaging, is found once pip has
installed it.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

MODULE = '''"""Radau IIA with two points, and a rocket car."""

from dataclasses import dataclass
from typing import ClassVar, final

from socp import Ipopt, Method, Problem, Solution, Watch, hookimpl, option, silent
from socp import controls, final_time, single_phase, solve_collocated, states, uniform
from socp.transcription import radau_iia

x, v = states("x v")
u = controls("u")
car = Problem(
    name="rocket_car",
    minimise=final_time,
    dynamics={x: v, v: u},
    bounds={u: (-1, 1)},
    start={x: 0, v: 0},
    end={x: 1, v: 0},
)


@final
@dataclass(frozen=True)
class RadauTwo(Method):
    """Radau IIA with two points."""

    name: ClassVar[str] = "radau-two"
    source: ClassVar[str] = "Hairer, Wanner, Solving ODEs II, IV.5"
    steps: int = option(100, "steps of equal length", least=1)

    def solve(self, problem: Problem, guess: Solution, watch: Watch = silent) -> Solution:
        """Solve on one phase."""
        meshes = [uniform(radau_iia(2), self.steps)]
        return solve_collocated(single_phase(problem), meshes, Ipopt(), guess, watch)


@hookimpl
def socp_methods() -> list[type[Method]]:
    return [RadauTwo]
'''
PACKAGING = """[project]
name = "stranger"
version = "1.0"
[project.entry-points."socp.plugins"]
radau_two = "stranger"
[project.entry-points."socp.problems"]
rocket_car = "stranger:car"
"""


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the package and install it into a folder of its own."""
    source, home = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("home")
    (source / "stranger.py").write_text(MODULE)
    (source / "pyproject.toml").write_text(PACKAGING)
    pip = [
        sys.executable,
        "-m",
        "pip",
        "install",
        "--quiet",
        "--no-index",
        "--no-deps",
        "--no-build-isolation",
    ]
    done = subprocess.run(
        [*pip, "--target", str(home), str(source)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return home


def socp(home: Path, *arguments: str, code: int = 0) -> str:
    """Run the command line with the stranger's package on the search path; returns standard
    output.
    """
    environment = {**os.environ, "PYTHONPATH": str(home)}
    environment.pop("SOCP_PLUGINS", None)
    command = [sys.executable, "-m", "socp.cli", *arguments]
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env=environment, cwd=home
    )
    assert done.returncode == code, done.stderr
    return done.stdout


def test_the_package_fits_on_a_page() -> None:
    assert len([line for line in MODULE.splitlines() if line.strip()]) <= 40
    assert len(PACKAGING.splitlines()) <= 7


@pytest.mark.slow
def test_the_method_and_the_problem_are_listed(home: Path) -> None:
    methods = {row["name"]: row for row in json.loads(socp(home, "methods", "--json"))}
    assert methods["radau-two"]["package"] == "stranger 1.0"
    assert "euler-ipopt" in methods
    problems = {row["name"]: row["about"] for row in json.loads(socp(home, "list", "--json"))}
    assert problems["rocket_car"] == "Radau IIA with two points, and a rocket car."


@pytest.mark.slow
def test_both_are_solved_with(home: Path) -> None:
    """From rest to rest over a unit of distance with |u| <= 1: tf = 2, switch at 1."""
    found = json.loads(socp(home, "solve", "rocket_car", "-m", "radau-two", "--json"))
    assert found["objective"] == pytest.approx(2.0, rel=1e-4)
    assert found["switches"] == pytest.approx([1.0], rel=1e-2)
    auv = json.loads(socp(home, "solve", "auv", "-m", "radau-two", "--json", code=1))
    assert (auv["stop"], auv["outcome"]) == (
        "SOLVED",
        "MISSED",
    )  # between its nodes its control rings out of its box

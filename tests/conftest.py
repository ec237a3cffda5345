"""What the tests share."""

import os

# Before numpy is loaded: two workers on two cores, each with threads of its own, hinder each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from socp.registry.plugins import Registry

# how long an example takes, or is drawn, depends on what else is running
settings.register_profile(
    "socp", max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("socp")

Install = Callable[..., None]

PLUGIN = '''
from dataclasses import dataclass
from typing import ClassVar, final
from socp import Ipopt, Method, hookimpl, option, single_phase, solve_collocated, uniform
from socp.transcription import euler

@final
@dataclass(frozen=True)
class Mine(Method):
    """A stranger's method."""
    name: ClassVar[str] = "{name}"
    source: ClassVar[str] = "no paper"
    steps: int = option(50, "steps", least=1)
    bold: bool = option(False, "a flag")
    rate: float = option(0.5, "a number")
    note: str = option("", "a text")
    backend: Ipopt = option(Ipopt(), "solver")

    def solve(self, problem, guess, watch=None):
        meshes = [uniform(euler(), self.steps)]
        return solve_collocated(single_phase(problem), meshes, self.backend, guess)

@hookimpl
def socp_methods():
    return [Mine]
'''


@pytest.fixture(scope="session")
def registry() -> Registry:
    """Everything installed."""
    return Registry.load()


@pytest.fixture
def install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Install:
    """Install a package of one module as pip would leave it: the module and its metadata on the
    search path.
    """
    monkeypatch.syspath_prepend(str(tmp_path))

    def put(
        module: str, source: str, *, plugin: str = "", problem: str = "", target: str = ""
    ) -> None:
        (tmp_path / f"{module}.py").write_text(source)
        folder = tmp_path / f"{module}-1.0.dist-info"
        folder.mkdir()
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module}\nVersion: 1.0\n")
        lines = [f"[socp.plugins]\n{plugin} = {module}\n"] if plugin else []
        lines += (
            [f"[socp.problems]\n{problem} = {target or f'{module}:problem'}\n"] if problem else []
        )
        (folder / "entry_points.txt").write_text("".join(lines))

    return put

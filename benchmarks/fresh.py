"""Build wheel and sdist, install the wheel alone in a fresh environment, and use it there.

`python benchmarks/fresh.py` prints the size of the environment, and fails where it is large, the
core does not solve, what an extra brings is missing without a word, or the sdist makes another
wheel.
"""

import subprocess
import sys
import tempfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
CORE = (
    "solve double_integrator_time --quiet",
    "check double_integrator_time.socp.json",
    f"solve {ROOT / 'problems' / 'auv.py'} --strict --quiet",
    "list",
)
LARGEST = 700e6  # bytes of an environment with the core alone
# commands that need more than the core, and the extra that brings it
MISSING = {
    "plot double_integrator_time.socp.json": "plot",
    "report double_integrator_time.socp.json": "report",
    "export double_integrator_time.socp.json --format parquet": "export",
    "export double_integrator_time.socp.json --format netcdf": "export",
    "export double_integrator_time --format nl": "mip",
    "solve double_integrator_time -m mboc -o solver=scip -o switches=1": "mip",
    "record double_integrator_time.socp.json": "record",
    "prove double_integrator_time.socp.json": "prove",
    "bound double_integrator_time.socp.json": "prove",
}


def called(*command: str | Path, folder: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Run a command in a folder and return what it wrote."""
    words = [str(word) for word in command]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True, check=False)  # noqa: S603


def done(*command: str | Path, folder: Path = ROOT) -> None:
    """Run a command that has to succeed."""
    found = called(*command, folder=folder)
    assert found.returncode == 0, f"{command}: {found.stdout}{found.stderr}"


def files(wheel: Path) -> set[str]:
    """Return the names of a wheel's files."""
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def main() -> None:
    """Build, install, use, measure."""
    with tempfile.TemporaryDirectory() as place:
        folder, python = Path(place), Path(sys.executable)
        done(python, "-m", "build", "--no-isolation", "--outdir", folder, ROOT)
        (wheel,), (sdist,) = folder.glob("*.whl"), folder.glob("*.tar.gz")
        again = folder / "again"
        pip = (python, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation")
        done(*pip, "-w", again, sdist)
        assert files(wheel) == files(next(again.glob("*.whl"))), "the sdist makes another wheel"
        venv.create(folder / "env", with_pip=True)
        own = folder / "env" / "bin"
        constraints = ROOT / "constraints" / "tested.txt"
        done(own / "python", "-m", "pip", "install", "-q", "--no-compile", wheel, "-c", constraints)
        for each in CORE:
            done(own / "socp", *each.split(), folder=folder)
        for each, extra in MISSING.items():
            found = called(own / "socp", *each.split(), folder=folder)
            said = found.stdout + found.stderr
            assert f"pip install 'socp[{extra}]'" in said, f"{each}: {said}"
            assert "Traceback" not in said, each
        size = sum(each.stat().st_size for each in (folder / "env").rglob("*") if each.is_file())
        assert size < LARGEST, f"{size / 1e6:.0f} MB"
        print(f"{wheel.name}: works alone, in an environment of {size / 1e6:.0f} MB")


if __name__ == "__main__":
    main()

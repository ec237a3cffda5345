"""What is built holds what it must, and every entry point leads somewhere."""

import re
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest
from packaging.utils import canonicalize_name
from packaging.version import Version

from socp import default_guess, judge, save
from socp.cli import main
from socp.methods.contract import Method
from socp.registry.plugins import Registry

ROOT = Path(__file__).parents[2]


def test_every_plugin_loads_and_every_problem_imports(registry: Registry) -> None:
    own = [plugin for plugin in registry.plugins if plugin.package.startswith("socp ")]
    assert {plugin.status for plugin in own} == {"loaded"}
    assert all(issubclass(method, Method) for method in registry.methods.values())
    for name in registry.problems:
        assert registry.problem(name).name == name


def test_every_file_of_plugins_and_problems_is_registered() -> None:
    for room, group in (("plugins", "socp.plugins"), ("problems", "socp.problems")):
        targets = {point.value.partition(":")[0] for point in metadata.entry_points(group=group)}
        folders = [front.parent for front in (ROOT / room).glob("*/__init__.py")]
        paths = [*(ROOT / room).glob("[!_]*.py"), *folders]
        assert {f"socp_{room}.{path.stem}" for path in paths} <= targets


def test_every_folder_of_modules_is_packaged() -> None:
    listed = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"]
    named = {"socp": "socp", "plugins": "socp_plugins", "problems": "socp_problems"}
    folders = {
        path.parent.relative_to(ROOT).parts
        for room in named
        for path in (ROOT / room).rglob("*.py")
    }
    assert sorted(listed) == sorted(".".join((named[room], *inner)) for room, *inner in folders)


def test_the_command_is_installed() -> None:
    (point,) = metadata.entry_points(group="console_scripts", name="socp")
    assert point.value == "socp.cli:main"
    assert callable(point.load())


def requirements() -> dict[str, str]:
    """Return the lowest version of every package that pyproject.toml asks for."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    lines = [
        *project["dependencies"],
        *(line for extra in project["optional-dependencies"].values() for line in extra),
    ]
    lines = [line for line in lines if not line.startswith("socp[")]
    found = [re.match(r"([\w-]+)(?:\[\w+\])?>=([\w.]+)", line) for line in lines]
    assert None not in found, "every package has a lower bound"
    return {each[1]: each[2] for each in found if each}


def pins(name: str) -> dict[str, str]:
    lines = (ROOT / "constraints" / name).read_text().splitlines()
    return dict(line.split("==") for line in lines if not line.startswith("#"))


def test_the_lowest_versions_are_those_that_pyproject_allows() -> None:
    assert pins("lowest.txt") == requirements()


def test_every_package_has_a_tested_version_that_pyproject_allows() -> None:
    tested = {canonicalize_name(name): version for name, version in pins("tested.txt").items()}
    for name, lowest in requirements().items():
        if name != "setuptools":  # comes with every environment
            assert Version(tested[name]) >= Version(lowest), name


@pytest.mark.slow
def test_what_is_built_holds_every_module_and_no_more(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "build",
        "--no-isolation",
        "--outdir",
        str(tmp_path),
        str(ROOT),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    (wheel,) = tmp_path.glob("*.whl")
    (sdist,) = tmp_path.glob("*.tar.gz")
    rooms = {"socp": "socp", "plugins": "socp_plugins", "problems": "socp_problems"}
    files = {  # a lazy front reads its stub when it runs
        room: [path for ending in ("py", "pyi") for path in (ROOT / room).rglob(f"*.{ending}")]
        for room in rooms
    }
    wanted = {
        f"{rooms[room]}/{path.relative_to(ROOT / room)}"
        for room, paths in files.items()
        for path in paths
    }
    with zipfile.ZipFile(wheel) as archive:
        held = {
            name for name in archive.namelist() if not name.partition("/")[0].endswith(".dist-info")
        }
        assert held == wanted | {"socp/py.typed"}
        assert any(name.endswith("licenses/LICENSE") for name in archive.namelist())
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    sources = {str(path.relative_to(ROOT)) for paths in files.values() for path in paths}
    assert sources | {"pyproject.toml", "LICENSE", "socp/py.typed"} <= names


PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def test_one_version_stands_everywhere() -> None:
    version = PROJECT["version"]
    assert f"\n## [{version}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    recipe = (ROOT / "packaging" / "conda" / "meta.yaml").read_text(encoding="utf-8")
    assert f'version = "{version}"' in recipe


def test_the_recipe_asks_for_what_pip_does() -> None:
    recipe = (ROOT / "packaging" / "conda" / "meta.yaml").read_text(encoding="utf-8")
    listed = re.findall(r"^    - (\S+) (>=\S+)$", recipe.partition("  run:")[2], re.MULTILINE)
    found = {name + bound for name, bound in listed}
    assert found == {f"python{PROJECT['requires-python']}", *PROJECT["dependencies"]}


@pytest.mark.parametrize(
    ("package", "extra", "command"),
    [
        ("rerun", "record", "record result.socp.json"),
        ("matplotlib", "plot", "plot result.socp.json"),
        ("plotly", "report", "report result.socp.json"),
        ("pyarrow", "export", "export result.socp.json --format parquet"),
        ("xarray", "export", "export result.socp.json --format netcdf"),
        ("pyomo.environ", "mip", "export fuller --format nl"),
        ("pyscipopt", "mip", "solve double_integrator_time -m mboc -o solver=scip -o switches=1"),
    ],
)
def test_what_an_extra_brings_is_named_where_it_is_missing(
    package: str,
    extra: str,
    command: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    problem = Registry.load().problem("double_integrator_time")
    save(judge(problem, default_guess(problem)), "result.socp.json")
    for name in [package, *(each for each in sys.modules if each.startswith(f"{package}."))]:
        monkeypatch.setitem(sys.modules, name, None)
    assert main(command.split()) != 0
    assert f"pip install 'socp[{extra}]'" in capsys.readouterr().err


def test_the_core_stands_in_no_extra() -> None:
    extras = PROJECT["optional-dependencies"]
    core = {re.match(r"[\w-]+", each)[0] for each in PROJECT["dependencies"]}  # type: ignore[index]
    assert not core & {
        "rerun-sdk",
        "matplotlib",
        "plotly",
        "pyarrow",
        "xarray",
        "pandas",
        "pyomo",
        "pyscipopt",
        "highspy",
        "cvxpy",
        "distributed",
    }
    assert extras["all"] == ["socp[dask,export,mip,plot,prove,record,report]"]
    assert "socp[all]" in extras["dev"]

"""Exports read back what the solution holds, bit for bit, with names, dimensions and units."""

import csv
import io
import json
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
import xarray
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from records import built, revised
from scipy.io import loadmat

from socp import Problem, Solution, default_guess, errors, run, time
from socp.cli import main
from socp.cli.commands.exporting import FORMATS
from socp.errors import MethodError
from socp.model.data.files import save
from socp.model.result.arc import Arc
from socp.model.result.solution import Stop
from socp.registry.plugins import Registry
from socp.view import exports as tabular
from socp.view.traces import sampled, traces


@pytest.fixture(scope="module")
def problem(registry: Registry) -> Problem:
    found = registry.problem("double_integrator_vlimit")
    x, v = found.dynamics
    return replace(found, units={x: "m", v: "m/s", time: "s"})


@pytest.fixture(scope="module")
def solution(problem: Problem, registry: Registry) -> Solution:
    return run(
        registry.method("lgr-multiphase")(word=problem.reference.word),
        problem,
        default_guess(problem),
    )


def same(read: Any, held: Any) -> None:
    """Assert that numbers are the same bit for bit, nan being nan."""
    read, held = np.asarray(read, dtype=float), np.asarray(held, dtype=float)
    assert read.shape == held.shape
    known = ~np.isnan(held)
    assert np.array_equal(np.isnan(read), ~known)
    assert np.array_equal(read[known].view(np.int64), held[known].view(np.int64))


def read_csv(content: bytes) -> dict[str, np.ndarray]:
    rows = list(csv.reader(io.StringIO(content.decode(), newline="")))
    return {name: np.array([float(row[k]) for row in rows[1:]]) for k, name in enumerate(rows[0])}


def read_parquet(content: bytes) -> dict[str, np.ndarray]:
    found = pyarrow.parquet.read_table(io.BytesIO(content))
    return {name: found[name].to_numpy() for name in found.column_names}


def read_mat(content: bytes) -> Any:
    return loadmat(io.BytesIO(content), struct_as_record=False)["result"][0, 0]


def read_netcdf(content: bytes) -> Any:
    return xarray.load_dataset(io.BytesIO(content), engine="scipy")


@pytest.mark.slow
def test_flat_tables_hold_every_value(problem: Problem, solution: Solution) -> None:
    along = traces(problem, solution)
    held = {
        "time": solution.t,
        "x": solution.rows("x")[0],
        "u": solution.rows("u")[0],
        "H": along.hamiltonian,
    }
    held |= {"lambda_v": solution.rows("costate")[1], "sigma_u": along.switching[0]}
    held["mu_v.upper"] = np.concatenate([arc.multipliers["v.upper"] for arc in solution.arcs])
    held["arc"] = np.repeat([1.0, 2.0, 3.0], [arc.t.size for arc in solution.arcs])
    text, columns = (
        read_csv(tabular.to_csv(solution, problem)),
        read_parquet(tabular.to_parquet(solution, problem)),
    )
    assert list(columns) == [
        "time",
        "arc",
        "x",
        "v",
        "u",
        "lambda_x",
        "lambda_v",
        "sigma_u",
        "H",
        "mu_v.upper",
    ]
    units = {"time": "time [s]", "x": "x [m]", "v": "v [m/s]"}
    assert list(text) == [units.get(name, name) for name in columns]
    for name, values in held.items():
        same(columns[name], values)
        same(text[units.get(name, name)], values)


def test_parquet_carries_units_and_facts(problem: Problem, solution: Solution) -> None:
    schema = pyarrow.parquet.read_schema(io.BytesIO(tabular.to_parquet(solution, problem)))
    assert schema.field("v").metadata == {b"units": b"m/s"}
    facts = json.loads(schema.metadata[b"socp"])
    assert facts["objective"] == solution.objective
    assert facts["switches"] == solution.switches


def test_netcdf_has_named_dimensions_and_units(problem: Problem, solution: Solution) -> None:
    read, along = read_netcdf(tabular.to_netcdf(solution, problem)), traces(problem, solution)
    assert read.states.dims == ("state", "node")
    assert read.multipliers.dims == ("constraint", "node")
    assert read.time.attrs["units"] == "s"
    assert read.states.attrs["units"] == "x: m, v: m/s"
    same(read.time, solution.t)
    same(read.states.sel(state="v"), solution.rows("x")[1])
    same(read.controls.sel(control="u"), solution.rows("u")[0])
    same(read.costates, solution.rows("costate"))
    same(read.switching_functions, along.switching)
    same(read.attrs["switches"], solution.switches)
    assert read.attrs["word"] == solution.word
    assert read.attrs["objective"] == solution.objective
    assert read.attrs["rung"] == "WORD"


def test_a_dataset_of_a_solution_without_its_problem(solution: Solution) -> None:
    dataset = tabular.nodes_to_xarray(revised(solution, statement=None))
    same(dataset.states, solution.rows("x"))
    assert "switching_functions" not in dataset
    assert "units" not in dataset.time.attrs
    assert list(dataset.arc.values[[0, -1]]) == [1, 3]


def test_mat_has_a_phase_an_arc(problem: Problem, solution: Solution) -> None:
    result = read_mat(tabular.to_mat(solution, problem))
    phases = result.solution[0, 0].phase[0]
    assert len(phases) == len(solution.arcs) == 3
    for phase, arc in zip(phases, solution.arcs, strict=True):
        same(phase.time, arc.t[:, None])
        same(phase.state, arc.x.T)
        same(phase.control, arc.u.T)
        same(phase.costate, arc.costate.T)
        assert [str(mode[0]) for mode in phase.modes[0]] == list(map(str, arc.modes))
    assert result.objective[0, 0] == solution.objective
    assert [str(name[0]) for name in result.names[0, 0].state[0]] == ["x", "v"]
    assert [str(unit[0]) for unit in result.units[0, 0].state[0]] == ["m", "m/s"]


any_float = st.floats(allow_nan=True, allow_infinity=True, width=64)


@settings(max_examples=25)
@given(
    t=arrays(float, 3, elements=st.floats(-1e300, 1e300), unique=True).map(np.sort),
    rows=arrays(float, (5, 3), elements=any_float),
    parameter=any_float,
)
def test_every_float_survives_every_format(
    t: np.ndarray, rows: np.ndarray, parameter: float
) -> None:
    x, u, costate = rows[:2], rows[2:3], rows[3:]
    mesh = np.array([0, 2])
    arc = Arc(
        t=t,
        x=x,
        u=u,
        costate=costate,
        mesh=mesh,
        side="left",
        modes=("*",),
        multipliers={"c": u[0]},
    )
    solution = built(
        problem="p",
        method="m",
        arcs=(arc,),
        objective=parameter,
        stop=Stop.SOLVED,
        state_names=("a", "time"),
        control_names=("é[1]",),
        parameters={"q": parameter},
    )
    for columns in (read_csv(tabular.to_csv(solution)), read_parquet(tabular.to_parquet(solution))):
        same(columns["time"], t)
        same([columns["a"], columns["time_"]], x)  # a state of that name steps aside
        same(columns["é[1]"], u[0])
        same([columns["lambda_a"], columns["lambda_time"]], costate)
        same(columns["mu_c"], u[0])
    dataset = read_netcdf(tabular.to_netcdf(solution))
    same(dataset.states, x)
    same(dataset.time, t)
    same(dataset.parameters, [parameter])
    result = read_mat(tabular.to_mat(solution))
    same(result.solution[0, 0].phase[0, 0].state, x.T)
    same(result.solution[0, 0].parameter, [[parameter]])
    same(result.objective, [[parameter]])


def test_traces_without_a_problem_know_what_the_solution_knows(
    problem: Problem, solution: Solution
) -> None:
    alone, full = traces(None, solution), traces(problem, solution)
    same(alone.x, full.x)
    assert np.isnan(alone.switching).all()
    assert alone.multipliers == {}


def test_sampled_traces_follow_the_polynomials_and_jump(
    problem: Problem, solution: Solution
) -> None:
    along = sampled(problem, solution, 300)
    assert along.t.size >= 300
    assert (np.diff(along.t) >= 0).all()
    inside = np.array([np.abs(solution.junctions - t).min() > 1e-9 for t in along.t])
    np.testing.assert_allclose(along.x[:, inside], solution.at(along.t[inside]), rtol=0, atol=1e-14)
    for junction, before, after in zip(
        solution.junctions, solution.arcs, solution.arcs[1:], strict=False
    ):
        pair = np.flatnonzero(along.t == junction)
        assert pair.size == 2
        np.testing.assert_allclose(along.u[0, pair], [before.u[0, -1], after.u[0, 0]])
    np.testing.assert_allclose(along.hamiltonian, -1.0, atol=1e-8)
    touching = along.constraints["v.upper"] > -1e-9
    assert (np.abs(along.switching[0][touching & (along.arc == 1)]) < 1e-8).all()
    np.testing.assert_allclose(along.multipliers["v.upper"][along.arc != 1], 0.0, atol=1e-9)


@pytest.fixture
def saved(solution: Solution, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    save(solution, "bang.socp.json")
    return tmp_path


@pytest.mark.parametrize("name", sorted(FORMATS))
def test_command_writes_the_file_and_says_its_name(
    name: str, saved: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if FORMATS[name].takes != "result":
        return
    assert main(["export", "bang.socp.json", "--format", name]) == 0
    path = saved / capsys.readouterr().out.strip()
    assert path.name == f"bang{FORMATS[name].ending}"
    assert path.stat().st_size > 1000
    assert sorted(each.name for each in saved.iterdir()) == sorted(["bang.socp.json", path.name])


def test_command_goes_by_the_ending(saved: Path, solution: Solution) -> None:
    assert main(["export", "bang.socp.json", "-o", "mine.nc"]) == 0
    same(xarray.load_dataset(saved / "mine.nc", engine="scipy").states, solution.rows("x"))


def test_command_without_its_problem_says_what_is_missing(
    saved: Path, solution: Solution, capsys: pytest.CaptureFixture[str]
) -> None:
    save(revised(solution, problem="elsewhere", statement=None), saved / "other.json")
    assert main(["export", "other.json", "--format", "csv"]) == 0
    assert "--problem FILE" in capsys.readouterr().err
    assert "sigma_u" not in read_csv((saved / "other.csv").read_bytes())
    assert (
        main(["export", "other.json", "--format", "csv", "--problem", "double_integrator_vlimit"])
        == 0
    )
    assert "sigma_u" in read_csv((saved / "other.csv").read_bytes())


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["bang.socp.json"], 2, "which format?"),
        (["bang.socp.json", "--format", "cvs"], 2, "did you mean 'csv'?"),
        (
            ["bang.socp.json", "-o", "nowhere/a.csv"],
            2,
            "-o nowhere/a.csv: there is no directory nowhere",
        ),
        (
            ["bang.socp.json", "--format", "nl"],
            2,
            "is a result, but nl is made of a problem; for a result take csv",
        ),
        (
            ["auv.py", "--format", "csv"],
            2,
            "is a problem, but csv is made of a result; for a problem take nl, pyomo",
        ),
        (["gone.json", "--format", "csv"], 1, "gone.json: No such file"),
        (["bang.socp.json", "--format", "csv", "--problem", "goddard"], 1, "its states are x, v"),
    ],
)
def test_command_says_what_is_wrong(
    arguments: list[str], code: int, said: str, saved: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["export", *arguments]) == code
    assert said in capsys.readouterr().err
    assert [each.name for each in saved.iterdir()] == ["bang.socp.json"]


@pytest.mark.parametrize(("name", "package"), [("netcdf", "xarray"), ("parquet", "pyarrow")])
def test_a_missing_package_is_one_line(
    name: str,
    package: str,
    saved: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def absent(module: str) -> Any:
        if module.partition(".")[0] == package:
            raise ModuleNotFoundError(f"No module named '{package}'", name=package)
        return import_module(module)

    monkeypatch.setattr(errors, "import_module", absent)
    assert main(["export", "bang.socp.json", "--format", name]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert f"needs the package {package}" in lines[0]
    assert "pip install 'socp[export]'" in lines[0]
    assert len(list(saved.iterdir())) == 1


def test_what_a_package_lacks_itself_is_named() -> None:
    with pytest.raises(
        MethodError, match=r"needs the package no_such, .*pip install 'socp\[plot\]'"
    ):
        errors.load("no_such.part", "plot", "a figure")

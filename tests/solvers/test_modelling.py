"""Programmes for other packages: what is written reads back and has the same values at any
point.
"""

import runpy
from pathlib import Path
from typing import Any

import casadi
import numpy as np
import pyomo.environ as pyo
import pytest
from pyomo.gdp import Disjunction
from socp_problems.auv import problem as auv
from socp_problems.double_integrator_time import problem as integrator

from socp.cli import main
from socp.errors import MethodError
from socp.search.integer.disjunctive import disjunctive, pyomo_model
from socp.search.integer.programmes import programme, write
from socp.search.integer.reduction import binary_modes
from socp.solvers.contract import NLP
from socp.solvers.pyomo_model import pyomo_programme, to_pyomo, write_nl
from socp.transcription.collocation import collocate
from socp.transcription.mesh import uniform
from socp.transcription.schemes import lgr


def points(nlp: NLP, count: int = 5) -> list[np.ndarray]:
    random = np.random.default_rng(1)
    return [random.uniform(0.1, 1.9, nlp.v.numel()) for _ in range(count)]


def ours(nlp: NLP) -> casadi.Function:
    return casadi.Function("ours", [nlp.v], [nlp.f, nlp.g])


def close(a: Any, b: Any) -> bool:
    return bool(
        np.abs(np.asarray(a) - np.asarray(b)).max() <= 1e-10 * (1 + np.abs(np.asarray(b)).max())
    )


@pytest.fixture(scope="module")
def small() -> tuple[NLP, np.ndarray]:
    return programme(auv, 1, 3)


def test_an_nl_file_reads_back_in_casadi_with_the_same_values(
    small: tuple[NLP, np.ndarray], tmp_path: Path
) -> None:
    nlp, start = small
    model = pyomo_programme(nlp, start)
    columns = write_nl(model, tmp_path / "auv.nl")
    back = casadi.NlpBuilder()
    back.import_nl(str(tmp_path / "auv.nl"))
    theirs = casadi.Function("theirs", [casadi.vertcat(*back.x)], [back.f, casadi.vertcat(*back.g)])
    assert np.array(back.discrete).tolist() == nlp.binary[columns].tolist()
    assert np.array(back.x_lb) == pytest.approx(nlp.v_box[0][columns])
    kept = sorted(columns)
    for v in points(nlp):
        f, g = (each.full().ravel() for each in ours(nlp)(v))
        their_f, their_g = (each.full().ravel() for each in theirs(v[columns]))
        assert close(their_f, f)
        assert close(sorted(_slack(their_g, back.g_lb, back.g_ub)), sorted(_slack(g, *nlp.g_box)))
    assert len(kept) == len(set(kept))


def _slack(g: np.ndarray, low: Any, high: Any) -> list[float]:
    """Return how far rows are within their bounds: the constants and the order of the rows are the
    writer's.
    """
    low, high = np.array(low, dtype=float), np.array(high, dtype=float)
    return (np.where(np.isfinite(low), g - low, high - g)).tolist()


@pytest.mark.parametrize("elementary", [False, True])
def test_a_pyomo_programme_has_the_values_of_casadi(
    small: tuple[NLP, np.ndarray], elementary: bool
) -> None:
    nlp, _ = small
    model = pyomo_programme(nlp, elementary=elementary)
    for v in points(nlp):
        for i, value in enumerate(v):
            model.v[i].set_value(value, skip_validation=True)
        f, g = (each.full().ravel() for each in ours(nlp)(v))
        assert close(pyo.value(model.objective), f)
        assert close([pyo.value(model.g[j].body) for j in model.g], g[list(model.g)])


def test_hyperbolic_functions_are_written_by_exp_where_asked() -> None:
    x = casadi.SX.sym("x")
    model = pyo.ConcreteModel()
    model.x = pyo.Var(initialize=0.7)
    found = to_pyomo(
        casadi.vertcat(casadi.tanh(x), casadi.cosh(x), casadi.sinh(x)),
        x,
        [model.x],
        elementary=True,
    )
    assert not any(name in str(each) for each in found for name in ("tanh", "cosh", "sinh"))
    assert [pyo.value(each) for each in found] == pytest.approx(
        [np.tanh(0.7), np.cosh(0.7), np.sinh(0.7)]
    )


def test_an_operation_that_pyomo_does_not_have_is_named() -> None:
    x = casadi.SX.sym("x")
    with pytest.raises(MethodError, match="holds 'erf', which has no translation"):
        to_pyomo(casadi.erf(x), x, [1.0])


# -- disjunctions


def test_the_disjunctive_model_has_one_disjunct_an_arc_and_combination() -> None:
    model = pyomo_model(integrator, 1, 2)
    assert len(model.choice) == 2
    assert {len(model.choice[k].disjuncts) for k in model.choice} == {len(model.mode) // 2}


@pytest.mark.parametrize("transformation", ["bigm", "hull"])
def test_the_disjunctive_model_transforms(transformation: str) -> None:
    disjuncts, model = (
        pyomo_model(integrator, 1, 2),
        pyomo_model(integrator, 1, 2, transformation, horizon=5.0),
    )
    assert list(disjuncts.component_data_objects(Disjunction, active=True))
    assert not list(model.component_data_objects(Disjunction, active=True))
    rows = [
        sum(1 for _ in each.component_data_objects(pyo.Constraint, active=True))
        for each in (disjuncts, model)
    ]
    assert rows[1] > rows[0]


def test_the_script_stands_alone_and_builds_the_same_model(tmp_path: Path) -> None:
    write(auv, tmp_path / "auv.pyomo.py", format="pyomo", switches=1, points=3)
    script = (tmp_path / "auv.pyomo.py").read_text(encoding="utf-8")
    assert "socp" not in script
    model = runpy.run_path(str(tmp_path / "auv.pyomo.py"))["model"]
    assert len(model.mode) == 2 * 11
    assert model.nvariables() == pyomo_model(auv, 1, 3).nvariables()


@pytest.mark.parametrize("elementary", [False, True])
def test_defects_of_the_disjunctive_model_are_those_of_the_reduction(elementary: bool) -> None:
    nlp = collocate(binary_modes(auv, 1, collocated=True), [uniform(lgr(3), 1)] * 2).problem
    made = disjunctive(auv, 1, 3, elementary=elementary)
    names: dict[str, Any] = {"__name__": "model"}
    exec(made.script, names)  # noqa: S102
    model = names["model"]
    (v,) = points(nlp, 1)
    for variable, value in zip(names["variables"](model), v, strict=False):
        variable.set_value(value, skip_validation=True)
    g = ours(nlp)(v)[1].full().ravel()
    defects = [pyo.value(row.body) - pyo.value(row.upper) for row in model.defects.values()]
    assert len(defects) == 2 * 3 * 4
    for value in defects:
        assert np.abs(g - value).min() < 1e-5


# -- files


@pytest.mark.parametrize("format", ["nl", "gams", "pyomo", "lp"])
def test_every_format_is_written(format: str, tmp_path: Path) -> None:  # noqa: A002
    write(integrator, tmp_path / "out", format=format, switches=1, points=2)
    text = (tmp_path / "out").read_text(encoding="utf-8")
    assert len(text) > 500
    marks = {"nl": "g3 ", "gams": "VARIABLES", "pyomo": "import pyomo.environ", "lp": "binary"}
    assert marks[format].lower() in text.lower()


def test_a_nonlinear_problem_has_no_lp_and_nothing_is_left(tmp_path: Path) -> None:
    with pytest.raises(MethodError, match="problem 'auv' cannot be written as lp"):
        write(auv, tmp_path / "auv.lp", format="lp", switches=1, points=2)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"format": "mps"}, "no format 'mps' for programmes; there are nl, pyomo, gams, lp"),
        ({"format": "nl", "points": 0}, "points=0: an arc needs 1 collocation point or more"),
    ],
)
def test_what_cannot_be_written_is_refused(
    given: dict[str, Any], said: str, tmp_path: Path
) -> None:
    with pytest.raises(MethodError, match=said):
        write(integrator, tmp_path / "out", **given)


def test_the_command_writes_a_programme(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert (
        main(
            [
                "export",
                "double_integrator_time",
                "--format",
                "nl",
                "--switches",
                "1",
                "--points",
                "2",
            ]
        )
        == 0
    )
    assert (tmp_path / "double_integrator_time.nl").read_text(encoding="utf-8").startswith("g3 ")
    assert main(["export", "auv", "--format", "lp"]) == 2

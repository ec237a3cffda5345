"""Programmes for Pyomo, and through it for every solver that reads AMPL's or GAMS's files."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import casadi
import numpy as np

from socp.errors import load
from socp.model import (
    AREA,
    ARITHMETIC,
    HYPERBOLIC,
    POWERS,
    TRIGONOMETRIC,
    interpret,
    operation_names,
)
from socp.solvers.contract import NLP


def to_pyomo(
    expressions: Any, symbols: Any, values: Sequence[Any], *, elementary: bool = False
) -> list[Any]:
    """Return casadi expressions (m, 1) of symbols (n, 1) as Pyomo's, in the n values given for the
    symbols.

    `elementary` writes hyperbolic functions by exp, for solvers that know no others. Raises
    MethodError, with its name, for an operation that Pyomo does not have.
    """
    operations = _operations()
    if elementary:
        operations = {**operations, **_by_exp(operations[casadi.OP_EXP])}
    return interpret(expressions, symbols, values, operations)


def pyomo_programme(nlp: NLP, start: np.ndarray | None = None, *, elementary: bool = False) -> Any:
    """Return a nonlinear programme as a Pyomo ConcreteModel.

    `model.v[i]` are its variables in order, binary where flagged; `model.g[j]` its rows; `start`
    (n,) their values. Where an interior start is given, binaries are kept as they are, fractions
    included.
    """
    pyo = load("pyomo.environ", "mip", "a programme for other solvers")
    model = pyo.ConcreteModel()
    low, high = nlp.v_box
    model.v = pyo.Var(
        range(nlp.count),
        domain=lambda _m, i: pyo.Binary if nlp.binary[i] else pyo.Reals,
        bounds=lambda _m, i: (_finite(low[i]), _finite(high[i])),
    )
    if start is not None:
        for i, value in enumerate(start):
            model.v[i].set_value(float(value), skip_validation=True)
    values = [model.v[i] for i in range(nlp.count)]
    cost, *rows = to_pyomo(casadi.vertcat(nlp.f, nlp.g), nlp.v, values, elementary=elementary)
    model.objective = pyo.Objective(expr=cost)
    model.g = pyo.Constraint(range(len(rows)))
    for j, row in enumerate(rows):
        if not isinstance(
            row, (int, float)
        ):  # a row of no variable says nothing, or is none to begin with
            model.g.add(j, _bounded(row, *nlp.g_box[:, j]))
    return model


def write_nl(model: Any, path: str | Path) -> list[int]:
    """Write a model of `pyomo_programme` as AMPL's .nl file; returns which variable stands in each
    of its columns.

    Pyomo leaves out variables that occur nowhere and orders the others; so does the list.
    """
    from pyomo.repn.plugins.nl_writer import NLWriter

    with Path(path).open("w", encoding="utf-8", newline="") as file:
        info = NLWriter().write(model, file, linear_presolve=False, scale_model=False)
    places = {id(variable): i for i, variable in model.v.items()}
    return [places[id(variable)] for variable in info.variables]


def _bounded(row: Any, low: float, high: float) -> Any:
    if low == high:
        return row == float(low)
    return (_finite(low), row, _finite(high))


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _operations() -> Mapping[int, Callable[..., Any]]:
    """Return Pyomo's functions by casadi's operation codes."""
    pyo = load("pyomo.environ", "mip", "a programme for other solvers")
    from pyomo.core.expr import Expr_if

    named = operation_names(*TRIGONOMETRIC, *HYPERBOLIC, *AREA, *POWERS)
    return {
        **{code: getattr(pyo, name) for code, name in named.items()},
        **ARITHMETIC,
        casadi.OP_FABS: abs,
        casadi.OP_LT: lambda a, b: Expr_if(a < b, 1.0, 0.0),
        casadi.OP_LE: lambda a, b: Expr_if(a <= b, 1.0, 0.0),
        casadi.OP_IF_ELSE_ZERO: lambda a, b: a * b,
        casadi.OP_FMAX: lambda a, b: (a + b + abs(a - b)) / 2,
        casadi.OP_FMIN: lambda a, b: (a + b - abs(a - b)) / 2,
    }


def _by_exp(exp: Callable[[Any], Any]) -> Mapping[int, Callable[..., Any]]:
    """Return hyperbolic functions by exp alone."""
    return {
        casadi.OP_TANH: lambda a: 1 - 2 / (exp(2 * a) + 1),
        casadi.OP_COSH: lambda a: (exp(a) + exp(-a)) / 2,
        casadi.OP_SINH: lambda a: (exp(a) - exp(-a)) / 2,
    }

"""Generalised disjunctive programmes for Pyomo.GDP, written as a Python script that builds them,
and built from it.

One disjunct an arc and combination of modes, with the laws of the controls and the entry conditions
under it; the defects hold for all. The script stands alone: it needs Pyomo and nothing else.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pprint import pformat
from typing import Any, final

import casadi
import numpy as np

from socp import laws
from socp.laws import arc_modes
from socp.model import (
    HYPERBOLIC,
    POWERS,
    TRIGONOMETRIC,
    Expr,
    Modes,
    Problem,
    column,
    final_time,
    initial_time,
    interpret,
    operation_names,
    time,
)
from socp.process import one_line
from socp.search.integer.bounds import enclosures, reachable
from socp.search.integer.reduction import binary_modes
from socp.search.integer.template import MODEL
from socp.solvers import NLPPoint
from socp.transcription import Table, lgr, table, uniform

_FUNCTIONS = operation_names(*TRIGONOMETRIC, *HYPERBOLIC, *POWERS)
_SIGNS = {"ADD": "+", "SUB": "-", "MUL": "*", "DIV": "/", "POW": "**", "CONSTPOW": "**"}


@final
@dataclass(frozen=True, eq=False)
class Disjunctive:
    """A script that builds `model`, and the binaries of the reduction (nz,) that every combination
    stands for.
    """

    script: str
    binaries: tuple[tuple[float, ...], ...]

    def model(self) -> Any:
        """Run the script and return its Pyomo model."""
        names: dict[str, Any] = {"__name__": "model"}
        # written above, from numbers and operations
        exec(compile(self.script, "model.py", "exec"), names)  # noqa: S102
        return names["model"]


def pyomo_model(
    problem: Problem, switches: int, points: int, transformation: str = "", horizon: float = np.inf
) -> Any:
    """Return a problem on `switches` + 1 arcs of `points` Legendre-Gauss-Radau points as a
    Pyomo.GDP model.

    `transformation` is "bigm" or "hull" for the mixed-integer programme that Pyomo makes of it,
    empty for disjuncts. The hull needs bounds of all states: those that follow from a longest
    `horizon` are used, where one is given. Raises MethodError for a negative number of switches,
    and for an operation that Pyomo does not have.
    """
    model = disjunctive(problem, switches, points, horizon=horizon).model()
    if transformation:
        import pyomo.environ as pyo

        pyo.TransformationFactory(f"gdp.{transformation}").apply_to(model)
    return model


def disjunctive(
    problem: Problem,
    switches: int,
    points: int,
    start: NLPPoint | None = None,
    *,
    horizon: float = np.inf,
    elementary: bool = False,
) -> Disjunctive:
    """Return the disjunctive programme.

    `start`: a point of the collocated reduction, for the values of the variables; `horizon`: the
    longest that matters; `elementary` writes what Pyomo does not differentiate in other words.
    """
    choice = binary_modes(problem, switches, collocated=True).phases[0].choice
    assert choice is not None  # noqa: S101 - every phase of the reduction has one
    combinations = arc_modes(problem)
    t = table(uniform(lgr(points), 1))
    parts = (
        [_head(problem, switches, points)],
        _data(problem, switches, (t, horizon), combinations),
        _functions(problem, combinations, elementary=elementary),
        [MODEL],
        _values(start) if start is not None else [],
    )
    binaries = tuple(tuple(choice.values(each).tolist()) for each in combinations)
    return Disjunctive("\n".join(line for part in parts for line in part), binaries)


def _head(problem: Problem, switches: int, points: int) -> str:
    legend = "; ".join(
        f"{what} {', '.join(f'{letter}[{i}] = {name}' for i, name in enumerate(names)) or 'none'}"
        for what, letter, names in (
            ("states", "x", problem.state_names),
            ("controls", "u", problem.control_names),
            ("parameters", "p", problem.parameter_names),
        )
    )
    return (
        f'"""{_inside(problem.name)}: at most {switches} switches, {switches + 1} arcs of {points} '
        f"Legendre-Gauss-Radau points; a Pyomo.GDP model.\n\n"
        f'{_inside(legend)}; y the costate, where laws need it.\n"""\n\n'
        f"import pyomo.environ as pyo\nfrom pyomo.environ import {', '.join(_FUNCTIONS.values())}\n"
        "from pyomo.gdp import Disjunct, Disjunction\n"
    )


def _inside(text: str) -> str:
    """Return text as it may stand inside the script's docstring, which it can neither end nor
    break.
    """
    return one_line(text).replace("\\", "\\\\").replace('"', "'")


def _data(
    problem: Problem, switches: int, grid: tuple[Table, float], combinations: Sequence[Modes]
) -> Iterator[str]:
    """Yield the tables of the programme as assignments; grid: the table of an arc, and the longest
    horizon.
    """
    t, horizon = grid
    box = reachable(problem, horizon, t) if np.isfinite(horizon) else problem.state_box
    spans = _spans(problem, combinations)
    data = {
        "ARCS": switches + 1,
        "POINTS": t.collocated.tolist(),
        "NODES": t.tau.size,
        "TAU": t.tau.tolist(),
        "A": t.A.array().tolist(),
        "B": t.B.array()[:, t.collocated].tolist(),
        "WEIGHTS": t.weights[t.collocated].tolist(),
        "NX": problem.x.numel(),
        "NU": problem.u.numel(),
        "NP": problem.p.numel(),
        "X_BOX": _pairs(box),
        "U_BOX": _pairs(problem.box),
        "P_BOX": _pairs(problem.parameter_box),
        "START": _pairs(problem.start_box),
        "END": _pairs(problem.end_box),
        "LONGEST": horizon if np.isfinite(horizon) else None,
        "T0": _pairs(np.array([problem.initial_time_box]).T)[0],
        "TF": _pairs(np.array([problem.final_time_box]).T)[0],
        "EQUATION": [condition.equation for condition in problem.conditions],
        "MODES": [" ".join(map(str, each)) for each in combinations],
        "COSTATE": [laws.arc_law(problem, each).costate for each in combinations],
        "BIG_M": spans,
    }
    for name, value in data.items():
        yield f"{name} = {pformat(value, width=116, compact=True)}"


def _pairs(box: np.ndarray) -> list[tuple[float | None, float | None]]:
    low, high = ([float(v) if np.isfinite(v) else None for v in row] for row in box)
    return list(zip(low, high, strict=True))


def _spans(
    problem: Problem, combinations: Sequence[Modes]
) -> list[list[tuple[float, float] | None]]:
    """Return how far a control may be from its law in every combination, None where nothing bounds
    that.
    """
    symbols = casadi.vertcat(problem.x, time, problem.p, problem.costate)
    unknown = np.repeat([[-np.inf], [np.inf]], problem.x.numel(), axis=1)
    times = [[problem.initial_time_box[0]], [problem.final_time_box[1]]]
    box = np.hstack([problem.state_box, times, problem.parameter_box, unknown])
    found: list[list[tuple[float, float] | None]] = []
    for each in combinations:
        low, high = enclosures(laws.arc_law(problem, each).control, symbols, box)
        spans = np.array([problem.box[0] - high, problem.box[1] - low]).T
        found.append(
            [(float(a), float(b)) if np.isfinite([a, b]).all() else None for a, b in spans]
        )
    return found


def _functions(
    problem: Problem, combinations: Sequence[Modes], *, elementary: bool
) -> Iterator[str]:
    """Yield the functions of the programme."""
    written = partial(_function, elementary=elementary)
    x, u, p, y = problem.x, problem.u, problem.p, problem.costate
    names = {"x": x, "u": u, "t": time, "p": p}
    ends = {"x": x, "x0": problem.x0, "p": p, "t0": initial_time, "tf": final_time}
    yield written("rate", names, problem.rate)
    yield written("running", names, problem.lagrangian)
    yield written("mayer", ends, problem.mayer)
    yield written("target", ends, column(c.expression for c in problem.conditions))
    constraints = [c.expression for c in problem.constraints if c.name in problem.path]
    yield written("path", {"x": x, "t": time, "p": p}, column(constraints))
    own = {"x": x, "y": y, "t": time, "p": p}
    for k, each in enumerate(combinations):
        law = laws.arc_law(problem, each)
        yield written(f"law_{k}", own, law.control)
        yield written(f"entry_{k}", own, column((*law.entry, *law.costate_entry)))
        yield written(f"costate_rate_{k}", own, law.costate_rate if law.costate else column(()))


def _function(name: str, arguments: dict[str, Expr], expressions: Expr, *, elementary: bool) -> str:
    """Return a Python function of the arguments that computes expressions (m, 1) step by step, as
    text.
    """
    lines: list[str] = []

    def step(text: str) -> str:
        lines.append(f"    w{len(lines)} = {text}")
        return f"w{len(lines) - 1}"

    operations: dict[int, Any] = {
        **{code: (lambda a, f=f: step(f"{f}({a})")) for code, f in _FUNCTIONS.items()},
        **{
            getattr(casadi, f"OP_{s}"): (lambda a, b, s=sign: step(f"{a} {s} {b}"))
            for s, sign in _SIGNS.items()
        },
        casadi.OP_ASSIGN: lambda a: a,
        casadi.OP_NEG: lambda a: step(f"-{a}"),
        casadi.OP_SQ: lambda a: step(f"{a}**2"),
        casadi.OP_TWICE: lambda a: step(f"2 * {a}"),
        casadi.OP_INV: lambda a: step(f"1 / {a}"),
        casadi.OP_FABS: lambda a: step(f"abs({a})"),
        **(_elementary(step) if elementary else {}),
    }
    symbols = casadi.vertcat(*arguments.values())
    values = [
        key if each.numel() == 1 and key in {"t", "t0", "tf"} else f"{key}[{i}]"
        for key, each in arguments.items()
        for i in range(each.numel())
    ]
    found = interpret(expressions, symbols, values, operations, lambda number: f"({number!r})")
    listed = ", ".join(map(str, found))
    return "\n".join([f"\n\ndef {name}({', '.join(arguments)}):", *lines, f"    return [{listed}]"])


def _elementary(step: Callable[[str], str]) -> dict[int, Callable[[str], str]]:
    """Return what Pyomo cannot differentiate everywhere in other words; |a| is rounded off by 1e-6
    where it is 0.
    """
    return {
        casadi.OP_TANH: lambda a: step(f"1 - 2 / (exp(2 * {a}) + 1)"),
        casadi.OP_SINH: lambda a: step(f"(exp({a}) - exp(-({a}))) / 2"),
        casadi.OP_COSH: lambda a: step(f"(exp({a}) + exp(-({a}))) / 2"),
        casadi.OP_FABS: lambda a: step(f"sqrt({a}**2 + 1e-12)"),
    }


def _values(start: NLPPoint) -> Iterator[str]:
    """Yield the values of the variables at a point of the collocated reduction."""
    yield (
        "\nSTART_VALUES = "
        f"{pformat([float(f'{v:.12g}') for v in start.v], width=116, compact=True)}"
    )
    yield "for variable, value in zip(variables(model), START_VALUES):"
    yield "    variable.set_value(value, skip_validation=True)"

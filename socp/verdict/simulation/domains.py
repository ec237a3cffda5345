"""Where a motion ends because a function of it does: sqrt, log and powers below zero."""

from collections.abc import Sequence

import casadi
import numpy as np

from socp.model import Expr, Problem, nodes, numbers, of_motion, once, time
from socp.process import short

_ROOTS = {casadi.OP_SQRT: "sqrt", casadi.OP_LOG: "log"}
_POWERS = {casadi.OP_POW, casadi.OP_CONSTPOW}
# Of what an argument changes by when states change by their own magnitude: an integrator gets as
# near as that to where there are no rates any more
_NEAR = 1e-4


def domain_ended(
    problem: Problem, x: np.ndarray, t: float, p: np.ndarray, scale: np.ndarray
) -> str:
    """Return which function of the rates, or of the running cost, has no value beyond a state x
    (nx,) of magnitudes scale (nx,), and what keeps a motion from there; empty where none is near.
    """
    for name, text, function in _arguments(problem):
        value, slopes = (each.ravel() for each in numbers(function, x, t, p))
        if not value[0] > _NEAR * float(np.abs(slopes) @ scale):
            return f"; {name} has no value where {text} < 0: a path constraint keeps a motion off"
    return ""


@of_motion
@once
def _arguments(problem: Problem) -> list[tuple[str, str, casadi.Function]]:
    """Return the functions that have no value below zero, each with its argument as text and as a
    function (x, t, p) -> value, slopes (1, nx).
    """
    found: list[tuple[str, Expr]] = []
    for node in nodes(casadi.vertcat(problem.rate, problem.lagrangian)):
        arguments = [node.dep(k) for k in range(node.n_dep())]
        name = _ROOTS.get(node.op(), "a power" if _fractional(node.op(), arguments) else "")
        if name and not arguments[0].is_constant():
            found.append((name, arguments[0]))
    symbols = [problem.x, time, problem.p]
    return [
        (name, short(str(each)), casadi.Function("a", symbols, _with_slopes(problem, each)))
        for name, each in found
        if not casadi.depends_on(each, problem.u)
    ]


def _fractional(operation: int, arguments: Sequence[Expr]) -> bool:
    if operation not in _POWERS:
        return False
    exponent = arguments[-1]
    return exponent.is_constant() and float(exponent) % 1.0 != 0.0


def _with_slopes(problem: Problem, argument: Expr) -> list[Expr]:
    return [argument, casadi.densify(casadi.jacobian(argument, problem.x))]

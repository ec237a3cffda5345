"""Control laws on arcs: what the problem gives, and what can be derived from it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import casadi

from socp.errors import MethodError
from socp.problem import Constraint, Problem
from socp.symbols import Expr, column, time
from socp.word import Mode

_DEEPEST = 12  # total derivatives tried before a constraint's order is called infinite


@final
@dataclass(frozen=True, eq=False)
class ArcLaw:
    """Control (nu, 1) on an arc, conditions that vanish at its entry, and the state constraints that it keeps active."""

    control: Expr
    entry: tuple[Expr, ...]
    kept: frozenset[str]


def total_derivative(problem: Problem, expression: Expr) -> Expr:
    """Return d/dt of an expression of x, t, p along x' = f0 + G u."""
    return casadi.jtimes(expression, problem.x, problem.rate) + casadi.jacobian(expression, time)


def tower(problem: Problem, constraint: Constraint) -> tuple[list[Expr], Expr]:
    """Return ([c, c', .., c^(q-1)], c^(q)) of a state constraint, q its order: c^(q) is the first that holds a control.

    Raises MethodError where no control appears at all.
    """
    held = [constraint.expression]
    for _ in range(_DEEPEST):
        derivative = total_derivative(problem, held[-1])
        if casadi.depends_on(derivative, problem.u):
            return held, derivative
        held.append(derivative)
    raise MethodError(f"state constraint '{constraint.name}': no control appears in its first {_DEEPEST} derivatives")


def arc_law(problem: Problem, modes: tuple[Mode, ...]) -> ArcLaw:
    """Return the control law of an arc; MethodError names the control whose law is missing or ambiguous."""
    control, entry, kept = [], [], []
    for i, mode in enumerate(modes):
        if mode.kind == "lower" or mode.kind == "upper":
            control.append(problem.box[int(mode.kind == "upper"), i])
        elif mode.kind == "free":
            control.append(problem.u[i])
        elif mode.kind == "singular":
            control.append(_singular(problem, i))
        else:
            law, constraint = _boundary(problem, i, mode)
            control.append(law)
            entry += tower(problem, constraint)[0]
            kept.append(constraint.name)
    return ArcLaw(column(control), tuple(entry), frozenset(kept))


def _singular(problem: Problem, i: int) -> Expr:
    for control, law in problem.singular.items():
        if control.name() == problem.control_names[i]:
            return law
    raise MethodError(f"problem '{problem.name}' has no singular law for control '{problem.control_names[i]}'")


def _boundary(problem: Problem, i: int, mode: Mode) -> tuple[Expr, Constraint]:
    name = problem.control_names[i]
    given = next((law for control, law in problem.boundary.items() if control.name() == name), None)
    if given is None:
        raise MethodError(f"problem '{problem.name}' has no boundary law for control '{name}'")
    laws = given if isinstance(given, Mapping) else {c.name: given for c in problem.constraints}
    if mode.constraint is None and len(laws) > 1:
        raise MethodError(f"control '{name}': which state constraint does the boundary arc follow? Write " + " or ".join(f"b[{c}]" for c in laws))
    wanted = mode.constraint or next(iter(laws))
    if wanted not in laws:
        raise MethodError(f"control '{name}' has no boundary law on '{wanted}'; it has one on {', '.join(laws)}")
    return laws[wanted], next(c for c in problem.constraints if c.name == wanted)

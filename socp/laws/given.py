"""Laws that the user gives, held against the derived ones at random admissible points."""

from collections.abc import Iterator, Mapping

import casadi
import numpy as np

from socp.errors import MethodError, ProblemError
from socp.laws import probes
from socp.laws.contacts import controlled_constraints
from socp.laws.law import given_singular
from socp.laws.principle import ArcPrinciple, derive
from socp.model import Expr, Problem

# Relative to the control's box: laws given in decimals agree to their digits, wrong ones differ by
# more
_ALIKE = 1e-6


def check_laws(problem: Problem) -> None:
    """Refuse user-given laws that differ from the derived ones.

    A singular law may be right only while other controls are on state constraints; it is refused if
    it is wrong on every arc that can be derived. A law that cannot be derived is not checked.
    Raises ProblemError with both formulas and the point where they differ most.
    """
    for i, name in enumerate(problem.control_names):
        law = given_singular(problem, i)
        if law is not None:
            _refuse(problem, name, "singular law", law, list(_singular_arcs(problem, name)))
        if any(control.name() == name for control in problem.boundary):
            _check_boundary(problem, i)


def _check_boundary(problem: Problem, i: int) -> None:
    name = problem.control_names[i]
    named = next(law for control, law in problem.boundary.items() if control.name() == name)
    acting = controlled_constraints(problem, i)
    wanted = [c for c in acting if isinstance(named, Mapping) and c.name in named]
    if isinstance(named, Mapping):
        for constraint in wanted:
            law = casadi.SX(named[constraint.name])
            _refuse(
                problem,
                name,
                f"boundary law on '{constraint.name}'",
                law,
                _boundary_arcs(problem, name, [constraint.name]),
            )
        idle = [c for c in named if c not in {constraint.name for constraint in acting}]
        if idle:
            raise ProblemError(
                f"problem '{problem.name}': boundary law of '{name}': it does not act on "
                f"'{idle[0]}'"
            )
    else:
        _refuse(
            problem,
            name,
            "boundary law",
            casadi.SX(named),
            _boundary_arcs(problem, name, [c.name for c in acting]),
        )


def _singular_arcs(problem: Problem, name: str) -> Iterator[ArcPrinciple]:
    yield from _derived(problem, (name,), {})
    for j, other in enumerate(problem.control_names):
        if other != name:
            for constraint in controlled_constraints(problem, j):
                yield from _derived(problem, (name,), {other: constraint.name})


def _boundary_arcs(problem: Problem, name: str, constraints: list[str]) -> list[ArcPrinciple]:
    return [
        found for constraint in constraints for found in _derived(problem, (), {name: constraint})
    ]


def _derived(
    problem: Problem, singular: tuple[str, ...], boundary: Mapping[str, str]
) -> Iterator[ArcPrinciple]:
    try:
        yield derive(problem, singular, boundary)
    except MethodError:
        return


def _refuse(problem: Problem, name: str, kind: str, law: Expr, arcs: list[ArcPrinciple]) -> None:
    """Raise ProblemError unless the law agrees with the derived one on one of the arcs, or none
    could be derived.
    """
    i = problem.control_names.index(name)
    differences = [_difference(problem, i, law, found) for found in arcs]
    if not differences or any(text is None for text in differences):
        return
    raise ProblemError(
        f"problem '{problem.name}': the {kind} given for '{name}' is wrong: {differences[0]}; "
        "leave it out, it is derived"
    )


def _difference(problem: Problem, i: int, law: Expr, principle: ArcPrinciple) -> str | None:
    """Return both formulas and their values at the point where they differ most, None where they
    agree.
    """
    own, derived = (
        values[:, 0, 0]
        for values in probes.evaluator(problem, law, principle.control[i])(principle.points)
    )
    gap = np.abs(own - derived) / (np.ptp(problem.box[:, i]) + np.abs(derived))
    gap = np.where(np.isfinite(derived), np.where(np.isfinite(own), gap, np.inf), 0.0)
    if not gap.size or gap.max() <= _ALIKE:
        return None
    k, name = int(np.argmax(gap)), problem.control_names[i]
    point = ", ".join(
        f"{s} = {v:.6g}"
        for s, v in zip(
            problem.state_names, principle.points[1 : 1 + problem.x.numel(), k], strict=True
        )
    )
    formula = principle.control[i] if principle.feedback is None else principle.feedback[i]
    return (
        f"{name} = {law}, but Pontryagin's principle gives {name} = {formula}; "
        f"at {point} they are {own[k]:.6g} and {derived[k]:.6g}"
    )

"""The laws of a problem for the reader: formulas, orders and the Legendre-Clebsch condition, or why
there is no law.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations
from typing import final

import numpy as np

from socp.errors import MethodError
from socp.laws import probes
from socp.laws.contacts import controlled_constraints
from socp.laws.principle import ArcPrinciple, derive
from socp.laws.simplify import simplified
from socp.laws.singular import regular
from socp.model import Expr, Problem

_SAMPLES = 200  # points at which signs and bounds are looked at
_JOINT = 3  # controls at most of which every pair is described as singular together


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Law:
    """One derived law, or the reason why there is none.

    `controls` are singular together, or the one that follows `constraint`; `expressions` are their
    laws in x, t, p, and in the costate where `costate` is true; `order` of the singular arc or of
    the constraint; `legendre_clebsch` is the expression that has to be >= 0 on an arc with one
    singular control; `remarks` say what sampling shows; `reason` stands where there is no law.
    """

    controls: tuple[str, ...]
    constraint: str | None = None
    expressions: tuple[Expr, ...] = ()
    order: int = 0
    costate: bool = False
    legendre_clebsch: Expr | None = None
    remarks: tuple[str, ...] = ()
    reason: str = ""


def describe_laws(problem: Problem) -> list[Law]:
    """Return the derived laws: each control singular, the others constant; pairs of controls; every
    boundary arc.
    """
    names = problem.control_names
    groups: list[tuple[str, ...]] = [(name,) for name in names]
    groups += list(combinations(names, 2)) if len(names) <= _JOINT else []
    found = [_singular(problem, group) for group in groups]
    for j, name in enumerate(names):
        found += [
            _boundary(problem, name, constraint.name)
            for constraint in controlled_constraints(problem, j)
        ]
    return found


def law_lines(problem: Problem, write: Callable[[Expr], str]) -> Iterator[tuple[str, str]]:
    """Yield (label, text) for every derived law, its formulas written by `write`."""
    for law in describe_laws(problem):
        label = "boundary law" if law.constraint else "singular law"
        where = f" on {law.constraint}" if law.constraint else ""
        if law.reason:
            yield label, f"{', '.join(law.controls)}{where}: none: {law.reason}"
            continue
        formulas = ", ".join(
            f"{name} = {write(e)}" for name, e in zip(law.controls, law.expressions, strict=True)
        )
        kind = f"order {law.order}" + (", with the costate" if law.costate else "")
        yield label, f"{formulas}{where} ({kind})"
        if law.legendre_clebsch is not None:
            yield label, f"  Legendre-Clebsch: {write(law.legendre_clebsch)} >= 0"
        yield from ((label, f"  {remark}") for remark in law.remarks)


def _singular(problem: Problem, group: tuple[str, ...]) -> Law:
    try:
        found = derive(problem, group)
    except MethodError as error:
        return Law(controls=group, reason=_reason(error))
    at = [problem.control_names.index(name) for name in group]
    law = found.control if found.feedback is None else found.feedback
    single = len(group) == 1
    remarks = [
        _remark(
            problem,
            found,
            at,
            "the other controls constant" if len(group) < len(problem.control_names) else "",
        )
    ]
    remarks += list(_partly(problem, group[0])) if single else []
    return Law(
        controls=group,
        expressions=tuple(simplified(problem, law[i], found.points) for i in at),
        order=max(found.orders[name] for name in group),
        costate=found.feedback is None,
        legendre_clebsch=simplified(problem, found.legendre_clebsch, found.points)
        if single
        else None,
        remarks=tuple(remarks),
    )


def _partly(problem: Problem, name: str) -> Iterator[str]:
    """Yield a remark for every state constraint that another control can follow while this one is
    singular.
    """
    i = problem.control_names.index(name)
    for j, other in enumerate(problem.control_names):
        for constraint in controlled_constraints(problem, j) if j != i else ():
            try:
                found = derive(problem, (name,), {other: constraint.name})
            except MethodError:
                continue
            yield _remark(problem, found, [i], f"{other} on {constraint.name}")


def _boundary(problem: Problem, name: str, constraint: str) -> Law:
    try:
        found = derive(problem, (), {name: constraint})
    except MethodError as error:
        return Law(controls=(name,), constraint=constraint, reason=_reason(error))
    i = problem.control_names.index(name)
    law = simplified(problem, found.control[i], found.points)
    remarks = tuple(filter(None, [_outside(problem, found, [i], "")]))
    return Law(
        controls=(name,),
        constraint=constraint,
        expressions=(law,),
        order=found.orders[constraint],
        remarks=remarks,
    )


def _reason(error: MethodError) -> str:
    """Return an error's text without the problem and the arc, which stand before it."""
    _, _, rest = str(error).partition(": ")
    return rest or str(error)


def _remark(problem: Problem, principle: ArcPrinciple, at: list[int], where: str) -> str:
    """Return what sampling shows of the Legendre-Clebsch matrix where the law is within the
    bounds.
    """
    outside = _outside(problem, principle, at, where)
    if outside:
        return outside
    inside = _inside(problem, principle, at)
    matrix = probes.evaluator(problem, principle.legendre_clebsch)(inside)[0]
    matrix = matrix[np.isfinite(matrix).all(axis=(1, 2))]
    values = np.linalg.eigvalsh((matrix + matrix.transpose(0, 2, 1)) / 2)
    prefix, count = f"{where}: " if where else "", f"{len(values)} sampled points"
    if not len(values):
        return f"{prefix}its sign is not known: it has no value at any sampled point"
    if (values > 0).all():
        return f"{prefix}positive at all {count}"
    if (values < 0).any(axis=1).all():
        return f"{prefix}negative at all {count}: such an arc cannot minimise"
    share = (values > 0).all(axis=1).mean()
    return f"{prefix}positive at {share:.0%} of {count}: to be checked along an arc"


def _points(problem: Problem, principle: ArcPrinciple) -> np.ndarray:
    """Return points (nv, n) on the arc at which its law has a value, those of its derivation among
    them.
    """
    at = probes.onto(problem, principle.equations, probes.admissible(problem, _SAMPLES))
    if principle.chain is None:
        return at
    at = at[:, regular(principle.setting, principle.chain, at)]
    return at if at.shape[1] > principle.points.shape[1] else principle.points


def _values(
    problem: Problem, principle: ArcPrinciple, at: list[int], points: np.ndarray
) -> np.ndarray:
    values: np.ndarray = probes.evaluator(problem, principle.control[at])(points)[0][:, :, 0]
    return values


def _inside(problem: Problem, principle: ArcPrinciple, at: list[int]) -> np.ndarray:
    """Return the sampled points (nv, n) at which the laws of the controls respect their bounds."""
    points = _points(problem, principle)
    u = _values(problem, principle, at, points)
    low, high = problem.box[:, at]
    return points[:, ((u >= low) & (u <= high)).all(axis=1)]


def _outside(problem: Problem, principle: ArcPrinciple, at: list[int], where: str) -> str:
    """Return a warning where a law leaves the bounds at every sampled point, or no point was met,
    else nothing.
    """
    points = _points(problem, principle)
    prefix = f"{where}: " if where else ""
    if not points.shape[1]:
        return f"{prefix}no state and costate that satisfy its conditions were met by sampling"
    if _inside(problem, principle, at).shape[1]:
        return ""
    names = ", ".join(problem.control_names[i] for i in at)
    return (
        f"{prefix}the law lies outside the bounds of {names} at all {points.shape[1]} sampled "
        "points"
    )

"""State constraints and the controls that act on them: which one a boundary arc follows, and how it
is met and left.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import final

import casadi
import numpy as np

from socp.errors import MethodError
from socp.laws import probes
from socp.laws.setting import tower
from socp.model import (
    Constraint,
    Kind,
    Mode,
    Modes,
    Problem,
    Solution,
    Word,
    column,
    of_motion,
    once,
)

_SIGNS: dict[Kind | None, int] = {"lower": -1, "upper": 1}  # of the bounds that a control goes to


@final
@dataclass(frozen=True)
class Tie:
    """A joint at which the law of a control, on an arc (an index), has the value of the bound that
    it is at beside it: where its arc ends (`end` -1), or begins (0).
    """

    arc: int
    control: int
    end: int


@of_motion
@once
def controlled_constraints(problem: Problem, control: int) -> tuple[Constraint, ...]:
    """Return the state constraints on which a control acts: those whose first controlled derivative
    holds it.
    """
    return tuple(c for c in problem.constraints if _acts(problem, c, control))


def name_constraints(problem: Problem, word: Word) -> Word:
    """Return the word with a state constraint named on every boundary arc.

    Where several constraints act on the control, the neighbouring bang arcs tell: before contact
    the control drives c up to zero, after it away from zero. Raises MethodError, listing the names,
    where they do not.
    """
    arcs = [
        tuple(_named(problem, word, k, i) for i in range(len(arc)))
        for k, arc in enumerate(word.arcs)
    ]
    return Word(word.controls, tuple(arcs))


def constraint_of(problem: Problem, i: int, mode: Mode) -> Constraint:
    """Return the constraint that a boundary mode follows, if it can be told from the mode alone."""
    name, candidates = problem.control_names[i], controlled_constraints(problem, i)
    listed = " or ".join(f"b[{c.name}]" for c in candidates) or "none does"
    if mode.constraint is None and len(candidates) == 1:
        return candidates[0]
    if mode.constraint is None:
        question = (
            "which state constraint does the boundary arc follow? Write"
            if candidates
            else "no state constraint depends on it:"
        )
        raise MethodError(f"problem '{problem.name}', control '{name}': {question} {listed}")
    found = next((c for c in problem.constraints if c.name == mode.constraint), None)
    if found is None:
        known = ", ".join(c.name for c in problem.constraints) or "none"
        raise MethodError(
            f"problem '{problem.name}' has no state constraint '{mode.constraint}' for control "
            f"'{name}' to follow; it has {known}"
        )
    return found


def _named(problem: Problem, word: Word, k: int, i: int) -> Mode:
    mode = word.arcs[k][i]
    if mode.kind != "boundary" or mode.constraint is not None:
        return mode
    candidates = controlled_constraints(problem, i)
    row = [arc[i] for arc in word.arcs]
    before = next((m.kind for m in reversed(row[:k]) if m != mode), None)
    after = next((m.kind for m in row[k + 1 :] if m != mode), None)
    fitting = [c for c in candidates if _fits(problem, c, i, (before, after))]
    if len(candidates) > 1 and len(fitting) == 1:
        return Mode("boundary", fitting[0].name)
    return Mode("boundary", constraint_of(problem, i, mode).name)


def _fits(
    problem: Problem, constraint: Constraint, i: int, around: tuple[Kind | None, Kind | None]
) -> bool:
    """Tell whether bang neighbours can enter and leave a constraint: c^(q) < 0 after it, (-1)^q
    c^(q) < 0 before.
    """
    order, push = _push(problem, constraint, i)
    before, after = (push * _SIGNS.get(kind, 0) for kind in around)
    return bool((before or after) and before * (-1) ** order <= 0 and after <= 0)


@of_motion
@once
def _push(problem: Problem, constraint: Constraint, i: int) -> tuple[int, int]:
    """Return the order q of a constraint and the sign with which control i enters c^(q), 0 where it
    is not one.
    """
    held, _ = tower(problem, constraint)
    at = probes.points_on(problem, column(held))
    return len(held), _sign(problem, constraint, i, at)


def _sign(problem: Problem, constraint: Constraint, i: int, at: np.ndarray) -> int:
    """Return the sign with which control i enters c^(q) at all points (nv, n), 0 where it is not
    one.
    """
    slope = casadi.jacobian(tower(problem, constraint)[1], problem.u[i])
    slopes = probes.evaluator(problem, slope)(at)[0].ravel()
    alike = slopes.size and slopes.min() * slopes.max() > 0
    return int(np.sign(slopes[0])) if alike else 0


def tangential_joints(problem: Problem, word: Word, near: Solution | None = None) -> frozenset[Tie]:
    """Return the joints of a word at which the law of a boundary arc has to have the value of the
    bound that its control goes to, or comes from.

    A bang that drives c up, after an arc along c = 0, would violate it, were the law not at that
    bound where it is left: c^(q) <= 0 is needed of what follows, and the box keeps the law from
    going further. Before an arc (-1)^q c^(q) <= 0 is needed likewise. Where another control that
    acts on the constraint changes as well at that time nothing follows. Which bound drives c up may
    depend on the states: then those at the joint tell it in a guess or solution that is `near`, one
    with the arcs of the word.
    """
    arcs = name_constraints(problem, word).arcs
    known = near if near is not None and len(near.arcs) == len(arcs) else None
    return frozenset(
        Tie(arc, i, end)
        for k, (one, other) in enumerate(pairwise(arcs))
        for arc, end, modes, beside in ((k, -1, one, other), (k + 1, 0, other, one))
        for i, mode in enumerate(modes)
        if mode.kind == "boundary"
        and _tangential(problem, i, (modes, beside), end, _joint(problem, known, k))
    )


def _joint(problem: Problem, near: Solution | None, k: int) -> np.ndarray:
    """Return the point (nv, 1) where arc k of a solution ends, without costates and controls; none,
    (nv, 0), without a solution.
    """
    if near is None:
        return np.empty((0, 0))
    arc, rest = near.arcs[k], np.zeros(problem.x.numel() + problem.u.numel())
    p = [near.parameters.get(name, 0.0) for name in problem.parameter_names]
    return np.concatenate([arc.t[-1:], arc.x[:, -1], p, rest])[:, None]


def _tangential(
    problem: Problem, i: int, modes: tuple[Modes, Modes], end: int, joint: np.ndarray
) -> bool:
    own, beside = modes
    constraint = constraint_of(problem, i, own[i])
    if beside[i].kind not in _SIGNS or any(mode.constraint == constraint.name for mode in beside):
        return False
    order, push = _push(problem, constraint, i)
    if not push and joint.size:
        push = _sign(problem, constraint, i, joint)
    towards = push * _SIGNS[beside[i].kind] * (1 if end else (-1) ** order)
    changed = (j for j, mode in enumerate(own) if j != i and mode != beside[j])
    return towards > 0 and not any(
        constraint in controlled_constraints(problem, j) for j in changed
    )


def _acts(problem: Problem, constraint: Constraint, control: int) -> bool:
    try:
        held, top = tower(problem, constraint)
    except MethodError:
        return False
    at = probes.points_on(problem, column(held))
    slope = casadi.jacobian(top, problem.u[control])
    return bool(slope.nnz() and (not at.shape[1] or probes.nonzero(problem, slope, at).all()))

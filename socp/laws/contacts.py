"""State constraints and the controls that act on them: which one a boundary arc follows."""

import casadi
import numpy as np

from socp.errors import MethodError
from socp.laws import probes
from socp.laws.setting import tower
from socp.model import Constraint, Mode, Problem, Word, column, once


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
    problem: Problem, constraint: Constraint, i: int, around: tuple[str | None, str | None]
) -> bool:
    """Tell whether bang neighbours can enter and leave a constraint: c^(q) < 0 after it, (-1)^q
    c^(q) < 0 before.
    """
    held, top = tower(problem, constraint)
    at = probes.points_on(problem, column(held))
    slopes = probes.evaluator(problem, casadi.jacobian(top, problem.u[i]))(at)[0].ravel()
    if not slopes.size or slopes.min() * slopes.max() <= 0:
        return False
    push = {"upper": 1, "lower": -1}
    before, after = (push.get(kind or "", 0) * int(np.sign(slopes[0])) for kind in around)
    return bool((before or after) and before * (-1) ** len(held) <= 0 and after <= 0)


def _acts(problem: Problem, constraint: Constraint, control: int) -> bool:
    try:
        held, top = tower(problem, constraint)
    except MethodError:
        return False
    at = probes.points_on(problem, column(held))
    slope = casadi.jacobian(top, problem.u[control])
    return bool(slope.nnz() and (not at.shape[1] or probes.nonzero(problem, slope, at).all()))

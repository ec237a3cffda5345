"""What an arc may be: every combination of modes of the controls for which the problem has a
law.
"""

from itertools import product

import casadi
import numpy as np

from socp.errors import MethodError
from socp.laws.contacts import controlled_constraints
from socp.laws.law import arc_law
from socp.model import Mode, Modes, Problem, evaluate, of_motion, once, time

_BANGS = (Mode("lower"), Mode("upper"))


def control_modes(problem: Problem, i: int) -> tuple[Mode, ...]:
    """Return the modes that control i may be in: its finite bounds, singular, and along each
    constraint it acts on.
    """
    bangs = [
        mode for mode, bound in zip(_BANGS, problem.box[:, i], strict=True) if np.isfinite(bound)
    ]
    return (
        *bangs,
        Mode("singular"),
        *(Mode("boundary", c.name) for c in controlled_constraints(problem, i)),
    )


def arc_modes(problem: Problem) -> tuple[Modes, ...]:
    """Return every combination of modes, one a control, that has a law inside the box; others
    cannot be an arc.
    """
    choices = product(*(control_modes(problem, i) for i in range(problem.u.numel())))
    return tuple(modes for modes in choices if _possible(problem, modes))


def _possible(problem: Problem, modes: Modes) -> bool:
    try:
        arc_law(problem, modes)
    except MethodError:
        return False
    return True


def law_values(
    problem: Problem, modes: Modes, x: np.ndarray, costate: np.ndarray, t: np.ndarray, p: np.ndarray
) -> np.ndarray:
    """Return the controls (nu, n) that the law of an arc gives at x (nx, n), costate (nx, n), t
    (n,), p (np,).

    They are nan where the law needs a costate that is nan. Raises MethodError where there is no
    law.
    """
    given = costate if arc_law(problem, modes).costate else np.nan_to_num(costate)
    return evaluate(_law_function(problem, modes), x, given, t, p)[0]


@of_motion
@once
def _law_function(problem: Problem, modes: Modes) -> casadi.Function:
    symbols = [problem.x, problem.costate, time, problem.p]
    control = arc_law(problem, modes).control
    return casadi.Function("law", symbols, [casadi.densify(control)])


@of_motion
@once
def feedback_function(problem: Problem, modes: Modes) -> casadi.Function:
    """Return the control of an arc whose law needs no costate as a function of x, t, p.

    Raises MethodError where there is no such law.
    """
    law = arc_law(problem, modes)
    if law.costate:
        raise MethodError("a law that depends on the costate is no feedback in the state")
    return casadi.Function("law", [problem.x, time, problem.p], [casadi.densify(law.control)])

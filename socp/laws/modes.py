"""What an arc may be: every combination of modes of the controls for which the problem has a
law.
"""

from itertools import product

import casadi
import numpy as np

from socp.errors import MethodError
from socp.laws import law as laws
from socp.model import Mode, Modes, Problem, time

_BANGS = (Mode("lower"), Mode("upper"))


def control_modes(problem: Problem, i: int) -> tuple[Mode, ...]:
    """Return the modes that control i may be in: its finite bounds, singular, and along each
    constraint it acts on.
    """
    bangs = [
        mode for mode, bound in zip(_BANGS, problem.box[:, i], strict=True) if np.isfinite(bound)
    ]
    return (*bangs, Mode("singular"), *(Mode("boundary", c.name) for c in laws.acting(problem, i)))


def arc_modes(problem: Problem) -> tuple[Modes, ...]:
    """Return every combination of modes, one a control, that has a law inside the box; others
    cannot be an arc.
    """
    choices = product(*(control_modes(problem, i) for i in range(problem.u.numel())))
    return tuple(modes for modes in choices if _possible(problem, modes))


def _possible(problem: Problem, modes: Modes) -> bool:
    try:
        laws.arc_law(problem, modes)
    except MethodError:
        return False
    return True


def values(
    problem: Problem, modes: Modes, x: np.ndarray, costate: np.ndarray, t: np.ndarray, p: np.ndarray
) -> np.ndarray:
    """Return the controls (nu, n) that the law of an arc gives at x (nx, n), costate (nx, n), t
    (n,), p (np, n).

    They are nan where the law needs a costate that is nan. Raises MethodError where there is no
    law.
    """
    known: dict[Modes, casadi.Function] = vars(problem).setdefault(
        "_law_values", {}
    )  # as its own cached properties
    law = laws.arc_law(problem, modes)
    if modes not in known:
        symbols = [problem.x, problem.costate, time, problem.p]
        known[modes] = casadi.Function("law", symbols, [casadi.densify(law.control)])
    given = costate if law.costate else np.nan_to_num(costate)
    return np.array(known[modes].map(t.size)(x, given, t[None, :], p).full())

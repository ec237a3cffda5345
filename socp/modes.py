"""What an arc may be: every combination of modes of the controls for which the problem has a law."""

from itertools import product

import numpy as np

from socp import laws
from socp.errors import MethodError
from socp.principle import Modes
from socp.problem import Problem
from socp.word import Mode


def control_modes(problem: Problem, i: int) -> tuple[Mode, ...]:
    """Return the modes that control i may be in: its finite bounds, singular, and along each constraint it acts on."""
    bangs = [Mode(kind) for kind, bound in (("lower", 0), ("upper", 1)) if np.isfinite(problem.box[bound, i])]
    return (*bangs, Mode("singular"), *(Mode("boundary", c.name) for c in laws.acting(problem, i)))


def arc_modes(problem: Problem) -> tuple[Modes, ...]:
    """Return every combination of modes, one a control, that has a law inside the box; others cannot be an arc."""
    choices = product(*(control_modes(problem, i) for i in range(problem.u.numel())))
    return tuple(modes for modes in choices if _possible(problem, modes))


def _possible(problem: Problem, modes: Modes) -> bool:
    try:
        laws.arc_law(problem, modes)
    except MethodError:
        return False
    return True

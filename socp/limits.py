"""Where the objectives of a sequence of words tend to."""

from collections.abc import Sequence

import numpy as np

from socp.solution import Solution

_ROUNDING = 1e-11  # relative: what a difference of two objectives has to exceed to say anything


def limit(solutions: Sequence[Solution]) -> float | None:
    """Return Aitken's extrapolation of the objectives, of the last three that differ by more than rounding.

    It is the limit of a sequence that converges geometrically, and of no other. None where the last four are none: both
    ratios of their differences have to lie between 0 and 1, and the extrapolation of the first three has to agree with
    that of the last three as far as the last one goes.
    """
    values = [solution.objective for solution in solutions]
    steps = np.diff(values)
    clear = [k for k in range(1, len(steps)) if abs(steps[k]) > _ROUNDING * abs(values[-1])]
    if not clear or clear[-1] < 2:
        return None
    k = clear[-1]
    if not all(0.0 < steps[j] / steps[j - 1] < 1.0 for j in (k, k - 1)):
        return None
    before, last = (float(values[j + 1] - steps[j] ** 2 / (steps[j] - steps[j - 1])) for j in (k - 1, k))
    return last if abs(last - before) <= abs(last - values[k + 1]) else None


def told(solutions: Sequence[Solution]) -> str:
    """Say in a sentence what the objective is for every number of switches, and where it tends to."""
    said = ", ".join(f"{len(each.arcs) - 1}: {each.objective:.12g}" for each in solutions)
    end, ratios = limit(solutions), shortening(solutions[-1])
    tends = "" if end is None else f"; Aitken's extrapolation of the last three is {end:.12g}"
    law = f"; arcs between switches shorten by {', '.join(f'{each:.4g}' for each in ratios)}" if ratios else ""
    return f"best objective by number of switches {said}{tends}{law}"


def shortening(solution: Solution) -> list[float]:
    """Return what the length of every arc between two switches is times the one before; none unless all shorten."""
    lengths = np.diff(solution.junctions)
    ratios = (lengths[1:] / lengths[:-1]).tolist()
    return ratios if all(0.0 < each < 1.0 for each in ratios) else []

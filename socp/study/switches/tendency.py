"""Where the objectives of a sequence of words tend to."""

from collections.abc import Sequence

import numpy as np

from socp.model import Solution

_ROUNDING = 1e-11  # relative: what a difference of two objectives has to exceed to say anything
# Times: what two ratios tell of the rest; further apart the rest is not known to its first digit
_ALIKE = 2.0


def limit(solutions: Sequence[Solution]) -> float | None:
    """Return Aitken's extrapolation of the objectives, of the last three that differ by more than
    rounding.

    It is the limit of a sequence that converges geometrically, and of no other. None where the last
    four are none: what is left of a geometric sequence is a fixed share of its last step, which
    both ratios of the steps tell alike.
    """
    values = [solution.objective for solution in solutions]
    steps = np.diff(values)
    clear = [k for k in range(1, len(steps)) if abs(steps[k]) > _ROUNDING * abs(values[-1])]
    if not clear or clear[-1] < 2:
        return None
    k = clear[-1]
    ratios = steps[k] / steps[k - 1], steps[k - 1] / steps[k - 2]
    if not all(0.0 < ratio < 1.0 for ratio in ratios):
        return None
    left, before = (ratio / (1.0 - ratio) for ratio in ratios)
    return (
        float(values[k + 1] + left * steps[k])
        if max(left, before) <= _ALIKE * min(left, before)
        else None
    )


def summary(solutions: Sequence[Solution]) -> str:
    """Say in a sentence what the objective is for every number of switches, and where it tends
    to.
    """
    said = ", ".join(f"{len(each.arcs) - 1}: {each.objective:.12g}" for each in solutions)
    end, ratios = limit(solutions), length_ratios(solutions[-1])
    tends = "" if end is None else f"; Aitken's extrapolation of the last three is {end:.12g}"
    law = (
        f"; arcs between switches shorten by {', '.join(f'{each:.4g}' for each in ratios)}"
        if ratios
        else ""
    )
    return f"best objective by number of switches {said}{tends}{law}"


def length_ratios(solution: Solution) -> list[float]:
    """Return what the length of every arc between two switches is times the one before; none unless
    all shorten.
    """
    lengths = np.diff(solution.junctions)
    ratios = (lengths[1:] / lengths[:-1]).tolist()
    return ratios if all(0.0 < each < 1.0 for each in ratios) else []

"""Where the objectives of a sequence of words tend to."""

from collections.abc import Sequence

import numpy as np

from socp.solution import Solution

_ROUNDING = 1e-11  # relative: what a difference of two objectives has to exceed to say anything


def limit(solutions: Sequence[Solution]) -> float | None:
    """Return Aitken's extrapolation of the objectives, of the last three that differ by more than rounding.

    It is the limit of a sequence that converges geometrically; None where the last three do not shrink so.
    """
    values = [solution.objective for solution in solutions]
    steps = np.diff(values)
    clear = [k for k in range(1, len(steps)) if abs(steps[k]) > _ROUNDING * abs(values[-1])]
    if not clear or not 0.0 < steps[clear[-1]] / steps[clear[-1] - 1] < 1.0:
        return None
    k = clear[-1]
    return float(values[k + 1] - steps[k] ** 2 / (steps[k] - steps[k - 1]))


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

"""The problem language under its first address; new files import it from `socp`."""

from socp.model import (
    Problem,
    Reference,
    Scene,
    controls,
    final_time,
    free,
    initial,
    initial_time,
    parameters,
    states,
    time,
)

__all__ = [
    "Problem",
    "Reference",
    "Scene",
    "controls",
    "final_time",
    "free",
    "initial",
    "initial_time",
    "parameters",
    "states",
    "time",
]

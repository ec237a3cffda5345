"""Which rooms of socp a call spends its time in.

A function's own time belongs to the stage of its file. What serves many stages, functions of other
packages first of all, is charged to its callers, each by the time that it spent through it.
"""

import cProfile
import pstats
from collections.abc import Callable
from pathlib import Path

import socp

Function = tuple[str, int, str]

# the first that a file's path under socp begins with; what stands under no stage is its callers'
_STAGES = {
    "laws": ("laws",),
    "build": tuple(
        f"transcription/{name}"
        for name in ("assembly", "collocation", "entries", "grid", "lifting", "phases", "scaling")
    ),
    "solve": ("solvers",),
    "verify": ("verdict/reintegration", "verdict/simulation", "verdict/motion"),
    "polish": ("verdict/newton", "verdict/accuracy", "methods/polish"),
    "second order": ("verdict/minimum",),
    "judge": ("verdict",),
    "search": ("methods", "search", "registry"),
}
NAMES = tuple(_STAGES)
_HOME = Path(socp.__file__).parent.as_posix() + "/"
_ROUNDS = 60  # callers of callers of callers: what goes in circles has nearly left them by then


def _stage(function: Function) -> str | None:
    """Return the stage that owns a function, or nothing where it serves its callers."""
    file, _, name = function
    if not file.startswith(_HOME):
        return None
    if file.endswith("ipopt.py") and name == "_solver":  # lays the solver, as a transcription does
        return "build"
    place = file.removeprefix(_HOME)
    owners = (stage for stage, starts in _STAGES.items() if place.startswith(starts))
    return next(owners, None)


def shares(call: Callable[[], object]) -> dict[str, float]:
    """Return the share of each stage in the time of a call, from 0 to 1."""
    profile = cProfile.Profile()
    profile.runcall(call)
    spent = dict.fromkeys(_STAGES, 0.0)
    known = pstats.Stats(profile).stats
    left = {function: own for function, (_, _, own, _, _) in known.items()}
    for _ in range(_ROUNDS):
        up: dict[Function, float] = {}
        for function, seconds in left.items():
            callers = known[function][4]
            through = sum(each[3] for each in callers.values())
            if (stage := _stage(function)) is not None or not through:
                spent[stage or "search"] += seconds
                continue
            for caller, each in callers.items():
                up[caller] = up.get(caller, 0.0) + seconds * each[3] / through
        left = up
    whole = sum(spent.values())
    return {stage: seconds / whole for stage, seconds in spent.items()}

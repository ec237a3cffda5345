"""What an event is called: by the figure that passes through zero, and from which side."""

from socp.model import Solution
from socp.study.monitors import Clue

TOUCHED, LEFT = "constraint touched", "constraint left"
_KINDS = {  # going forth, and coming back
    "length": ("arc vanishes", "arc appears"),
    "switching": ("arc appears", "arc vanishes"),
    "lower": ("law leaves its box", "law enters its box"),
    "upper": ("law leaves its box", "law enters its box"),
    "constraint": (TOUCHED, LEFT),
    "multiplier": (LEFT, TOUCHED),
}
MINIMUM = "minimum lost", "minimum gained"
FOLD, MET = "fold", "switches meet"
# an arc loses its length, and has it again at the other bound
TURNED = "bound changes"


def named(solution: Solution, clue: Clue, *, back: bool) -> tuple[str, str]:
    """Return what happens where a margin is zero on the way forth, or `back`, and to what."""
    kind = clue.kind.split()[0]
    called = _KINDS[kind][back]
    if kind != "length":
        return called, clue.of
    k, arcs = clue.number, solution.arcs
    here = arcs[k].modes
    names = solution.control_names
    if 0 < k < len(arcs) - 1:
        entered = {i for i, m in enumerate(arcs[k - 1].modes) if m != here[i]}
        left = {i for i, m in enumerate(arcs[k + 1].modes) if m != here[i]}
        if not entered & left:
            return MET, ", ".join(names[i] for i in sorted(entered | left))
    beside = arcs[k - 1].modes if k else arcs[min(1, len(arcs) - 1)].modes
    changed = [i for i, mode in enumerate(here) if mode != beside[i]] or list(range(len(names)))
    return called, ", ".join(names[i] for i in changed)

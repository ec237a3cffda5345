"""Which sides of a region are clipped: where leaving a state beyond them can only make it worse."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from fractions import Fraction
from itertools import product
from typing import Any

from socp.errors import SolveError
from socp.proof.bound.checking import Check
from socp.proof.bound.comparing import Beyond
from socp.proof.bound.lifting import Limits

_MOST = 4  # states with open sides: each is clipped below, above or not, which makes 81 cases

Pairs = list[tuple[int, int]]


def clips(
    check: Check, box: Sequence[Limits], edges: Mapping[tuple[int, int], Fraction]
) -> tuple[Mapping[int, int], Pairs]:
    """Return as many sides (place, 0 below or 1 above) as can be clipped together where their
    edges are, one of a variable, and the pairs (j, k) of them where the rate of j depends on k.

    The box is that of the base variables without clips. What can be is for the checker to say.
    """
    places = sorted({k for k, _ in edges})
    if not places or len(places) > _MOST:
        return {}, []
    start: Any = [check.initial(k) for k in range(len(check.model.base))]
    cases = product(*([None, *(side for k, side in edges if k == place)] for place in places))
    for case in sorted(cases, key=lambda each: each.count(None)):
        sides = {k: side for k, side in zip(places, case, strict=True) if side is not None}
        ends: Any = [None if None in each else list(each) for each in box]
        for k, side in sides.items():
            ends[k][side] = edges[k, side]
        with suppress(SolveError):
            beyond = Beyond(check.model, sides, ends, start)
            return sides, beyond.require_order(check.vertices, check.running, check.final)
    return {}, []

"""The check of what lies beyond clipped sides: that the motion depends on it one way, in fractions.

A region with clipped sides stands for every state beyond them too, where the function has the value
that it has at the side.
"""

from collections.abc import Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import combinations
from math import inf
from typing import Any, final

from socp.proof.bound.reading import Box, Ends, Model, Poly, at, plus, put, ranged, require

Sides = Mapping[int, int]  # variable -> 0 where what is below its side is clipped, 1 above
_WHOLE = (Fraction(-1), Fraction(1))


@final
class Beyond:
    """What lies beyond the clipped sides of a box of the base variables."""

    def __init__(self, model: Model, sides: Sides, box: Box, start: Box) -> None:
        self._model, self.sides, self._box = model, sides, box
        self._wide: list[Any] = self._reached(start) if sides else []

    def depends(self, p: Poly) -> bool:
        """Tell whether a polynomial depends on a clipped variable."""
        return any(self._model.gradient(p, k) for k in self.sides)

    def require_order(
        self, vertices: Sequence[Mapping[int, Poly]], running: Poly, final: Poly
    ) -> list[tuple[int, int]]:
        """Require that what is further out moves further out, and costs no less, and that the rates
        of other variables do not depend on it. Return pairs (j, k) where the rate of the clipped
        variable j depends on k.
        """
        model, pairs = self._model, []
        require(not self.sides or not model.rough, "how what is not smooth depends on a state")
        for k in self.sides:
            self._require_rising(k, final, -1, "the final cost")
            for vertex in vertices:
                self._require_rising(k, put(running, vertex), -1, "the running cost")
            for j in range(len(model.base)):
                rates = [put(model.rates[j], vertex) for vertex in vertices]
                if j == k or not any(model.gradient(rate, k) for rate in rates):
                    continue
                require(j in self.sides, f"that {model.base[j]} does not depend on a clipped state")
                for rate in rates:
                    self._require_rising(k, rate, self._sign(j), f"the rate of {model.base[j]}")
                pairs.append((j, k))
        return sorted(pairs)

    def faces(self) -> Iterator[tuple[list[Any], list[Poly]]]:
        """Yield the box of the base variables, and the rates of all variables, where some of the
        clipped variables are beyond their sides.
        """
        model, clipped = self._model, sorted(self.sides)
        for count in range(1, len(clipped) + 1):
            for chosen in combinations(clipped, count):
                base = [{} if j in chosen else rate for j, rate in self._base()]
                yield self.face(chosen), model.field(base)

    def face(self, chosen: Sequence[int]) -> list[Any]:
        """Return the box of the base variables with some of the clipped ones at their sides."""
        box: list[Any] = [None if each is None else list(each) for each in self._box]
        for k in chosen:
            box[k] = [box[k][self.sides[k]]] * 2
        return box[: len(self._model.base)]

    def outward(self, value: Poly, j: int) -> Poly:
        """Return how a function rises with a clipped variable toward the outside."""
        return plus({}, self._model.gradient(value, j), Fraction(-self._sign(j)))

    def _base(self) -> Iterator[tuple[int, Poly]]:
        return enumerate(self._model.rates[: len(self._model.base)])

    def _sign(self, k: int) -> int:
        return -1 if self.sides[k] else 1

    def _require_rising(self, k: int, p: Poly, sign: int, what: str) -> None:
        model = self._model
        slope = plus({}, model.gradient(p, k), Fraction(sign * self._sign(k)))
        its = ranged(slope, self._wide)
        require(its is not None and its[0] >= 0, f"how {what} depends on {model.base[k]}")

    def _reached(self, start: Box) -> list[Any]:
        """Return the box without its clipped sides, with the ranges of functions; what is in a
        denominator alone keeps its sign.
        """
        model = self._model
        size = len(model.base)
        found: list[Any] = [*self._box[:size], *[None] * (model.count - size)]
        for k, side in self.sides.items():
            require(found[k] is not None, "a clipped side")
            found[k] = (found[k][0], inf) if side else (-inf, found[k][1])
        for name, of in model.functions:
            for k in self.sides if name == "inv" and len(of) == 1 else ():
                (exponents,), its = of, start[k]
                if exponents[k] and its is not None and its[0] > 0:
                    found[k] = (max(found[k][0], Fraction(0)), found[k][1])
                elif exponents[k] and its is not None and its[1] < 0:
                    found[k] = (found[k][0], min(found[k][1], Fraction(0)))
        for k, (name, of) in enumerate(model.functions):
            found[size + k] = _image(name, ranged(of, found))
        return found


def _image(function: str, of: Any) -> Any:
    """Return an interval around a function on an interval that may be without ends."""
    if function in {"sin", "cos", "tanh"}:
        return _WHOLE
    if of is None:
        return None
    low, high = of
    if function == "exp":
        return (
            Fraction(0) if low == -inf else at("exp", low)[0],
            inf if high == inf else at("exp", high)[1],
        )
    if low < 0 < high:
        return None
    ends = [None if not each else 1 / each if abs(each) < inf else Fraction(0) for each in of]
    if low >= 0:  # a denominator is not zero
        return ends[1], inf if ends[0] is None else ends[0]
    return -inf if ends[1] is None else ends[1], ends[0]


def nonnegative(nodes: Sequence[Any], place: int | None) -> bool:
    """Tell whether an entry is at least zero by its operations alone."""
    if place is None:
        return True
    node = nodes[place]
    if isinstance(node, (int, float)):
        return node >= 0
    if isinstance(node, str):
        return False
    if node[0] in {"sq", "exp", "fabs"}:
        return True
    return node[0] in {"add", "mul", "div", "twice"} and all(
        nonnegative(nodes, k) for k in node[1:]
    )


def both(a: Any, b: Any) -> Ends | None:
    """Return what two intervals have in common, None unless it has two ends."""
    low = max(
        (each[0] for each in (a, b) if each is not None and each[0] is not None), default=None
    )
    high = min(
        (each[1] for each in (a, b) if each is not None and each[1] is not None), default=None
    )
    if low is None or high is None:
        return None
    require(low <= high, "that there are admissible ends")
    return low, high

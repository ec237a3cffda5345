"""The check of the sides of a region, in fractions: that nobody leaves through them, or that the
motion depends on what lies beyond clipped ones one way.

A region with clipped sides stands for every state beyond them too, where the function has the value
that it has at the side.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from fractions import Fraction
from itertools import combinations
from math import inf, isqrt
from typing import Any, final

from socp.proof.bound.reading import (
    Box,
    Ends,
    Model,
    Poly,
    around,
    at,
    image,
    plus,
    put,
    ranged,
    require,
    short,
)

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
        for place in model.lasting:
            name, of = model.functions[place - size]
            for k in self.sides if name == "inv" and len(of) == 1 else ():
                (exponents,), its = of, start[k]
                if exponents[k] and its is not None and its[0] > 0:
                    found[k] = (max(found[k][0], Fraction(0)), found[k][1])
                elif exponents[k] and its is not None and its[1] < 0:
                    found[k] = (found[k][0], min(found[k][1], Fraction(0)))
        for k, (name, of) in enumerate(model.functions):
            found[size + k] = _image(name, ranged(of, found))
        return found


@final
class Staying:
    """The sides of a box that no admissible trajectory leaves through."""

    def __init__(
        self,
        model: Model,
        vertices: Sequence[Mapping[int, Poly]],
        statement: Mapping[str, Any],
        box: Box,
        start: Box,
    ) -> None:
        self._model, self._vertices, self._statement = model, vertices, statement
        self._box, self._start = box, start

    def within(self, k: int, side: int, length: Fraction | None) -> bool:
        """Tell whether a variable cannot leave through a side: where it is there, it does not move
        outward; or there is too little time to get there, None where the horizon is free.
        """
        box, start, sign = self._box[k], self._start[k], 1 if side else -1
        if box is None or start is None:
            return False
        if self._turned_back(k, box[side], sign) or self._one_way(k, side, sign):
            return True
        fastest = self._outward(k, self._box, sign)
        if length is None or fastest is None:
            return False
        return (start[side] - box[side]) * sign + length * max(fastest, Fraction(0)) <= 0

    def _turned_back(self, k: int, value: Fraction, sign: int) -> bool:
        """Tell whether a variable does not move outward from a side, or is nowhere beyond it.

        That it moves inward at no speed keeps it in where its rate is Lipschitz continuous there
        (Nagumo): a root is where what it is of is positive.
        """
        model = self._model
        face = boxed(model, [*self._box[:k], (value, value), *self._box[k + 1 :]])
        if any(self._ends(of, k, value, sign) for of in self._roots(model.lasting)):
            return True
        outward = self._outward(k, face, sign)
        if outward is None or outward > 0:
            return False
        least = [ranged(of, face) for of in self._roots(model.made([model.rates[k]]))]
        return outward < 0 or all(each is not None and each[0] > 0 for each in least)

    def _roots(self, places: Collection[int]) -> list[Poly]:
        """Return what the roots among functions are of."""
        functions, size = self._model.functions, len(self._model.base)
        return [functions[k - size][1] for k in places if functions[k - size][0] == "sqrt"]

    def _ends(self, of: Poly, k: int, value: Fraction, sign: int) -> bool:
        """Tell whether what a root is of is a line in one variable that is negative beyond a
        side.
        """
        slope, constant = (Fraction(0),) * 2
        for e, c in of.items():
            if any(e) and (e[k] != 1 or sum(e) != 1):
                return False
            slope, constant = (c, constant) if any(e) else (slope, c)
        return slope * sign < 0 and constant + slope * value <= 0

    def _one_way(self, k: int, side: int, sign: int) -> bool:
        """Tell whether a variable, wherever the others are, only moves outward and has to end
        inside.
        """
        names, box = self._model.base, self._box[k]
        end = interval(self._statement["end"].get(names[k], (-inf, inf)))[side]
        bounds = [interval(self._statement["bounds"].get(name, (-inf, inf))) for name in names]
        everywhere: list[Any] = [None] * self._model.count
        for i, (low, high) in enumerate(bounds):
            everywhere[i] = -inf if low is None else low, inf if high is None else high
        for i, (name, of) in enumerate(self._model.functions, start=len(names)):
            everywhere[i] = _image(name, ranged(of, everywhere))
        back = self._outward(k, everywhere, -sign)
        inside = box is not None and end is not None and (end - box[side]) * sign <= 0
        return inside and back is not None and back <= 0

    def _outward(self, k: int, box: Box, sign: int) -> Fraction | None:
        """Return the most that a variable moves outward on a box, None where there is no most."""
        fastest = []
        for vertex in self._vertices:
            its = ranged(put(self._model.rates[k], vertex), box)
            fastest.append(None if its is None else its[1] if sign > 0 else -its[0])
        return None if None in fastest else max(each for each in fastest if each is not None)


def boxed(model: Model, given: Sequence[Any]) -> Box:
    """Return a box of the variables, with the ranges of functions on it worked out anew."""
    box: Box = [None] * model.count
    for k in range(len(model.base)):
        its = given[k]
        box[k] = None if its is None else (Fraction(its[0]), Fraction(its[1]))
        require(its is None or Fraction(its[0]) <= Fraction(its[1]), "a box")
    for k, (name, of) in enumerate(model.functions):
        box[len(model.base) + k] = short(image(name, ranged(of, box)))
    return box


def interval(given: Sequence[Any]) -> tuple[Fraction | None, Fraction | None]:
    """Return fractions around an interval of a statement, None where it has no end."""
    low, high = (float(each) for each in given)
    return (
        None if low == -inf else around(low)[0],
        None if high == inf else around(high)[1],
    )


def _image(function: str, of: Any) -> Any:
    """Return an interval around a function on an interval that may be without ends."""
    if function in {"sin", "cos", "tanh"}:
        return _WHOLE
    if of is None or function in {"fabs", "sqrt"}:
        return None if function in {"exp", "inv"} else (Fraction(0), inf)
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


def root(value: Fraction) -> Fraction:
    """Return a fraction that is at least the square root of another."""
    fine = 10**12
    return Fraction(isqrt(value.numerator * fine**2 // value.denominator) + 1, fine)


def disc(guard: Poly, k: int) -> Fraction | None:
    """Return the largest modulus of variable k where constant - squares is at least zero."""
    constant = weight = Fraction(0)
    for e, c in guard.items():
        if not any(e):
            constant = c
            continue
        even = all(n % 2 == 0 for n in e)
        if not even or c > 0:
            return None
        if e[k] == 2 and sum(e) == 2:
            weight = -c
    return root(constant / weight) if weight and constant >= 0 else None

"""Boxes of the variables of a lift, and polynomials in coordinates of [-1, 1] on them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from itertools import combinations
from typing import Any, final

from socp.errors import SolveError
from socp.proof.balls import flint
from socp.proof.bound.lifting import Lift, Limits, Polynomial, rational, span

_WHOLE = (Fraction(-1), Fraction(1))  # what sine, cosine and tanh are within everywhere
_GRAIN = 2**60  # ends of the ranges of functions are multiples of one over it, rounded outward
_BITS = 128
# A coordinate that varies by less is a number to the programme; what it varies by is in the defect
FLAT = Fraction(1, 10**12)
# A function of the state that varies by less, over its size, is as good as a number to functions
# that need not be exact; the inequalities keep what it varies by
_HARDLY = Fraction(1, 10)


@final
@dataclass(frozen=True, eq=False)
class Region:
    """A set: a box of all variables, (None, None) of those without bounds, and polynomials that are
    at least zero on it.

    Of a variable in `clipped`, what is beyond the side 0 (below) or 1 is as if it were at the side;
    `pairs` are (j, k) where the rate of the clipped variable j depends on k.
    """

    lift: Lift
    box: list[Limits]
    guards: list[Polynomial] = field(default_factory=list)
    clipped: Mapping[int, int] = field(default_factory=dict)
    pairs: list[tuple[int, int]] = field(default_factory=list)

    def bounded(self, place: int) -> bool:
        """Tell whether a variable has both bounds."""
        return None not in self.box[place]

    def within(self, other: "Region") -> bool:
        """Tell whether a region is in another one, as the boxes of the base variables are."""
        pairs = zip(self.box[: self.lift.base], other.box, strict=False)
        return all(
            (b[0] is None or (a[0] is not None and b[0] <= a[0]))
            and (b[1] is None or (a[1] is not None and a[1] <= b[1]))
            for a, b in pairs
        )

    def face(self, places: Mapping[int, int]) -> "Region":
        """Return where variables are at their sides 0 (below) or 1."""
        box = list(self.box[: self.lift.base])
        for place, side in places.items():
            box[place] = (box[place][side],) * 2
        return Region(self.lift, with_ranges(self.lift, box), self.guards)

    def faces(self) -> Iterator[tuple["Region", list[Polynomial]]]:
        """Yield the region and where it is clipped, each with the rates of variables there."""
        yield self, self.lift.rates
        for count in range(1, len(self.clipped) + 1):
            for chosen in combinations(sorted(self.clipped), count):
                base = self.lift.rates[: self.lift.base]
                rates = [self.lift.zero if k in chosen else rate for k, rate in enumerate(base)]
                yield self.face({k: self.clipped[k] for k in chosen}), self.lift.field(rates)

    def middle(self, place: int) -> Fraction:
        """Return the middle of a variable, zero without bounds."""
        low, high = self.box[place]
        return Fraction(0) if low is None or high is None else (low + high) / 2

    def radius(self, place: int) -> Fraction:
        """Return the radius of a variable, one without bounds."""
        low, high = self.box[place]
        return Fraction(1) if low is None or high is None else (high - low) / 2

    def wide(self, place: int) -> bool:
        """Tell whether a variable varies at all."""
        return not self.bounded(place) or self.radius(place) > FLAT

    def steady(self, place: int) -> bool:
        """Tell whether a variable hardly varies, over its size."""
        low, high = self.box[place]
        return low is not None and high is not None and high - low < _HARDLY * abs(low + high)

    def scaled(self, given: Polynomial) -> Polynomial:
        """Return a polynomial of the variables as one of their coordinates."""
        gens, ring = self.lift.ring.gens(), self.lift.ring
        used = given.degrees()
        maps = [
            rational(self.radius(k)) * gen + rational(self.middle(k)) if used[k] > 0 else gen
            for k, gen in enumerate(gens)
        ]
        return given.compose(*maps, ctx=ring)

    def coordinate(self, place: int) -> Polynomial:
        """Return the coordinate of a variable as a polynomial of it."""
        gen = self.lift.ring.gen(place)
        if not self.bounded(place) or not self.radius(place):
            return gen - rational(self.middle(place))
        return (gen - rational(self.middle(place))) / rational(self.radius(place))

    def circles(self) -> list[tuple[int, int]]:
        """Return pairs of places (sine, cosine) on a whole circle."""
        places = [k for k, f in enumerate(self.lift.functions) if f[0] == "sin"]
        pairs = [(self.lift.base + k, self.lift.base + k + 1) for k in places]
        return [pair for pair in pairs if all(self.box[each] == _WHOLE for each in pair)]

    def reduced(self, given: Mapping[tuple[int, ...], Any]) -> dict[tuple[int, ...], Any]:
        """Return a polynomial of coordinates with sin^2 as 1 - cos^2 on whole circles."""
        found = dict(given)
        for sine, cosine in self.circles():
            found = _on_circle(found, sine, cosine)
        return found


def _on_circle(given: Mapping[tuple[int, ...], Any], s: int, c: int) -> dict[tuple[int, ...], Any]:
    found: dict[tuple[int, ...], Any] = {}
    work = list(given.items())
    while work:
        exponents, value = work.pop()
        if exponents[s] < 2:
            found[exponents] = found.get(exponents, 0) + value
            continue
        lower = list(exponents)
        lower[s] -= 2
        work.append((tuple(lower), value))
        lower[c] += 2
        work.append((tuple(lower), -value))
    return found


def with_ranges(lift: Lift, box: Sequence[Limits]) -> list[Limits]:
    """Return a box of the base variables with the ranges of all functions on it."""
    found = [*box[: lift.base], *([(None, None)] * (len(lift.names) - lift.base))]
    for operation, place, argument in lift.functions:
        found[place] = _range(operation, span(argument, found))
    return found


def _range(operation: str, of: Limits) -> Limits:
    low, high = of
    if low is None or high is None:
        return _WHOLE if operation in {"sin", "cos", "tanh"} else (None, None)
    if operation == "fabs":
        return max(low, -high, Fraction(0)), max(-low, high)
    if operation == "inv":
        return (None, None) if low <= 0 <= high else _shortened(1 / high, 1 / low)
    if operation == "sqrt":
        return Fraction(0), -_outward(-_ball(operation, max(high, Fraction(0)))[1])
    if operation in {"exp", "tanh"}:
        return _shortened(_ball(operation, low)[0], _ball(operation, high)[1])
    # the mean value theorem at the middle: slopes of sine and cosine are at most one
    near = _ball(operation, (low + high) / 2)
    reach = (high - low) / 2
    return max(_outward(near[0] - reach), _WHOLE[0]), min(-_outward(-near[1] - reach), _WHOLE[1])


def _shortened(low: Fraction, high: Fraction) -> Limits:
    return _outward(low), -_outward(-high)


def _outward(value: Fraction) -> Fraction:
    """Return a short fraction that is no larger."""
    return Fraction(value.numerator * _GRAIN // value.denominator, _GRAIN)


def _ball(operation: str, at: Fraction) -> tuple[Fraction, Fraction]:
    module = flint()
    before, module.ctx.prec = module.ctx.prec, _BITS
    try:
        found = getattr(module.arb(rational(at)), operation)()
        middle, radius = (each.man_exp() for each in (found.mid(), found.rad()))
    finally:
        module.ctx.prec = before
    centre, width = (Fraction(int(m)) * Fraction(2) ** int(e) for m, e in (middle, radius))
    return centre - width, centre + width


def full(lift: Lift, region: Region, polynomials: Sequence[Polynomial]) -> None:
    """Raise SolveError where polynomials hold a variable that a region does not bound."""
    for each in polynomials:
        for k, degree in enumerate(each.degrees()):
            if degree > 0 and not region.bounded(k):
                raise SolveError(f"'{lift.names[k]}' has no bounds in the inequality")

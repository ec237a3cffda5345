"""`socp check CERTIFICATE`: that a certificate proves a lower bound of its problem's optimum."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import product
from math import inf
from typing import Any, final

from socp.errors import SolveError
from socp.proof.bound.comparing import (
    Beyond,
    Sides,
    Staying,
    both,
    boxed,
    disc,
    interval,
    nonnegative,
)
from socp.proof.bound.reading import (
    Box,
    Ends,
    Model,
    Poly,
    around,
    by,
    monomial,
    on_circle,
    plus,
    polynomial,
    put,
    ranged,
    require,
    slope,
    squares,
)

FORMAT = "socp bound 1"
_ZERO, _ONE = Fraction(0), Fraction(1)
# What a file that is no certificate raises somewhere
_BROKEN = (
    LookupError,
    TypeError,
    ValueError,
    AttributeError,
    ArithmeticError,
    StopIteration,
    RecursionError,
)


def checked(certificate: Mapping[str, Any]) -> Fraction:
    """Return the lower bound that a certificate proves; SolveError says what it does not show."""
    try:
        return Check(certificate).bound()
    except _BROKEN as error:
        raise SolveError(f"no certificate: {type(error).__name__}: {error}") from error


@final
class Check:
    """One certificate."""

    def __init__(self, certificate: Mapping[str, Any]) -> None:
        require(certificate["format"] == FORMAT, f"the format {FORMAT}")
        self.certificate, self.statement = certificate, certificate["problem"]
        self.model = model = Model(self.statement, certificate["functions"])
        self.time, self.vertices = model.places["t"], self._vertices()
        self.running = model.of(self.statement["running"])
        self.final = model.of(self.statement["minimise"])
        self.free = float(self.statement["final_time"][1]) == inf
        self.rate = _ZERO  # what the running cost is at least, where the horizon is free
        if self.free:
            self._free_time()
        self.path = [model.relation(k)[0] for k in self.statement["path"].values()]
        self.box: Box = []
        self.exits: dict[tuple[int, int], Any] = {}
        self.beyond = Beyond(model, {}, [], [])
        self.pairs: list[tuple[int, int]] = []

    # -- what is bounded

    def bound(self) -> Fraction:
        """Return the lower bound: the last value at the start, or that of leaving a region.

        Whoever leaves the last region goes on at the cost of the value of the region before, unless
        that is left as well.
        """
        found: Fraction | None = None
        floor: Poly | None = None
        for stage in self.certificate["stages"]:
            outer, self.box = self.box, self._ranges(stage["box"])
            for its, wider in zip(self.box, outer, strict=False):
                inside = wider is None or (
                    its is not None and wider[0] <= its[0] and its[1] <= wider[1]
                )
                require(inside, "a region in the one before")
            self.exits = {(each["variable"], each["side"]): each for each in stage["exits"]}
            self.start = self._start()
            self._clip(dict(stage.get("clipped", ())), outer)
            for k in range(len(self.model.base)):
                self._sides(k)
            for each in self.exits.values():
                left = self._left(stage["box"], each, floor)
                found = min((x for x in (found, left) if x is not None), default=None)
            value, floor = self._value(
                stage["value"], self.running, self._ends(), self.final, self._target()
            )
        require(bool(self.certificate["stages"]), "a region")
        found = value if found is None else min(value, found)  # None: nobody leaves
        stated = self.certificate["bound"]
        require(stated is None or Fraction(stated) <= found, "the bound that is stated")
        return found if stated is None else Fraction(stated)

    def _clip(self, sides: Sides, outer: Box) -> None:
        """Take in which sides are clipped: those of the region before, where there is one."""
        for k, side in sides.items():
            require(0 <= k < self.time and side in {0, 1}, "a clipped side")
            its, wider = self.box[k], outer[k] if outer else self.box[k]
            require(its is not None and wider is not None and its[side] == wider[side], "one clip")
        require(not outer or dict(sides) == dict(self.beyond.sides), "the clips of before")
        self.beyond = Beyond(self.model, sides, self.box, self.start)
        self.pairs = self.beyond.require_order(self.vertices, self.running, self.final)

    def _left(
        self, box: Sequence[Any], given: Mapping[str, Any], floor: Poly | None
    ) -> Fraction | None:
        """Return what leaving the region through a side costs at least, None where nobody gets
        there: a function that does not decrease along any motion is positive at the start, and at
        most zero at the side.
        """
        face = list(box[: len(self.model.base)])
        face[given["variable"]] = [face[given["variable"]][given["side"]]] * 2
        after = given["after"]
        if after == "barrier":
            low = self._value(given, {}, self._ranges(face), {}, [], priced=False)[0]
            require(low > 0, "a barrier")
            return None
        if after == "nothing":
            floor = {} if self._nothing_after() else None
        if floor is None:
            raise SolveError("not shown: that nothing is gained after leaving the region")
        return self._value(given, self.running, self._ranges(face), floor, [])[0]

    def _value(
        self,
        given: Mapping[str, Any],
        running: Poly,
        ends: Box,
        final: Poly,
        guards: Sequence[Poly],
        *,
        priced: bool = True,
    ) -> tuple[Fraction, Poly]:
        """Return what a function proves: its value at the start, less its defects, and the function
        less its defects, which is at most the cost from every point on.

        `priced` where the running cost has that of time in it.
        """
        model, proofs = self.model, iter(given["proofs"])
        value = self._function(given["function"])
        most, inside = _ZERO, self._inside()
        for face, rates in [(self.box, model.rates), *self.beyond.faces()]:
            box = face if face is self.box else self._ranges(face)
            for vertex in self.vertices:
                rate = put(running, vertex)
                for k in range(model.size):
                    part = slope(value, k)
                    rate = plus(rate, by(part, put(rates[k], vertex))) if part else rate
                most = max(most, self._shown(next(proofs), rate, box, inside))
        for j, k in self.pairs:
            box = self._ranges(self.beyond.face([k]))
            falls = self._shown(next(proofs), self.beyond.outward(value, j), box, inside) <= 0
            require(falls, f"how the function depends on {model.base[j]}")
        end = plus(final, value, -_ONE)
        missed = max(_ZERO, self._shown(next(proofs), end, ends, [*inside, *guards]))
        share = _ONE
        if not self.free:
            missed += most * (self._times()[1] - self._times()[0])
        elif most:
            require(priced and self.rate > 0 and not self.final, "that time costs something")
            share = 1 / (1 + most / self.rate)
        start: Any = ranged(value, self.start)
        require(start is not None, "the value at the start")
        low = start[0] - missed
        return low * share, plus({}, plus(value, model.number(missed), -_ONE), share)

    def _times(self) -> Ends:
        """Return an interval around all times of a horizon that is not free."""
        first, last = self.statement["initial_time"][0], self.statement["final_time"][1]
        return around(float(first))[0], around(float(last))[1]

    def _function(self, given: Sequence[Any]) -> Poly:
        """Return a function given in coordinates of the region's box as one of the variables."""
        p = polynomial(given, self.model.count)
        maps = {}
        for k in range(self.model.size):
            low, high = self.box[k] or (-_ONE, _ONE)
            require(high > low, "a box with an interior")
            maps[k] = plus(
                {e: 2 * c / (high - low) for e, c in self.model.variable(k).items()},
                self.model.number(-(high + low) / (high - low)),
            )
        require(all(not e[k] for e in p for k in self.model.rough), "a function that is smooth")
        return put(p, maps)

    def _shown(self, proof: Sequence[Any], p: Poly, box: Box, guards: Sequence[Poly]) -> Fraction:
        """Return how far a polynomial may be below zero on a box where all guards are at least
        zero, by what is left of it without squares times guards; a constant above that is a margin.
        """
        model, circles = self.model, self.model.circles(box)
        maps, unit = {}, [_ZERO, _ZERO]
        for k in range(model.size):
            its = box[k]
            if its is not None:
                unit = [(its[1] + its[0]) / 2, (its[1] - its[0]) / 2]
                maps[k] = plus(model.number(unit[0]), model.variable(k), unit[1])
        left = put(p, maps)
        for guard, basis, rows, scale in proof:
            require(scale > 0, "a scale")
            sum_of_squares = squares([monomial(each, model.count) for each in basis], rows)
            factor = self._guard(guard, maps, guards)
            left = plus(left, by(sum_of_squares, factor), Fraction(-1, scale**2))
        for s, c in circles:
            left = on_circle(left, s, c)
        require(all(not n or k in maps for e in left for k, n in enumerate(e)), "a bounded region")
        margin = left.pop((0,) * model.count, _ZERO)
        return sum((abs(each) for each in left.values()), _ZERO) - margin

    def _guard(self, given: Any, maps: Mapping[int, Poly], guards: Sequence[Poly]) -> Poly:
        model = self.model
        if given == "one":
            return model.number(_ONE)
        kind, k = given
        if kind == "box":
            require(k in maps, "a bounded variable")
            square = by(model.variable(k), model.variable(k))
            return plus(model.number(_ONE), square, -_ONE)
        return put(guards[k], maps)

    # -- regions

    def _ranges(self, given: Sequence[Any]) -> Box:
        return boxed(self.model, given)

    def _inside(self) -> list[Poly]:
        """Return what is at least zero along every admissible trajectory."""
        path = [plus({}, each, -_ONE) for each in self.path if not self.beyond.depends(each)]
        return [*path, *self.model.facts(self.model.lasting)]

    def initial(self, k: int) -> Any:
        """Return the interval in which a variable starts."""
        start = self.statement["start"].get(self.model.base[k], (-inf, inf))
        return interval(self.statement["initial_time"] if k == self.time else start)

    def _start(self) -> Box:
        given = [self.initial(k) for k in range(len(self.model.base))]
        for k, its in enumerate(given):
            require(None not in its, f"a start with {self.model.base[k]}")
            bounds = self.box[k]
            require(
                bounds is None or (bounds[0] <= its[0] and its[1] <= bounds[1]) or k == self.time,
                "that the start is in the region",
            )
        return self._ranges(given)

    def _target(self) -> list[Poly]:
        """Return what is at least zero at admissible ends."""
        found = []
        for k in self.statement["target"].values():
            p, equal = self.model.relation(k)
            if self.beyond.depends(p):
                continue  # what is beyond a clipped side may end otherwise
            found.append(plus({}, p, -_ONE))
            found += [p] if equal else []
        ended = [self.model.relation(k)[0] for k in self.statement["target"].values()]
        last = self.model.made([self.final, *ended]) - self.model.lasting
        return [*found, *self.model.facts(last)]

    def _ends(self) -> Box:
        """Return the box of admissible ends: of the region, end values and target conditions."""
        model, found = self.model, list(self.box)
        for k, name in enumerate(model.base):
            its = self.statement["end"].get(name, (-inf, inf))
            if k == self.time:
                its = self.statement["final_time"]
            found[k] = both(found[k], self._clipped(k, interval(its)))
            for guard in self._target():
                most = disc(guard, k)
                found[k] = found[k] if most is None else both(found[k], (-most, most))
        return self._ranges(
            [None if each is None else list(each) for each in found[: len(model.base)]]
        )

    def _clipped(self, k: int, its: Any) -> Any:
        """Return the ends of an interval of a variable, none beyond its clipped side."""
        side, bounds = self.beyond.sides.get(k), self.box[k]
        if side is None or bounds is None:
            return its
        other = min if side else max
        return tuple(None if each is None else other(each, bounds[side]) for each in its)

    def _sides(self, k: int) -> None:
        """Require that no admissible trajectory leaves the region through the sides of a variable,
        other than through those with a function of its own.
        """
        if self.box[k] is None:
            return
        name, box = self.model.base[k], self.box[k] or (_ZERO, _ZERO)
        if k == self.time:
            times = not self.free and box[0] <= self._times()[0] and self._times()[1] <= box[1]
            require(times, "a region of all times")
            return
        low, high = interval(self.statement["bounds"].get(name, (-inf, inf)))
        length = None if self.free else self._times()[1] - self._times()[0]
        staying = Staying(self.model, self.vertices, self.statement, self.box, self.start)
        for side, limit, sign in ((0, low, -1), (1, high, 1)):
            bounded = limit is not None and (limit - box[side]) * sign <= 0
            clipped = self.beyond.sides.get(k) == side
            if not bounded and not clipped and (k, side) not in self.exits:
                kept = staying.within(k, side, length)
                require(kept, f"that {name} stays on side {side}")

    # -- data of the problem

    def _vertices(self) -> list[dict[int, Poly]]:
        """Return the vertices of the box of controls, and require that everything is affine."""
        model, names = self.model, self.statement["controls"]
        places = [model.places[name] for name in names]
        for p in (*model.rates, model.of(self.statement["running"])):
            require(all(sum(e[model.size :]) <= 1 for e in p), "that controls enter linearly")
        ends = []
        for name in names:
            low, high = interval(self.statement["bounds"][name])
            require(low is not None and high is not None, f"bounds of {name}")
            ends.append([model.number(low or _ZERO), model.number(high or _ZERO)])
        return [dict(zip(places, each, strict=True)) for each in product(*ends)]

    def _free_time(self) -> None:
        """Make the weight of a free final time a running cost, and see what costs at least."""
        model, weight = self.model, slope(self.final, self.time)
        constant = (0,) * model.count
        require(set(weight) <= {constant}, "a final time that enters linearly")
        rate = weight.get(constant, _ZERO)
        first, last = interval(self.statement["initial_time"])
        require(first == 0 and (last == 0 or rate >= 0), "a start at time zero")
        self.final = plus(self.final, model.variable(self.time), -rate)
        self.rate = (
            rate if nonnegative(self.statement["nodes"], self.statement["running"]) else _ZERO
        )
        self.running = plus(self.running, model.number(rate))

    def _nothing_after(self) -> bool:
        """Tell whether what follows costs at least nothing, from everywhere."""
        running = nonnegative(self.statement["nodes"], self.statement["running"])
        constant = self.final.get((0,) * self.model.count, _ZERO)
        return running and len(self.final) <= (constant != 0) and constant >= 0 and self.rate >= 0

"""A problem as polynomials: functions such as tanh, sin or exp become variables of their own, whose
rates are polynomials again.
"""

from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from math import inf
from typing import Any, final

from socp.errors import SolveError
from socp.model import Problem
from socp.proof.balls import flint

Polynomial = Any  # a flint.fmpq_mpoly
Ends = tuple[Fraction, Fraction]
Limits = tuple[Fraction | None, Fraction | None]

# A float with no more digits than this is the decimal that somebody wrote; others, such as pi, are
# enclosed
_WRITTEN = 12
_APART = Fraction(1, 10**15)  # relative; a float is nearer than this to what it stands for
_POWER = 32  # the largest power that is multiplied out
_PLAIN: Mapping[str, Callable[..., Polynomial]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "neg": lambda a: -a,
    "sq": lambda a: a * a,
    "twice": lambda a: 2 * a,
}
_ROUGH = {"fabs", "sqrt"}  # without rates: known by what they satisfy
_LIFTED = {"exp", "sin", "cos", "tanh", "inv", "sqrt"}
# Entries that may make functions, two at most
_MAKING = {*_LIFTED, "fabs", "fmin", "fmax", "div", "pow", "constpow"}


def enclosed(value: float) -> Ends:
    """Return fractions around the number that a float stands for."""
    exact = Fraction(repr(float(value)))
    digits = repr(float(value)).partition("e")[0].replace("-", "").replace(".", "").strip("0")
    apart = 0 if len(digits) <= _WRITTEN else abs(exact) * _APART
    return exact - apart, exact + apart


def limits(given: Any) -> Limits:
    """Return fractions around an interval (low, high) of a statement, None where it has no end."""
    low, high = (float(each) for each in given)
    return (
        None if low == -inf else enclosed(low)[0],
        None if high == inf else enclosed(high)[1],
    )


@final
@dataclass(eq=False)
class Lift:
    """The data of a problem as polynomials of states, parameters, time, `functions` and controls,
    in this order.

    A function is (operation, place of its name, polynomial that it is of). `rates` are those of all
    variables but controls; running cost, final cost, path constraints c <= 0 and end conditions are
    (polynomial, equality).
    """

    names: list[str]
    ring: Any
    base: int
    controls: list[int]
    functions: list[tuple[str, int, Polynomial]] = field(default_factory=list)
    rates: list[Polynomial] = field(default_factory=list)
    running: Polynomial = None
    final: Polynomial = None
    path: list[Polynomial] = field(default_factory=list)
    target: list[tuple[Polynomial, bool]] = field(default_factory=list)

    @property
    def zero(self) -> Polynomial:
        """The polynomial that is zero."""
        return self.ring.constant(0)

    def appear(self, but: Container[int] = ()) -> set[int]:
        """Return the places of base variables that rates, but those of some variables, costs or
        constraints depend on, other than through functions that have rates.
        """
        rough = [of for name, _, of in self.functions if name in _ROUGH]
        rates = [rate for k, rate in enumerate(self.rates) if k not in but]
        its = [*rates, self.running, *self.path, *rough]
        return {
            k for each in its for k, degree in enumerate(each.degrees()[: self.base]) if degree > 0
        }

    def through(self) -> set[int]:
        """Return the places of base variables that functions are of."""
        degrees = (of.degrees()[: self.base] for _, _, of in self.functions)
        return {k for each in degrees for k, degree in enumerate(each) if degree > 0}

    def ranged(self) -> set[int]:
        """Return the places of base variables that functions are of which are bounded only where
        those are.
        """
        its = [of for name, _, of in self.functions if name in {"exp", "inv", *_ROUGH}]
        return {k for of in its for k, degree in enumerate(of.degrees()[: self.base]) if degree > 0}

    def rough(self) -> set[int]:
        """Return the places of functions without a rate."""
        return {k for name, k, _ in self.functions if name in _ROUGH}

    def made(self, polynomials: Iterable[Polynomial]) -> set[int]:
        """Return the places of functions that polynomials are made of."""
        found, left = set[int](), list(polynomials)
        while left:
            degrees = left.pop().degrees()
            new = {k for _, k, _ in self.functions if degrees[k] > 0} - found
            found |= new
            left += [of for _, k, of in self.functions if k in new]
        return found

    def lasting(self) -> set[int]:
        """Return the places of functions that have a value all along a trajectory."""
        return self.made([*self.rates[: self.base], self.running, *self.path])

    def last(self) -> set[int]:
        """Return the places of functions that have a value at ends alone."""
        return self.made([self.final, *(each for each, _ in self.target)]) - self.lasting()

    def facts(self, places: Container[int]) -> list[Polynomial]:
        """Return what is at least zero of functions without a rate, at some places."""
        found = []
        for name, k, of in self.functions:
            own = self.ring.gen(k)
            if name in _ROUGH and k in places:
                left = own**2 - (of**2 if name == "fabs" else of)
                found += [*([own - of, own + of] if name == "fabs" else [own]), left, -left]
        return found

    def field(self, base: Sequence[Polynomial]) -> list[Polynomial]:
        """Return the rates of all variables but controls by those of the base variables."""
        rates = list(base)
        for operation, _, argument in self.functions:
            rates.append(_rate(self, operation, len(rates), self.along(argument, rates)))
        return rates

    def along(self, of: Polynomial, rates: Sequence[Polynomial]) -> Polynomial:
        """Return the derivative of a polynomial along a motion with the rates of variables."""
        found = self.zero
        for k, rate in enumerate(rates):
            part = of.derivative(k)
            if part != 0:
                found += part * rate
        return found

    def unit(self, place: int) -> list[Polynomial]:
        """Return the rates of all variables where one base variable moves at speed one alone."""
        return self.field([self.ring.constant(int(k == place)) for k in range(self.base)])

    def depends(self, of: Polynomial, places: Iterable[int]) -> bool:
        """Tell whether a polynomial depends on one of some base variables, through functions or
        not.
        """
        return any(self.along(of, self.unit(k)) != 0 for k in places)

    def of(self, name: str) -> int:
        """Return the place of a variable."""
        return self.names.index(name)


def lifted(problem: Problem) -> Lift:
    """Return a problem as polynomials; SolveError names what has no polynomial rate."""
    statement = problem.statement
    nodes = statement["nodes"]
    wanted = sum(1 for each in nodes if isinstance(each, (list, tuple)) and each[0] in _MAKING)
    base = [*statement["states"], *statement["parameters"], "t"]
    spare = [f"f{k}" for k in range(2 * wanted)]
    names = [*base, *spare, *statement["controls"]]
    ring = flint().fmpq_mpoly_ctx.get(tuple(names), flint().Ordering.lex)
    first = len(base) + len(spare)
    lift = Lift(names, ring, len(base), list(range(first, len(names))))
    reader = _Reader(lift, statement)
    rates = [reader.at(statement["dynamics"][name]) for name in statement["states"]]
    lift.running = lift.zero if statement["running"] is None else reader.at(statement["running"])
    lift.final = lift.zero if statement["minimise"] is None else reader.at(statement["minimise"])
    lift.path = [reader.relation(place)[0] for place in statement["path"].values()]
    lift.target = [reader.relation(place) for place in statement["target"].values()]
    one = ring.constant(1)
    lift.rates = lift.field([*rates, *(lift.zero for _ in statement["parameters"]), one])
    return lift


def _rate(lift: Lift, operation: str, place: int, slope: Polynomial) -> Polynomial:
    """Return the rate of a function by that of its argument."""
    if operation in _ROUGH:
        return lift.zero
    own = lift.ring.gen(place)
    partner = {"sin": 1, "cos": -1}.get(operation, 0)
    if partner:  # sine and cosine stand side by side
        return partner * lift.ring.gen(place + partner) * slope
    return {"exp": own, "tanh": 1 - own * own, "inv": -own * own}[operation] * slope


@final
class _Reader:
    """Entries of a statement as polynomials."""

    def __init__(self, lift: Lift, statement: Mapping[str, Any]) -> None:
        self._lift, self._nodes, self._bounds = lift, statement["nodes"], statement["bounds"]
        self._known: dict[int, Polynomial] = {}

    def at(self, place: int) -> Polynomial:
        """Return the polynomial of an entry."""
        if place not in self._known:
            self._known[place] = self._read(place)
        return self._known[place]

    def relation(self, place: int) -> tuple[Polynomial, bool]:
        """Return an entry that is a relation as (polynomial, equality): at most or equal to
        zero.
        """
        node = self._nodes[place]
        if node[0] not in {"le", "lt", "eq"}:
            raise SolveError(f"the relation '{node[0]}' has no polynomial")
        return self.at(node[1]) - self.at(node[2]), node[0] == "eq"

    def _read(self, place: int) -> Polynomial:
        node, lift = self._nodes[place], self._lift
        if isinstance(node, str):
            return self._symbol(node)
        if isinstance(node, (int, float)):
            return lift.ring.constant(rational(Fraction(repr(float(node)))))
        operation, given = node[0], node[1:]
        if operation in {"pow", "constpow"}:
            return self._power(self.at(given[0]), self._nodes[given[1]])
        values = [self.at(each) for each in given]
        return self._operation(operation, *values)

    def _operation(self, operation: str, *values: Polynomial) -> Polynomial:
        if operation in _PLAIN:
            return _PLAIN[operation](*values)
        if operation == "div":
            return values[0] * self._function("inv", values[1])
        if operation == "fabs":
            return self._size(values[0])
        if operation in {"fmin", "fmax"}:
            apart = self._size(values[0] - values[1])
            return (values[0] + values[1] + (apart if operation == "fmax" else -apart)) / 2
        if operation in _LIFTED:
            return self._function(operation, values[0])
        raise SolveError(f"'{operation}' has no polynomial rate here")

    def _symbol(self, name: str) -> Polynomial:
        name = "t" if name == "tf" else name
        if name not in self._lift.names:
            raise SolveError(f"'{name}' in an objective or a condition has no bound yet")
        return self._lift.ring.gen(self._lift.of(name))

    def _power(self, of: Polynomial, exponent: Any) -> Polynomial:
        if not isinstance(exponent, (int, float)) or exponent != int(exponent):
            raise SolveError("a power that is no whole number has no polynomial rate here")
        if abs(exponent) > _POWER:
            raise SolveError(f"a power of {exponent:g} is too large")
        found = of ** abs(int(exponent))
        return self._function("inv", found) if exponent < 0 else found

    def _size(self, of: Polynomial) -> Polynomial:
        """Return a modulus: of what has one sign by the bounds of the problem, as it is."""
        names = self._lift.names
        low, high = span(of, [limits(self._bounds.get(name, (-inf, inf))) for name in names])
        if low is not None and low >= 0:
            return of
        if high is not None and high <= 0:
            return -of
        return self._function("fabs", of)

    def _function(self, operation: str, of: Polynomial) -> Polynomial:
        lift = self._lift
        if of.is_constant():
            return self._number(operation, of)
        if any(of.degrees()[k] > 0 for k in lift.controls):
            raise SolveError(f"'{operation}' of a control")
        if any(of.degrees()[k] > 0 for k in lift.rough()):
            raise SolveError(f"'{operation}' of what has no rate")
        pair = ("sin", "cos") if operation in {"sin", "cos"} else (operation,)
        for k, (known, _, argument) in enumerate(lift.functions):
            if known == operation and argument == of:
                return lift.ring.gen(lift.base + k)
        at = lift.base + len(lift.functions)
        lift.functions += [(each, at + k, of) for k, each in enumerate(pair)]
        return lift.ring.gen(at + pair.index(operation))

    def _number(self, operation: str, of: Polynomial) -> Polynomial:
        if operation == "inv" and of != 0:
            return self._lift.ring.constant(1 / of.leading_coefficient())
        raise SolveError(f"'{operation}' of a number is no fraction")


def fraction(value: Any) -> Fraction:
    """Return a rational of flint as a fraction."""
    return Fraction(int(value.p), int(value.q))


def rational(value: Fraction) -> Any:
    """Return a fraction as a rational of flint."""
    return flint().fmpq(value.numerator, value.denominator)


def span(of: Polynomial, box: Sequence[Limits]) -> Limits:
    """Return an interval around the values of a polynomial on a box, None where it has no end."""
    low: Fraction | None = Fraction(0)
    high: Fraction | None = Fraction(0)
    for exponents, coefficient in of.terms():
        part: Limits = (Fraction(1), Fraction(1))
        for its, exponent in zip(box, exponents, strict=True):
            if exponent:
                part = _times(part, _to_the(its, int(exponent)))
        scale = fraction(coefficient)
        part = _times(part, (scale, scale))
        low = None if low is None or part[0] is None else low + part[0]
        high = None if high is None or part[1] is None else high + part[1]
    return low, high


def _to_the(its: Limits, exponent: int) -> Limits:
    low, high = its
    powers = [None if each is None else each**exponent for each in its]
    if exponent % 2:
        return powers[0], powers[1]
    most = None if None in powers else max(each for each in powers if each is not None)
    if low is not None and low >= 0:
        return powers[0], most
    if high is not None and high <= 0:
        return powers[1], most
    return Fraction(0), most


def _times(a: Limits, b: Limits) -> Limits:
    if (Fraction(0), Fraction(0)) in (a, b):
        return Fraction(0), Fraction(0)
    ends = [_product(x, y, i, j) for i, x in enumerate(a) for j, y in enumerate(b)]
    return (
        None if -inf in ends else min(each for each in ends),
        None if inf in ends else max(each for each in ends),
    )


def _product(x: Fraction | None, y: Fraction | None, i: int, j: int) -> Any:
    """Return the product of two ends, the lower one at place 0 and the upper one at 1."""
    if x is not None and y is not None:
        return x * y
    if x == 0 or y == 0:
        return Fraction(0)
    sign_x = (1 if i else -1) if x is None else (1 if x > 0 else -1)
    sign_y = (1 if j else -1) if y is None else (1 if y > 0 else -1)
    return inf * sign_x * sign_y

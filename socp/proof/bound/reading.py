"""The check of a certificate of a lower bound, in fractions, with an arithmetic of its own.

Nothing here is shared with what finds certificates: a statement's entries become polynomials anew,
every inequality is expanded anew, and what a certificate says of itself is not believed. Only the
values of exp, tanh, sin and cos at fractions are python-flint's balls.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from fractions import Fraction
from math import inf
from typing import Any, final

from socp.errors import SolveError

Poly = dict[tuple[int, ...], Fraction]  # exponents of the variables -> coefficient
Ends = tuple[Fraction, Fraction]
Box = list[Ends | None]  # None: without bounds

_WHOLE = (Fraction(-1), Fraction(1))
_DIGITS, _APART = 12, Fraction(1, 10**15)  # floats with more digits are enclosed, relative
_ROUGH = ("fabs", "sqrt")  # without rates: known by what they satisfy
_FUNCTIONS = ("exp", "sin", "cos", "tanh", "inv", *_ROUGH)


def require(holds: bool, what: str) -> None:
    """Raise SolveError with what does not hold."""
    if not holds:
        raise SolveError(f"not shown: {what}")


# -- numbers and intervals


def decimal(value: Any) -> Fraction:
    """Return a number of a statement as the fraction that it is written as."""
    return Fraction(repr(float(value)))


def around(value: float) -> Ends:
    """Return fractions around what a float stands for: itself, or a number such as pi."""
    exact, text = decimal(value), repr(float(value)).partition("e")[0]
    short = len(text.replace("-", "").replace(".", "").strip("0")) <= _DIGITS
    apart = 0 if short else abs(exact) * _APART
    return exact - apart, exact + apart


def times(a: Ends, b: Ends) -> Ends:
    """Return the product of two intervals."""
    ends = [x * y if x and y else Fraction(0) for x in a for y in b]  # of infinite ends too
    return min(ends), max(ends)


def power(a: Ends, n: int) -> Ends:
    """Return a power of an interval."""
    low, high = sorted((a[0] ** n, a[1] ** n))
    return (Fraction(0) if n % 2 == 0 and a[0] < 0 < a[1] else low), high


def ranged(p: Poly, box: Box) -> Ends | None:
    """Return an interval around a polynomial on a box, None where it has no bounds there."""
    low = high = Fraction(0)
    for exponents, coefficient in p.items():
        part: Ends = (coefficient, coefficient)
        for its, n in zip(box, exponents, strict=True):
            if n:
                if its is None:
                    return None
                part = times(part, power(its, n))
        low, high = low + part[0], high + part[1]
    return low, high


def image(function: str, of: Ends | None) -> Ends | None:
    """Return an interval around a function on an interval."""
    if of is None:
        return _WHOLE if function in {"sin", "cos", "tanh"} else None
    if function == "fabs":
        return max(of[0], -of[1], Fraction(0)), max(-of[0], of[1])
    if function == "sqrt":
        return Fraction(0), at(function, max(of[1], Fraction(0)))[1]
    if function == "inv":
        return None if of[0] <= 0 <= of[1] else (1 / of[1], 1 / of[0])
    if function in {"exp", "tanh"}:  # both increase
        return at(function, of[0])[0], at(function, of[1])[1]
    near, half = at(function, (of[0] + of[1]) / 2), (of[1] - of[0]) / 2  # slopes of at most one
    return max(near[0] - half, Fraction(-1)), min(near[1] + half, Fraction(1))


def at(function: str, value: Fraction) -> Ends:
    """Return an interval around a function at a fraction, by a ball of python-flint."""
    from flint import arb, ctx

    before, ctx.prec = ctx.prec, 160
    try:
        ball = getattr(arb(value.numerator) / value.denominator, function)()
        ends = [each.man_exp() for each in (ball.mid(), ball.rad())]
    finally:
        ctx.prec = before
    middle, radius = (Fraction(int(m)) * Fraction(2) ** int(e) for m, e in ends)
    return middle - radius, middle + radius


# -- polynomials


def plus(p: Poly, q: Poly, factor: Fraction = Fraction(1)) -> Poly:
    """Return p + factor q."""
    found = dict(p)
    for e, c in q.items():
        found[e] = found.get(e, Fraction(0)) + factor * c
    return {e: c for e, c in found.items() if c}


def by(p: Poly, q: Poly) -> Poly:
    """Return the product of two polynomials."""
    found: Poly = {}
    for a, x in p.items():
        for b, y in q.items():
            e = tuple(i + j for i, j in zip(a, b, strict=True))
            found[e] = found.get(e, Fraction(0)) + x * y
    return {e: c for e, c in found.items() if c}


def slope(p: Poly, k: int) -> Poly:
    """Return the derivative of a polynomial by variable k."""
    return {(*e[:k], e[k] - 1, *e[k + 1 :]): c * e[k] for e, c in p.items() if e[k]}


def put(p: Poly, values: Mapping[int, Poly]) -> Poly:
    """Return a polynomial with others in place of some of its variables."""
    found: Poly = {}
    powers: dict[tuple[int, int], Poly] = {}
    for e, c in p.items():
        term: Poly = {tuple(0 if k in values else n for k, n in enumerate(e)): c}
        for k, value in values.items():
            if e[k] and (k, e[k]) not in powers:
                raised = value
                for _ in range(e[k] - 1):
                    raised = by(raised, value)
                powers[k, e[k]] = raised
            term = by(term, powers[k, e[k]]) if e[k] else term
        found = plus(found, term)
    return found


# -- the problem, from its statement


@final
class Model:
    """A problem as polynomials of its states and the time, functions and controls, read off its
    statement; functions are those of a certificate.
    """

    def __init__(self, statement: Mapping[str, Any], functions: Sequence[Any]) -> None:
        require(not statement["parameters"], "a problem with parameters")
        self.nodes, self.bounds = statement["nodes"], statement["bounds"]
        self.base = [*statement["states"], "t"]
        self.size = len(self.base) + len(functions)
        self.count = self.size + len(statement["controls"])
        self.places = {name: k for k, name in enumerate(self.base)}
        self.places |= {name: self.size + k for k, name in enumerate(statement["controls"])}
        self.places["tf"] = self.places["t"]
        self.functions: list[tuple[str, Poly]] = []
        for name, of in functions:
            argument = polynomial(of, self.count)
            known = len(self.base) + len(self.functions)
            require(name in _FUNCTIONS and within(argument, known), "a function of what is known")
            smooth = all(not e[k] for e in argument for k in self.rough)
            require(smooth, "a function of what has a rate")
            self.functions.append((name, argument))
        self._done: dict[int, Poly] = {}
        rates = [self.of(statement["dynamics"][name]) for name in statement["states"]]
        self.rates = self.field([*rates, self.number(Fraction(1))])
        path = [self.relation(k)[0] for k in statement["path"].values()]
        self.lasting = self.made([*rates, self.of(statement["running"]), *path])

    def field(self, base: Sequence[Poly]) -> list[Poly]:
        """Return the rates of all variables by those of the states and the time."""
        rates = list(base)
        for name, argument in self.functions:
            rates.append(self._rate(len(rates), name, self.along(argument, rates)))
        return rates

    def along(self, p: Poly, rates: Sequence[Poly]) -> Poly:
        """Return the derivative of a polynomial along a motion with the rates of variables."""
        found: Poly = {}
        for k, rate in enumerate(rates):
            part = slope(p, k)
            found = plus(found, by(part, rate)) if part and rate else found
        return found

    def gradient(self, p: Poly, k: int) -> Poly:
        """Return the derivative of a polynomial by a state, through functions too."""
        unit = [self.number(Fraction(int(i == k))) for i in range(len(self.base))]
        return self.along(p, self.field(unit))

    @property
    def rough(self) -> list[int]:
        """Variables that are functions without a rate."""
        its = [k for k, (name, _) in enumerate(self.functions) if name in _ROUGH]
        return [len(self.base) + k for k in its]

    def made(self, polynomials: Sequence[Poly]) -> set[int]:
        """Return the functions that polynomials are made of: where these have values, all that the
        functions are of is where those are defined.
        """
        found, left = set[int](), list(polynomials)
        while left:
            of = left.pop()
            new = {k for e in of for k in range(len(self.base), self.size) if e[k]} - found
            found |= new
            left += [self.functions[k - len(self.base)][1] for k in new]
        return found

    def facts(self, places: Collection[int]) -> list[Poly]:
        """Return what is at least zero of functions without a rate, at some places."""
        found = []
        for k in self.rough:
            if k not in places:
                continue
            name, of = self.functions[k - len(self.base)]
            own, square = self.variable(k), by(of, of) if name == "fabs" else of
            left = plus(by(own, own), square, Fraction(-1))
            sides = [plus(own, of, Fraction(-1)), plus(own, of)] if name == "fabs" else [own]
            found += [*sides, left, plus({}, left, Fraction(-1))]
        return found

    def number(self, value: Fraction) -> Poly:
        """Return a number as a polynomial."""
        return {(0,) * self.count: value} if value else {}

    def variable(self, k: int) -> Poly:
        """Return a variable as a polynomial."""
        return {tuple(int(i == k) for i in range(self.count)): Fraction(1)}

    def of(self, place: int | None) -> Poly:
        """Return the polynomial of an entry, zero for None."""
        if place is None:
            return {}
        if place not in self._done:
            self._done[place] = self._read(self.nodes[place])
        return self._done[place]

    def relation(self, place: int) -> tuple[Poly, bool]:
        """Return a relation as (polynomial <= 0, whether it is an equality)."""
        name, left, right = self.nodes[place]
        require(name in {"le", "lt", "eq"}, f"the relation {name}")
        return plus(self.of(left), self.of(right), Fraction(-1)), name == "eq"

    def _read(self, node: Any) -> Poly:
        if isinstance(node, str):
            require(node in self.places, f"an expression of {node}")
            return self.variable(self.places[node])
        if isinstance(node, (int, float)):
            return self.number(decimal(node))
        name = node[0]
        if name in {"pow", "constpow"}:
            return self._power(self.of(node[1]), self.nodes[node[2]])
        a = self.of(node[1])
        b = self.of(node[2]) if len(node) > 2 else {}
        plain: Mapping[str, Callable[[], Poly]] = {
            "add": lambda: plus(a, b),
            "sub": lambda: plus(a, b, Fraction(-1)),
            "mul": lambda: by(a, b),
            "neg": lambda: plus({}, a, Fraction(-1)),
            "sq": lambda: by(a, a),
            "twice": lambda: plus(a, a),
            "div": lambda: by(a, self._function("inv", b)),
            "fabs": lambda: self._size(a),
            "fmin": lambda: self._mean(a, b, Fraction(-1)),
            "fmax": lambda: self._mean(a, b, Fraction(1)),
        }
        return plain[name]() if name in plain else self._function(name, a)

    def _power(self, a: Poly, n: Any) -> Poly:
        require(isinstance(n, (int, float)) and n == int(n), "a power")
        found = self.number(Fraction(1))
        for _ in range(abs(int(n))):
            found = by(found, a)
        return found if n >= 0 else self._function("inv", found)

    def _function(self, name: str, a: Poly) -> Poly:
        constant = a.get((0,) * self.count)
        if name == "inv" and len(a) == 1 and constant:
            return self.number(1 / constant)
        for k, (known, argument) in enumerate(self.functions):
            if known == name and argument == a:
                return self.variable(len(self.base) + k)
        raise SolveError(f"not shown: {name} is none of the certificate's functions")

    def _size(self, a: Poly) -> Poly:
        box: Box = [None] * self.count
        for name, its in self.bounds.items():
            if all(abs(float(each)) < inf for each in its):
                box[self.places[name]] = around(float(its[0]))[0], around(float(its[1]))[1]
        its = ranged(a, box)
        if its is None or its[0] < 0 < its[1]:
            return self._function("fabs", a)
        return a if its[0] >= 0 else plus({}, a, Fraction(-1))

    def _mean(self, a: Poly, b: Poly, sign: Fraction) -> Poly:
        apart = self._size(plus(a, b, Fraction(-1)))
        return {e: c / 2 for e, c in plus(plus(a, b), apart, sign).items()}

    def _rate(self, k: int, name: str, inner: Poly) -> Poly:
        own, argument = self.variable(k), self.functions[k - len(self.base)][1]
        if name in _ROUGH:
            return {}
        outer = {
            "exp": lambda: own,
            "tanh": lambda: plus(self.number(Fraction(1)), by(own, own), Fraction(-1)),
            "inv": lambda: plus({}, by(own, own), Fraction(-1)),
            "sin": lambda: self._function("cos", argument),
            "cos": lambda: plus({}, self._function("sin", argument), Fraction(-1)),
        }[name]()
        return by(outer, inner)

    def circles(self, box: Box) -> list[tuple[int, int]]:
        """Return places (sine, cosine) of one angle whose ranges in a box are whole."""
        n = len(self.base)
        return [
            (n + i, n + j)
            for i, (a, of_a) in enumerate(self.functions)
            for j, (b, of_b) in enumerate(self.functions)
            if a == "sin" and b == "cos" and of_a == of_b and box[n + i] == box[n + j] == _WHOLE
        ]


def polynomial(given: Sequence[Any], count: int) -> Poly:
    """Return a polynomial of a certificate: pairs of ((variable, power), ...) and a fraction."""
    found: Poly = {}
    for powers, value in given:
        found = plus(found, {monomial(powers, count): Fraction(value)})
    return found


def within(p: Poly, count: int) -> bool:
    """Tell whether a polynomial is one of the first variables alone."""
    return all(not any(e[count:]) for e in p)


def short(its: Ends | None) -> Ends | None:
    """Return an interval with short ends that contains another."""
    grain = 2**60
    if its is None:
        return None
    low, high = (its[0] * grain).__floor__(), (its[1] * grain).__ceil__()
    return Fraction(low, grain), Fraction(high, grain)


def monomial(given: Sequence[Any], count: int) -> tuple[int, ...]:
    """Return exponents of pairs (variable, power)."""
    exponents = [0] * count
    for k, n in given:
        require(type(n) is int and n > 0 and 0 <= k < count, "a monomial")
        exponents[k] = n
    return tuple(exponents)


def squares(basis: Sequence[tuple[int, ...]], rows: Sequence[Sequence[int]]) -> Poly:
    """Return the sum of squares of rows . basis, rows of whole numbers."""
    columns = list(zip(*rows, strict=True))
    require(not columns or len(columns) == len(basis), "rows of a basis")
    require(all(type(each) is int for row in rows for each in row), "whole numbers")
    found: dict[tuple[int, ...], int] = {}
    for i, a in enumerate(basis if columns else ()):
        for j in range(i + 1):
            e = tuple(m + n for m, n in zip(a, basis[j], strict=True))
            value = sum(map(int.__mul__, columns[i], columns[j]))
            found[e] = found.get(e, 0) + (value if i == j else 2 * value)
    return {e: Fraction(c) for e, c in found.items() if c}


def on_circle(p: Poly, s: int, c: int) -> Poly:
    """Return a polynomial with sin^2 as 1 - cos^2."""
    found: Poly = {}
    for e, value in p.items():
        half, rest = divmod(e[s], 2)
        term: Poly = {tuple(rest if k == s else n for k, n in enumerate(e)): value}
        for _ in range(half):
            up = {tuple(n + 2 * (k == c) for k, n in enumerate(f)): -v for f, v in term.items()}
            term = plus(term, up)
        found = plus(found, term)
    return found

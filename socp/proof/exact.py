"""Numbers of a problem as they are meant, decimals, simple fractions and multiples of pi in place
of the floats that stand for them, and expressions that keep them apart from what is computed.

Casadi folds constants in floating point, in derivatives too: an exact rational read off such a
derivative would be that of another function. So every number becomes a symbol before anything is
derived, but 0, 1 and 2, whose sums, products and halves are exact.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any, final

import casadi

from socp.errors import SolveError
from socp.model import Expr, fold, operation_name, operation_names

# A number with no more digits than this is one that somebody wrote down
_WRITTEN = 12
# Denominators of simple fractions, of 1 and of pi: those below it that are told apart from a float
# by chance are about one in 1e10
_SIMPLE = 1000
_TURNS = 180
# A power is multiplied out up to this exponent; with more it is an exponential
_POWER = 32
_PLAIN = (0.0, 1.0, 2.0)

_BINARY = operation_names("add", "sub", "mul", "div", "fmin", "fmax")
_SMOOTH = "assign neg sq twice inv sqrt exp log sin cos tan asin acos atan sinh cosh tanh"
_UNARY = operation_names(*_SMOOTH.split(), "fabs")
_POWERS = operation_names("pow", "constpow")


@final
@dataclass(frozen=True)
class Exact:
    """A number: a fraction, times pi where `pi` is true."""

    fraction: Fraction
    pi: bool = False

    @classmethod
    def of(cls, value: float) -> "Exact":
        """Return the number that a float stands for.

        What is printed with few digits is that decimal, otherwise the fraction with a denominator
        of at most 1000, or the multiple of pi by one of at most 180, that rounds to the float, else
        the float itself.
        """
        text = repr(float(value))
        if len(text.partition("e")[0].replace("-", "").replace(".", "").strip("0")) <= _WRITTEN:
            return cls(Fraction(text))
        simple = Fraction(value).limit_denominator(_SIMPLE)
        if float(simple) == value:
            return cls(simple)
        turns = Fraction(value / math.pi).limit_denominator(_TURNS)
        if math.isclose(float(turns) * math.pi, value, rel_tol=4e-16):
            return cls(turns, pi=True)
        return cls(Fraction(value))

    def __str__(self) -> str:
        if not self.pi:
            return str(self.fraction)
        above, below = self.fraction.numerator, self.fraction.denominator
        return ("" if above == 1 else f"{above} ") + "pi" + ("" if below == 1 else f" / {below}")

    def __float__(self) -> float:
        return float(self.fraction) * (math.pi if self.pi else 1.0)


@final
@dataclass(frozen=True, eq=False)
class Numbers:
    """The numbers of a problem by symbol, and the kinks of its expressions: symbols of the sign of
    an expression, which is their place in `kinks`.
    """

    values: dict[Expr, Exact] = field(default_factory=dict)
    kinks: dict[Expr, Expr] = field(default_factory=dict)
    _known: dict[float, Expr] = field(default_factory=dict)

    def of(self, value: float) -> Expr:
        """Return a number as an expression, a symbol unless it is plain."""
        value = float(value)
        if value < 0.0:
            return -self.of(-value)
        if value in _PLAIN:
            return casadi.SX(value)
        if value not in self._known:
            symbol = casadi.SX.sym(f"number({value!r})")
            self._known[value] = symbol
            self.values[symbol] = Exact.of(value)
        return self._known[value]

    def expression(self, given: Expr, put: Mapping[Expr, Expr]) -> Expr:
        """Return expressions (m, 1) with numbers and kinks as symbols, and others put in place of
        their own symbols.

        Raises SolveError for an operation that is not smooth, or has no enclosure here.
        """
        symbols = casadi.vertcat(*casadi.symvar(given))
        names = (
            [put.get(each, each) for each in casadi.vertsplit(symbols)] if symbols.numel() else []
        )

        def built(operation: int, *arguments: Any) -> Any:
            return self._built(operation, *arguments)

        found = fold(casadi.vec(given), symbols, names.__getitem__, float, built)
        parts = [self._plain(0.0 if each is None else each) for each in found]
        return casadi.vertcat(casadi.SX(0, 1), *parts)

    def _plain(self, value: Any) -> Expr:
        return self.of(value) if isinstance(value, float) else value

    def _built(self, operation: int, *arguments: Any) -> Any:
        if operation in _POWERS:
            return self._power(self._plain(arguments[0]), arguments[1])
        given = [self._plain(each) for each in arguments]
        name = _BINARY.get(operation) or _UNARY.get(operation)
        if name in {"fmin", "fmax"}:
            half = self._kink(given[0] - given[1]) * (given[0] - given[1]) / 2
            return (given[0] + given[1]) / 2 + (half if name == "fmax" else -half)
        if name == "fabs":
            return self._kink(given[0]) * given[0]
        if operation in _BINARY:
            return casadi.SX.binary(operation, *given[:2])
        if operation in _UNARY:
            return casadi.SX.unary(operation, given[0])
        raise SolveError(f"'{operation_name(operation)}' has no enclosure")

    def _kink(self, argument: Expr) -> Expr:
        for symbol, known in self.kinks.items():
            if casadi.is_equal(known, argument, 50):
                return symbol
        symbol = casadi.SX.sym(f"sign({len(self.kinks)})")
        self.kinks[symbol] = argument
        return symbol

    def _power(self, base: Expr, exponent: Any) -> Expr:
        if not isinstance(exponent, float):
            return casadi.exp(exponent * casadi.log(base))
        whole, half = round(exponent), round(2 * exponent)
        if exponent == whole and abs(whole) <= _POWER:
            found = casadi.SX(1)
            for _ in range(abs(int(whole))):
                found = found * base
            return 1 / found if whole < 0 else found
        if 2 * exponent == half and abs(half) <= _POWER:
            root = casadi.sqrt(base)
            return self._power(root, float(half))
        return casadi.exp(self.of(exponent) * casadi.log(base))

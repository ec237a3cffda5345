"""Expressions as functions of balls and of power series of balls: python-flint's arithmetic, in
which every rounding is enclosed.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from typing import Any, final

import casadi

from socp.errors import SolveError
from socp.model import Expr, fold, operation_name, operation_names
from socp.proof.exact import Exact

Ball = Any  # an arb; python-flint is there only where something is proved
Series = Any  # an arb_series, or an arb where it is constant
Matrix = Any  # an arb_mat

_BINARY = {"add": "({0}+{1})", "sub": "({0}-{1})", "mul": "({0}*{1})", "div": "({0}/{1})"}
_UNARY = {
    "assign": "{0}",
    "neg": "(-{0})",
    "sq": "({0}*{0})",
    "twice": "({0}+{0})",
    "inv": "(1/{0})",
    "tanh": "(1-2/((2*{0}).exp()+1))",
    "sinh": "(({0}).exp()-(-{0}).exp())/2",
    "cosh": "(({0}).exp()+(-{0}).exp())/2",
    **{name: "({0})." + name + "()" for name in ("sqrt", "exp", "log", "sin", "cos", "tan")},
    **{name: "({0})." + name + "()" for name in ("asin", "acos", "atan")},
}
_NAMES = operation_names(*_BINARY, *_UNARY)
# What stands in an expression as a number is a small multiple of a small power of two, made of 0,
# 1 and 2 without rounding; anything else was rounded by whoever folded it
_DYADIC = 2.0**30


@cache
def flint() -> Any:
    """Return python-flint; SolveError says how to get it."""
    try:
        return import_module("flint")
    except ImportError as error:
        raise SolveError("python-flint is missing: pip install 'socp[prove]'") from error


@contextmanager
def precision(bits: int) -> Iterator[None]:
    """Work with so many bits; what the process worked with before comes back."""
    context = flint().ctx
    before = context.prec, context.cap
    context.prec = bits
    try:
        yield
    finally:
        context.prec, context.cap = before


def ball(number: Exact) -> Ball:
    """Return a ball that contains a number."""
    arb = flint().arb
    found = arb(number.fraction.numerator) / number.fraction.denominator
    return found * arb.pi() if number.pi else found


@final
@dataclass(frozen=True, eq=False)
class Compiled:
    """Expressions (m,) as a Python function of a sequence of balls, or of series: (k, f), with
    every number in place; None stands for what is zero throughout.
    """

    source: str
    call: Callable[[Sequence[Any]], list[Any]]


def compiled(expressions: Expr, given: Expr, values: Mapping[Expr, Any]) -> Compiled:
    """Return expressions (m, 1) of symbols `given` (n, 1) as a function of n balls or series, the
    other symbols being numbers.
    """
    lines: list[str] = []
    constants: dict[str, Any] = {}
    others = [s for s in casadi.symvar(expressions) if not casadi.depends_on(s, given)]
    symbols = casadi.vertcat(given, *others)
    count = given.numel()
    known = {symbol.element_hash(): value for symbol, value in values.items()}

    def of_symbol(place: int) -> str:
        if place < count:
            return f"z[{place}]"
        symbol = others[place - count]
        if symbol.element_hash() not in known:
            raise SolveError(f"'{symbol}' has no value")
        name = f"c{place}"
        constants[name] = known[symbol.element_hash()]
        return name

    def of_number(value: float) -> str:
        if value * _DYADIC != round(value * _DYADIC) or abs(value) > _DYADIC:
            raise SolveError(f"the number {value!r} in an expression is rounded")
        name = f"n{len(constants)}"
        constants[name] = flint().arb(value)
        return name

    def of_operation(operation: int, *arguments: str) -> str:
        name = _NAMES.get(operation)
        if name is None:
            raise SolveError(f"'{operation_name(operation)}' has no enclosure")
        written = (_BINARY.get(name) or _UNARY[name]).format(*arguments)
        lines.append(f" w{len(lines)}={written}")
        return f"w{len(lines) - 1}"

    shared = casadi.cse(casadi.densify(expressions))
    outputs = fold(shared, symbols, of_symbol, of_number, of_operation)
    source = "\n".join(["def f(z):", *lines, f" return [{','.join(map(str, outputs))}]"])
    exec(source, constants)  # noqa: S102 - of our own making: names, numbers and operations alone
    return Compiled(source, constants["f"])


def coefficients(series: Series, count: int) -> list[Ball]:
    """Return so many coefficients of a series, of a ball or of None, which is zero; ValueError
    where the series does not know so many.
    """
    module = flint()
    if series is None:
        return [module.arb(0)] * count
    if isinstance(series, module.arb_series):
        if series.prec < count:
            raise ValueError(f"a series has {series.prec} coefficients of {count}")
        found = list(series.coeffs())[:count]
        return found + [module.arb(0)] * (count - len(found))
    return [module.arb(series)] + [module.arb(0)] * (count - 1)


def balls_of(found: Sequence[Any]) -> list[Ball]:
    """Return what compiled expressions come to as balls: None is zero."""
    return [flint().arb(0 if each is None else each) for each in found]


def finite(balls: Sequence[Ball]) -> bool:
    """Tell whether all balls are bounded."""
    return all(each.is_finite() for each in balls)


def negative(value: Ball) -> bool:
    """Tell whether every number of a ball is below zero; of a ball that is not finite none is."""
    return bool(value.is_finite() and value < 0)


def positive(value: Ball) -> bool:
    """Tell whether every number of a ball is above zero."""
    return bool(value.is_finite() and value > 0)

"""Formulas for the reader: expressions put through sympy, and believed only where their values stay
the same.
"""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from fractions import Fraction
from types import FrameType
from typing import Any, final

import casadi
import numpy as np

from socp.laws import probes
from socp.model import AREA, ARITHMETIC, HYPERBOLIC, TRIGONOMETRIC, Expr, Problem, operation_names

_SECONDS = 3.0  # for one formula; what is not simple by then is not going to be
_LARGEST = 150  # operations of a formula that is simplified in full where no timer can stop it
_MOST = 0.9  # of the points that have to agree: at a few, both may be 0/0 but for rounding
_SAME = 1e-9  # relative difference that two ways to evaluate one formula may have

_LARGE = 1e4  # numbers in a sum above which they are divided by the least of them
_OPERATIONS: dict[int, str | Callable[..., Any]] = {
    **ARITHMETIC,
    **operation_names("log", "sqrt", *TRIGONOMETRIC, *HYPERBOLIC, *AREA, "sign"),
    casadi.OP_FABS: "Abs",
}


class _TooLongError(Exception):
    """The time for one formula is over, or it holds what cannot be translated."""


def simplified(problem: Problem, expression: Expr, points: np.ndarray) -> Expr:
    """Return an expression (1, 1) as short as sympy makes it in a few seconds, its values at points
    (nv, n) unchanged.

    Returns the expression itself where it cannot be translated, takes too long, or does not come
    out the same.
    """
    import sympy  # noqa: F401 - here, as an import that the alarm cuts off stays half loaded

    expression = casadi.SX(expression)
    translation = _Translation({s.name(): s for s in casadi.symvar(expression)})
    shortest = expression
    try:
        with _limited(_SECONDS):
            for candidate in _candidates(translation.there(expression), length(expression)):
                back = casadi.SX(translation.back(candidate))
                if length(back) < length(shortest) and _same(problem, expression, back, points):
                    shortest = back
    except (
        _TooLongError,
        ArithmeticError,
        ValueError,
        TypeError,
        NotImplementedError,
        RecursionError,
    ):
        return shortest
    return shortest


def length(expression: Expr) -> int:
    """Return how many symbols, numbers and operations an expression is written with, repetitions
    counted.
    """
    memo: dict[int, tuple[Expr, int]] = {}

    def count(e: Expr) -> int:
        key = e.element_hash()
        if key not in memo:
            memo[key] = (e, 1 + sum(count(e.dep(k)) for k in range(e.n_dep())))
        return memo[key][1]

    return count(expression)


def _candidates(expression: Any, size: int) -> Iterator[Any]:
    import sympy

    yield expression
    together = sympy.cancel(sympy.together(expression))
    yield together
    yield sympy.factor(together)
    if size <= _LARGEST or _can_stop():
        simple = sympy.simplify(together)
        yield simple
        yield sympy.factor(simple)


def _same(problem: Problem, before: Expr, after: Expr, points: np.ndarray) -> bool:
    a, b = (values.ravel() for values in probes.evaluator(problem, before, after)(points))
    a, b = a[np.isfinite(a)], b[np.isfinite(a)]
    alike = (
        np.abs(a - b) <= _SAME * (np.median(np.abs(a)) + np.abs(a))
        if a.size
        else np.zeros(1, dtype=bool)
    )
    return bool(alike.mean() >= _MOST)


def _can_stop() -> bool:
    return threading.current_thread() is threading.main_thread() and hasattr(signal, "setitimer")


@contextmanager
def _limited(seconds: float) -> Iterator[None]:
    """Raise _TooLongError in the body after so many seconds, where signals allow it."""
    if not _can_stop():
        yield
        return

    def stop(_number: int, _frame: FrameType | None) -> None:
        raise _TooLongError

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@final
@dataclass(eq=False)
class _Translation:
    """Between casadi and sympy. An exponential is one symbol to sympy, which would make huge powers
    of it.
    """

    symbols: dict[str, Expr]
    memo: dict[int, tuple[Expr, Any]] = field(default_factory=dict)
    exponentials: list[tuple[Any, Any, Expr]] = field(
        default_factory=list
    )  # (exponent, symbol, expression)

    def there(self, e: Expr) -> Any:
        """Return a casadi expression as a sympy one; _TooLongError where an operation has no
        translation.
        """
        key = e.element_hash()
        if key not in self.memo:
            self.memo[key] = (e, self._node(e))
        return self.memo[key][1]

    def _node(self, e: Expr) -> Any:
        import sympy

        if e.is_constant():
            return _number(float(e))
        if e.is_symbolic():
            return sympy.Symbol(e.name(), real=True)
        parts = [self.there(e.dep(k)) for k in range(e.n_dep())]
        if e.op() == casadi.OP_EXP:
            return self._exponential(parts[0], e)
        operation = _OPERATIONS.get(e.op())
        if operation is None:
            raise _TooLongError
        return operation(*parts) if callable(operation) else getattr(sympy, operation)(*parts)

    def _exponential(self, exponent: Any, e: Expr) -> Any:
        import sympy

        for known, symbol, _ in self.exponentials:
            if sympy.expand(known - exponent) == 0:
                return symbol
            if sympy.expand(known + exponent) == 0:
                return 1 / symbol
        symbol = sympy.Symbol(f"_exp_{len(self.exponentials)}", positive=True)
        self.exponentials.append((exponent, symbol, e))
        return symbol

    def back(self, e: Any) -> Any:
        """Return a sympy expression as a casadi one."""
        import sympy

        if e.is_Symbol:
            return next(
                (whole for _, symbol, whole in self.exponentials if symbol == e),
                self.symbols.get(e.name),
            )
        if e.is_number:
            return float(e)
        if isinstance(e, sympy.Mul):
            return self._product(e)
        if isinstance(e, sympy.Add):
            return self._sum(e)
        parts = [self.back(part) for part in e.args]
        if isinstance(e, sympy.Pow):
            return (
                1 / parts[0]
                if e.exp == -1
                else 1 / parts[0] ** -parts[1]
                if e.exp.is_negative
                else parts[0] ** parts[1]
            )
        name = "fabs" if isinstance(e, sympy.Abs) else type(e).__name__
        if not hasattr(casadi, name):
            raise _TooLongError
        return getattr(casadi, name)(*parts)

    def _sum(self, e: Any) -> Any:
        """Return a sum, terms with a minus sign last, so that they are differences."""
        terms = sorted(e.args, key=lambda term: bool(term.could_extract_minus_sign()))
        total = self.back(terms[0])
        for term in terms[1:]:
            total = (
                total - self.back(-term)
                if term.could_extract_minus_sign()
                else total + self.back(term)
            )
        return total

    def _product(self, e: Any) -> Any:
        """Return a product as one quotient with one number in front."""
        number, rest = e.as_coeff_Mul()
        above, below = rest.as_numer_denom()
        top, bottom, number = casadi.SX(1), casadi.SX(1), float(number)
        for size, factor in map(_content, above.as_ordered_factors()):
            number, top = number * size, top * self.back(factor)
        for size, factor in map(_content, below.as_ordered_factors()):
            number, bottom = number / size, bottom * self.back(factor)
        return (
            number * top / bottom
            if not top.is_constant() or bottom.is_constant()
            else number / bottom
        )


def _content(factor: Any) -> tuple[float, Any]:
    """Split a number off a sum whose numbers are large because denominators were multiplied out of
    it.
    """
    import sympy

    numbers = (
        [abs(float(term.as_coeff_Mul()[0])) for term in factor.args]
        if isinstance(factor, sympy.Add)
        else []
    )
    if not numbers or max(numbers) < _LARGE:
        return 1.0, factor
    least = min(numbers)
    terms = [term.as_coeff_Mul() for term in factor.args]
    return least, sympy.Add(*(_number(float(c) / least) * rest for c, rest in terms))


def _fraction(value: float) -> tuple[int, int]:
    """Return a number as the fraction that its decimals mean."""
    short = Fraction(value).limit_denominator(1000)
    exact = short if abs(float(short) - value) <= 1e-14 * abs(value) else Fraction(f"{value:.14e}")
    return exact.numerator, exact.denominator


def _number(value: float) -> Any:
    import sympy

    return sympy.Rational(*_fraction(value))

"""Expressions as a problem file writes them: Python's signs, no needless parentheses, multiples of pi by name."""

import math
from typing import Any

import casadi

from socp.symbols import Expr

_INFIX = {  # operation -> sign, precedence
    casadi.OP_LE: (" <= ", 1), casadi.OP_LT: (" < ", 1), casadi.OP_EQ: (" == ", 1), casadi.OP_NE: (" != ", 1),
    casadi.OP_ADD: (" + ", 2), casadi.OP_SUB: (" - ", 2), casadi.OP_MUL: ("*", 3), casadi.OP_DIV: ("/", 3),
    casadi.OP_POW: ("**", 5), casadi.OP_CONSTPOW: ("**", 5),
}  # fmt: skip
_CALLS = {
    getattr(casadi, f"OP_{name.upper()}"): name
    for name in (
        "exp", "log", "sqrt", "sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh",
        "atanh", "fabs", "sign", "floor", "ceil", "erf", "fmin", "fmax", "atan2", "fmod", "log1p", "expm1", "hypot",
    )
}  # fmt: skip
_ATOM, _UNARY, _PRODUCT = 9, 4, 3
_OPPOSITE = {casadi.OP_ADD: " - ", casadi.OP_SUB: " + "}
_DENOMINATORS = (1, 2, 3, 4, 6)


def formula(expression: Expr) -> str:
    """Return an expression (1, 1), or a relation of two, as text; what has no sign here is left to casadi.

    So is an expression that is nested too deeply to be walked through.
    """
    try:
        return _write(casadi.SX(expression))[0]
    except RecursionError:
        return str(expression)


def number(value: float) -> str:
    """Return a number in 12 digits, multiples and simple fractions of pi by name."""
    for denominator in _DENOMINATORS if math.isfinite(value) else ():
        times = value / math.pi * denominator
        if times and abs(times) < 13 and abs(times - round(times)) < 1e-13 * abs(times):
            sign, count = "-" if times < 0 else "", abs(round(times))
            return sign + ("pi" if count == 1 else f"{count}*pi") + ("" if denominator == 1 else f"/{denominator}")
    return f"{value:.12g}"


def _write(expression: Any) -> tuple[str, int]:
    """Return the text of an expression and how tightly its outermost operation binds."""
    if expression.is_constant():
        value = float(expression)
        return number(value), _UNARY if value < 0 else _ATOM if "/" not in number(value) else _PRODUCT
    if expression.is_symbolic():
        return expression.name(), _ATOM
    operation = expression.op()
    parts = [expression.dep(k) for k in range(expression.n_dep())]
    if operation in _CALLS:
        return f"{_CALLS[operation]}({', '.join(formula(part) for part in parts)})", _ATOM
    if operation in _INFIX:
        return _infix(operation, *parts)
    if operation in _SPECIAL:
        return _SPECIAL[operation](parts[0])
    return str(expression), 0


def _infix(operation: int, left: Any, right: Any) -> tuple[str, int]:
    sign, binds = _INFIX[operation]
    if operation == casadi.OP_MUL and right.is_constant() and not left.is_constant():
        left, right = right, left
    strict = operation in {casadi.OP_SUB, casadi.OP_DIV}
    power = binds == _INFIX[casadi.OP_POW][1]
    before, after = _held(left, binds + power), _held(right, binds + strict)
    if operation in _OPPOSITE and after.startswith("-"):  # a - -2*b is a + 2*b
        return before + _OPPOSITE[operation] + after[1:], binds
    return before + sign + after, binds


def _held(expression: Any, binds: int) -> str:
    text, its = _write(expression)
    return text if its >= binds else f"({text})"


def _negated(inner: Any) -> tuple[str, int]:
    text = _held(inner, _PRODUCT)
    return (text[1:], _PRODUCT) if text.startswith("-") else (f"-{text}", 2)


def _squared(inner: Any) -> tuple[str, int]:
    return f"{_held(inner, 6)}**2", 5


def _doubled(inner: Any) -> tuple[str, int]:
    return f"2*{_held(inner, _PRODUCT)}", _PRODUCT


def _inverted(inner: Any) -> tuple[str, int]:
    return f"1/{_held(inner, _PRODUCT + 1)}", _PRODUCT


_SPECIAL = {casadi.OP_NEG: _negated, casadi.OP_SQ: _squared, casadi.OP_TWICE: _doubled, casadi.OP_INV: _inverted}

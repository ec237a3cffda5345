"""Expressions as a problem file writes them: Python's signs, no needless parentheses, multiples of
pi by name.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import casadi
import numpy as np

from socp.model import AREA, HYPERBOLIC, POWERS, TRIGONOMETRIC, Expr, operation_names
from socp.view.report import constant_lines

_INFIX = {  # operation -> sign, precedence
    casadi.OP_LE: (" <= ", 1),
    casadi.OP_LT: (" < ", 1),
    casadi.OP_EQ: (" == ", 1),
    casadi.OP_NE: (" != ", 1),
    casadi.OP_ADD: (" + ", 2),
    casadi.OP_SUB: (" - ", 2),
    casadi.OP_MUL: ("*", 3),
    casadi.OP_DIV: ("/", 3),
    casadi.OP_POW: ("**", 5),
    casadi.OP_CONSTPOW: ("**", 5),
}
_CALLS = operation_names(
    *(*POWERS, *TRIGONOMETRIC, *HYPERBOLIC, *AREA, "fabs", "sign", "floor", "ceil", "erf"),
    *("fmin", "fmax", "atan2", "fmod", "log1p", "expm1", "hypot"),
)
_ATOM, _UNARY, _PRODUCT = 9, 4, 3
_OPPOSITE = {casadi.OP_ADD: " - ", casadi.OP_SUB: " + "}
_DENOMINATORS = (1, 2, 3, 4, 6)


def formula(expression: Expr) -> str:
    """Return an expression (1, 1), or a relation of two, as text; what has no sign here is left to
    casadi.

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
            return (
                sign
                + ("pi" if count == 1 else f"{count}*pi")
                + ("" if denominator == 1 else f"/{denominator}")
            )
    return f"{value:.12g}"


def _write(expression: Any) -> tuple[str, int]:
    """Return the text of an expression and how tightly its outermost operation binds."""
    if expression.is_constant():
        value = float(expression)
        return number(value), _UNARY if value < 0 else _ATOM if "/" not in number(
            value
        ) else _PRODUCT
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


_SPECIAL = {
    casadi.OP_NEG: _negated,
    casadi.OP_SQ: _squared,
    casadi.OP_TWICE: _doubled,
    casadi.OP_INV: _inverted,
}


if TYPE_CHECKING:
    from socp.model import Problem

Line = tuple[str, str]


def statement_rows(problem: "Problem") -> Iterator[Line]:
    """Yield (label, text) of cost, dynamics, bounds, ends, constraints and given laws."""
    terms = [formula(problem.minimise)] if problem.minimise is not None else []
    terms += [f"integral of {formula(problem.running)}"] if problem.running is not None else []
    yield "minimise", " + ".join(terms)
    yield from (
        ("dynamics", f"{state}' = {formula(rate)}") for state, rate in problem.dynamics.items()
    )
    yield from _intervals(problem)
    for label in ("target", "path"):
        yield from (
            (label, f"{name}: {formula(relation)}")
            for name, relation in getattr(problem, label).items()
        )
    given = problem.singular.items()
    yield from (
        ("given law", f"{control} = {formula(law)} where singular") for control, law in given
    )
    yield from _boundary(problem)


def notes(problem: "Problem") -> Iterator[Line]:
    """Yield (label, text) of what is known beside the problem: constants, units, references."""
    for line, each in zip(constant_lines(problem), problem.constants.values(), strict=True):
        yield "constant", f"{line}: {each.text}" if each.text else line
    yield from (("unit", f"{symbol}: {unit}") for symbol, unit in problem.units.items())
    yield from _reference(problem)


def _intervals(problem: "Problem") -> Iterator[Line]:
    boxes = (
        ("control", problem.box),
        ("state", problem.state_box),
        ("parameter", problem.parameter_box),
    )
    for kind, box in boxes:
        yield from ((kind, text) for text in _box(getattr(problem, f"{kind}_names"), box))
    for label, box in (("start", problem.start_box), ("end", problem.end_box)):
        yield label, ", ".join(_box(problem.state_names, box))
    times = np.array([problem.initial_time_box, problem.final_time_box]).T
    yield "time", ", ".join(_box(("t0", "tf"), times))


def _box(names: Sequence[str], box: np.ndarray) -> list[str]:
    """Return the intervals of names (n,) with bounds (2, n), those that are free together at the
    end.
    """
    bounded = np.isfinite(box).any(axis=0)
    free = ", ".join(name for name, its in zip(names, bounded, strict=True) if not its)
    pairs = zip(names, box.T, bounded, strict=True)
    return [_interval(name, *pair) for name, pair, its in pairs if its] + (
        [f"{free} free"] if free else []
    )


def _interval(name: str, low: float, high: float) -> str:
    if low == high:
        return f"{name} = {number(low)}"
    left = "" if low == -float("inf") else f"{number(low)} <= "
    right = "" if high == float("inf") else f" <= {number(high)}"
    return f"{left}{name}{right}"


def _boundary(problem: "Problem") -> Iterator[Line]:
    for control, laws in problem.boundary.items():
        if isinstance(laws, Mapping):
            yield from (
                ("given law", f"{control} = {formula(law)} on {name}") for name, law in laws.items()
            )
        else:
            yield "given law", f"{control} = {formula(laws)} on the boundary"


def _reference(problem: "Problem") -> Iterator[Line]:
    reference = problem.reference
    if reference is None:
        return
    yield "reference", f"objective {reference.objective:.16g}"
    if reference.word:
        yield "reference", f"word {reference.word}"
    if reference.switches:
        yield "reference", "switching times " + "  ".join(f"{t:.13g}" for t in reference.switches)
    if reference.source:
        yield "reference", reference.source

"""Numbers in a problem: intervals for bounds, ends and times, values for guesses, and what is wrong
with them.
"""

import math
from collections.abc import Mapping
from typing import Any

import casadi
import numpy as np

from socp.errors import ProblemError
from socp.model import advice
from socp.model.symbols import (
    Expr,
    expression,
    final_time,
    free,
    initial_time,
    is_logical,
    is_number,
    role,
    time,
)
from socp.process import plainly, shown

Interval = tuple[float, float]

_LARGEST = 1e100  # numbers beyond it overflow in products of three
_RESOLVED = 1e-12  # share of the times below which a horizon drowns in their rounding
_SMALLEST = 1e-80  # the same for a horizon from 0: its powers underflow


def interval(value: Any) -> Interval:
    """Return a number as the interval (value, value), a pair as it is; None in a pair means
    unbounded.

    Raises TypeError or ValueError for what is neither.
    """
    if isinstance(value, (tuple, list, np.ndarray)):
        low, high = value
        return (
            -math.inf if low is None else _number(low),
            math.inf if high is None else _number(high),
        )
    return (_number(value), _number(value))


def rows(symbols: Expr, given: Mapping[Expr, Any]) -> np.ndarray:
    """Return the intervals of symbols (n, 1) as an array (2, n), lower row, upper row; free where
    not given.
    """
    parts = casadi.vertsplit(symbols) if symbols.numel() else []
    return (
        np.array([interval(given.get(part, free)) for part in parts], dtype=float).reshape(-1, 2).T
    )


def check(problem: Mapping[str, Any]) -> None:
    """Raise ProblemError, naming the offender, for a number that is out of place among a problem's
    arguments.
    """
    bounds, initial, final = (problem[name] for name in ("bounds", "initial_time", "final_time"))
    for symbol, value in bounds.items():
        _bounds(symbol, value)
    for table in ("start", "end"):
        for symbol, value in problem[table].items():
            _end(table, symbol, value, bounds.get(symbol))
    first, last = _pair("initial_time", initial), _pair("final_time", final)
    if last[1] <= first[0]:
        raise ProblemError(f"final_time: {final} is not after initial_time {initial}")
    times = abs(first[0]), abs(last[1])
    if max(times) < math.inf and last[1] - first[0] <= _RESOLVED * max(*times, _SMALLEST):
        raise ProblemError(f"final_time: {final} cannot be told from initial_time {initial}")
    for symbol, value in problem["guess"].items():
        _guess(symbol, value)


def _number(value: Any) -> float:
    if not is_number(value):
        raise TypeError(value)
    return float(value)


def _bounds(symbol: Expr, value: Any) -> None:
    place = f"bounds of '{symbol}'"
    low, high = _pair(place, value, symbol, single=False)
    if role(symbol) == "control" and not (math.isfinite(low) and math.isfinite(high)):
        raise ProblemError(
            f"{place}: ({low}, {high}); a control needs finite bounds; choose them wider than it "
            "will go, and see whether the solution reaches them"
        )
    if role(symbol) != "parameter" and low == high:
        raise ProblemError(
            f"{place}: lower = upper = {low}; write the constant in its place instead"
        )


def _end(table: str, symbol: Expr, value: Any, bounds: Any) -> None:
    low, high = _pair(f"{table} of '{symbol}'", value, symbol)
    lower, upper = (-math.inf, math.inf) if bounds is None else interval(bounds)
    if high < lower or low > upper:
        raise ProblemError(
            f"{table} of '{symbol}': {plainly(value)} lies outside its bounds ({lower}, {upper})"
        )


def _pair(place: str, value: Any, symbol: Expr = None, *, single: bool = True) -> Interval:
    try:
        # two values of an array are hardly meant as an interval of ends or times
        low, high = (
            interval(shown(value) if isinstance(value, np.ndarray) else value)
            if single
            else interval([*value])
        )
    except Exception:  # noqa: BLE001 - what is iterated or compared may be of a stranger's class
        wanted = "a number or a pair (lower, upper)" if single else "a pair (lower, upper)"
        raise ProblemError(
            f"{place}: {shown(value)} where {wanted} is needed{advice.numbers(symbol, value)}"
        ) from None
    if math.isnan(low) or math.isnan(high) or low == math.inf or high == -math.inf:
        raise ProblemError(f"{place}: {shown(value)} where finite numbers are needed")
    if any(_LARGEST < abs(each) < math.inf for each in (low, high)):
        raise ProblemError(
            f"{place}: {shown(value)}, larger than {_LARGEST:g}: products of it overflow; "
            "choose other units, or None in a pair for no bound"
        )
    if low > high:
        raise ProblemError(f"{place}: lower {low} > upper {high}")
    return low, high


def _guess(symbol: Expr, value: Any) -> None:
    place = f"guess of '{symbol}'"
    constant = role(symbol) == "parameter" or symbol in {initial_time, final_time}
    pair = isinstance(value, (tuple, list, np.ndarray))
    if pair and (constant or np.shape(value)[:1] != (2,)):
        wanted = (
            "a number" if constant else "a number, a pair (start, end) or an expression of time"
        )
        raise ProblemError(f"{place}: {shown(value)} where {wanted} is needed")
    for part in value if pair else [value]:
        _part(place, part, constant=constant or pair)


def _part(place: str, part: Any, *, constant: bool) -> None:
    if not is_number(part) and not (
        isinstance(part, casadi.SX) and part.is_scalar() and not is_logical(part)
    ):
        raise ProblemError(f"{place}: {shown(part)} where a number is needed")
    value = expression(part)
    if any(not (s == time).is_one() for s in casadi.symvar(value)):
        raise ProblemError(f"{place}: {part} may only depend on time")
    if value.is_constant() and not math.isfinite(float(value)):
        raise ProblemError(f"{place}: {part} where a finite number is needed")
    if constant and not value.is_constant():
        raise ProblemError(f"{place}: {part} where a number is needed, not a function of time")

"""Changes of a problem by name: constants, ends, bounds, times and other parts."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from socp.errors import ProblemError
from socp.model.data.constants import constant_value
from socp.model.data.portable import TIMES
from socp.model.symbols import Expr, free, is_symbol, symbols_of
from socp.process import close, shown

Symbols = Mapping[str, Expr]  # by name

SIDES = ("lower", "upper")
_INTERVALS = ("bounds", "start", "end")  # tables of intervals, by symbol
_NAMED = ("path", "target")  # tables by name
_TOLD = 8  # names told where none is close


def by_name(given: Any) -> dict[str, Any]:
    """Return changes by name; a symbol stands for its name. ProblemError for what is no table."""
    if not isinstance(given, Mapping):
        raise ProblemError(f"with_({shown(given)}): give a table, such as {{'start.x': 30}}")
    found = {key.name() if is_symbol(key) else key: value for key, value in given.items()}
    for key in found:
        if not isinstance(key, str):
            raise ProblemError(f"with_: {shown(key)} where the name of a number is needed")
    return found


def changed(
    written: Mapping[str, Any], constants: Symbols, symbols: Symbols, changes: Mapping[str, Any]
) -> tuple[dict[str, Any], dict[Expr, float]]:
    """Return the arguments of `Problem` with changes made in them, and new values of constants.

    A change is named by a constant, by an argument, whose tables are added to, or by a place in
    one: `start.x`, `bounds.u.upper`, `final_time.lower`. Raises ProblemError, with the closest
    name, for one that there is not.
    """
    found, values = dict(written), dict[Expr, float]()
    for name, value in changes.items():
        head, dot, rest = name.partition(".")
        try:
            if name in constants:
                values[constants[name]] = constant_value(name, value)
            elif dot:
                found[head] = _placed(head, found[head], rest, value, symbols)
            elif isinstance(found[head], Mapping):
                found[head] = _merged(head, found[head], value, symbols)
            else:
                found[head] = value
        except KeyError:
            near = _near(name, [*numbers(written, constants, symbols), *written])
            raise ProblemError(f"there is no '{name}' to change{near}") from None
    return found, values


def alike(known: Any, other: Any) -> bool:
    """Tell whether a field that is no table stays none, or a table holds what it has held."""
    if not isinstance(known, Mapping) or not isinstance(other, Mapping):
        return not isinstance(known, Mapping) and not isinstance(other, Mapping)
    return len(known) == len(other) and all(key in known for key in other)


def numbers(written: Mapping[str, Any], constants: Symbols, symbols: Symbols) -> list[str]:
    """Return the names of what takes numbers: constants, times, ends and bounds."""
    states = [str(state) for state in written["dynamics"]]
    ends = [f"{end}.{state}" for end in ("start", "end") for state in states]
    return [*constants, *TIMES, *ends, *(f"bounds.{n}.{side}" for n in symbols for side in SIDES)]


def _near(name: str, known: list[str]) -> str:
    """Return the name of which this is the last part, else the closest one, else a few of all; a
    constant that the problem does not hold is told as that.
    """
    if name in {symbol.name() for symbol in symbols_of("constant")}:
        return ": it is a constant that the problem does not hold"
    head, dot, _ = name.partition(".")
    beside = [each for each in known if each.startswith(f"{head}.")] if dot else []
    known = beside or known
    last = [each for each in known if each.endswith(f".{name}")]
    if last:
        return f"; did you mean '{last[0]}'?"
    return close(name, known) or f"; there are {', '.join(known[:_TOLD])}, ..."


def _placed(head: str, value: Any, rest: str, new: Any, symbols: Symbols) -> Any:
    """Return an argument with one entry of its table changed, or one side of an interval."""
    place = f"{head}.{rest}"
    if head in TIMES and rest in SIDES:
        return _sided(place, value, rest, new)
    name, _, side = rest.rpartition(".")
    if head not in _INTERVALS or side not in SIDES:
        name, side = rest, ""
    if not isinstance(value, Mapping):
        raise KeyError(rest)
    key = _key(head, value, name, symbols)
    return {**value, key: _sided(place, value.get(key, free), side, new) if side else new}


def _sided(place: str, interval: Any, side: str, value: Any) -> tuple[Any, Any]:
    """Return an interval with one side changed, to none where that is `free`; of a number both are
    that number.
    """
    if isinstance(value, (tuple, list)):
        if tuple(value) != free:
            raise ProblemError(f"{place}: {shown(value)} where a number, or free, is needed")
        value = None
    if isinstance(interval, np.ndarray) and interval.shape == (2,):
        interval = tuple(interval.tolist())
    low, high = interval if isinstance(interval, (tuple, list)) else (interval, interval)
    return (value, high) if side == "lower" else (low, value)


def _merged(head: str, table: Mapping[Any, Any], given: Any, symbols: Symbols) -> dict[Any, Any]:
    """Return a table with entries added, or changed, by symbol or by name."""
    if not isinstance(given, Mapping):
        raise ProblemError(f"{head}: {shown(given)} where a table {{...: ...}} is needed")
    found = dict(table)
    for key, value in given.items():
        try:
            found[_key(head, table, key, symbols) if isinstance(key, str) else key] = value
        except KeyError:
            raise ProblemError(f"{head}: there is no '{key}'{_near(key, [*symbols])}") from None
    return found


def _key(head: str, table: Mapping[Any, Any], name: str, symbols: Symbols) -> Any:
    """Return the key of a table for a name, that of one of its entries or of a new one."""
    if head in _NAMED:
        return name
    keys = {str(key): key for key in table}
    return keys[name] if name in keys else symbols[name]

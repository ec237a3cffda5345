"""Named constants: numbers of a problem that can be changed without rewriting it.

A problem is written with their symbols and holds their values in place of these, so that whatever
reads a problem meets numbers alone. Its formula keeps what was written.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, final

import casadi
import numpy as np

from socp.errors import ProblemError
from socp.model.parts import Scene, check_text
from socp.model.symbols import Expr, column, declared, is_logical, is_number, role, symbols_of
from socp.process import shown

Path = tuple[str, ...]  # a place in a problem, such as ("bounds", "u", "1")


@final
@dataclass(frozen=True)
class Constant:
    """A named constant: its value, its unit and a sentence for people, both empty where not
    given.
    """

    value: float
    unit: str = ""
    text: str = ""


_DECLARED: dict[Expr, Constant] = {}


def constants(**given: Any) -> Any:
    """Declare named constants, each with its value, or with value, unit and a sentence; one gives
    one symbol, several a tuple.

    `current, drag = constants(current=(0.8, "m/s", "strength of the current"), drag=1)`. Such a
    symbol stands wherever a number may, in bounds, ends, times, guesses and the scene too, alone or
    in an expression; `Problem.with_` changes its value, in the same unit. Raises
    ProblemError for what is no name, for the names of time, and for a value that is no finite
    number.
    """
    names = ", ".join(given)
    if not given:
        raise ProblemError("constants(): name at least one constant: constants(drag=0.3)")
    records = {name: _constant(name, value) for name, value in given.items()}
    symbols = declared(tuple(records), "constant", names)
    _DECLARED.update(zip(symbols, records.values(), strict=True))
    return symbols if len(symbols) > 1 else symbols[0]


def _constant(name: str, given: Any) -> Constant:
    parts = given if isinstance(given, (tuple, list)) else (given,)
    if not 1 <= len(parts) <= 3:
        raise ProblemError(
            f"constants({name}={shown(given)}): give a number, or (value, unit, sentence)"
        )
    for what, text in zip(("unit", "sentence"), parts[1:], strict=False):
        check_text(f"constants({name}=...): its {what}", text)
    return Constant(constant_value(name, parts[0]), *parts[1:])


def constant_value(name: str, value: Any) -> float:
    """Return the value of a constant; ProblemError for what is no finite number."""
    if not is_number(value) or not math.isfinite(value):
        raise ProblemError(f"constant '{name}': {shown(value)} where a finite number is needed")
    return float(value)


@final
@dataclass(frozen=True, eq=False)
class Formula:
    """What of a problem was written with constants: their values by symbol, the expressions by
    place, and the fields that hold the values in their place.
    """

    values: Mapping[Expr, float]
    leaves: Mapping[Path, Expr]
    fields: Mapping[str, Any]

    @property
    def named(self) -> dict[str, Constant]:
        """The constants by name, each with the value that it has here."""
        return {
            symbol.name(): replace(_DECLARED[symbol], value=value)
            for symbol, value in self.values.items()
        }

    def written(self, arguments: Mapping[str, Any]) -> dict[str, Any]:
        """Return the arguments of `Problem` as they were written, in symbols of constants."""
        return planted(arguments, self.leaves)


def formula_of(arguments: Mapping[str, Any], known: Formula | None) -> Formula | None:
    """Return what holds constants among the arguments of `Problem`, and the fields with values in
    place; None where nothing does.

    A field that is one of `known` was written as that tells; constants have the values of `known`,
    and those that they were declared with where it tells none.
    """
    leaves: dict[Path, Expr] = {}
    for name, value in arguments.items():
        if known is not None and value is known.fields.get(name):
            leaves |= {path: leaf for path, leaf in known.leaves.items() if path[0] == name}
        else:
            leaves |= {(name, *inner): found for inner, found in _leaves(value)}
    if not leaves:
        return None
    used = {symbol for leaf in leaves.values() for symbol in casadi.symvar(leaf)}
    values = {s: _DECLARED[s].value for s in symbols_of("constant") if s in used}
    if known is not None:
        values |= {symbol: value for symbol, value in known.values.items() if symbol in values}
    numbers = {path: valued(leaf, values) for path, leaf in leaves.items()}
    names = dict.fromkeys(path[0] for path in leaves)
    return Formula(values, leaves, planted({name: arguments[name] for name in names}, numbers))


def numbers_in(value: Any) -> Any:
    """Return a number, an interval or a table of them with floats for expressions that casadi has
    folded to a number, as where constants cancel; the same thing where there are none.
    """
    if isinstance(value, casadi.SX) and value.is_scalar() and value.is_constant():
        return float(value)
    if not isinstance(value, (Mapping, tuple, list)):
        return value
    parts = _parts(value)
    found = {key: numbers_in(part) for key, part in parts.items()}
    if all(found[key] is part for key, part in parts.items()):
        return value
    return found if isinstance(value, Mapping) else tuple(found.values())


def planted(arguments: Mapping[str, Any], leaves: Mapping[Path, Any]) -> dict[str, Any]:
    """Return arguments of `Problem` with others in given places; ProblemError names a place that
    there is not.
    """
    found = dict(arguments)
    for path, leaf in leaves.items():
        try:
            found[path[0]] = _planted(found[path[0]], path[1:], leaf)
        except KeyError:
            raise ProblemError(f"formula: the problem has no place '{'.'.join(path)}'") from None
    return found


def _parts(value: Any) -> dict[Any, Any]:
    """Return the parts of a table, a sequence or a scene by key, place or field; none of anything
    else.
    """
    if isinstance(value, Mapping):
        return dict(value)
    if isinstance(value, (tuple, list)) or (isinstance(value, np.ndarray) and value.dtype == "O"):
        return dict(enumerate(value))
    if isinstance(value, Scene):
        return {each.name: getattr(value, each.name) for each in fields(value)}
    return {}


def _leaves(value: Any) -> Iterator[tuple[Path, Expr]]:
    """Yield (place, expression) of all that holds constants; other keys are not even looked at."""
    if isinstance(value, casadi.SX):
        if any(role(symbol) == "constant" for symbol in casadi.symvar(value)):
            yield (), value
        return
    for key, part in _parts(value).items():
        for inner, found in _leaves(part):
            yield (str(key), *inner), found


def _planted(value: Any, path: Path, leaf: Any) -> Any:
    if not path:
        return leaf
    parts = _parts(value)
    key = {str(key): key for key in parts}[path[0]]
    parts[key] = _planted(parts[key], path[1:], leaf)
    if isinstance(value, Scene):
        return Scene(**parts)
    return parts if isinstance(value, Mapping) else tuple(parts.values())


def valued(expression: Expr, values: Mapping[Expr, float]) -> Any:
    """Return an expression with constants' values in place, as a number where it is one."""
    found = casadi.substitute(expression, column(values), casadi.DM(list(values.values())))
    if found.is_scalar() and found.is_constant() and not is_logical(expression):
        return float(found)
    return found


def check_constants(formula: Formula | None, taken: Mapping[str, str]) -> None:
    """Raise ProblemError for a constant with a name that means something else in the problem, by
    what it is taken for.
    """
    seen: set[str] = set()
    for symbol in () if formula is None else formula.values:
        name = symbol.name()
        if name in taken:
            raise ProblemError(f"constant '{name}': this is the name of {taken[name]}")
        if name in seen:
            raise ProblemError(f"the name '{name}' is used for two constants")
        seen.add(name)

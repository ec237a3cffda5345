"""Where two problems differ, part by part, as their statements tell."""

from collections.abc import Iterator
from typing import Any

from socp.model.data import grammar
from socp.model.data.portable import NUMBERS, Place, by_name, expressions
from socp.model.problem import Problem


def differences(one: Problem, other: Problem) -> tuple[str, ...]:
    """Return where two problems differ, such as `start.x` or `dynamics.v`; empty where their
    fingerprints are equal.
    """
    if one.fingerprint == other.fingerprint:
        return ()
    first, second = dict(_entries(one)), dict(_entries(other))
    places = dict.fromkeys([*first, *second])
    found = tuple(".".join(place) for place in places if first.get(place) != second.get(place))
    return found or ("the order of its constraints",)


def _entries(problem: Problem) -> Iterator[tuple[Place, Any]]:
    """Yield (place, plain value) of all that defines a problem, every expression by itself."""
    symbols, data = by_name(problem.symbols), problem.statement
    yield from (
        ((kind,), data[kind])
        for kind in ("states", "controls", "parameters", "initial_time", "final_time")
    )
    for table in NUMBERS:
        yield from (((table, name), value) for name, value in data[table].items())
    for place, each in expressions(vars(problem)):
        yield place, grammar.written([each], symbols)

"""Points of a sweep: values of the numbers of a problem, on grids, from tables, or drawn at
random.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, final

import numpy as np

from socp.errors import MethodError
from socp.process import short

MOST = 1_000_000  # points of one sweep: a slip of the pen asks for more
_DRAWN = re.compile(r"(normal|uniform)\(([^,()]+),([^,()]+)\)")


@final
@dataclass(frozen=True, eq=False)
class Points:
    """Values (n, d) of the numbers `names`, a point a row."""

    names: tuple[str, ...]
    values: np.ndarray

    def __len__(self) -> int:
        return len(self.values)

    def named(self, k: int) -> dict[str, float]:
        """Return the values of a point by name."""
        return dict(zip(self.names, map(float, self.values[k]), strict=True))


def points(
    numbers: Mapping[str, Sequence[float] | np.ndarray | str],
    table: Mapping[str, Sequence[float]] | None = None,
    sample: int | None = None,
    seed: int = 0,
) -> Points:
    """Return every combination of rows of the table, values of the grid and draws, in that order,
    the last one fastest.

    `numbers`: by name values (n,), a text `lo:hi:n` for n values from lo to hi, or a
    text `normal(mean, deviation)` or `uniform(lo, hi)`, from which `sample` draws are made: the
    same ones with the same seed, whatever else is asked for. Raises MethodError for anything else,
    for names given twice, and for no point at all.
    """
    drawn = {name: each for name, given in numbers.items() if (each := _drawn(given)) is not None}
    parts = [] if table is None else [_tabled(table)]
    parts += [
        Points((name,), _values(name, given)[:, None])
        for name, given in numbers.items()
        if name not in drawn
    ]
    if drawn:
        parts.append(_sampled(drawn, sample, seed))
    elif sample is not None:
        raise MethodError(
            f"sample={sample}: no number is drawn; give one a distribution: normal(1,0.1)"
        )
    if not parts:
        raise MethodError("a sweep needs a number with several values, such as 0.5:1:20")
    found = reduce(_crossed, parts)
    twice = {name for name in found.names if found.names.count(name) > 1}
    if twice:
        raise MethodError(f"{short(min(twice))} is given twice")
    if not len(found) or not np.isfinite(found.values).all():
        raise MethodError("a sweep needs at least one point, and finite numbers in all of them")
    return found


def _drawn(given: Any) -> tuple[str, float, float] | None:
    """Return a distribution and its two numbers, None where a text is none."""
    match = _DRAWN.fullmatch(given.replace(" ", "")) if isinstance(given, str) else None
    if match is None:
        return None
    kind, one, other = match.groups()
    try:
        a, b = float(one), float(other)
    except ValueError:
        a, b = math.nan, math.nan
    if not math.isfinite(a + b) or (b < 0 if kind == "normal" else b < a):
        raise MethodError(f"{short(given)}: give normal(mean,deviation) or uniform(lowest,highest)")
    return kind, a, b


def _values(name: str, given: Any) -> np.ndarray:
    """Return the values (n,) that a number takes."""
    if isinstance(given, str):
        return _range(name, given)
    try:
        values = np.atleast_1d(np.asarray(given, dtype=float))
    except (TypeError, ValueError):
        values = np.empty((0, 0))
    if values.ndim != 1:
        raise MethodError(f"{short(name)}: give its values as numbers in one row")
    return values


def _range(name: str, given: str) -> np.ndarray:
    """Return the values (n,) of a text `lo:hi:n`."""
    try:
        first, last, number = given.split(":")
        low, high, count = float(first), float(last), int(number)
    except ValueError:
        low, high, count = 0.0, 0.0, 0
    if not 1 <= count <= MOST:
        raise MethodError(
            f"{short(name)}={short(given)}: give lo:hi:n, or a distribution, "
            "normal(mean,deviation) or uniform(lowest,highest)"
        )
    return np.linspace(low, high, count)


def _tabled(table: Mapping[str, Sequence[float]]) -> Points:
    try:
        columns = [np.asarray(column, dtype=float) for column in table.values()]
        return Points(tuple(map(str, table)), np.stack(columns, axis=1))
    except (TypeError, ValueError) as error:
        raise MethodError(f"table: columns of numbers of one length are needed: {error}") from None


def _sampled(
    drawn: Mapping[str, tuple[str, float, float]], sample: int | None, seed: int
) -> Points:
    if sample is None or not 1 <= sample <= MOST:
        raise MethodError(f"{', '.join(drawn)}: say how many points are drawn: sample=100")
    columns = []
    for name, (kind, a, b) in drawn.items():
        # a stream a name: another number beside it changes none of its draws
        generator = np.random.default_rng([seed, *name.encode()])
        columns.append(getattr(generator, kind)(a, b, sample))
    return Points(tuple(drawn), np.stack(columns, axis=1))


def _crossed(one: Points, other: Points) -> Points:
    """Return every row of one beside every row of the other, the other's fastest."""
    if len(one) * len(other) > MOST:
        raise MethodError(f"more than {MOST} points: ask for fewer in one sweep")
    left = np.repeat(one.values, len(other), axis=0)
    right = np.tile(other.values, (len(one), 1))
    return Points(one.names + other.names, np.hstack([left, right]))

"""Tables of a sweep over their numbers: as a grid where they are on one, as a Dataset of xarray."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from socp import errors
from socp.errors import SolveError

if TYPE_CHECKING:
    from collections.abc import Iterable

Rows = Sequence[Mapping[str, Any]]
_COLUMNS = ("objective", "word", "switches", "rung", "message")


def checked(rows: Rows, facts: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the numbers of a sweep's table; SolveError for rows that are none."""
    names = tuple(facts.get("names", ()))
    if not rows or not names or not all(row.keys() >= {*names, *_COLUMNS} for row in rows):
        raise SolveError("the table holds no sweep")
    return names


def axes_of(rows: Rows, names: "Iterable[str]") -> dict[str, np.ndarray]:
    """Return the different values (n,) of every number that has several, in increasing order."""
    found = {name: np.unique([row[name] for row in rows]) for name in names}
    return {name: values for name, values in found.items() if values.size > 1}


def gridded(rows: Rows, axes: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Return the number of the row at every place of a grid, -1 where there is none; None where the
    points are on no grid: most of its places would be empty, or two rows are at one.
    """
    shape = tuple(values.size for values in axes.values())
    found = np.full(shape, -1)
    if found.size > 2 * len(rows):
        return None
    for k, row in enumerate(rows):
        place = tuple(int(np.searchsorted(v, row[name])) for name, v in axes.items())
        if found[place] >= 0:
            return None
        found[place] = k
    return found


def sweep_to_xarray(rows: Rows, facts: Mapping[str, Any]) -> Any:
    """Return a sweep as an xarray.Dataset over its numbers, those with several values, where they
    are on a grid, and over `point` where they are not.

    Variables: objective, final_time, word, rung, certified, start, seconds, message, and
    `switches`, over the dimension `switch` as well, nan beyond the last one of a row. Places of the
    grid without a row hold nan, empty texts and no certificate.

    Raises MethodError where xarray is not installed, SolveError for rows that are no sweep.
    """
    xarray = errors.load("xarray", "export", "an xarray Dataset")
    names = checked(rows, facts)
    axes = axes_of(rows, names)
    index = gridded(rows, axes)
    if index is None:
        dimensions: tuple[str, ...] = ("point",)
        index, coordinates = np.arange(len(rows)), dict[str, Any]()
        coordinates |= {name: ("point", [row[name] for row in rows]) for name in names}
    else:
        dimensions, coordinates = tuple(axes), dict(axes)
        coordinates |= {name: rows[0][name] for name in names if name not in axes}
    values: dict[str, Any] = {}
    for name in ("objective", "final_time", "seconds", "start"):
        if name not in names:
            values[name] = (dimensions, placed(index, [row[name] for row in rows], np.nan))
    for name in ("word", "rung", "message"):
        values[name] = (dimensions, placed(index, [row[name] for row in rows], ""))
    good = [not row["message"] for row in rows]
    values["certified"] = (dimensions, placed(index, good, fill=False))
    values["switches"] = ((*dimensions, "switch"), switching(index, rows))
    kept = {k: v for k, v in facts.items() if isinstance(v, (str, int, float))}
    return xarray.Dataset(values, coordinates, kept)


def placed(index: np.ndarray, column: Sequence[Any], fill: Any) -> np.ndarray:
    """Return a column's values at the places of an index, `fill` where that is -1."""
    found: np.ndarray = np.array([*column, fill])[index]
    return found


def switching(index: np.ndarray, rows: Rows) -> np.ndarray:
    """Return switching times (..., most) at the places of an index, nan beyond a row's last one."""
    most = max(len(row["switches"]) for row in rows)
    table = np.full((len(rows) + 1, most), np.nan)
    for k, row in enumerate(rows):
        table[k, : len(row["switches"])] = row["switches"]
    found: np.ndarray = table[index]
    return found

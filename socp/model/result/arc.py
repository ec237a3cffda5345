"""Arcs: values at nodes in time, and what they are in between."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, final

import numpy as np

from socp.model.polynomials import lagrange, legendre_coefficients, piecewise
from socp.model.word import Mode, Modes

# Intervals that are evaluated one after the other: all at once takes as long as some of these
_ONE_BY_ONE = 4

Which = Literal["x", "u", "costate"]


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Arc:
    """One arc: nodes in time with the values there.

    t (n,) increasing; x (nx, n); u (nu, n); costate (nx, n), nan where unknown; modes: one a
    control, which may be given as a word spells them; multipliers: state constraint -> density
    (n,), nan at nodes of no weight. `mesh` (k + 1,) holds the indices of the nodes where the arc's
    k intervals begin and end; on each the state is the polynomial through all of its nodes, the
    control the one through those of its nodes that are collocated: all but the ends that `side`
    leaves out.
    """

    t: np.ndarray
    x: np.ndarray
    u: np.ndarray
    costate: np.ndarray
    mesh: np.ndarray
    side: Literal["left", "right", "both"]
    modes: Modes
    multipliers: Mapping[str, np.ndarray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        given: Sequence[Mode | str] = self.modes
        modes = tuple(Mode.parse(each) if isinstance(each, str) else each for each in given)
        object.__setattr__(self, "modes", modes)

    @property
    def lawful(self) -> bool:
        """Whether all controls follow laws, none was collocated."""
        return all(mode.kind != "free" for mode in self.modes)

    def nodes(self, interval: int, which: Which = "x") -> slice:
        """Return the nodes that carry a quantity on one interval."""
        first, last = int(self.mesh[interval]), int(self.mesh[interval + 1])
        if which != "u":
            return slice(first, last + 1)
        return slice(first + (self.side == "right"), last + (self.side != "left"))

    def alike(self, which: Which = "x") -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Yield the intervals (m,) that have as many nodes as one another, and these (m, p)."""
        spans = [self.nodes(k, which) for k in range(len(self.mesh) - 1)]
        first, last = np.array([(each.start, each.stop) for each in spans]).T
        for size in np.unique(last - first).tolist():
            some = np.flatnonzero(last - first == size)
            yield some, first[some, None] + np.arange(size)

    def means(self, row: np.ndarray) -> np.ndarray:
        """Return the mean (k,) over every interval of the polynomial through values, a row (n,) of
        them, at the nodes of the controls.
        """
        found, ends = np.empty(len(self.mesh) - 1), self.t[self.mesh]
        for some, nodes in self.alike("u"):
            span = ends[some], ends[some + 1]
            found[some] = legendre_coefficients(self.t[nodes], row[nodes], span)[:, 0]
        return found

    def at(self, t: Any, which: Which = "x", seen: Any = None) -> np.ndarray:
        """Evaluate x, u or costate at times t (k,) inside the arc; returns (rows, k).

        Where intervals meet the later one counts, or that of the times `seen` (k,) where they are
        given.
        """
        values: np.ndarray = getattr(self, which)
        t = np.atleast_1d(np.asarray(t, dtype=float))
        place = t if seen is None else np.atleast_1d(np.asarray(seen, dtype=float))
        interval = np.clip(
            np.searchsorted(self.t[self.mesh], place, side="right") - 1, 0, len(self.mesh) - 2
        )
        out = np.empty((values.shape[0], t.size))
        used = np.flatnonzero(np.bincount(interval))
        if used.size <= _ONE_BY_ONE:
            for k in used:
                here, own = interval == k, self.nodes(int(k), which)
                out[:, here] = lagrange(self.t[own], values[:, own], t[here])
            return out
        return on_intervals((self,), which, t, interval)


def on_intervals(
    arcs: Sequence[Arc], which: Which, t: np.ndarray, interval: np.ndarray
) -> np.ndarray:
    """Evaluate x, u or costate at every time of t (k,) on the interval whose number, counted
    through all of the arcs, stands in `interval` (k,); returns (rows, k).
    """
    begins = np.cumsum([0, *(arc.t.size for arc in arcs)])
    first, last = (
        np.concatenate([arc.mesh[part] + begin for arc, begin in zip(arcs, begins, strict=False)])
        for part in (slice(None, -1), slice(1, None))
    )
    if which == "u":
        sides = np.repeat([arc.side for arc in arcs], [arc.mesh.size - 1 for arc in arcs])
        first, last = first + (sides == "right"), last - (sides == "left")
    count = last - first + 1
    times = np.concatenate([arc.t for arc in arcs])
    values = np.hstack([getattr(arc, which) for arc in arcs])
    if (count == count[0]).all():
        nodes = first[:, None] + np.arange(count[0])
        return piecewise(times[nodes], values[:, nodes], t, interval)
    out, wanted = np.empty((values.shape[0], t.size)), count[interval]
    for size in np.flatnonzero(np.bincount(wanted)).tolist():
        here, alike = np.flatnonzero(wanted == size), np.flatnonzero(count == size)
        nodes, place = first[alike, None] + np.arange(size), np.empty(count.size, dtype=int)
        place[alike] = np.arange(alike.size)
        on = place[interval[here]]
        out[:, here] = piecewise(times[nodes], values[:, nodes], t[here], on)
    return out


def in_arcs(arcs: Sequence[Arc], which: Which, times: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Evaluate x, u or costate at the times (k,) of every arc, where intervals meet on the later
    one; returns (rows, k) for each.
    """
    before = np.cumsum([0, *(arc.mesh.size - 1 for arc in arcs)]).tolist()
    on = [
        begin + arc.t[arc.mesh[1:-1]].searchsorted(t, side="right")
        for begin, arc, t in zip(before, arcs, times, strict=False)
    ]
    found = on_intervals(arcs, which, np.concatenate(times), np.concatenate(on))
    return np.split(found, np.cumsum([t.size for t in times])[:-1], axis=1)


def join(arcs: Sequence[Arc]) -> Arc:
    """Return neighbouring arcs of the same modes as one, with the intervals of all; a shared node
    is the later arc's.

    So their controls and costates are those of the later arc there, as at any node between two
    intervals.
    """
    first = np.cumsum([0, *(arc.t.size - 1 for arc in arcs[:-1])])

    def row(values: Sequence[np.ndarray]) -> np.ndarray:
        """Return the arcs' values in a row, those of a joint once."""
        return np.concatenate([*(each[..., :-1] for each in values[:-1]), values[-1]], axis=-1)

    mesh = np.unique(
        np.concatenate([arc.mesh + start for arc, start in zip(arcs, first, strict=True)])
    )
    names = (
        arcs[0].multipliers
        if all(arc.multipliers.keys() == arcs[0].multipliers.keys() for arc in arcs)
        else ()
    )
    return Arc(
        t=row([arc.t for arc in arcs]),
        x=row([arc.x for arc in arcs]),
        u=row([arc.u for arc in arcs]),
        mesh=mesh,
        costate=row([arc.costate for arc in arcs]),
        side=arcs[0].side,
        modes=arcs[0].modes,
        multipliers={name: row([arc.multipliers[name] for arc in arcs]) for name in names},
    )

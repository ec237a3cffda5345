"""Which point of a sweep goes on from which: chains of neighbours, fixed before any is solved.

The points are the nodes of a shortest tree (Prim, Bell Syst. Tech. J. 36, 1957), so that each goes
on from a neighbour. The tree is cut into chains, pieces of work for one worker. What a point goes
on from depends on the points alone: neither on how many workers there are nor on their speed.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

import numpy as np

_WHOLE = 8  # points that one worker walks at least: a piece of work is worth its hand-over
# Points that one worker walks at most, and pieces that a long line is cut into, so that there is
# work for several; the first points of pieces are further apart than those inside them
_LONGEST, _PIECES = 32, 8


@final
@dataclass(frozen=True)
class Chain:
    """Points by number, each going on from the one before it, the first from `start`, a point of
    another chain, or -1 where nothing is before it.
    """

    number: int
    points: tuple[int, ...]
    start: int


def planned(values: np.ndarray, near: np.ndarray) -> tuple[Chain, ...]:
    """Return the chains through points (n, d), the first one from the point nearest to `near` (d,).
    A chain's start is in a chain before it.

    Distances are in spans of the numbers.
    """
    spans = np.ptp(values, axis=0)
    scale = np.where(spans > 0.0, spans, 1.0)
    scaled, here = values / scale, np.nan_to_num(near) / scale
    root = int(np.argmin(((scaled - here) ** 2).sum(axis=1)))
    order, parents = tree(scaled, root)
    chains = list[Chain]()
    for path in _paths(order, parents):
        for points, start in _cut(path, parents[path[0]]):
            chains.append(Chain(len(chains), tuple(points), start))
    return tuple(chains)


def _cut(path: list[int], start: int) -> Iterator[tuple[list[int], int]]:
    """Yield a path in pieces, each with what it goes on from: a long one's first points of pieces
    before the rest of these, which may be walked side by side then.
    """
    piece = min(max(-(-len(path) // _PIECES), _WHOLE), _LONGEST)
    if len(path) <= piece:
        yield path, start
        return
    yield from _cut(path[::piece], start)
    for k in range(0, len(path) - 1, piece):
        yield path[k + 1 : k + piece], path[k]


def tree(scaled: np.ndarray, root: int) -> tuple[list[int], list[int]]:
    """Return points in the order in which a shortest tree grows from a root, and the parent of
    each, -1 of the root.
    """
    count = len(scaled)
    parents, order = np.full(count, -1), [root]
    far = ((scaled - scaled[root]) ** 2).sum(axis=1)
    parents[:] = root
    parents[root] = -1
    out = np.ones(count, dtype=bool)
    out[root] = False
    for _ in range(count - 1):
        new = int(np.argmin(np.where(out, far, np.inf)))
        order.append(new)
        out[new] = False
        here = ((scaled - scaled[new]) ** 2).sum(axis=1)
        nearer = out & (here < far)
        far[nearer], parents[nearer] = here[nearer], new
    return order, parents.tolist()


def _paths(order: list[int], parents: list[int]) -> list[list[int]]:
    """Return a tree as paths, each going on into the largest branch; the parent of a path's first
    point is on a path before it.
    """
    sizes, children = [1] * len(order), [list[int]() for _ in order]
    for k in reversed(order):
        if parents[k] >= 0:
            sizes[parents[k]] += sizes[k]
    for k in order:
        if parents[k] >= 0:
            children[parents[k]].append(k)
    paths, heads = [], [order[0]]
    for head in heads:
        path = [head]
        while children[path[-1]]:
            heavy = max(children[path[-1]], key=lambda k: (sizes[k], -k))
            heads += [k for k in children[path[-1]] if k != heavy]
            path.append(heavy)
        paths.append(path)
    return paths

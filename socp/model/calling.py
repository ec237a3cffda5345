"""Values of casadi functions at many points and over many calls, on memory that is kept: on its way
to casadi and back a call takes several evaluations' worth.
"""

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from typing import final

import casadi
import numpy as np

from socp.model.keeping import once


def evaluate(function: casadi.Function, *given: np.ndarray) -> list[np.ndarray]:
    """Evaluate a function of columns (rows, n), times and parameters at n points.

    The last two of what is given are times (n,) and parameters, (np,) where they are the same
    everywhere. A result of k columns has k n of them, a point's next to one another.
    """
    *columns, t, p = given
    return numbers(function, *columns, t[None, :], p if p.ndim == 2 else p[:, None])


def numbers(function: casadi.Function, *given: np.ndarray | float) -> list[np.ndarray]:
    """Return the results (r, c n) of a casadi function at n points, one beside the other.

    What is given is (rows, k n) where the function asks for (rows, k), the same everywhere where it
    is (rows, k), as (rows,) and numbers are. Both sides work on the same memory: what casadi's own
    conversions of arrays cost is several evaluations' worth. ValueError refuses other sizes.
    """
    asked, told = _ports(function)
    columns, counts = [], {1}
    for each, (size, _, entries) in zip(given, asked, strict=True):
        if size:
            value = np.asarray(each, dtype=float)
            whole = value.ndim == 2 and len(value) == size
            if not whole and value.size % size:
                raise _sized(function, given)
            value = value.T if whole else value.ravel("F").reshape(-1, size)
            columns.append(value if entries is None else value[:, entries])
            counts.add(len(value))
    count = 0 if 0 in counts else max(counts)
    if not counts <= {0, 1, count}:
        raise _sized(function, given)
    if not count:  # casadi maps over one column at least
        return [np.empty((rows, 0)) for rows, *_ in told]
    desk = _taken(function, count)
    for own, column in zip(desk.asked, columns, strict=True):
        own[:] = column
    desk.run()
    found = []
    for (rows, width, _, entries), at in zip(told, desk.found, strict=True):
        if entries is None:
            filled = at.copy()
        else:
            filled = np.zeros((count, rows * width))
            filled[:, entries] = at
        found.append((filled if width == 1 else filled.reshape(count * width, rows)).T)
    _put_back(function, desk)
    return found


def repeated(
    function: casadi.Function, first: Sequence[np.ndarray], given: Sequence[np.ndarray], times: int
) -> list[np.ndarray]:
    """Return the results (times, n, entries) of a casadi function called over and over at n points,
    all of them dense, as are its arguments: what it gives takes the place of what it was given
    `first`, (n, entries) each, in as many of its first arguments.

    The other arguments are `given` for every call and point, or such that they can be spread over
    these, (times, n, entries), as the next one is where none comes `first`. A function of all calls
    would take longer to be built.
    """
    count = len(first[0]) if first else given[0].shape[1]
    desk = _taken(function, count)
    begun, others = desk.given[: len(first)], desk.given[len(first) :]
    pairs = []
    for own, each in zip(others, given, strict=True):
        if each.ndim < own.ndim + 1:  # the same for every call
            own[:] = each
        elif own.size:
            spread = each if len(each) == times else np.broadcast_to(each, (times, *own.shape))
            pairs.append((own, spread))
    found = [np.empty((times, *own.shape)) for own in desk.found]
    for own, each in zip(begun, first, strict=True):
        own[:] = each
    for k in range(times):
        for own, each in pairs:
            own[:] = each[k]
        desk.run()
        for whole, own in zip(found, desk.found, strict=True):
            whole[k] = own
        for own, each in zip(begun, desk.found, strict=False):
            own[:] = each
    _put_back(function, desk)
    return found


def _sized(function: casadi.Function, given: tuple[np.ndarray | float, ...]) -> ValueError:
    return ValueError(f"{function}: given {', '.join(str(np.shape(each)) for each in given)}")


def _taken(function: casadi.Function, count: int) -> "_Desk":
    """Return a desk for so many points, on which nobody else works until it is put back."""
    desks: dict[int, _Desk] = vars(function).setdefault(_DESK, {})
    return desks.pop(count, None) or _Desk(function, count)


def _put_back(function: casadi.Function, desk: "_Desk") -> None:
    desks: dict[int, _Desk] = vars(function)[_DESK]
    while len(desks) >= _DESKS:
        with suppress(RuntimeError):  # another thread takes or puts back one
            desks.pop(next(iter(desks), desk.count), None)
    desks[desk.count] = desk


_DESK = "desk"  # where they stand beside what a function has of its own
_FEW = 48  # points: for more of them a map of maps is made faster than a map
_DESKS = 8  # of a function, for as many counts of points: solves in turns keep to a few


@final
class _Desk:
    """The memory on which a function works at so many points: what is given and what is found,
    (count, entries) each; `asked` is what is given where it has a size.
    """

    def __init__(self, function: casadi.Function, count: int) -> None:
        asked, told = _ports(function)
        self.count = count
        size, blocks = _blocks(count)
        block = function.map(size) if size > 1 else function
        self.function = block.map(blocks) if blocks > 1 else block
        self.buffer, self.trigger = self.function.buffer()
        given = [np.zeros((size * blocks, kept)) for _, kept, _ in asked]
        found = [np.zeros((size * blocks, kept)) for *_, kept, _ in told]
        for place, arrays in ((self.buffer.set_arg, given), (self.buffer.set_res, found)):
            for i, each in enumerate(arrays):
                if each.size:
                    place(i, each.reshape(-1).data)
        self.given, self.found = ([each[:count] for each in both] for both in (given, found))
        self.asked = [each for each, (size, *_) in zip(self.given, asked, strict=True) if size]
        self.spare = [(each[count:], each[0]) for each in given if each.size and len(each) > count]

    def run(self) -> None:
        """Find what is asked for: at points to spare what is given of the first, as a function may
        not be defined anywhere else.
        """
        for rest, first in self.spare:
            rest[:] = first
        self.trigger()


@cache
def _blocks(count: int) -> tuple[int, int]:
    """Return the points of a block, and how many blocks hold so many points with the fewest to
    spare.

    For a map casadi goes over the patterns of all its points, which takes longer than most
    functions do there: a map of a map has twice the square root of them.
    """
    if count <= _FEW:
        return count, 1
    root = math.isqrt(count)
    size = min(range(root, 3 * root), key=lambda each: -count % each)
    return size, -(-count // size)


@once
def _ports(
    function: casadi.Function,
) -> tuple[list[tuple[int, int, np.ndarray | None]], list[tuple[int, int, int, np.ndarray | None]]]:
    """Return the size of every argument and the rows and columns of every result, each with how
    many of its entries casadi keeps, and which, None for all of them. To ask casadi costs as much
    as many evaluations.
    """
    asked, told = [], []
    for i in range(function.n_in()):
        size, kept = function.numel_in(i), function.nnz_in(i)
        which = None if kept == size else np.array(function.sparsity_in(i).find(), dtype=int)
        asked.append((size, kept, which))
    for i in range(function.n_out()):
        (rows, width), kept = function.size_out(i), function.nnz_out(i)
        whole = kept == rows * width
        which = None if whole else np.array(function.sparsity_out(i).find(), dtype=int)
        told.append((rows, width, kept, which))
    return asked, told


def fast(function: casadi.Function) -> Callable[..., np.ndarray]:
    """Return a function of numpy arrays for a casadi function of one dense output column, quick to
    call at one point after another.
    """
    desk = _Desk(function, 1)
    places = [(i, each[0]) for i, each in enumerate(desk.given) if each.size]
    trigger, found = desk.trigger, desk.found[0][0]

    def call(*arguments: np.ndarray | float) -> np.ndarray:
        for i, place in places:
            place[:] = arguments[i]
        trigger()
        return np.array(found)

    call.__dict__["keep"] = desk  # the buffer must outlive the call
    return call

"""The controls of an iterate as lines in a plane, where they show on any timeline."""

from collections.abc import Iterator, Sequence

import numpy as np

from socp.model import Problem, Solution
from socp.view.recording.contents import control
from socp.view.recording.items import GREY, PALETTE, Drawing, Item, Plane

_ASPECT, _TALL = 2.5, 0.8  # width to height of all rows of controls; share of a row that is used


def control_lines(problem: Problem, solution: Solution) -> list[np.ndarray]:
    """Return the controls as lines (n, 2), one above the other in rows of height 1, each between
    its bounds, over the share of the horizon that has gone.
    """
    horizon = solution.final_time - solution.initial_time
    curves = []
    for k, (low, high) in enumerate(problem.box.T):
        t, u = control(solution, k)
        curves.append(((t - solution.initial_time) / horizon, (u - low) / (high - low)))
    return in_rows(curves)


def control_frame(problem: Problem, path: str) -> Iterator[Item]:
    """Yield the bounds of the controls, and their names, for lines of `control_lines`."""
    return rows_frame(problem.control_names, path)


def in_rows(curves: Sequence[tuple[np.ndarray, np.ndarray]]) -> list[np.ndarray]:
    """Return curves, shares (n,) of a span and of a range each, as lines (n, 2) in rows of height
    1, the first on top.
    """
    count = len(curves)
    return [
        np.column_stack([_ASPECT * count * across, count - 1.0 - k + _TALL * up])
        for k, (across, up) in enumerate(curves)
    ]


def rows_frame(names: Sequence[str], path: str) -> Iterator[Item]:
    """Yield the ends of the ranges of rows, and their names."""
    count = len(names)
    yield Plane(path=path, scale=(1.0, 1.0))
    for k, name in enumerate(names):
        low = count - 1.0 - k
        for side, up in (("lower", low), ("upper", low + _TALL)):
            ends = np.array([[0.0, up], [_ASPECT * count, up]])
            yield Drawing(
                path=f"{path}/{k}/{side}", kind="line", points=ends, colour=GREY, size=0.5
            )
        place = np.array([[-0.06 * _ASPECT * count, low + 0.5 * _TALL]])
        yield Drawing(
            path=f"{path}/{k}/name", kind="points", points=place, colour=PALETTE[k % len(PALETTE)],
            size=0.5, labels=(name,)
        )  # fmt: skip


def rows_window(count: int) -> np.ndarray:
    """Return the corners (2, 2) of what shows so many rows, y pointing down, with room for their
    names.
    """
    width = _ASPECT * count
    return np.array([[-0.14 * width, 1.02 * width], [-float(count), 0.2]])

"""What is shown of a branch of extremals: objective and switching times over its number, and
trajectories that move with it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np

from socp.model import Solution
from socp.view.recording.contents import control
from socp.view.recording.items import (
    PALETTE,
    Film,
    Group,
    Item,
    Note,
    Page,
    Panel,
    Series,
)
from socp.view.recording.iterates import in_rows, rows_frame, rows_window
from socp.view.recording.page import fitted

ROWS = "/rows"  # where trajectories are
# Timelines count billionths of their unit, and hold some 10^9 of it: where the largest value is
# between these, all fit as they are, with six digits and more
_COUNTED = 1e-3, 1e6


@final
@dataclass(frozen=True, eq=False)
class _Piece:
    """Points of a branch from event to event: numbers, values of its number, solutions."""

    numbers: np.ndarray
    values: np.ndarray
    solutions: Sequence[Solution]


def branch_page(
    name: str, solutions: Sequence[Solution], rows: Sequence[Mapping[str, Any]]
) -> Page:
    """Return the recording of a branch over a number, by `name`: its timeline counts the number, in
    units of a power of 1000 where the values ask for that.

    `solutions` are those of its points, `rows` those of its table, events among them.
    """
    size = max(abs(row["value"]) for row in rows)
    plain = size == 0.0 or _COUNTED[0] <= size <= _COUNTED[1]
    power = 0 if plain else 3 * int(np.floor(np.log10(size) / 3))
    pieces = list(_pieces(solutions, rows, 10.0**-power))
    first = solutions[0]
    found: list[Item] = [
        *(item for k, piece in enumerate(pieces) for item in _curves(piece, k)),
        *rows_frame((*first.state_names, *first.control_names), ROWS),
        *_films(pieces),
        Note(path="/summary", text=_summary(name, rows)),
    ]
    called = name if not power else f"{name} / 1e{power}"
    return Page(items=tuple(found), layout=fitted(_layout(first), found), timeline=called)


def _pieces(
    solutions: Sequence[Solution], rows: Sequence[Mapping[str, Any]], factor: float
) -> Iterator[_Piece]:
    """Yield the points from event to event: along each the word is one, and the number goes one
    way.
    """
    cuts, k = [0], 0
    values = []
    for row in rows:
        if row["event"]:
            cuts.append(k)
        else:
            values.append(factor * row["value"])
            k += 1
    for a, b in zip(cuts, [*cuts[1:], k], strict=True):
        if a < b:
            yield _Piece(np.arange(a, b), np.array(values[a:b]), solutions[a:b])


def _curves(piece: _Piece, k: int) -> Iterator[Series]:
    """Yield objective and switching times of a piece."""
    order = np.argsort(piece.values, kind="stable")
    objective = np.array([each.objective for each in piece.solutions])
    times = np.array([[*each.junctions, each.final_time] for each in piece.solutions])
    rows = [("objective", objective), *((f"times/{j}", row) for j, row in enumerate(times.T))]
    for what, values in rows:
        yield Series(
            path=f"/{what}/{k}",
            timeline="value",
            at=piece.values[order],
            values=values[order],
            name=piece.solutions[0].word,
            colour=PALETTE[k % len(PALETTE)],
            along=piece.numbers[order],
        )


def _films(pieces: Sequence[_Piece]) -> Iterator[Film]:
    """Yield the trajectories of pieces, all to one scale."""
    everyone = [each for piece in pieces for each in piece.solutions]
    curves = [_quantities(each) for each in everyone]
    span = min(e.initial_time for e in everyone), max(e.final_time for e in everyone)
    boxes = [
        (min(float(v.min()) for _, v in same), max(float(v.max()) for _, v in same))
        for same in zip(*curves, strict=True)
    ]
    shares = iter([_shares(each, span, boxes) for each in curves])
    for k, piece in enumerate(pieces):
        frames = tuple(tuple(in_rows(next(shares))) for _ in piece.solutions)
        yield Film(path=f"{ROWS}/piece/{k}", at=piece.values, along=piece.numbers, frames=frames)


def _quantities(solution: Solution) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return times and values of states and controls."""
    t, x = solution.t, solution.rows("x")
    return [
        *((t, row) for row in x),
        *(control(solution, k) for k in range(len(solution.control_names))),
    ]


def _shares(
    curves: Sequence[tuple[np.ndarray, np.ndarray]],
    span: tuple[float, float],
    boxes: Sequence[tuple[float, float]],
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return curves as shares of the time and of what their quantities go through."""
    return [
        ((t - span[0]) / (span[1] - span[0]), (v - low) / ((high - low) or 1.0))
        for (t, v), (low, high) in zip(curves, boxes, strict=True)
    ]


def _layout(first: Solution) -> Group:
    count = len(first.state_names) + len(first.control_names)
    curves = tuple(
        Panel(kind="curves", name=name, contents=(f"{path}/**",), timeline="value")
        for name, path in (
            ("Objective", "/objective"),
            ("Times between arcs, and the last", "/times"),
        )
    )
    moving = Panel(
        kind="plane",
        name="States and controls over time",
        contents=(f"{ROWS}/**",),
        timeline="value",
        box=rows_window(count),
    )
    text = Panel(kind="text", name="Summary", contents=("/summary",), timeline="value")
    parts = (Group(kind="column", parts=curves), moving, text)
    return Group(kind="row", name="Branch", parts=parts, shares=(1.0, 1.2, 0.8))


def _summary(name: str, rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the events, and where the branch begins and ends, as a table."""
    shown = [row for k, row in enumerate(rows) if row["event"] or k in {0, len(rows) - 1}]
    lines = [f"| {name} | objective | |", "|---|---|---|"]
    for row in shown:
        said = (
            f"{row['event']}: {row['where']}" if row["event"] else f"{row['word']}, {row['rung']}"
        )
        lines.append(f"| {row['value']:.12g} | {row['objective']:.10g} | {said} |")
    return "\n".join(lines)

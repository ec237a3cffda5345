"""What can be shown: records of series, lanes, drawings and texts, and of the panels that hold
them.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, final

import numpy as np

Colour = tuple[int, int, int]
Corner = Literal["", "LeftTop", "LeftBottom", "RightTop", "RightBottom"]
Timeline = Literal["t", "iteration", "refinement", "progress", "value"]

# mid-tones, which show on dark and on light ground, and differ from one another by more than
# smoothing does
PALETTE: tuple[Colour, ...] = (
    (70, 140, 215),
    (225, 115, 50),
    (65, 165, 85),
    (195, 80, 160),
    (140, 110, 215),
    (35, 165, 170),
    (180, 140, 40),
    (215, 75, 80),
)
GREY: Colour = (125, 125, 125)
MODES: Mapping[str, Colour] = {
    "+": PALETTE[1],
    "-": PALETTE[0],
    "s": PALETTE[2],
    "b": PALETTE[4],
    "*": GREY,
}


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Series:
    """A quantity (n,) over a timeline, `at` (n,) increasing; a jump stands there as two values at
    one time.

    `points`: draw marks instead of a line; `exact`: never average neighbours on the screen, as
    jumps need. `magnitude`: of the terms that it is a sum of; a change far below that is rounding.
    `along` (n,): where its values are on the timeline `point` as well.
    """

    path: str
    timeline: Timeline
    at: np.ndarray
    values: np.ndarray
    name: str
    colour: Colour
    width: float = 1.5
    points: bool = False
    exact: bool = True
    magnitude: float = 0.0
    along: np.ndarray | None = None


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Lane:
    """States that follow each other in time, `at` (n,) where each begins; the last one is empty and
    ends the lane.
    """

    path: str
    at: np.ndarray
    states: tuple[str, ...]

    @property
    def colours(self) -> dict[str, Colour]:
        """Colour by state."""
        return {state: MODES[state[0]] for state in self.states if state}


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Note:
    """A text in Markdown."""

    path: str
    text: str


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Drawing:
    """Something in the plane, at points (n, 2): a line, points, or arrows with vectors (n, 2).

    `size` is the radius on the screen. Where `at` (n,) is given, point after point shows at its
    time `t` alone.
    """

    path: str
    kind: Literal["line", "points", "arrows"]
    points: np.ndarray
    colour: Colour
    size: float = 1.5
    vectors: np.ndarray | None = None
    labels: tuple[str, ...] = ()
    at: np.ndarray | None = None


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Plane:
    """Everything below `path` is drawn with these scales; y points up."""

    path: str
    scale: tuple[float, float]


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Bars:
    """Values (n,) as bars over `at` (n,), seen whatever the timeline."""

    path: str
    at: np.ndarray
    values: np.ndarray
    colour: Colour


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Film:
    """Lines (k, 2) in the plane, frame after frame: at values `at` (n,) of the timeline `value`,
    and at `along` (n,), increasing, of the timeline `point`; none before the first nor after the
    last.
    """

    path: str
    at: np.ndarray
    along: np.ndarray
    frames: tuple[tuple[np.ndarray, ...], ...]


Item = Series | Lane | Note | Drawing | Plane | Bars | Film


@final
@dataclass(frozen=True, kw_only=True)
class Panel:
    """One view of the layout, with the paths that it shows.

    Of curves, `legend` is the corner that their legend stands in, empty for none, `span` the values
    that are shown, and `times` the stretch of time, where it is not the one that the curves of all
    panels share. Of a plane, `box` (2, 2) holds the corners of what is shown as columns.
    """

    kind: Literal["curves", "lanes", "plane", "text", "bars", "table"]
    name: str
    contents: tuple[str, ...]
    legend: Corner = ""
    span: tuple[float, float] | None = None
    times: tuple[float, float] | None = None
    box: np.ndarray | None = field(default=None, compare=False)
    timeline: Timeline = "t"


@final
@dataclass(frozen=True, kw_only=True)
class Group:
    """Panels together: tabs, a row, a column or a grid, with shares of the room."""

    kind: Literal["tabs", "row", "column", "grid"]
    parts: tuple["Panel | Group", ...]
    name: str = ""
    shares: tuple[float, ...] | None = None
    columns: int | None = None


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Page:
    """A recording that is no solve's: its items, how they are laid out, and what its timeline
    `value`, on which it opens, is called.
    """

    items: tuple[Item, ...]
    layout: Group
    timeline: str

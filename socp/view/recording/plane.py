"""The picture of a solution: path, switches, start, target and current in the plane, and who moves
there.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from socp.model import Problem, Solution
from socp.view.picture import Picture, picture_of
from socp.view.recording.items import GREY, PALETTE, Colour, Drawing, Item, Plane

STRIP = 2.5  # a picture so many times wider than high is laid out across the others
_PATH, _FLOW, _VEHICLE, _SWITCH = PALETTE[0], (90, 130, 150), PALETTE[7], PALETTE[1]


def drawings(
    problem: Problem,
    solution: Solution,
    root: str = "",
    colour: Colour | None = None,
    among: Picture | None = None,
) -> Iterator[Item]:
    """Yield what is drawn of a solution below `/plan`; `colour` tells it from other runs.

    `among` is the picture of the first of several runs, whose scale all of them have. Several runs,
    told apart by `colour`, stand on one `ground`, which is drawn once all of them are known.
    """
    seen = picture_of(problem, solution)
    plan = f"{root}/plan"
    yield Plane(path=plan, scale=scale(among or seen))
    yield Drawing(
        path=f"{plan}/path", kind="line", points=seen.path.T, colour=colour or _PATH, size=1.5
    )
    yield Drawing(
        path=f"{plan}/start", kind="points", points=seen.path.T[:1], colour=GREY, size=5.0
    )
    if seen.marks:
        places = np.array([mark.place for mark in seen.marks])
        yield Drawing(
            path=f"{plan}/switches", kind="points", points=places, colour=_SWITCH, size=3.5
        )
        if colour is None:
            yield from _labels(seen, f"{plan}/labels")
    yield from _moving(seen, plan, colour or _VEHICLE)
    if colour is None:
        yield from ground(seen, plan)


def together(pictures: Sequence[Picture]) -> Picture:
    """Return the first of several pictures with room for the paths of all."""
    return replace(pictures[0], path=np.hstack([each.path for each in pictures]))


def ground(picture: Picture, plan: str) -> Iterator[Item]:
    """Yield what stays: target, current, frame."""
    if picture.target is not None:
        angle = np.linspace(0.0, 2.0 * np.pi, 49)
        disc = np.array(picture.target[:2]) + picture.target[2] * np.column_stack(
            [np.cos(angle), np.sin(angle)]
        )
        yield Drawing(path=f"{plan}/target", kind="line", points=disc, colour=PALETTE[2])
    if picture.flow is not None:
        points, vectors = picture.flow
        fastest = float(np.hypot(*vectors).max())
        length = (
            0.8 * float(np.diff(np.unique(points[0])).min(initial=1.0)) / fastest
            if fastest > 0
            else 1.0
        )
        yield Drawing(
            path=f"{plan}/flow",
            kind="arrows",
            points=points.T,
            vectors=length * vectors.T,
            colour=_FLOW,
            size=1.0,
        )
    yield from _frame(picture, f"{plan}/frame")


def scale(picture: Picture) -> tuple[float, float]:
    """Return the factors on both axes: a scene's own units, a phase plane on a square of side 1."""
    width, height = picture.box[:, 1] - picture.box[:, 0]
    return (1.0, 1.0) if picture.spatial else (1.0 / width, 1.0 / height)


def window(picture: Picture, factors: tuple[float, float] | None = None) -> np.ndarray:
    """Return the corners (2, 2) of what the view shows, in its own coordinates: y points down
    there.
    """
    box = picture.box * np.array(factors or scale(picture))[:, None]
    across, up = (box[:, 1] - box[:, 0]) * (
        (0.03, 0.3) if picture.stretch > STRIP else (0.12, 0.14)
    )  # for the labels
    return np.array(
        [[box[0, 0] - across, box[0, 1] + across], [-box[1, 1] - 0.4 * up, -box[1, 0] + up]]
    )


def _labels(picture: Picture, path: str) -> Iterator[Item]:
    """Yield the labels of the switches, moved apart where they would cover one another, each tied
    to its point.
    """
    sizes = picture.box[:, 1] - picture.box[:, 0]
    wide, high = sizes * ((0.09, 0.14) if picture.stretch > STRIP else (0.24, 0.075))  # of a label
    taken: list[np.ndarray] = []
    for k, mark in enumerate(picture.marks):
        up = mark.place[1] < picture.box[1].mean()
        anchor = mark.place + np.array([0.0, high if up else -0.4 * high])
        while any(abs(anchor[0] - x) < wide and abs(anchor[1] - y) < 0.99 * high for x, y in taken):
            anchor = anchor + np.array([0.0, high if up else -high])
        taken.append(anchor)
        yield Drawing(
            path=f"{path}/{k}/tie",
            kind="line",
            points=np.array([mark.place, anchor]),
            colour=GREY,
            size=0.5,
        )
        yield Drawing(
            path=f"{path}/{k}",
            kind="points",
            points=anchor[None, :],
            colour=_SWITCH,
            size=0.5,
            labels=(mark.label,),
        )


def _moving(picture: Picture, plan: str, colour: Colour) -> Iterator[Item]:
    """Yield who moves along the path: a point, and an arrow where there is a heading."""
    yield Drawing(
        path=f"{plan}/now",
        kind="points",
        points=picture.path.T,
        colour=colour,
        size=4.5,
        at=picture.t,
    )
    if picture.heading is not None:
        length = 0.06 * float((picture.box[:, 1] - picture.box[:, 0]).max())
        ahead = length * np.column_stack([np.cos(picture.heading), np.sin(picture.heading)])
        yield Drawing(
            path=f"{plan}/heading",
            kind="arrows",
            points=picture.path.T,
            vectors=ahead,
            colour=colour,
            size=2.0,
            at=picture.t,
        )


def _frame(picture: Picture, path: str) -> Iterator[Item]:
    """Yield a frame with the axes' names and ends: the plane has no numbers of its own."""
    (left, right), (low, high) = picture.box
    corners = np.array([[left, low], [right, low], [right, high], [left, high], [left, low]])
    yield Drawing(path=f"{path}/box", kind="line", points=corners, colour=GREY, size=0.5)
    across, up = picture.labels
    below, beside = low - 0.02 * (high - low), left - 0.0 * (right - left)
    places = [
        [left, below],
        [(left + right) / 2, below],
        [right, below],
        [beside, (low + high) / 2],
        [beside, high],
    ]
    texts = (f"{left:.3g}, {low:.3g}", across, f"{right:.3g}", up, f"{high:.3g}")
    yield Drawing(
        path=f"{path}/axes",
        kind="points",
        points=np.array(places),
        colour=GREY,
        size=1.0,
        labels=texts,
    )

"""The curves of a figure: what there is to draw of a solution and of others beside it, whatever
draws it.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, final

import numpy as np

from socp.model import TINY
from socp.view.exports import unit
from socp.view.figures import style
from socp.view.figures.overlay import Group
from socp.view.picture import Picture, picture_of, scene_of
from socp.view.traces import Traces

if TYPE_CHECKING:
    from socp.model import Problem, Solution

Stretch = tuple[str, float, float]
# Of the largest multiplier: what an interior point leaves of a constraint that is not active
_NOTHING = 1e-6
_APART = 1e-3  # of its largest value: nearer to zero a constraint on a grid may be active


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Curve:
    """One panel over time: values (n,) at times t (n,), its label, bounds, and the stretches that
    shade it.

    `switches`: times that are marked; `zero`: whether a line marks zero; `lanes`: whether the arcs
    are named above; `others`: look, times and values of the same quantity of other solutions.
    """

    label: str
    unit: str
    t: np.ndarray
    values: np.ndarray
    bounds: tuple[float, float] = (-np.inf, np.inf)
    stretches: tuple[Stretch, ...] = ()
    switches: Sequence[float] = ()
    zero: bool = False
    lanes: bool = False
    others: tuple[tuple[style.Look, np.ndarray, np.ndarray], ...] = ()

    @property
    def everything(self) -> np.ndarray:
        """The finite values of all solutions (k,)."""
        values = np.concatenate([self.values, *(each for _, _, each in self.others)])
        finite: np.ndarray = values[np.isfinite(values)]
        return finite

    @property
    def span(self) -> tuple[float, float]:
        """The first and the last time of all solutions."""
        times = [self.t, *(t for _, t, _ in self.others)]
        return min(float(t[0]) for t in times), max(float(t[-1]) for t in times)


def curves_of(
    name: str, solution: "Solution", problem: "Problem | None", group: Group
) -> Iterator[Curve]:
    """Yield the panels of one kind that have anything to show."""
    rows = _rows(name, solution, group.along)
    others = [(_rows(name, each.solution, each.along), each) for each in group.others]
    box = _bounds(name, problem)
    for (owner, label), values in rows.items():
        if not np.isfinite(values).any():
            continue
        arcs = solution.structure.get(owner, ()) if name in {"controls", "switching"} else ()
        yield Curve(
            label=label,
            unit=unit_of(problem, owner) if name in {"controls", "states"} else "",
            t=group.along.t,
            values=values,
            bounds=box.get(owner, (-np.inf, np.inf)),
            stretches=arcs,
            switches=[end for _, _, end in arcs[:-1]] if arcs else solution.switches,
            zero=name in {"switching", "multipliers"},
            lanes=name == "controls",
            others=tuple(
                (each.look, each.along.t, found[owner, label])
                for found, each in others
                if (owner, label) in found
            ),
        )


def _rows(name: str, solution: "Solution", along: Traces) -> dict[tuple[str, str], np.ndarray]:
    """Return the values (n,) of one kind of panels by name and label."""
    sizes = {
        c: float(np.nanmax(np.abs(row), initial=0.0))
        for c, row in along.multipliers.items()
        if _met(along.constraints.get(c))
    }
    active = [c for c, size in sizes.items() if size > _NOTHING * max(sizes.values())]
    found: dict[str, tuple[Sequence[str], str, Iterable[np.ndarray]]] = {
        "controls": (solution.control_names, "{}", along.u),
        "switching": (solution.control_names, r"\sigma_{{{}}}", along.switching),
        "states": (solution.state_names, "{}", along.x),
        "costates": (solution.state_names, r"\lambda_{{{}}}", along.costate),
        "multipliers": (tuple(active), r"\mu_{{{}}}", [along.multipliers[c] for c in active]),
        "hamiltonian": (("H",), "{}", [along.hamiltonian]),
    }
    names, pattern, values = found[name]
    return {
        (each, pattern.format(style.symbol(each))): row
        for each, row in zip(names, values, strict=True)
    }


def _met(constraint: np.ndarray | None) -> bool:
    """Tell whether a constraint c (n,) <= 0 comes near zero: the multiplier of one that does not is
    what an interior point leaves of it.
    """
    if constraint is None or not constraint.size:
        return True
    return bool(np.nanmax(constraint) >= -_APART * np.nanmax(np.abs(constraint)))


def unit_of(problem: "Problem | None", name: str) -> str:
    """Return the unit of a quantity, as it may stand in a label."""
    return style.plain(unit(problem, name))


def _bounds(name: str, problem: "Problem | None") -> dict[str, tuple[float, float]]:
    """Return the bounds of controls or states by name."""
    if problem is None or name not in {"controls", "states"}:
        return {}
    pair = (
        (problem.control_names, problem.box)
        if name == "controls"
        else (problem.state_names, problem.state_box)
    )
    return {
        each: (float(low), float(high)) for each, low, high in zip(pair[0], *pair[1], strict=True)
    }


def has_scene(problem: "Problem | None") -> bool:
    """Tell whether there is a plane to draw: that of the problem, or that of two states."""
    if problem is None:
        return False
    return problem.scene is not None or len(problem.state_names) > 1


def scene_of_group(
    solution: "Solution", problem: "Problem", group: Group
) -> tuple[Picture, tuple[str, str]]:
    """Return the scene with the paths of the solutions beside, and the labels of its axes in
    mathtext. What has other states or parameters than the problem has no path (2, 0) in it.
    """
    seen = picture_of(problem, solution, group.along.t)
    paths = (
        picture_of(problem, each.solution, each.along.t).path
        if each.solution.state_names == problem.state_names
        and each.solution.control_names == problem.control_names
        and set(problem.parameter_names) <= set(each.solution.parameters)
        else np.empty((2, 0))
        for each in group.others
    )
    plane = [str(each) for each in scene_of(problem).plane]
    pairs = zip(plane, seen.labels, strict=True)
    labels = [
        style.label(style.symbol(p), unit_of(problem, p))
        if p in (*solution.state_names, "t")
        else text
        for p, text in pairs
    ]
    return replace(seen, others=tuple(paths)), (labels[0], labels[1])


def power_of(values: np.ndarray) -> int:
    """Return the power of ten in whose units the labels of finite values (k,) are short."""
    largest = float(np.max(np.abs(values), initial=0.0))
    power = int(np.floor(np.log10(largest))) if largest > 0 else 0
    return power if power <= -3 or power >= 5 else 0


def limits_of(curve: Curve, unit: float) -> tuple[float, float]:
    """Return limits that hold the values, and bounds that are near, with a margin."""
    seen = curve.everything
    low, high = (float(seen.min()), float(seen.max())) if seen.size else (0.0, 1.0)
    span = high - low
    near = [
        b for b in curve.bounds if np.isfinite(b) and low - 0.5 * span <= b <= high + 0.5 * span
    ]
    shown = near if not curve.lanes else [b for b in curve.bounds if np.isfinite(b)]
    low, high = (
        min([low, *shown, *([0.0] if curve.zero else [])]),
        max([high, *shown, *([0.0] if curve.zero else [])]),
    )
    least = 1e-4 * max(abs(low), abs(high), TINY)  # what no label tells apart fills no panel
    pad = (
        0.08 * max(high - low, least)
        if high - low > least
        else max(0.1 * abs(high), 0.5 * unit * 1e-3, 1e-12)
    )
    return (low - pad) / unit, (high + pad) / unit

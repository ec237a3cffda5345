"""The statement of a problem for the reader, part by part, in the problem's own symbols."""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from socp.formula import formula, number

if TYPE_CHECKING:
    from socp.problem import Problem

Line = tuple[str, str]


def stated(problem: "Problem") -> Iterator[Line]:
    """Yield (label, text) of cost, dynamics, bounds, ends, constraints and given laws."""
    terms = [formula(problem.minimise)] if problem.minimise is not None else []
    terms += [f"integral of {formula(problem.running)}"] if problem.running is not None else []
    yield "minimise", " + ".join(terms)
    yield from (("dynamics", f"{state}' = {formula(rate)}") for state, rate in problem.dynamics.items())
    yield from _intervals(problem)
    for label in ("target", "path"):
        yield from ((label, f"{name}: {formula(relation)}") for name, relation in getattr(problem, label).items())
    given = problem.singular.items()
    yield from (("given law", f"{control} = {formula(law)} where singular") for control, law in given)
    yield from _boundary(problem)


def notes(problem: "Problem") -> Iterator[Line]:
    """Yield (label, text) of what is known beside the problem: units and reference values."""
    yield from (("unit", f"{symbol}: {unit}") for symbol, unit in problem.units.items())
    yield from _reference(problem)


def _intervals(problem: "Problem") -> Iterator[Line]:
    boxes = (("control", problem.box), ("state", problem.state_box), ("parameter", problem.parameter_box))
    for kind, box in boxes:
        yield from ((kind, text) for text in _box(getattr(problem, f"{kind}_names"), box))
    for label, box in (("start", problem.start_box), ("end", problem.end_box)):
        yield label, ", ".join(_box(problem.state_names, box))
    times = np.array([problem.initial_time_box, problem.final_time_box]).T
    yield "time", ", ".join(_box(("t0", "tf"), times))


def _box(names: Sequence[str], box: np.ndarray) -> list[str]:
    """Return the intervals of names (n,) with bounds (2, n), those that are free together at the end."""
    bounded = np.isfinite(box).any(axis=0)
    free = ", ".join(name for name, its in zip(names, bounded, strict=True) if not its)
    pairs = zip(names, box.T, bounded, strict=True)
    return [_interval(name, *pair) for name, pair, its in pairs if its] + ([f"{free} free"] if free else [])


def _interval(name: str, low: float, high: float) -> str:
    if low == high:
        return f"{name} = {number(low)}"
    left = "" if low == -float("inf") else f"{number(low)} <= "
    right = "" if high == float("inf") else f" <= {number(high)}"
    return f"{left}{name}{right}"


def _boundary(problem: "Problem") -> Iterator[Line]:
    for control, laws in problem.boundary.items():
        if isinstance(laws, Mapping):
            yield from (("given law", f"{control} = {formula(law)} on {name}") for name, law in laws.items())
        else:
            yield "given law", f"{control} = {formula(laws)} on the boundary"


def _reference(problem: "Problem") -> Iterator[Line]:
    reference = problem.reference
    if reference is None:
        return
    yield "reference", f"objective {reference.objective:.16g}"
    if reference.word:
        yield "reference", f"word {reference.word}"
    if reference.switches:
        yield "reference", "switching times " + "  ".join(f"{t:.13g}" for t in reference.switches)
    if reference.source:
        yield "reference", reference.source

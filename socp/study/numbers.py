"""Numbers of a problem, by the names that `Problem.with_` knows them by."""

from collections.abc import Iterator

from socp.model import Problem


def numbers_of(problem: Problem) -> dict[str, float]:
    """Return the numbers that a problem has a value of: fixed ends and times, finite bounds, and
    constants.
    """
    found = {name: low for name, low, high in _ends(problem) if low == high}
    tables = (problem.control_names, problem.box), (problem.state_names, problem.state_box)
    for names, box in tables:
        for name, (low, high) in zip(names, box.T.tolist(), strict=True):
            sides = {f"bounds.{name}.lower": low, f"bounds.{name}.upper": high}
            found |= {side: value for side, value in sides.items() if abs(value) < float("inf")}
    return found | {name: each.value for name, each in problem.constants.items()}


def _ends(problem: Problem) -> Iterator[tuple[str, float, float]]:
    """Yield the boxes of states and times at the ends."""
    for end, box in (("start", problem.start_box), ("end", problem.end_box)):
        for name, (low, high) in zip(problem.state_names, box.T.tolist(), strict=True):
            yield f"{end}.{name}", low, high
    times = {"initial_time": problem.initial_time_box, "final_time": problem.final_time_box}
    yield from ((name, float(low), float(high)) for name, (low, high) in times.items())

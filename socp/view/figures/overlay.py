"""Several solutions in one figure, and what its title says."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, final

from socp.errors import MethodError
from socp.model import known_problem
from socp.view.figures import style
from socp.view.ladder import top_text
from socp.view.traces import Traces, sampled

if TYPE_CHECKING:
    from socp.model import Problem, Solution

_POINTS = 500  # of a curve, about


@final
@dataclass(frozen=True, eq=False)
class Other:
    """A solution beside the one that is drawn: its name, its look and its values."""

    name: str
    look: style.Look
    solution: "Solution"
    along: Traces


@final
@dataclass(frozen=True, eq=False)
class Group:
    """Values of the solution that is drawn, its name, and the solutions beside it."""

    along: Traces
    name: str
    others: tuple[Other, ...]

    @property
    def until(self) -> float:
        """The last time of all."""
        return max(
            float(each.t[-1]) for each in (self.along, *(other.along for other in self.others))
        )

    @property
    def names(self) -> tuple[tuple[str, style.Look], ...]:
        """Names for a legend with their looks; none where a solution stands alone."""
        rest = tuple((each.name, each.look) for each in self.others)
        return ((self.name, style.OWN), *rest) if rest else ()


def overlaid(
    problem: "Problem | None",
    solution: "Solution",
    beside: "Mapping[str, Solution] | Iterable[Solution]" = (),
    **unknown: Any,
) -> Group:
    """Return a solution with those beside it, which are named by their methods unless they have
    names; what is not known of theirs is left out.
    """
    if unknown:
        raise MethodError(f"a figure has no option '{next(iter(unknown))}'")
    if isinstance(beside, Mapping):
        named = [(style.plain(name), each) for name, each in beside.items()]
    else:
        named = [(style.plain(each.method), each) for each in beside]
    found = []
    for k, (name, each) in enumerate(named):
        pairs = (
            (each.state_names, solution.state_names),
            (each.control_names, solution.control_names),
        )
        if not any(set(theirs) & set(own) for theirs, own in pairs):
            raise MethodError(f"'{name}' shares no state or control with '{solution.problem}'")
        alike = each.state_names == solution.state_names
        along = sampled(problem if alike else known_problem(each), each, _POINTS)
        found.append(Other(name, style.OTHERS[k % len(style.OTHERS)], each, along))
    return Group(sampled(problem, solution, _POINTS), style.plain(solution.method), tuple(found))


def heading_of(solution: "Solution", title: str | bool) -> str:
    """Return the title of a figure: a text as it is, for True what is known of the solution."""
    if not isinstance(title, bool):
        return style.plain(title) if title else ""
    if not title:
        return ""
    rung = "not judged" if solution.verdict is None else top_text(solution)
    times = f"objective {solution.reached:.8g}, final time {solution.final_time:.6g}"
    return style.plain(f"{solution.problem} by {solution.method}: {times}, {rung}")

"""A branch of extremals over one number of a problem: its points, and the events between them."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, final

from socp.model import Solution, rung_of


@final
@dataclass(frozen=True, eq=False)
class Point:
    """A certified solution at a value of the number."""

    value: float
    solution: Solution


@final
@dataclass(frozen=True, eq=False)
class Event:
    """Where the word of a branch changes, or the branch ends.

    `value` of the number, located within `error` (infinite where it was not, and lies after the
    last point); `kind`: what happens, `where`: to what, `time`: when, nan where that is not known;
    the words `before` and `after`, empty where nothing follows, the same at a fold, where the
    number turns back, and where an extremal ceases to be a minimum, or becomes one. `place`: how
    many points of the branch come before it. `solution` is the limit of what comes before, or
    after, None where that is not known.
    """

    value: float
    error: float
    kind: str
    where: str
    time: float
    before: str
    after: str
    place: int
    solution: Solution | None = None


@final
@dataclass(frozen=True, eq=False)
class Branch:
    """Certified solutions of a problem over one of its numbers, by `name`, in the order in which
    they were followed, and the events on the way; `ended` says why it does not reach the last
    value, where it does not.
    """

    problem: str
    name: str
    points: tuple[Point, ...]
    events: tuple[Event, ...]
    ended: str = ""
    interrupted: bool = False

    @property
    def rows(self) -> list[dict[str, Any]]:
        """Points and events as plain values, in order: the `value` of the number, objective, final
        time, word, switching times, rung of the ladder, and of events what happens, to what, when,
        the next word, and within what the value is located; texts are empty and numbers nan where
        there are none.
        """
        return [self._row(value, solution, event) for value, solution, event in self._merged()]

    def _merged(self) -> Iterator[tuple[float, Solution | None, Event | None]]:
        """Yield points and events in the order of the branch."""
        for k, point in enumerate((*self.points, None)):
            yield from ((e.value, e.solution, e) for e in self.events if e.place == k)
            if point is not None:
                yield point.value, point.solution, None

    def _row(self, value: float, solution: Solution | None, event: Event | None) -> dict[str, Any]:
        return {
            "value": value,
            "objective": solution.objective if solution is not None else float("nan"),
            "final_time": solution.final_time if solution is not None else float("nan"),
            "word": event.before if event else solution.word if solution else "",
            "switches": [float(t) for t in solution.junctions] if solution is not None else [],
            "rung": rung_of(solution).value if solution is not None and event is None else "",
            "event": event.kind if event else "",
            "where": event.where if event else "",
            "time": event.time if event else float("nan"),
            "after": event.after if event else "",
            "error": event.error if event else float("nan"),
        }

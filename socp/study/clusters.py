"""What starts came to: outcomes, and the extremals that they are clustered into by objective and
word.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

from socp.model import Solution

_SAME = 1e-6  # relative difference of two certified objectives of one extremal
_ALIKE = 1e-3  # the same where nothing is certified: the grids differ by as much


@final
@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of one start: its solution, certified or the best there is, or None with the reason
    in `error`.
    """

    number: int
    about: str
    solution: Solution | None = None
    error: str = ""

    @property
    def certified(self) -> bool:
        """Whether the solution is certified as an extremal."""
        return self.solution is not None and bool(self.solution.extremal)


@final
@dataclass(frozen=True, eq=False)
class Cluster:
    """An extremal, or what looks like one: its solution of the least residual, and the starts that
    ended in it.
    """

    solution: Solution
    starts: tuple[int, ...]


@final
@dataclass(frozen=True, eq=False)
class Census:
    """All that the starts of a problem came to; `wanted` starts were asked for, `died` are those
    whose worker did.

    `unkept` says why finished starts could not be kept, where they could not.
    """

    wanted: int
    outcomes: tuple[Outcome, ...]
    died: tuple[int, ...] = ()
    interrupted: bool = False
    unkept: str = ""

    @property
    def extremals(self) -> tuple[Cluster, ...]:
        """The certified extremals, best objective first."""
        return clusters([each for each in self.outcomes if each.certified])

    @property
    def others(self) -> tuple[Cluster, ...]:
        """The local solutions in which starts ended that nothing certified, best objective
        first.
        """
        return clusters([each for each in self.outcomes if not each.certified], certified=False)

    @property
    def failed(self) -> tuple[Outcome, ...]:
        """The starts that led nowhere."""
        return tuple(each for each in self.outcomes if each.solution is None)

    @property
    def best(self) -> Solution | None:
        """The certified extremal of the best objective, or else the best of the other solutions."""
        found = self.extremals or self.others
        return found[0].solution if found else None


def clusters(outcomes: Sequence[Outcome], *, certified: bool = True) -> tuple[Cluster, ...]:
    """Return outcomes clustered by objective, and by word too where they are certified; best
    objective first.
    """
    found: list[list[tuple[int, Solution]]] = []
    solved = [(each.number, each.solution) for each in outcomes if each.solution is not None]
    for number, solution in sorted(solved, key=lambda pair: (_value(pair[1]), pair[0])):
        home = next(
            (cluster for cluster in found if _together(cluster[0][1], solution, certified)), None
        )
        if home is None:
            found.append([(number, solution)])
        else:
            home.append((number, solution))
    return tuple(
        Cluster(
            min(each, key=lambda pair: residual(pair[1]))[1],
            tuple(sorted(number for number, _ in each)),
        )
        for each in found
    )


def _together(a: Solution, b: Solution, certified: bool) -> bool:
    one, other = _value(a), _value(b)
    if math.isinf(one) or math.isinf(other):
        return one == other
    near = (_SAME if certified else _ALIKE) * max(abs(one), abs(other))
    return abs(one - other) <= near and (a.word == b.word or not certified)


def _value(solution: Solution) -> float:
    """Return the objective that a solution is told by, infinite where none is known."""
    return math.inf if math.isnan(solution.told) else solution.told


def residual(solution: Solution) -> float:
    """Return the worst residual of the principle, infinite where nobody judged."""
    return solution.verdict.residual if solution.verdict else float("inf")

"""Recorders as plugins provide them, and the guard around one: its failure is a line, never the end
of a solve.
"""

import copy
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, Protocol, final

from socp.registry.calls import invoke

if TYPE_CHECKING:
    from socp.model import Problem, Progress, Solution


class Recorder(Protocol):
    """What a plugin's `socp_recorder` returns."""

    def __call__(self, now: "Progress", /) -> None:
        """Look at the progress of an iteration."""

    def finish(self, problem: "Problem", solution: "Solution") -> None:
        """Record a solution, judged where it could be; once a run."""

    def close(self) -> None:
        """Complete the recording; called once, last, whatever happened."""


@final
@dataclass(eq=False)
class Guarded:
    """A recorder whose first failure is kept as a line in `complaints` and ends the recording."""

    recorder: Recorder | None
    explain: Callable[[BaseException], str] = str
    complaints: list[str] = field(default_factory=list)

    def __call__(self, now: "Progress", /) -> None:
        """Pass the progress of an iteration on."""
        if self.recorder is not None:
            self._tried(self.recorder, now)

    def finish(self, problem: "Problem", solution: "Solution") -> None:
        """Record a solution."""
        if self.recorder is not None:
            self._tried(self.recorder.finish, problem, read_only(solution))

    def close(self) -> bool:
        """Complete the recording, and tell whether it is whole."""
        if self.recorder is not None:
            self._tried(self.recorder.close)
        whole = self.recorder is not None
        self.recorder = None
        return whole

    def _tried(self, act: Callable[..., None], *given: Any) -> None:
        try:
            invoke(act, *given)
        except Exception as error:  # noqa: BLE001 - a recorder's fault is not the solve's
            self.complaints.append(self.explain(error))
            self.recorder = None


def read_only(solution: "Solution") -> "Solution":
    """Return a copy of a solution for strangers: its arrays cannot be written to, and nothing else
    in it is shared.
    """
    found = copy.deepcopy({each.name: getattr(solution, each.name) for each in fields(solution)})
    for arc in found["arcs"]:
        for values in (arc.t, arc.x, arc.u, arc.costate, arc.mesh, *arc.multipliers.values()):
            values.setflags(write=False)
    return type(solution)(**found)

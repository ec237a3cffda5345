"""Viewers as plugins provide them, and the guard around one: whatever it raises says which plugin
it is from.
"""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, final

from socp.errors import ContractError, SolveError
from socp.process import shown
from socp.registry.calls import civil, prints_aside


class Viewer(Protocol):
    """What a plugin's `socp_viewer` returns; a module with these two functions will do."""

    def show(self, path: Path, /) -> None:
        """Open a recording and wait until its window is closed; SolveError says why it did not
        open.
        """

    def ready(self) -> str:
        """Return the address of a viewer on this computer, started unless one listens there
        already.

        SolveError says why there can be none.
        """


@final
@dataclass(frozen=True, eq=False)
class Screen:
    """A viewer that raises SolveError alone: its own as they are, and anything else explained.

    Its calls have no limit of time: a window stays open for as long as somebody looks at it.
    """

    viewer: Viewer
    explain: Callable[[BaseException], str] = str

    def show(self, path: Path) -> None:
        """Open a recording and wait until its window is closed."""
        self._tried(self.viewer.show, path)

    def ready(self) -> str:
        """Return the address of a viewer that listens."""
        address = self._tried(self.viewer.ready)
        if not (isinstance(address, str) and address):
            told = f"ready() of its viewer should return an address, not {shown(address)}"
            raise SolveError(self.explain(ContractError(told)))
        return address

    def _tried(self, act: Callable[..., Any], *given: Any) -> Any:
        try:
            with prints_aside():
                return act(*given)
        except (SolveError, KeyboardInterrupt):
            raise
        except BaseException as error:
            raise SolveError(self.explain(civil(error))) from error

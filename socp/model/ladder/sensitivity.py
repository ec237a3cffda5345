"""How an extremal moves with its data, as values."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, final

from socp.model.data.views import view


@final
@dataclass(frozen=True, kw_only=True)
class Sensitivity:
    """Derivatives of an extremal with respect to one datum, `to`, in the problem's units.

    - objective; initial_time; junctions (arcs - 1,), the times between the arcs; final_time;
    - parameters by name;
    - states: (nx,) at every time that was asked for.
    """

    to: str
    objective: float
    initial_time: float
    junctions: tuple[float, ...]
    final_time: float
    parameters: Mapping[str, float] = field(default_factory=dict)
    states: Mapping[float, tuple[float, ...]] = field(default_factory=dict)


@final
@dataclass(frozen=True, kw_only=True)
class Sensitivities:
    """Derivatives of one extremal, of a problem's name along a `word`, by one datum after another;
    `junctions` are the times between its arcs, `missing` says of every datum without derivatives
    why it has none.
    """

    problem: str
    word: str
    junctions: tuple[float, ...]
    states: tuple[str, ...]
    derivatives: tuple[Sensitivity, ...]
    missing: Mapping[str, str] = field(default_factory=dict)

    def __iter__(self) -> Iterator[Sensitivity]:
        return iter(self.derivatives)

    def __getitem__(self, place: int) -> Sensitivity:
        return self.derivatives[place]

    def __len__(self) -> int:
        return len(self.derivatives)

    @property
    def data(self) -> dict[str, Any]:
        """All of it as plain values, as JSON holds it."""
        return asdict(self)

    def to_xarray(self) -> Any:
        """Return the derivatives as an xarray.Dataset over datum, junction, parameter, time and
        state.
        """
        return view("derivatives")(self)

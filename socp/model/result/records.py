"""What becomes of a solution besides its point: what it cost, what is judged of it, and where it
is from, each a value that one stage of a run sets.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, final

from socp.model.ladder.rungs import Proof
from socp.model.ladder.starts import Starts
from socp.model.result.findings import Agreement, Feasibility, Node, Verdict


@final
@dataclass(frozen=True, kw_only=True)
class Effort:
    """How a solution was reached.

    `seconds` is split by stage; `trace` maps a quantity to its value per iteration. `nodes`: what a
    search over words tried, in order; `meshes`: the ends of all intervals (k,), in time, of every
    mesh solved on before the last. `starts`: from how many starts a search took the best, None
    where it made none.
    """

    iterations: int = 0
    seconds: Mapping[str, float] = field(default_factory=dict)
    trace: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    nodes: tuple[Node, ...] = ()
    meshes: tuple[tuple[float, ...], ...] = ()
    starts: Starts | None = None

    def after(self, earlier: "Effort", mesh: tuple[float, ...]) -> "Effort":
        """Return this effort with an earlier one, which it continues from a mesh, before it."""
        keys = {**earlier.seconds, **self.seconds}
        return Effort(
            iterations=self.iterations + earlier.iterations,
            seconds={k: self.seconds.get(k, 0.0) + earlier.seconds.get(k, 0.0) for k in keys},
            trace={k: (*earlier.trace.get(k, ()), *values) for k, values in self.trace.items()},
            nodes=(*earlier.nodes, *self.nodes),
            meshes=(*earlier.meshes, mesh, *self.meshes),
            starts=self.starts,
        )


@final
@dataclass(frozen=True, kw_only=True)
class Judgement:
    """What is known of a solution, worked out by others than the method that returned it.

    `structure` gives every control's stretches (mode, start, end). `verified` holds the feasibility
    by time and, where the word has laws, by feedback; `verdict` is the judge's. `agreement`: how
    far apart two computations of the solution are, where there were two; `proofs`: what was proved
    since it was judged.
    """

    structure: Mapping[str, tuple[tuple[str, float, float], ...]] = field(default_factory=dict)
    verified: tuple[Feasibility, ...] = ()
    verdict: Verdict | None = None
    agreement: Agreement | None = None
    proofs: tuple[Proof, ...] = ()


@final
@dataclass(frozen=True, kw_only=True)
class Origin:
    """Where a solution is from: the method with its options, the versions of what took part, and
    the problem that was judged, as data; `unstated` says why there is no `statement`, where it
    cannot be written.
    """

    method: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    statement: Mapping[str, Any] | None = None
    unstated: str = ""

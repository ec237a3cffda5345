"""Solutions: frozen arcs of states, controls and costates, and evaluation at any time."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from typing import TYPE_CHECKING, Any, final

import numpy as np

from socp.model.data.views import view
from socp.model.ladder.rungs import Proof
from socp.model.ladder.sensitivity import Sensitivities
from socp.model.ladder.starts import Starts
from socp.model.result.arc import Arc, Which
from socp.model.result.findings import Feasibility, Node, Verdict
from socp.model.result.records import Effort, Judgement, Origin
from socp.model.tolerances import EXTREMAL
from socp.model.word import Word

if TYPE_CHECKING:
    from socp.model.problem import Problem

_LONG = 60  # characters: a longer word has no room on one line


class Stop(Enum):
    """Why a solve stopped; the value is the sentence shown to the user. It says nothing about
    optimality.
    """

    SOLVED = "the solver met its tolerances"
    ACCEPTABLE = "the solver met only its weaker, acceptable tolerances"
    INFEASIBLE = "the solver found no point that satisfies the constraints"
    LIMIT = "the solver reached its limit of iterations or time"
    INTERRUPTED = "the solve was interrupted; this is its last iterate"
    FAILED = "the solver failed"
    SIMULATED = "a control was simulated, nothing was solved"

    @property
    def ok(self) -> bool:
        """Whether the point meets the solver's tolerances."""
        return self in {Stop.SOLVED, Stop.ACCEPTABLE}


@final
@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Solution:
    """What a method returns, a point without a claim, and three records of what is known besides:
    the `effort` that it cost, the `judgement` of it, and its `origin`.

    `objective` is the method's own value; `parameters` by name; all values, and those of the
    `arcs`, t (n,), x (nx, n), u (nu, n) and costate (nx, n), are in the problem's units. What is
    asked most of the records can be read from the solution itself: `solution.verdict` is
    `solution.judgement.verdict`.
    """

    problem: str
    arcs: tuple[Arc, ...]
    objective: float
    stop: Stop
    message: str = ""
    state_names: tuple[str, ...] = ()
    control_names: tuple[str, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    effort: Effort = field(default_factory=Effort)
    judgement: Judgement = field(default_factory=Judgement)
    origin: Origin = field(default_factory=Origin)

    def __repr__(self) -> str:
        judged = {None: "not judged", True: "certified", False: "not certified"}[self.extremal]
        word = f", {self.word}" if len(self.word) <= _LONG else f", {len(self.switches)} switches"
        return (
            f"Solution({self.problem!r} by {self.method}: objective {self.objective:.12g}"
            f"{word if self.structure else ''}, {judged})"
        )

    def __str__(self) -> str:
        told: str = view("text")(self)
        return told

    def __getitem__(self, name: str) -> np.ndarray:
        """Return the values (n,) at the nodes `t`, in the problem's units, of a column of
        `to_frame`: a state, a control, `time`, `lambda_x` or `sigma_u`.

        KeyError names those that there are.
        """
        if name not in self._columns:
            raise KeyError(f"no '{name}' in the solution; there are {', '.join(self._columns)}")
        return self._columns[name]

    def __contains__(self, name: object) -> bool:
        return name in self._columns

    __iter__ = None  # by names alone, not by places

    def _ipython_key_completions_(self) -> list[str]:
        return list(self._columns)

    @cached_property
    def _columns(self) -> Mapping[str, np.ndarray]:
        found: Mapping[str, np.ndarray] = view("table")(self)
        return found

    @property
    def seconds(self) -> Mapping[str, float]:
        """What every stage took, in seconds."""
        return self.effort.seconds

    @property
    def nodes(self) -> tuple[Node, ...]:
        """The words that a search tried, in order."""
        return self.effort.nodes

    @property
    def starts(self) -> Starts | None:
        """From how many starts it is the best; None where no search made any."""
        return self.effort.starts

    @property
    def structure(self) -> Mapping[str, tuple[tuple[str, float, float], ...]]:
        """Every control's stretches (mode, start, end)."""
        return self.judgement.structure

    @property
    def verified(self) -> tuple[Feasibility, ...]:
        """Its feasibility by re-integration: of the control in time, and of its laws."""
        return self.judgement.verified

    @property
    def verdict(self) -> Verdict | None:
        """What the judge found; None where nobody judged."""
        return self.judgement.verdict

    @property
    def proofs(self) -> tuple[Proof, ...]:
        """What was proved of it."""
        return self.judgement.proofs

    @property
    def method(self) -> str:
        """The method that returned it."""
        return self.origin.method

    @property
    def options(self) -> Mapping[str, Any]:
        """The options of its method."""
        return self.origin.options

    @property
    def statement(self) -> Mapping[str, Any] | None:
        """The problem that was judged, as data; None where it cannot be written."""
        return self.origin.statement

    @property
    def extremal(self) -> bool | None:
        """Whether the verdict certifies an extremal of Pontryagin's principle; None where nobody
        judged.
        """
        return None if self.verdict is None else self.verdict.extremal

    @property
    def reached(self) -> float:
        """The objective that the returned control reaches by re-integration; the method's own where
        nobody verified.
        """
        return self.objective if not self.verified else self.verified[0].objective

    @property
    def headline(self) -> tuple[str, ...]:
        """The objective as a report tells it: what the control reaches first, where the method's
        own value differs.
        """
        own = f"{self.objective:.12g}"
        if not self.overclaimed:
            return (own,)
        told = "no value" if np.isnan(self.reached) else f"{self.reached:.12g}"
        return (f"{told} reached by the control, re-integrated", f"{own} claimed by the method")

    @property
    def overclaimed(self) -> bool:
        """Whether the returned control reaches another objective than the method's own, by more
        than an extremal's may be off.
        """
        return bool(self.verified) and not self.verified[0].gap <= EXTREMAL

    @property
    def told(self) -> float:
        """The objective that a report leads with: the method's own, or what the control reaches
        where it is overclaimed.
        """
        return self.reached if self.overclaimed else self.objective

    @property
    def lawful(self) -> bool:
        """Whether a law holds on every arc: then it follows a word."""
        return all(arc.lawful for arc in self.arcs)

    @property
    def initial_time(self) -> float:
        """Time at which the first arc begins."""
        return float(self.arcs[0].t[0])

    @property
    def final_time(self) -> float:
        """Time at which the last arc ends."""
        return float(self.arcs[-1].t[-1])

    @property
    def word(self) -> str:
        """The word that the structure spells, `r: + s +; f: + b -`, every control by itself."""
        return "; ".join(
            f"{name}: {' '.join(mode for mode, _, _ in row)}"
            for name, row in self.structure.items()
        )

    @property
    def followed(self) -> Word:
        """The word that its arcs follow, with their modes as they stand."""
        return Word(self.control_names, tuple(arc.modes for arc in self.arcs))

    @property
    def switches(self) -> list[float]:
        """All switching times (n,) of the structure in order, in the problem's units; times that
        differ by rounding alone are one.
        """
        times = sorted({end for row in self.structure.values() for _, _, end in row[:-1]})
        apart = 1e-12 * (self.final_time - self.initial_time)
        return [t for k, t in enumerate(times) if k == 0 or t - times[k - 1] > apart]

    @cached_property
    def junctions(self) -> np.ndarray:
        """Times between the arcs (arcs - 1,)."""
        return np.array([arc.t[0] for arc in self.arcs[1:]])

    def at(self, t: Any, which: Which = "x", seen: Any = None) -> np.ndarray:
        """Evaluate x, u or costate at times t (k,), clipped to the horizon; returns (rows, k).

        It is right-continuous at switches; where times `seen` (k,) are given, they choose the side
        of a jump.
        """
        t, place = (
            np.clip(
                np.atleast_1d(np.asarray(each, dtype=float)), self.initial_time, self.final_time
            )
            for each in (t, t if seen is None else seen)
        )
        arc = np.searchsorted(self.junctions, place, side="right")
        out = np.empty((getattr(self.arcs[0], which).shape[0], t.size))
        for k in np.unique(arc):
            out[:, arc == k] = self.arcs[k].at(t[arc == k], which, place[arc == k])
        return out

    @cached_property
    def t(self) -> np.ndarray:
        """All nodes in time (nodes,), switches twice."""
        return np.concatenate([arc.t for arc in self.arcs])

    def rows(self, which: Which) -> np.ndarray:
        """Return x, u or costate at the nodes `t`, (rows, nodes)."""
        return np.hstack([getattr(arc, which) for arc in self.arcs])

    def after(self, earlier: "Solution") -> "Solution":
        """Return this solution with what an earlier one, which it continues, cost and tried before
        it added.
        """
        return replace(self, effort=self.effort.after(earlier.effort, earlier.corners))

    def with_effort(self, **changes: Any) -> "Solution":
        """Return this solution with fields of its `Effort` changed."""
        return replace(self, effort=replace(self.effort, **changes))

    def with_judgement(self, **changes: Any) -> "Solution":
        """Return this solution with fields of its `Judgement` changed."""
        return replace(self, judgement=replace(self.judgement, **changes))

    def with_origin(self, **changes: Any) -> "Solution":
        """Return this solution with fields of its `Origin` changed."""
        return replace(self, origin=replace(self.origin, **changes))

    def spent(self, **seconds: float) -> "Solution":
        """Return this solution with the seconds of stages in place of what they took before."""
        return self.with_effort(seconds={**self.seconds, **seconds})

    @property
    def corners(self) -> tuple[float, ...]:
        """Ends (intervals + 1,) of all intervals of the mesh, in time."""
        inner = [t for arc in self.arcs for t in arc.t[arc.mesh[:-1]].tolist()]
        return (*inner, self.final_time)

    def total_variation(self) -> np.ndarray:
        """Return the total variation of every control (nu,), jumps between intervals and arcs
        included.
        """
        pieces = [
            arc.u[:, arc.nodes(k, "u")] for arc in self.arcs for k in range(len(arc.mesh) - 1)
        ]
        variation: np.ndarray = np.abs(np.diff(np.hstack(pieces), axis=1)).sum(axis=1)
        return variation

    def to_frame(self, problem: "Problem | None" = None) -> Any:
        """Return the values at the nodes as a pandas.DataFrame over time, a quantity a column, a
        switch twice; the problem is the one that the solution carries, unless another is given.

        Raises MethodError where pandas is not installed.
        """
        return view("frame")(self, problem)

    def to_xarray(self, problem: "Problem | None" = None) -> Any:
        """Return the values at the nodes as an xarray.Dataset, with units and switching functions;
        the problem is the one that the solution carries, unless another is given.

        Raises MethodError where xarray is not installed.
        """
        return view("dataset")(self, problem)

    def simulate(self, problem: "Problem | None" = None, **how: Any) -> "Solution":
        """Return the motion that this solution's control leads to, integrated by DOP853.

        The problem is what is driven, the one that the solution carries unless another is given.
        `how` is what the view `simulate` takes: `disturbance`, `feedback` and `start`, see
        `socp.verdict.simulated`. Raises MethodError for a state that there is not, where no problem
        is known, and where an arc has no law of the state.
        """
        found: Solution = view("simulate")(self, problem, **how)
        return found

    def sensitivity(
        self,
        problem: "Problem | None" = None,
        to: Sequence[str] = (),
        at: Sequence[float] = (),
    ) -> Sensitivities:
        """Return the derivatives of a certified solution with respect to data of its problem, all
        where none is named, with those of the states at times `at`: see `socp.verdict.derivatives`.
        The problem is the one that the solution carries, unless another is given.

        Raises MethodError for what is no datum, SolveError where there are none, with the reason.
        """
        found: Sensitivities = view("sensitivity")(self, problem, to, at)
        return found

    def plot(self, problem: "Problem | None" = None, **look: Any) -> Any:
        """Return a matplotlib Figure; the problem is the one that the solution carries, unless
        another is given.

        `look` is what the view `figure` takes: `panels`, `width` in inches, `stretch` for short
        arcs, `beside` for other solutions in the same panels, `title`. Raises MethodError for other
        panels and options, and where matplotlib is not installed.
        """
        return view("figure")(self, problem, **look)

    def _repr_html_(self) -> str:
        shown: str = view("html")(self)
        return shown

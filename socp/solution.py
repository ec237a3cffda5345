"""Solutions: frozen arcs of states, controls and costates, evaluation at any time, and the JSON result file."""

import json
import os
import tempfile
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from enum import Enum
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Self, final

import numpy as np

from socp.errors import SolveError

SCHEMA = 1  # version of the result file; a reader refuses a newer one
Which = Literal["x", "u", "costate"]


class Stop(Enum):
    """Why a solve stopped; the value is the sentence shown to the user. It says nothing about optimality."""

    SOLVED = "the solver met its tolerances"
    ACCEPTABLE = "the solver met only its weaker, acceptable tolerances"
    INFEASIBLE = "the solver found no point that satisfies the constraints"
    LIMIT = "the solver reached its limit of iterations or time"
    INTERRUPTED = "the solve was interrupted; this is its last iterate"
    FAILED = "the solver failed"

    @property
    def ok(self) -> bool:
        """Whether the point meets the solver's tolerances."""
        return self in {Stop.SOLVED, Stop.ACCEPTABLE}


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Arc:
    """One arc: nodes in time with the values there.

    t (n,) increasing; x (nx, n); u (nu, n); costate (nx, n), nan where unknown; modes: one a control, as a word spells them;
    multipliers: state constraint -> density (n,), nan at nodes of no weight. `mesh` (k + 1,) holds the indices of the nodes
    where the arc's k intervals begin and end; on each the state is the polynomial through all of its nodes, the control the
    one through those of its nodes that are collocated: all but the ends that `side` (left, right, both) leaves out.
    """

    t: np.ndarray
    x: np.ndarray
    u: np.ndarray
    costate: np.ndarray
    mesh: np.ndarray
    side: Literal["left", "right", "both"]
    modes: tuple[str, ...]
    multipliers: Mapping[str, np.ndarray] = field(default_factory=dict)

    def nodes(self, interval: int, which: Which = "x") -> slice:
        """Return the nodes that carry a quantity on one interval."""
        first, last = int(self.mesh[interval]), int(self.mesh[interval + 1])
        if which != "u":
            return slice(first, last + 1)
        return slice(first + (self.side == "right"), last + (self.side != "left"))

    def at(self, t: np.ndarray, which: Which = "x") -> np.ndarray:
        """Evaluate x, u or costate at times t (k,) inside the arc; returns (rows, k)."""
        values: np.ndarray = getattr(self, which)
        t = np.atleast_1d(np.asarray(t, dtype=float))
        interval = np.clip(np.searchsorted(self.t[self.mesh], t, side="right") - 1, 0, len(self.mesh) - 2)
        out = np.empty((values.shape[0], t.size))
        for k in np.unique(interval):
            here, nodes = interval == k, self.nodes(int(k), which)
            out[:, here] = lagrange(self.t[nodes], values[:, nodes], t[here])
        return out


def lagrange(nodes: np.ndarray, values: np.ndarray, t: np.ndarray) -> np.ndarray:
    """Evaluate the polynomial through (nodes (p,), values (r, p)) at t (k,), by the barycentric formula; returns (r, k)."""
    span = float(np.ptp(nodes))
    if nodes.size == 1 or span == 0.0:
        return np.repeat(values[:, :1], t.size, axis=1)
    gaps = 4.0 * (nodes[:, None] - nodes[None, :]) / span  # an interval of length 4 has capacity 1: products stay near 1
    np.fill_diagonal(gaps, 1.0)
    weights = 1.0 / gaps.prod(axis=1)
    distance = t[:, None] - nodes[None, :]
    hit = distance == 0.0
    distance[hit] = 1.0
    terms = weights / distance
    result: np.ndarray = ((terms @ values.T) / terms.sum(axis=1, keepdims=True)).T
    where, node = np.nonzero(hit)
    result[:, where] = values[:, node]
    return result


@final
@dataclass(frozen=True, kw_only=True)
class Feasibility:
    """What an independent integration of the returned control says.

    Every figure is relative to the problem's own magnitudes (see `socp.simulate.scales`). `miss`: worst violation of start,
    end and target conditions by the re-integrated end point, at the condition `miss_at`; `path`: worst violation of a state
    constraint along the way, at `path_at`; `box`: worst violation of a control bound; `drift`: largest distance between the
    re-integrated and the returned states. `feedback` tells whether laws were integrated as feedback (True) or the control as
    a function of time (False). `error` holds the reason where the integration broke down.
    """

    miss: float
    miss_at: str
    path: float
    path_at: str
    box: float
    drift: float
    feedback: bool
    error: str = ""

    @property
    def worst(self) -> float:
        """Largest of the violations, infinite where the integration broke down."""
        return float("inf") if self.error else max(self.miss, self.path, self.box)


@final
@dataclass(frozen=True, eq=False, kw_only=True)
class Solution:
    """What a method returns: a point with its history, no claim.

    `objective` is the method's own value; `parameters` (np,); `trace` maps a quantity to its value per iteration;
    `seconds` is split into build and solve. `structure` gives every control's stretches (mode, start, end). `verified` holds the feasibility by time and, where the word has laws, by feedback.
    """

    problem: str
    method: str
    arcs: tuple[Arc, ...]
    objective: float
    stop: Stop
    message: str = ""
    state_names: tuple[str, ...] = ()
    control_names: tuple[str, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    options: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    iterations: int = 0
    seconds: Mapping[str, float] = field(default_factory=dict)
    trace: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    structure: Mapping[str, tuple[tuple[str, float, float], ...]] = field(default_factory=dict)
    verified: tuple[Feasibility, ...] = ()

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
        return "; ".join(f"{name}: {' '.join(mode for mode, _, _ in row)}" for name, row in self.structure.items())

    @property
    def switches(self) -> list[float]:
        """All switching times of the structure in order; times that differ by rounding alone are one."""
        times = sorted({end for row in self.structure.values() for _, _, end in row[:-1]})
        apart = 1e-12 * (self.final_time - self.initial_time)
        return [t for k, t in enumerate(times) if k == 0 or t - times[k - 1] > apart]

    @cached_property
    def junctions(self) -> np.ndarray:
        """Times between the arcs (arcs - 1,)."""
        return np.array([arc.t[0] for arc in self.arcs[1:]])

    def at(self, t: Any, which: Which = "x") -> np.ndarray:
        """Evaluate x, u or costate at times t (k,), right-continuous at switches, clipped to the horizon; returns (rows, k)."""
        t = np.clip(np.atleast_1d(np.asarray(t, dtype=float)), self.initial_time, self.final_time)
        place = np.searchsorted(self.junctions, t, side="right")
        out = np.empty((getattr(self.arcs[0], which).shape[0], t.size))
        for k in np.unique(place):
            out[:, place == k] = self.arcs[k].at(t[place == k], which)
        return out

    @cached_property
    def t(self) -> np.ndarray:
        """All nodes in time, switches twice."""
        return np.concatenate([arc.t for arc in self.arcs])

    def rows(self, which: Which) -> np.ndarray:
        """Return x, u or costate at the nodes `t`, (rows, nodes)."""
        return np.hstack([getattr(arc, which) for arc in self.arcs])

    def after(self, earlier: "Solution") -> "Solution":
        """Return this solution with the seconds and the iterations of an earlier one, whose work it continues, put before its own."""
        seconds = {key: self.seconds.get(key, 0.0) + earlier.seconds.get(key, 0.0) for key in {**earlier.seconds, **self.seconds}}
        trace = {key: (*earlier.trace.get(key, ()), *values) for key, values in self.trace.items()}
        return replace(self, seconds=seconds, trace=trace, iterations=self.iterations + earlier.iterations)

    def total_variation(self) -> np.ndarray:
        """Return the total variation of every control (nu,), jumps between intervals and arcs included."""
        pieces = [arc.u[:, arc.nodes(k, "u")] for arc in self.arcs for k in range(len(arc.mesh) - 1)]
        return np.abs(np.diff(np.hstack(pieces), axis=1)).sum(axis=1)

    # -- the result file

    def to_json(self) -> str:
        """Return the result file's text: strict JSON, null for what is unknown, floats that read back bit for bit."""
        document = {"schema": SCHEMA, "word": self.word, "switches": self.switches}
        document |= {f.name: _plain(getattr(self, f.name)) for f in fields(self)}
        return json.dumps(document, allow_nan=False, indent=1)

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Read what `to_json` wrote; SolveError says what is wrong with anything else."""
        try:
            document = json.loads(text)
            schema = document.pop("schema")
            if schema != SCHEMA:
                raise SolveError(f"result has schema {schema}; this socp reads schema {SCHEMA}")
            for derived in ("word", "switches"):
                document.pop(derived)
            arcs = tuple(_arc(arc) for arc in document.pop("arcs"))
            stop = Stop[document.pop("stop")]
            verified = tuple(Feasibility(**{k: float("inf") if v is None else v for k, v in f.items()}) for f in document.pop("verified"))
            trace = {k: tuple(_nan(v).tolist()) for k, v in document.pop("trace").items()}
            structure = {k: tuple((m, a, b) for m, a, b in row) for k, row in document.pop("structure").items()}
            names = {k: tuple(document.pop(k)) for k in ("state_names", "control_names")}
            objective = float("nan") if (value := document.pop("objective")) is None else value
            return cls(arcs=arcs, stop=stop, verified=verified, trace=trace, structure=structure, objective=objective, **names, **document)
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            raise SolveError(f"not a socp result: {type(error).__name__}: {error}") from error

    def save(self, path: str | Path) -> None:
        """Write the result file atomically: a reader sees the old file or the new one, never a part."""
        write_atomic(Path(path), self.to_json() + "\n")

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a result file; SolveError names the file and what is wrong with it."""
        try:
            return cls.from_json(Path(path).read_text(encoding="utf-8"))
        except OSError as error:
            raise SolveError(f"{path}: {error.strerror or error}") from error
        except (SolveError, UnicodeDecodeError) as error:
            raise SolveError(f"{path}: {error}") from error


def write_atomic(path: Path, text: str) -> None:
    """Write text to a file beside `path`, then rename it; SolveError names the path where that fails."""
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=path.name, suffix=".part")
    except OSError as error:
        raise SolveError(f"{path}: cannot be written: {error.strerror}") from error
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(text)
        Path(temporary).chmod(0o644)
        Path(temporary).replace(path)
    except OSError as error:
        Path(temporary).unlink(missing_ok=True)
        raise SolveError(f"{path}: cannot be written: {error.strerror}") from error


def _plain(value: Any) -> Any:
    """Return a value in JSON's types: arrays as lists, enums by name, nan and infinities as null."""
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, (Arc, Feasibility)):
        return _plain({f.name: getattr(value, f.name) for f in fields(value)} if isinstance(value, Arc) else asdict(value))
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, float):
        return value if np.isfinite(value) else None
    return value


def _nan(values: Any) -> np.ndarray:
    return np.array(values, dtype=float)  # None becomes nan


def _arc(data: Mapping[str, Any]) -> Arc:
    matrices = {k: _nan(data[k]).reshape(-1, len(data["t"])) for k in ("x", "u", "costate")}
    return Arc(
        t=_nan(data["t"]), mesh=np.array(data["mesh"], dtype=int), side=data["side"], modes=tuple(data["modes"]),
        multipliers={k: _nan(v) for k, v in data["multipliers"].items()}, **matrices,
    )  # fmt: skip

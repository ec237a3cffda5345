"""Records of a solution: how feasible it is, what a search tried, and what the judge finds."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, final

import numpy as np

from socp.model.data.views import view
from socp.model.ladder.grade import Grade
from socp.model.ladder.second_order import SecondOrder
from socp.model.tolerances import APPROXIMATE, EXTREMAL, FEASIBLE, TINY
from socp.model.word import Mode


@final
@dataclass(frozen=True, kw_only=True)
class Feasibility:
    """What an independent integration of the returned control says.

    Every figure is relative to the problem's own magnitudes (see `socp.model.evaluation.sizes`),
    which no returned state enlarges. `miss`: worst violation of start, end and target conditions by
    the re-integrated end point, at the condition `miss_at`; `path`: worst violation of a state
    constraint along the way, at `path_at`; `box`: worst violation of a control bound; `drift`:
    largest distance between the re-integrated and the returned states, at any node; `gap`: distance
    between the re-integrated and the returned objective. `feedback` tells whether laws were
    integrated as feedback (True) or the control as a function of time (False). `end` is the
    re-integrated final state (nx,) and `objective` the re-integrated objective, in the problem's
    units; nan where it is not known. `error` holds the reason where the integration broke down.
    """

    miss: float
    miss_at: str
    path: float
    path_at: str
    box: float
    drift: float
    feedback: bool
    end: tuple[float, ...] = ()
    error: str = ""
    objective: float = float("nan")
    gap: float = 0.0

    @property
    def off(self) -> float:
        """Largest figure of the control: its violations, and how far its objective is from the
        claimed one. How far its motion is from the returned states, `drift`, is a matter of these.
        """
        figures = (self.worst, self.gap)
        return float("inf") if np.isnan(figures).any() else max(figures)

    @property
    def off_at(self) -> str:
        """What the largest figure is of, as text."""
        found = {
            f"end condition {self.miss_at}": self.miss,
            f"state constraint {self.path_at}": self.path,
            "box of the controls": self.box,
            f"objective {self.objective:.6g}, not the returned one": self.gap,
        }
        return self.error or max(
            found, key=lambda what: np.inf if np.isnan(found[what]) else found[what]
        )

    @property
    def worst(self) -> float:
        """Largest of the violations, infinite where the integration broke down."""
        figures = (self.miss, self.path, self.box)
        return float("inf") if self.error or np.isnan(figures).any() else max(figures)


@final
@dataclass(frozen=True, kw_only=True)
class Node:
    """One node of a search over words: what was tried and what came of it; nan where it is not
    known.

    `bound` is a proved lower bound of the objective, `miss` and `residual` those of the node's
    verdict.
    """

    word: str
    stop: str
    objective: float = float("nan")
    bound: float = float("nan")
    miss: float = float("nan")
    residual: float = float("nan")


@final
@dataclass(frozen=True, kw_only=True)
class Agreement:
    """How far two computations of a solution are apart: objective, relative, and switching times,
    in the time's units.

    They differ in the mesh alone, or in method: a solver's tolerance says nothing of either.
    """

    objective: float
    switches: float

    @property
    def digits(self) -> int:
        """Significant digits of the objective on which they agree, 15 at most."""
        return int(np.clip(-np.log10(max(self.objective, 1e-15)), 0, 15))


# half as much variation again as the control's running mean: more than the shape of any arc adds
RINGS = 1.5


class Condition(Enum):
    """The conditions that a verdict holds a solution against: those of Pontryagin's principle, and
    what the solution says of itself.
    """

    INSIDE = "switching function zero inside the box"
    SIGN = "switching function sign"
    SWITCH = "switching function zero at a switch"
    FINAL_TIME = "Hamiltonian at the final time"
    INITIAL_TIME = "Hamiltonian at the initial time"
    CONSTANT = "Hamiltonian constant but for explicit time"
    START = "transversality at the start"
    PARAMETER = "stationarity of a parameter"
    END_SIGN = "sign of an end multiplier"
    CONSTRAINT_SIGN = "sign of a constraint's multiplier"
    JUMP_SIGN = "sign of a jump"
    MOTION = "states are those of the controls"
    OBJECTIVE = "objective is that of the states and controls"
    MODE = "control keeps the mode of its arc"
    PARAMETER_RANGE = "parameter within its interval"
    COMPLEMENTARY = "multipliers only where a constraint is met"
    NO_LENGTH = "arc without length, drop it from the word"
    OTHER = "another condition"  # of a file that another version wrote, in its own words

    @property
    def of_switching(self) -> bool:
        """Whether it is about a switching function."""
        return self in {Condition.INSIDE, Condition.SIGN, Condition.SWITCH}

    @property
    def of_free_time(self) -> bool:
        """Whether it ties the multipliers to the cost of a free time."""
        return self in {Condition.FINAL_TIME, Condition.INITIAL_TIME}


@final
@dataclass(frozen=True, kw_only=True)
class Place:
    """What a figure of a verdict is of.

    - control: the control, where it is of one;
    - of: the state, parameter, constraint or end condition, where it is of one of these;
    - stretch: the number of the control's stretch, from 1; arc: the number of the arc, from 1;
    - mode: what the control does there.
    """

    control: str | None = None
    of: str = ""
    stretch: int | None = None
    arc: int | None = None
    mode: Mode | None = None

    def __str__(self) -> str:
        parts = (
            self.control or self.of,
            "" if self.stretch is None else f"stretch {self.stretch}",
            "" if self.arc is None else f"arc {self.arc}",
        )
        mode = "" if self.mode is None else f" ({self.mode})"
        return ", ".join(filter(None, parts)) + mode


NOWHERE = Place()  # of the solution as a whole


@final
@dataclass(frozen=True, kw_only=True)
class Finding:
    """One condition of Pontryagin's principle: its worst residual over the Hamiltonian's magnitude,
    where and when.

    `residual` is dimensionless; it holds if it is at most `EXTREMAL`. `wants` is the mode (+ or -)
    that the switching function asks for there, where the condition is about one. `text` holds the
    words of a condition that is none of the known ones.
    """

    kind: Condition
    residual: float
    place: Place = NOWHERE
    t: float | None = None
    wants: Mode | None = None
    text: str = ""

    @property
    def condition(self) -> str:
        """The condition in words."""
        return self.text or self.kind.value

    @property
    def where(self) -> str:
        """Its place in words, empty for the solution as a whole."""
        return str(self.place)

    @property
    def control(self) -> str | None:
        """The control that it is of, if any."""
        return self.place.control

    @property
    def stretch(self) -> int | None:
        """The number of the control's stretch, from 1, where it is of one."""
        return self.place.stretch

    @property
    def data(self) -> dict[str, Any]:
        """All of it as plain values, in words as well, as result files hold it."""
        place = self.place
        return {
            "condition": self.condition,
            "residual": self.residual,
            "where": self.where,
            "t": self.t,
            "wants": "" if self.wants is None else str(self.wants),
            "kind": self.kind.name,
            "control": place.control,
            "of": place.of,
            "stretch": place.stretch,
            "arc": place.arc,
            "mode": "" if place.mode is None else str(place.mode),
        }

    @property
    def holds(self) -> bool:
        """Whether the residual is within the tolerance."""
        return self.residual <= EXTREMAL

    def __str__(self) -> str:
        place = f" on {self.where}" if self.where else ""
        when = f" at t = {self.t:.6g}" if self.t is not None else ""
        return f"{self.condition}{place}{when}: {self.residual:.1e}"


@final
@dataclass(frozen=True, kw_only=True, repr=False)
class Verdict:
    """The judgement of one solution by `socp.verdict.certify.certify`.

    - miss: the largest figure of re-integration, relative: a violation of ends, state
      constraints or box, or how far its objective is from the returned one; miss_at: what it is
      of, as text;
    - drift: how far the returned states are from those that the re-integrated control goes through;
    - findings: every condition of the principle with its residual;
    - distance: the least worst-case residual that any multipliers leave, found by a linear
      programme over all nodes, in the magnitude of the findings; None where the first
      multipliers already served;
    - chattering: controls that jump onto or off a singular arc of even order, which no finite
      word allows;
    - normality: the cost's own share of the Hamiltonian's magnitude, near 0 for an abnormal
      extremal;
    - legendre_clebsch: singular stretch -> the generalised Legendre-Clebsch expression at its
      worst, relative, not negative;
    - margins: bang stretch -> how far its switching function comes to the right side of zero,
      relative;
    - ringing: control -> total variation over that of its running mean, 1 for none;
    - objective_error, in the objective's units, and switch_errors, pairs (switching time,
      error): estimates, an infinite error belongs to a time that the conditions leave open;
    - flat: pairs (switching time from bound to bound, how far around it the switching function
      is as small as there);
    - remaining_error: the part of objective_error that is left where the tolerance of
      re-integration does not count;
    - digits: significant digits of the objective that objective_error leaves;
    - grade: of a feasible solution that is no extremal, how far its objective is from one's;
    - second_order: which kind of minimum an extremal is, None where that was not asked.
    """

    miss: float
    findings: tuple[Finding, ...] = ()
    distance: float | None = None
    normality: float = 1.0
    legendre_clebsch: Mapping[str, float] = field(default_factory=dict)
    margins: Mapping[Place, float] = field(default_factory=dict)
    ringing: Mapping[str, float] = field(default_factory=dict)
    objective_error: float = float("nan")
    remaining_error: float = float("nan")
    switch_errors: tuple[tuple[float, float], ...] = ()
    flat: tuple[tuple[float, float], ...] = ()
    digits: int = 0
    chattering: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    miss_at: str = ""
    drift: float = 0.0
    grade: Grade | None = None
    second_order: SecondOrder | None = None

    def __repr__(self) -> str:
        answers = {"feasible": self.feasible, "extremal": self.extremal}
        said = ", ".join(what if holds else f"not {what}" for what, holds in answers.items())
        return f"Verdict({said}: off by {self.miss:.1e}, residual {self.residual:.1e})"

    def __str__(self) -> str:
        told: str = view("text")(self)
        return told

    @property
    def feasible(self) -> bool:
        """Whether the re-integrated control meets all conditions and claims within `FEASIBLE`."""
        return self.miss <= FEASIBLE

    @property
    def residual(self) -> float:
        """Worst residual of the principle."""
        return max((finding.residual for finding in self.findings), default=float("inf"))

    @property
    def slack(self) -> tuple[Place, ...]:
        """Bang stretches whose switching function never takes the right sign clearly: a sign shows
        only where it stands out of the residuals.
        """
        level = min(self.residual, EXTREMAL)
        return tuple(place for place, margin in self.margins.items() if margin <= level)

    @property
    def reasons(self) -> tuple[str, ...]:
        """What stands against the solution being an extremal, worst first; empty if nothing
        does.
        """
        broken = sorted((f for f in self.findings if not f.holds), key=lambda f: -f.residual)
        found = [str(finding) for finding in broken]
        if not self.miss <= EXTREMAL:
            what = f": {self.miss_at}" if self.miss_at else ""
            found.insert(0, f"the re-integrated control is off by {self.miss:.1e}{what}")
        if not self.drift <= EXTREMAL:
            text = (
                f"the returned states are not those of the re-integrated control: {self.drift:.1e}"
            )
            found.append(text)
        found += [
            f"no strict sign of the switching function on {k}: {self.margins[k]:.1e}"
            for k in self.slack
        ]
        found += [
            f"Legendre-Clebsch condition on {k}: {v:.1e}"
            for k, v in self.legendre_clebsch.items()
            if v < -EXTREMAL
        ]
        found += [
            f"{name} jumps onto or off a singular arc of even order: it chatters"
            for name in self.chattering
        ]
        return tuple(found)

    @property
    def extremal(self) -> bool:
        """Whether every condition of the principle holds within `EXTREMAL`, feasibility and strict
        signs included.
        """
        return bool(self.findings) and not self.reasons

    @property
    def approximate(self) -> bool:
        """Whether it is approximately extremal: feasible in its states too, no extremal by the
        letter, its objective within `APPROXIMATE`, its singular arcs of the right curvature.
        """
        grade = self.grade
        near = grade is not None and grade.error <= APPROXIMATE * grade.size and grade.curved
        return near and max(self.miss, self.drift) <= FEASIBLE and not self.extremal

    def _repr_html_(self) -> str:
        shown: str = view("html")(self)
        return shown

    @property
    def rings(self) -> tuple[str, ...]:
        """Names of the controls that ring."""
        return tuple(name for name, ratio in self.ringing.items() if ratio > RINGS)


def digits_of(error: float, objective: float, most: int = 13) -> int:
    """Return the significant digits of an objective that an error leaves, none where it is not
    known.
    """
    relative = error / max(abs(objective), TINY)
    if not math.isfinite(relative):
        return 0
    return max(0, min(most, math.floor(-math.log10(max(relative, 10.0**-most)))))

"""The layout of result files: which fields there are, and what may stand in each."""

from collections.abc import Mapping
from typing import Annotated, Any, Literal

import msgspec

from socp.model.data.stated import Name, Number, Record

_COUNT = 2**63 - 1  # what a machine's integer holds

# null where there is none, as of a condition that is of no time, and not for nan
Known = Annotated[Number, msgspec.Meta(description="a number, if any")]
Row = list[Number]
Matrix = list[Row]
Count = Annotated[int, msgspec.Meta(ge=0, le=_COUNT)]


class Arc(Record):
    """Values at the nodes of an arc."""

    t: list[float]
    x: Matrix
    u: Matrix
    costate: Matrix
    mesh: list[Count]
    side: Literal["left", "right", "both"]
    modes: list[str]
    multipliers: dict[Name, Row]


class Node(Record):
    """What a search tried."""

    word: str
    stop: str
    objective: Number
    bound: Number
    miss: Number
    residual: Number


class Feasibility(Record):
    """What re-integration found."""

    miss: Number
    miss_at: str
    path: Number
    path_at: str
    box: Number
    drift: Number
    feedback: bool
    end: Row
    error: str
    objective: Number = None  # older files have none, nor `gap`
    gap: Number = 0.0


class Finding(Record):
    """A condition with its residual."""

    condition: str
    residual: Number
    where: str
    t: Known
    wants: str
    kind: str = ""  # older files have none, nor what follows: there it is in words alone
    control: str | None = None
    of: str = ""
    stretch: Count | None = None
    arc: Count | None = None
    mode: str = ""


class Grade(Record):
    """How near a solution is to an extremal."""

    objective: Number
    error: Number
    gain: Number
    dynamics: Number
    ends: Number
    path: Number
    size: Number
    curvature: Number


class Curvature(Record):
    """The least eigenvalue of a second variation."""

    least: Number
    error: Number
    free: Count


class Descent(Record):
    """What lowers the objective of an extremal."""

    times: Row
    parameters: Row
    predicted: Number
    found: Number


class SecondOrder(Record):
    """Which kind of minimum an extremal is."""

    kind: str
    theorem: str
    word: Curvature | None
    singular: Curvature | None
    limits: list[str]
    descent: Descent | None
    margin: Known = None  # older files have none


class Verdict(Record):
    """What the judge found."""

    miss: Number
    findings: list[Finding]
    distance: Known
    normality: Number
    legendre_clebsch: dict[str, Number]
    margins: dict[str, Number]
    ringing: dict[str, Number]
    objective_error: Number
    switch_errors: list[tuple[float, Number]]
    digits: Count
    chattering: list[str]
    notes: list[str]
    remaining_error: Number = None  # older files have none, nor `flat`
    flat: tuple[tuple[float, Number], ...] = ()
    miss_at: str = ""
    drift: Number = 0.0
    grade: Grade | None = None  # older files have none
    second_order: SecondOrder | None = None  # older files have none


class Agreement(Record):
    """How far two computations are apart."""

    objective: Number
    switches: Number


class Met(Record):
    """A local solution met beside the one returned."""

    objective: Number
    word: str
    starts: int


class Starts(Record):
    """From how many starts a solution is the best."""

    tried: int
    coarse: list[Met]
    extremals: list[Met]
    better: Known = None  # older files have none


class Proof(Record):
    """What was proved of a solution."""

    rung: str
    margin: Number
    statement: str


class Effort(Record):
    """How a solution was reached."""

    iterations: Count
    seconds: dict[str, Number]
    trace: dict[str, Row]
    nodes: list[Node]
    meshes: Matrix
    starts: Starts | None = None  # older files have none


class Judgement(Record):
    """What is known of a solution."""

    structure: dict[str, list[tuple[str, float, float]]]
    verified: list[Feasibility]
    verdict: Verdict | None
    agreement: Agreement | None
    proofs: tuple[Proof, ...] = ()  # older files have none


class Origin(Record):
    """Where a solution is from."""

    method: str  # empty where nobody has stamped it
    options: dict[str, Any]
    versions: dict[str, str]
    statement: dict[str, Any] | None = None
    unstated: str = ""


class Result(Record):
    """A result file."""

    schema: Literal[1, 2, 3]
    word: str
    switches: list[float]
    extremal: bool | None
    problem: Name
    arcs: Annotated[list[Arc], msgspec.Meta(min_length=1)]
    objective: Number
    stop: str
    message: str
    state_names: list[Name]
    control_names: list[Name]
    parameters: dict[Name, Number]
    effort: Effort
    judgement: Judgement
    origin: Origin


def in_parts(document: Mapping[str, Any]) -> dict[str, Any]:
    """Return the document of an older file, which held all fields in one table, in the parts of
    today's.
    """
    own, parts = dict(document), {"effort": Effort, "judgement": Judgement, "origin": Origin}
    for part, record in parts.items():
        names = [name for name in record.__struct_fields__ if name in own]
        own[part] = {name: own.pop(name) for name in names}
    return own

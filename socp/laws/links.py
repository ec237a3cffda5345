"""Links of singular arcs: switching functions on their way to the derivative that holds a control,
step by step.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import final

import casadi
import numpy as np

from socp.errors import MethodError
from socp.laws import probes
from socp.laws.brackets import extended_costate, switching_row
from socp.laws.setting import DEEPEST, Contact, Setting, common_factor, equations
from socp.model import Expr, column
from socp.process import in_time

_LEVEL = (
    1e-7  # of the sum of its terms: less is what a point that comes near a surface leaves of zero
)


class LostError(MethodError):
    """No law was found from these points: others may show one, unless it is `proved` that there is
    none.
    """

    def __init__(self, text: str, *, proved: bool = False) -> None:
        super().__init__(text)
        self.proved = proved


@final
@dataclass(frozen=True, eq=False)
class Link:
    """A switching function on its way: sigma^(depth) = factor * row z on the arc."""

    row: Expr
    factor: Expr
    depth: int = 0


@final
@dataclass(frozen=True, eq=False)
class Search:
    """The state of the differentiation: rows so far, points on their surface, and the links of the
    controls.

    `left` have been differentiated as often as any; `now` are to be followed this round, with their
    derivative (row without the singular controls, rows of these); `solved` hold a singular control.
    The search began at the points `start`, the costates of the states `aside` being zero.
    """

    setting: Setting
    touch: Contact
    start: np.ndarray
    points: np.ndarray
    aside: tuple[int, ...] = ()
    rows: tuple[Expr, ...] = ()
    goh: int = 0
    left: Mapping[int, Link] = field(default_factory=dict)
    now: Mapping[int, tuple[Link, Expr, list[Expr]]] = field(default_factory=dict)
    solved: Mapping[int, tuple[Expr, list[Expr], Link]] = field(default_factory=dict)

    def add(self, row: Expr, what: str, points: np.ndarray | None = None) -> "Search":
        """Return the search with one more row that vanishes, at points moved onto it; LostError
        where none arrives.
        """
        in_time(self.setting.name())
        start, rows = self.points if points is None else points, (*self.rows, row)
        own = casadi.vertcat(
            equations(self.setting, self.touch, rows),
            *(self.setting.problem.costate[j] for j in self.aside),
        )
        if row.is_constant() and contradictory(own):
            at = start[:, :0]
        else:
            at = probes.onto(self.setting.problem, own, start, interior=not self.setting.boundary)
        if not at.shape[1]:
            raise LostError(
                f"{self.setting.name()}: no such arc was found: no state and costate satisfy "
                f"{what} with all that precedes it ({start.shape[1]} points tried)"
            )
        return replace(self, rows=rows, points=at)

    def real(self, rows: Sequence[Expr]) -> np.ndarray:
        """Tell which rows differ from zero at which points (n, rows): by more than round-off and
        the points' error.
        """
        in_time(self.setting.name())
        z = extended_costate(self.setting.problem)
        stack = casadi.vertcat(*rows)
        evaluate = probes.evaluator(
            self.setting.problem,
            casadi.mtimes(stack, z),
            casadi.mtimes(casadi.fabs(stack), casadi.fabs(z)),
        )
        both: list[np.ndarray] = []

        def values(at: np.ndarray) -> np.ndarray:
            both.extend(each[:, :, 0] for each in evaluate(at))
            return both[0]

        found: np.ndarray = probes.real(self.setting.problem, values, self.points)
        value, terms = (each[: len(found)] for each in both)
        with np.errstate(invalid="ignore"):
            found &= np.abs(value) > _LEVEL * terms
        return found

    def holds(self, rows: Sequence[Expr]) -> bool:
        """Tell whether a row differs from zero at most of the points."""
        some = [row for row in rows if row.nnz()]
        return bool(some) and bool((self.real(some).mean(axis=0) > 0.5).any())


def contradictory(equations: Expr) -> bool:
    """Tell whether equations (m, 1) ask for what cannot be: with the symbols zero that they put to
    zero one by one, a number other than zero is left of one of them.

    Where lambda_v = 0 and lambda_x = 0, v lambda_x + 1 = 0 is met nowhere, though it is nearly so
    where v is large: points would go there step by step.
    """
    while True:
        plain = [
            e.dep(0) if e.n_dep() and e.op() == casadi.OP_NEG else e for e in equations.elements()
        ]
        if any(e.is_constant() and not e.is_zero() for e in plain):
            return True
        zero = column({e.element_hash(): e for e in plain if e.is_symbolic()}.values())
        if not zero.numel():
            return False
        equations = casadi.substitute(equations, zero, casadi.SX.zeros(zero.numel(), 1))


def begun(
    setting: Setting, touch: Contact, points: np.ndarray, aside: tuple[int, ...] = ()
) -> Search:
    """Return the search at its beginning: sigma of every singular control is to vanish, costates
    `aside` are zero.
    """
    search = Search(setting, touch, points, points, aside)
    for row in touch.rows:
        search = search.add(common_factor(row)[1], "sigma = 0 of its boundary controls")
    sigmas = {
        i: Link(switching_row(setting.problem, i), casadi.SX(1), -1) for i in setting.singular
    }
    return replace(search, now={i: (link, link.row, []) for i, link in sigmas.items()})


def differentiate(search: Search) -> Search:
    """Return the search with the derivatives of all links as the next to follow, Goh's condition
    required of them.
    """
    setting, links = search.setting, search.left
    for i, link in links.items():
        if setting.varying.numel() and casadi.depends_on(link.row, setting.varying):
            raise MethodError(
                f"{setting.name()}: the law of '{setting.problem.control_names[i]}' depends on "
                "the rate of change of a free control"
            )
    depth = next(iter(links.values())).depth + 1
    if depth > DEEPEST:
        raise LostError(
            f"{setting.name()}: no law was found: no singular control appears in {DEEPEST} "
            "derivatives"
        )
    parts = {i: split(search, link) for i, link in links.items()}
    if depth % 2:
        search = _goh(search, [slope for _, slopes in parts.values() for slope in slopes], depth)
    return replace(search, left={}, now={i: (links[i], *parts[i]) for i in links})


def split(search: Search, link: Link) -> tuple[Expr, list[Expr]]:
    """Return the derivative of a link as (row without the singular controls, rows of their
    coefficients).
    """
    unknown = search.setting.unknown
    row = search.touch.flow.of_row(link.row)
    given = [row, casadi.jacobian(row.T, unknown).T]
    rest, slopes = casadi.substitute(given, [unknown], [casadi.SX.zeros(unknown.numel(), 1)])
    return rest, casadi.vertsplit(slopes)


def _goh(search: Search, slopes: list[Expr], depth: int) -> Search:
    """Require the coefficients of singular controls in odd derivatives to vanish, as a minimum
    needs (Goh, Robbins).

    They vanish all along the arc, so their derivatives do; one that holds a singular control ends
    this.
    """
    what = f"Goh's condition on the sigma^({depth})"
    for slope in slopes:
        row = slope
        while search.goh < DEEPEST and search.holds([row]):
            if search.solved:
                name = search.setting.name()
                raise MethodError(
                    f"{name}: singular controls of different orders act on each other; not derived"
                )
            row = common_factor(row)[1]
            search = search.add(row, what)
            search = replace(search, goh=search.goh + 1)
            rest, held = split(search, Link(row, casadi.SX(1)))
            if search.holds(held):
                break
            row = rest
    return search

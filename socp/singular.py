"""Singular arcs: differentiate the switching functions until the controls appear, and solve for them."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import final

import casadi
import numpy as np

from socp import points as sampled
from socp.brackets import extended, switching_row
from socp.errors import MethodError
from socp.extremal import DEEPEST, Contact, Setting, equations, reduced
from socp.symbols import Expr


@final
@dataclass(frozen=True, eq=False)
class Link:
    """A switching function on its way: sigma^(depth) = factor * row z on the arc."""

    row: Expr
    factor: Expr
    depth: int = 0


@final
@dataclass(frozen=True, eq=False)
class Chain:
    """What the singular controls of an arc satisfy.

    `rows` (each (1, nx + 1)) vanish on the arc; the controls solve `slopes` u = -`rest`, entries [k][l] and [k] being
    rows, from sigma_k^(2 q_k) / factors[k]; `orders` are the q_k; `goh` counts the rows that come from Goh's condition;
    `points` (nv, n) lie on the arc's surface.
    """

    rows: list[Expr]
    rest: list[Expr]
    slopes: list[list[Expr]]
    factors: list[Expr]
    orders: list[int]
    goh: int
    points: np.ndarray


@dataclass(eq=False)
class _Search:
    """The state of the differentiation: rows so far, the same unreduced, and points on their surface."""

    setting: Setting
    touch: Contact
    rows: list[Expr]
    points: np.ndarray
    goh: int = 0
    solved: dict[int, tuple[Expr, list[Expr], Link]] = field(default_factory=dict)

    def add(self, row: Expr, what: str) -> tuple[Expr, Expr]:
        """Add a row, without its common factor where that leaves points; return (factor, row).

        Raises MethodError where no point is left.
        """
        factor, short = reduced(row)
        for scale, candidate in ((factor, short), (casadi.SX(1), row)):
            at = sampled.onto(
                self.setting.problem, equations(self.setting, self.touch, [*self.rows, candidate]), self.points
            )
            if at.shape[1]:
                self.rows, self.points = [*self.rows, candidate], at
                return scale, candidate
        raise MethodError(
            f"{self.setting.name()}: no such arc was found: no state and costate satisfy {what} with all that "
            f"precedes it ({self.points.shape[1]} points tried)"
        )

    def holds(self, rows: Sequence[Expr]) -> np.ndarray:
        """Tell which rows are generically nonzero on the surface (n,)."""
        values = casadi.vertcat(*(casadi.mtimes(row, extended(self.setting.problem)) for row in rows))
        return sampled.nonzero(self.setting.problem, values, self.points)[:, 0]


def chain(setting: Setting, touch: Contact) -> Chain:
    """Differentiate sigma of every singular control until singular controls appear in all of them.

    Raises MethodError, naming the case, where a control never appears (infinite order), no point satisfies the
    conditions, the controls do not follow from them, or a control that varies freely would have to be differentiated.
    """
    search = _begin(setting, touch)
    links = {}
    for i in setting.singular:
        factor, row = search.add(switching_row(setting.problem, i), f"sigma_{setting.problem.control_names[i]} = 0")
        links[i] = Link(row, factor)
    while links:
        links = _advance(search, links)
    found = [search.solved[i] for i in setting.singular]
    _solvable(search, [slopes for _, slopes, _ in found])
    return Chain(
        rows=search.rows, rest=[a for a, _, _ in found], slopes=[b for _, b, _ in found],
        factors=[link.factor for _, _, link in found],
        orders=[link.depth // 2 for _, _, link in found], goh=search.goh, points=search.points,
    )  # fmt: skip


def _begin(setting: Setting, touch: Contact) -> _Search:
    search = _Search(setting, touch, [], sampled.admissible(setting.problem))
    for row in touch.rows:
        search.add(row, "sigma = 0 of its boundary controls")
    return search


def _advance(search: _Search, links: dict[int, Link]) -> dict[int, Link]:
    """Differentiate all links once; those in which a singular control appears move to `solved`."""
    setting = search.setting
    _steady(setting, links)
    split = {i: _split(search, link) for i, link in links.items()}
    depth = next(iter(links.values())).depth + 1
    if depth > DEEPEST:
        raise MethodError(f"{setting.name()}: no singular control appears in {DEEPEST} derivatives (infinite order)")
    if depth % 2:
        _goh(search, [slope for _, slopes in split.values() for slope in slopes], depth)
    left = {}
    for i, (rest, slopes) in split.items():
        name = setting.problem.control_names[i]
        if search.holds(slopes).any():
            search.solved[i] = (rest, slopes, Link(rest, links[i].factor, depth))
        elif not search.holds([rest]).any():
            raise MethodError(
                f"{setting.name()}: sigma_{name} vanishes with all its derivatives from the {_nth(depth)} on, and no "
                "singular control appears in them (infinite order): the principle leaves the control open"
            )
        else:
            factor, row = search.add(rest, f"sigma_{name}^({depth}) = 0")
            left[i] = Link(row, links[i].factor * factor, depth)
    return left


def _nth(k: int) -> str:
    return {1: "1st", 2: "2nd", 3: "3rd"}.get(k, f"{k}th")


def _steady(setting: Setting, links: dict[int, Link]) -> None:
    for i, link in links.items():
        if setting.varying.numel() and casadi.depends_on(link.row, setting.varying):
            raise MethodError(
                f"{setting.name()}: the law of '{setting.problem.control_names[i]}' depends on the rate of change of a "
                "free control"
            )


def _split(search: _Search, link: Link) -> tuple[Expr, list[Expr]]:
    """Return the derivative of a link as (row without the singular controls, rows of their coefficients)."""
    unknown = search.setting.unknown
    row = search.touch.flow.of_row(link.row)
    slopes = casadi.jacobian(row.T, unknown)
    rest = casadi.substitute(row, unknown, casadi.SX.zeros(unknown.numel(), 1))
    return rest, [
        casadi.substitute(slopes[:, k].T, unknown, casadi.SX.zeros(unknown.numel(), 1)) for k in range(unknown.numel())
    ]


def _goh(search: _Search, slopes: list[Expr], depth: int) -> None:
    """Require the coefficients of singular controls in odd derivatives to vanish, as a minimum needs (Goh, Robbins).

    They vanish all along the arc, so their derivatives do; one that holds a singular control ends this.
    """
    what = f"Goh's condition on the sigma^({depth})"
    for slope in slopes:
        row = slope
        while search.goh < DEEPEST and search.holds([row]).any():
            if search.solved:
                name = search.setting.name()
                raise MethodError(f"{name}: singular controls of different orders act on each other; not derived")
            _, row = search.add(row, what)
            search.goh += 1
            rest, held = _split(search, Link(row, casadi.SX(1)))
            if search.holds(held).any():
                break
            row = rest


def _solvable(search: _Search, slopes: list[list[Expr]]) -> None:
    names = search.setting.problem.control_names
    odd = [names[i] for i in search.setting.singular if search.solved[i][2].depth % 2]
    matrix = sampled.evaluator(search.setting.problem, matrix_of(slopes, extended(search.setting.problem)))
    if odd or not sampled.generic(search.setting.problem, lambda at: np.linalg.det(matrix(at)[0]), search.points):
        raise MethodError(
            f"{search.setting.name()}: the conditions hold these controls but do not determine them "
            f"({'odd order of ' + odd[0] if odd else 'their matrix is singular everywhere: vanishing denominator'})"
        )


def matrix_of(slopes: list[list[Expr]], z: Expr) -> Expr:
    """Return the matrix (k, k) of rows times z."""
    return casadi.vertcat(*(casadi.horzcat(*(casadi.mtimes(row, z) for row in line)) for line in slopes))

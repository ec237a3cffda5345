"""Singular arcs: differentiate the switching functions until the controls appear, and solve for them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import final

import casadi
import numpy as np

from socp import points as sampled
from socp.brackets import extended, switching_row
from socp.errors import MethodError
from socp.extremal import DEEPEST, Contact, Setting, equations, homogeneous, reduced
from socp.invariant import closed
from socp.symbols import Expr

_QUORUM = 2  # points at which a control has to appear: one might be chance
_LEVEL = 1e-7  # of the sum of its terms: less is what a point that comes near a surface leaves of zero
_ASIDES = 3  # costates at most that are put aside: conserved quantities of one problem
_BRANCHES = 24  # ways of going on that are tried from one set of points


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


class Lost(MethodError):
    """No law was found from these points: others may show one."""


@final
@dataclass(frozen=True, eq=False)
class _Search:
    """The state of the differentiation: rows so far, points on their surface, and the links of the controls.

    `left` have been differentiated as often as any; `now` are to be followed this round, with their derivative (row
    without the singular controls, rows of these); `solved` hold a singular control. The search began at the points
    `start`, the costates of the states `aside` being zero.
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

    def add(self, row: Expr, what: str, points: np.ndarray | None = None) -> "_Search":
        """Return the search with one more row that vanishes, at points moved onto it; Lost where none arrives."""
        start, rows = self.points if points is None else points, (*self.rows, row)
        own = casadi.vertcat(
            equations(self.setting, self.touch, rows), *(self.setting.problem.costate[j] for j in self.aside)
        )
        at = sampled.onto(self.setting.problem, own, start, interior=not self.setting.boundary)
        if not at.shape[1]:
            raise Lost(
                f"{self.setting.name()}: no such arc was found: no state and costate satisfy {what} with all that "
                f"precedes it ({start.shape[1]} points tried)"
            )
        return replace(self, rows=rows, points=at)

    def real(self, rows: Sequence[Expr]) -> np.ndarray:
        """Tell which rows differ from zero at which points (n, rows): by more than round-off and the points' error."""
        z = extended(self.setting.problem)
        stack = casadi.vertcat(*rows)
        evaluate = sampled.evaluator(
            self.setting.problem, casadi.mtimes(stack, z), casadi.mtimes(casadi.fabs(stack), casadi.fabs(z))
        )
        value, terms = (each[:, :, 0] for each in evaluate(self.points))
        found: np.ndarray = sampled.real(self.setting.problem, lambda at: evaluate(at)[0][:, :, 0], self.points)
        with np.errstate(invalid="ignore"):
            return found & (np.abs(value) > _LEVEL * terms)

    def holds(self, rows: Sequence[Expr]) -> bool:
        """Tell whether a row differs from zero at most of the points."""
        return bool((self.real(rows).mean(axis=0) > 0.5).any())


def chain(setting: Setting, touch: Contact) -> Chain:
    """Differentiate sigma of every singular control until singular controls appear in all of them.

    Where the surface of the conditions has several branches, each is followed until one shows a law. Raises
    MethodError, naming the case, where no control appears, proved to be so or not, no point satisfies the conditions,
    the controls do not follow from them, or a control that varies freely would have to be differentiated.
    """
    problem, first = setting.problem, None
    for points in (sampled.admissible(problem), *sampled.noted(problem), sampled.scattered(problem)):
        try:
            found = _followed(_begun(setting, touch, points), [_BRANCHES])
        except Lost as error:
            first = first or error
            continue
        parts = [found.solved[i] for i in setting.singular]
        return Chain(
            rows=list(found.rows), rest=[a for a, _, _ in parts], slopes=[b for _, b, _ in parts],
            factors=[link.factor for _, _, link in parts],
            orders=[link.depth // 2 for _, _, link in parts], goh=found.goh, points=found.points,
        )  # fmt: skip
    raise first or Lost(setting.name())


def _begun(setting: Setting, touch: Contact, points: np.ndarray, aside: tuple[int, ...] = ()) -> _Search:
    search = _Search(setting, touch, points, points, aside)
    for row in touch.rows:
        search = search.add(reduced(row)[1], "sigma = 0 of its boundary controls")
    sigmas = {i: Link(switching_row(setting.problem, i), casadi.SX(1), -1) for i in setting.singular}
    return replace(search, now={i: (link, link.row, []) for i, link in sigmas.items()})


def _followed(search: _Search, budget: list[int]) -> _Search:
    """Return the search with all links solved, by the first way of going on that leads there; depth first."""
    if not search.now and search.left:
        search = _differentiated(search)
    if not search.now:
        return _solvable(search)
    for begin in _aside(search):
        with suppress(Lost):  # what it comes to says nothing of the points at hand
            return _followed(begin(), budget)
    lost: Lost | None = None
    for step in _ways(search):
        if budget[0] <= 0:
            break
        budget[0] -= 1
        try:
            return _followed(step(), budget)
        except Lost as error:
            lost = lost or error
    raise lost or _nothing(search)


def _sorted(search: _Search) -> tuple[np.ndarray, np.ndarray]:
    """Tell at which points (n,) the next link holds a singular control, and at which others its rest does not vanish."""
    _, rest, slopes = next(iter(search.now.values()))
    if not slopes:  # sigma itself
        return np.zeros(search.points.shape[1], dtype=bool), np.ones(search.points.shape[1], dtype=bool)
    held = search.real(slopes).any(axis=1)
    return held, ~held & search.real([rest])[:, 0]


def _aside(search: _Search) -> Iterator[Callable[[], _Search]]:
    """Yield the search begun anew with one costate zero, where at most points nothing is left of the next link.

    The gradient of a conserved quantity may be added to every costate, and alone it satisfies everything: so one
    costate may be put to zero, the largest at these points.
    """
    _, rest, slopes = next(iter(search.now.values()))
    held, open_ = _sorted(search)
    if held.sum() + open_.sum() >= search.points.shape[1] / 2 or len(search.aside) >= _ASIDES:
        return
    j = _largest(search, ~held & ~open_)
    proved = closed(search.setting, search.touch, search.rows, [rest, *slopes])
    if homogeneous(search.setting.problem) and j not in search.aside and not proved:
        yield lambda: _begun(search.setting, search.touch, search.start, (*search.aside, j))


def _ways(search: _Search) -> Iterator[Callable[[], _Search]]:
    """Yield what may be next on the branches that the points lie on, that of most points first.

    Points at which neither the controls nor the rest of the derivative is left, such as a costate that vanishes, decide
    nothing where there are others.
    """
    i, (link, rest, slopes) = next(iter(search.now.items()))
    later = {k: each for k, each in search.now.items() if k != i}
    held, open_ = _sorted(search)
    depth = link.depth + 1

    def solved() -> _Search:
        done = {**search.solved, i: (rest, slopes, replace(link, row=rest, depth=depth))}
        return replace(search, points=search.points[:, held], now=later, solved=done)

    def vanishing(factor: Expr, row: Expr) -> Callable[[], _Search]:
        def step() -> _Search:
            name = search.setting.problem.control_names[i]
            what = f"sigma_{name}^({depth}) = 0" if depth else f"sigma_{name} = 0"
            found = search.add(row, what, search.points[:, open_])
            return replace(found, now=later, left={**search.left, i: Link(row, link.factor * factor, depth)})

        return step

    on = [vanishing(*each) for each in _factored(search, rest)] if open_.any() else []
    enough = [solved] if held.sum() >= _QUORUM else []
    yield from (enough + on if held.sum() >= open_.sum() else on + enough)


def _largest(search: _Search, which: np.ndarray) -> int:
    """Return the state whose costate is the largest at some points (n,), each costate measured by how it spreads."""
    nx, first = search.setting.problem.x.numel(), 1 + search.setting.problem.x.numel() + search.setting.problem.p.numel()
    size = sampled.spread(search.setting.problem)[first : first + nx]
    return int(np.argmax(np.median(np.abs(search.points[first : first + nx, which]), axis=1) / size))


def _factored(search: _Search, row: Expr) -> Iterator[tuple[Expr, Expr]]:
    """Yield (factor, row) for every way in which a row may vanish: without its common factor, then the factor itself."""
    factor, short = reduced(row)
    yield factor, short
    if not factor.is_constant():
        alone = casadi.SX(1, row.numel())
        alone[row.numel() - 1] = factor
        yield casadi.mtimes(short, extended(search.setting.problem)), casadi.sparsify(alone)


def _nothing(search: _Search) -> Lost:
    """Return the error of a link that vanishes at all points: whether that is proved, or only all that was found."""
    i, (link, rest, slopes) = next(iter(search.now.items()))
    name, depth, count = search.setting.problem.control_names[i], link.depth + 1, search.points.shape[1]
    if closed(search.setting, search.touch, search.rows, [rest, *slopes]):
        return Lost(
            f"{search.setting.name()}: sigma_{name} vanishes with all its derivatives from the {_nth(depth)} on, and "
            "no singular control appears in them (infinite order): the principle leaves the control open"
        )
    return Lost(
        f"{search.setting.name()}: no law was found: at all {count} points found on sigma_{name} = 0 and its "
        f"derivatives the {_nth(depth)} vanishes too, which proves nothing"
    )


def _nth(k: int) -> str:
    return {1: "1st", 2: "2nd", 3: "3rd"}.get(k, f"{k}th")


def _differentiated(search: _Search) -> _Search:
    """Return the search with the derivatives of all links as the next to follow, Goh's condition required of them."""
    setting, links = search.setting, search.left
    for i, link in links.items():
        if setting.varying.numel() and casadi.depends_on(link.row, setting.varying):
            raise MethodError(
                f"{setting.name()}: the law of '{setting.problem.control_names[i]}' depends on the rate of change of a "
                "free control"
            )
    depth = next(iter(links.values())).depth + 1
    if depth > DEEPEST:
        raise Lost(f"{setting.name()}: no law was found: no singular control appears in {DEEPEST} derivatives")
    split = {i: _split(search, link) for i, link in links.items()}
    if depth % 2:
        search = _goh(search, [slope for _, slopes in split.values() for slope in slopes], depth)
    return replace(search, left={}, now={i: (links[i], *split[i]) for i in links})


def _split(search: _Search, link: Link) -> tuple[Expr, list[Expr]]:
    """Return the derivative of a link as (row without the singular controls, rows of their coefficients)."""
    unknown = search.setting.unknown
    row = search.touch.flow.of_row(link.row)
    slopes = casadi.jacobian(row.T, unknown)
    rest = casadi.substitute(row, unknown, casadi.SX.zeros(unknown.numel(), 1))
    return rest, [
        casadi.substitute(slopes[:, k].T, unknown, casadi.SX.zeros(unknown.numel(), 1)) for k in range(unknown.numel())
    ]


def _goh(search: _Search, slopes: list[Expr], depth: int) -> _Search:
    """Require the coefficients of singular controls in odd derivatives to vanish, as a minimum needs (Goh, Robbins).

    They vanish all along the arc, so their derivatives do; one that holds a singular control ends this.
    """
    what = f"Goh's condition on the sigma^({depth})"
    for slope in slopes:
        row = slope
        while search.goh < DEEPEST and search.holds([row]):
            if search.solved:
                name = search.setting.name()
                raise MethodError(f"{name}: singular controls of different orders act on each other; not derived")
            row = reduced(row)[1]
            search = search.add(row, what)
            search = replace(search, goh=search.goh + 1)
            rest, held = _split(search, Link(row, casadi.SX(1)))
            if search.holds(held):
                break
            row = rest
    return search


def _solvable(search: _Search) -> _Search:
    """Return a finished search whose conditions determine the controls, at its points where they do."""
    slopes = [search.solved[i][1] for i in search.setting.singular]
    names = search.setting.problem.control_names
    odd = [names[i] for i in search.setting.singular if search.solved[i][2].depth % 2]
    matrix = sampled.evaluator(search.setting.problem, matrix_of(slopes, extended(search.setting.problem)))
    regular = sampled.real(search.setting.problem, lambda at: np.linalg.det(matrix(at)[0]), search.points)
    if odd or not regular.any():
        raise Lost(
            f"{search.setting.name()}: the conditions hold these controls but do not determine them "
            f"({'odd order of ' + odd[0] if odd else 'their matrix is singular everywhere: vanishing denominator'})"
        )
    return replace(search, points=search.points[:, regular])


def matrix_of(slopes: list[list[Expr]], z: Expr) -> Expr:
    """Return the matrix (k, k) of rows times z."""
    return casadi.vertcat(*(casadi.horzcat(*(casadi.mtimes(row, z) for row in line)) for line in slopes))

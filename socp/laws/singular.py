"""Singular arcs: differentiate the switching functions until the controls appear, and solve for
them.
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import final

import casadi
import numpy as np

from socp.laws import probes
from socp.laws.brackets import extended_costate
from socp.laws.invariant import spans
from socp.laws.links import Link, LostError, Search, begun, differentiate
from socp.laws.setting import Contact, Setting, common_factor, equations, homogeneous
from socp.model import Expr, Problem, column, once

_QUORUM = 2  # points at which a control has to appear: one might be chance
_ASIDES = 3  # costates at most that are put aside: conserved quantities of one problem
_BRANCHES = 24  # ways of going on that are tried from one set of points


@final
@dataclass(frozen=True, eq=False)
class Derivatives:
    """What the singular controls of an arc satisfy.

    `rows` (each (1, nx + 1)) vanish on the arc; the controls solve `slopes` u = -`rest`, entries
    [k][l] and [k] being rows, from sigma_k^(2 q_k) / factors[k]; `orders` are the q_k; `goh` counts
    the rows that come from Goh's condition; `points` (nv, n) lie on the arc's surface.
    """

    rows: list[Expr]
    rest: list[Expr]
    slopes: list[list[Expr]]
    factors: list[Expr]
    orders: list[int]
    goh: int
    points: np.ndarray


def derivatives(setting: Setting, touch: Contact, tried: int | None = None) -> Derivatives:
    """Differentiate sigma of every singular control until singular controls appear in all of them.

    Where the surface of the conditions has several branches, each is followed until one shows a
    law. Raises MethodError, naming the case, where no control appears, proved to be so or not, no
    point satisfies the conditions, the controls do not follow from them, or a control that varies
    freely would have to be differentiated. Where so many sets of noted points were `tried` before,
    and random ones, there are only the others to begin from.
    """
    first: LostError | None = None
    for points in _sources(setting.problem, tried):
        try:
            found = _followed(begun(setting, touch, points), [_BRANCHES])
        except LostError as error:
            first = first or error
            if first.proved:
                break
            continue
        parts = [found.solved[i] for i in setting.singular]
        return Derivatives(
            rows=list(found.rows),
            rest=[a for a, _, _ in parts],
            slopes=[b for _, b, _ in parts],
            factors=[link.factor for _, _, link in parts],
            orders=[link.depth // 2 for _, _, link in parts],
            goh=found.goh,
            points=found.points,
        )
    raise first or LostError(setting.name())


def at_values(
    chain: Derivatives, setting: Setting, touch: Contact, held: Sequence[Expr] = ()
) -> Derivatives | None:
    """Return what was derived for constant controls with the values that an arc gives them, `held`
    (each (1, nx + 1)) vanishing as well, None where it says less there: at too few points of its
    surface are the singular controls determined, and no factor that was divided by vanishes.
    """
    problem, points = setting.problem, chain.points.copy()
    known = {i: float(e) for i, e in enumerate(touch.control.elements()) if e.is_constant()}
    points[[i - problem.u.numel() for i in known]] = [[value] for value in known.values()]
    lines = casadi.horzcat(*_lines(chain), *chain.factors)
    if casadi.depends_on(lines, column(problem.u[i] for i in known)):
        chain = _valued(chain, problem, touch.control)
    rows = [*held, *chain.rows]
    points = probes.onto(
        problem, equations(setting, touch, rows), points, interior=not setting.boundary
    )
    matrix = _decisive(chain, problem)

    def decisive(at: np.ndarray) -> np.ndarray:
        system, divided = matrix(at)
        return np.column_stack([np.linalg.det(system), divided[:, :, 0]])

    there = points[:, probes.real(problem, decisive, points).all(axis=1)]
    return replace(chain, rows=rows, points=there) if there.shape[1] >= _QUORUM else None


def _lines(chain: Derivatives) -> list[Expr]:
    return [*chain.rows, *chain.rest, *(each for line in chain.slopes for each in line)]


def _valued(chain: Derivatives, problem: Problem, control: Expr) -> Derivatives:
    """Return what was derived with controls (nu, 1) put in."""
    k, first = len(chain.rest), len(chain.rows)
    whole, factors = casadi.substitute(
        [casadi.vertcat(*_lines(chain)), casadi.vertcat(*chain.factors)], [problem.u], [control]
    )
    rows = casadi.vertsplit(casadi.sparsify(whole))
    slopes = [rows[first + (i + 1) * k : first + (i + 2) * k] for i in range(k)]
    return replace(
        chain,
        rows=rows[:first],
        rest=rows[first : first + k],
        slopes=slopes,
        factors=casadi.vertsplit(factors),
    )


@once
def _decisive(chain: Derivatives, problem: Problem) -> probes.Evaluate:
    """Return the function of points that gives the matrix of the singular controls, and the factors
    that were divided by.
    """
    matrix = matrix_of(chain.slopes, extended_costate(problem))
    return probes.evaluator(problem, matrix, casadi.vertcat(*chain.factors))


def along_constraints(chain: Derivatives, setting: Setting, touch: Contact) -> Derivatives | None:
    """Return what was derived for constant controls where some of them are so on state constraints,
    None where it says less there, or something else.

    lambda' = -H_x - sum mu dc/dx differs from what it was derived with in the multipliers alone:
    they leave the derivatives of rows that have no part along any dc/dx as they are.
    """
    problem = setting.problem
    slopes = casadi.jacobian(column(c.expression for c in setting.boundary.values()), problem.x)
    pulls = casadi.mtimes(casadi.vertcat(*chain.rows)[:, : problem.x.numel()], slopes.T)
    if casadi.sparsify(pulls).nnz():
        return None
    return at_values(chain, setting, touch, [common_factor(row)[1] for row in touch.rows])


def _sources(problem: Problem, tried: int | None) -> Iterator[np.ndarray]:
    """Yield points (nv, n) to begin from: those that solutions show, random ones, and many of them
    scattered widely; those alone that were noted since so many were `tried` with the random ones.
    """
    noted = probes.noted_points(problem)  # the latest first
    if tried is not None and tried < len(noted):
        yield from noted[: len(noted) - tried]
        return
    yield from noted
    yield probes.admissible(problem)
    yield probes.scattered_points(problem)


def _followed(search: Search, budget: list[int]) -> Search:
    """Return the search with all links solved, by the first way of going on that leads there; depth
    first.
    """
    if not search.now and search.left:
        search = differentiate(search)
    if not search.now:
        return _solvable(search)
    held, left = _sorted(search)
    for begin in _aside(search, ~held & ~left):
        with suppress(LostError):  # what it comes to says nothing of the points at hand
            return _followed(begin(), budget)
    lost: LostError | None = None
    for step in _ways(search, held, left):
        if budget[0] <= 0:
            break
        budget[0] -= 1
        try:
            return _followed(step(), budget)
        except LostError as error:  # proved only where it is on every branch
            lost = error if lost is None or lost.proved else lost
    raise lost or _nothing(search, int(held.sum()))


def _sorted(search: Search) -> tuple[np.ndarray, np.ndarray]:
    """Tell at which points (n,) the next link holds a singular control, and at which others its
    rest is left.
    """
    _, rest, slopes = next(iter(search.now.values()))
    if not slopes:  # sigma itself
        return np.zeros(search.points.shape[1], dtype=bool), np.ones(
            search.points.shape[1], dtype=bool
        )
    found = search.real([*slopes, rest])
    held: np.ndarray = np.any(found[:, :-1], axis=1)
    left: np.ndarray = ~held & found[:, -1]
    return held, left


def _aside(search: Search, empty: np.ndarray) -> Iterator[Callable[[], Search]]:
    """Yield the search begun anew with one costate zero, where the next link is `empty` (n,) at
    most points.

    The gradient of a conserved quantity may be added to every costate, and alone it satisfies
    everything: so one costate may be put to zero, the largest at these points.
    """
    if (
        empty.mean() <= 0.5
        or len(search.aside) >= _ASIDES
        or not homogeneous(search.setting.problem)
    ):
        return
    j = _largest(search, empty)
    if j not in search.aside and not _closed(search):
        yield lambda: begun(search.setting, search.touch, search.start, (*search.aside, j))


def _ways(search: Search, held: np.ndarray, open_: np.ndarray) -> Iterator[Callable[[], Search]]:
    """Yield what may be next on the branches that the points lie on, that of most points first.

    Points at which neither the controls nor the rest of the derivative is left, such as a costate
    that vanishes, decide nothing where there are others.
    """
    i, (link, rest, slopes) = next(iter(search.now.items()))
    later = {k: each for k, each in search.now.items() if k != i}
    depth = link.depth + 1

    def solved() -> Search:
        done = {**search.solved, i: (rest, slopes, replace(link, row=rest, depth=depth))}
        return replace(search, points=search.points[:, held], now=later, solved=done)

    def vanishing(factor: Expr, row: Expr) -> Callable[[], Search]:
        def step() -> Search:
            name = search.setting.problem.control_names[i]
            what = f"sigma_{name}^({depth}) = 0" if depth else f"sigma_{name} = 0"
            found = search.add(row, what, search.points[:, open_])
            return replace(
                found, now=later, left={**search.left, i: Link(row, link.factor * factor, depth)}
            )

        return step

    on = [vanishing(*each) for each in _factored(search, rest)] if open_.any() else []
    enough = [solved] if held.sum() >= _QUORUM else []
    yield from (enough + on if held.sum() >= open_.sum() else on + enough)


def _largest(search: Search, which: np.ndarray) -> int:
    """Return the state whose costate is the largest at some points (n,), each costate measured by
    how it spreads.
    """
    problem = search.setting.problem
    nx, first = problem.x.numel(), 1 + problem.x.numel() + problem.p.numel()
    size = probes.spread(problem)[first : first + nx]
    return int(
        np.argmax(np.median(np.abs(search.points[first : first + nx, which]), axis=1) / size)
    )


def _factored(search: Search, row: Expr) -> Iterator[tuple[Expr, Expr]]:
    """Yield (factor, row) for every way in which a row may vanish: without its common factor, then
    that factor.
    """
    factor, short = common_factor(row)
    yield factor, short
    if not factor.is_constant():
        alone = casadi.SX(1, row.numel())
        alone[row.numel() - 1] = factor
        yield casadi.mtimes(short, extended_costate(search.setting.problem)), casadi.sparsify(alone)


def _nothing(search: Search, held: int) -> LostError:
    """Return the error of a link of which nothing is left: whether that is proved, or only all that
    was found.

    At `held` points there was a control, too few to believe in it.
    """
    i, (link, _, _) = next(iter(search.now.items()))
    name, depth, count = (
        search.setting.problem.control_names[i],
        _nth(link.depth + 1),
        search.points.shape[1],
    )
    if _closed(search):
        return LostError(
            f"{search.setting.name()}: sigma_{name} vanishes with all its derivatives from the "
            f"{depth} on, and no singular control appears in them (infinite order): the principle "
            "leaves the control open",
            proved=True,
        )
    return LostError(
        f"{search.setting.name()}: no law was found: at {count - held} of {count} points found on "
        f"sigma_{name} = 0 and its derivatives the {depth} vanishes too, which proves nothing"
    )


def _closed(search: Search) -> bool:
    _, rest, slopes = next(iter(search.now.values()))
    return spans(search.setting, search.touch, search.rows, [rest, *slopes])


def _nth(k: int) -> str:
    return {1: "1st", 2: "2nd", 3: "3rd"}.get(k, f"{k}th")


def _solvable(search: Search) -> Search:
    """Return a finished search whose conditions determine the controls, at its points where they
    do.
    """
    names = search.setting.problem.control_names
    odd = [names[i] for i in search.setting.singular if search.solved[i][2].depth % 2]
    where = _determined(
        search.setting, [search.solved[i][1] for i in search.setting.singular], search.points
    )
    if odd or not where.any():
        why = (
            f"odd order of {odd[0]}"
            if odd
            else "their matrix is singular everywhere: vanishing denominator"
        )
        raise LostError(
            f"{search.setting.name()}: the conditions hold these controls but do not determine "
            f"them ({why})"
        )
    return replace(search, points=search.points[:, where])


def regular(setting: Setting, chain: Derivatives, points: np.ndarray) -> np.ndarray:
    """Tell at which points (n,) of the surface a chain determines its controls: on trivial branches
    it does not.
    """
    return _determined(setting, chain.slopes, points)


def _determined(setting: Setting, slopes: list[list[Expr]], points: np.ndarray) -> np.ndarray:
    matrix = probes.evaluator(setting.problem, matrix_of(slopes, extended_costate(setting.problem)))
    return probes.real(setting.problem, lambda at: np.linalg.det(matrix(at)[0]), points)


def matrix_of(slopes: list[list[Expr]], z: Expr) -> Expr:
    """Return the matrix (k, k) of rows times z."""
    k, values = len(slopes), casadi.mtimes(column(row for line in slopes for row in line), z)
    return casadi.reshape(values, k, k).T if k > 1 else values

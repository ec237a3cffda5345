"""The mixed-binary reduction: arcs that choose their modes by binaries, given only the number of
switches.

After Foroozandeh, de Pinho and Shamsi, DCDS-B 24(5) 2019, doi:10.3934/dcdsb.2019092, (13)-(18):
there every control has two binaries an arc, for its lower and its upper bound, and a singular
feedback law where both are 0.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise, product
from typing import final

import casadi
import numpy as np

from socp import laws
from socp.errors import MethodError
from socp.laws import admissible, arc_modes, evaluator
from socp.model import Expr, Mode, Modes, Problem, column, once, time
from socp.search.integer.bounds import enclosures
from socp.transcription import Choice, Phase, PhasedProblem, Row

_SAME = 1e-9  # relative: two formulas of one law differ by rounding
_LAST = (
    "boundary",
    "lower",
    "upper",
    "singular",
)  # the last mode is the one without a binary, the paper's singular


def binary_modes(
    problem: Problem, switches: int, *, collocated: bool = False, boxed: bool = True
) -> PhasedProblem:
    """Return the problem on `switches` + 1 arcs of free lengths, each of which chooses its modes by
    binaries.

    A control has one binary for every mode but its last, and the control is the sum of its laws
    times their shares. With `collocated`, controls stay variables instead, held to the law of the
    chosen mode by big-M rows, which suits solvers that relax globally; `boxed` keeps the laws'
    values within the control's bounds.

    Combinations of modes without a law are excluded, and so are equal neighbours: an arc that is
    not needed shrinks to length zero. Raises MethodError for a negative number of switches, or
    where no combination of modes has a law.
    """
    if switches < 0:
        raise MethodError(f"switches={switches}: a problem has 0 switches or more")
    menu = _menu(problem)
    if not menu.combinations:
        raise MethodError(
            f"problem '{problem.name}': no combination of modes has a law, so no arc has a choice"
        )
    phases = tuple(_phase(menu, k, collocated=collocated, boxed=boxed) for k in range(switches + 1))
    rules = [rule for phase in phases if phase.choice for rule in _rules(menu, phase.choice)]
    rules += [
        rule
        for a, b in pairwise(phases)
        if a.choice and b.choice
        for rule in _differ(menu, a.choice, b.choice)
    ]
    return PhasedProblem(problem, phases, tuple(rules))


@once
def _menu(problem: Problem) -> "_Menu":
    """Return the menu of a problem; it is made once, since comparing laws takes its time."""
    return _Menu(problem, arc_modes(problem))


@final
@dataclass(frozen=True, eq=False)
class _Menu:
    """The modes of every control, and the laws of their combinations."""

    problem: Problem
    combinations: tuple[Modes, ...]

    @cached_property
    def modes(self) -> tuple[tuple[Mode, ...], ...]:
        """Modes of every control that are part of some combination, the one without a binary
        last.
        """
        count = len(self.problem.control_names)
        return tuple(
            tuple(
                sorted(
                    {c[i] for c in self.combinations},
                    key=lambda m: (_LAST.index(m.kind), m.constraint or ""),
                )
            )
            for i in range(count)
        )

    @cached_property
    def at(self) -> np.ndarray:
        """Admissible points at which laws are compared."""
        return admissible(self.problem)

    @cached_property
    def laws(self) -> tuple[tuple["_Law", ...], ...]:
        """The laws of every control."""
        return tuple(tuple(_laws(self, i)) for i in range(len(self.modes)))

    @cached_property
    def box(self) -> np.ndarray:
        """Bounds of states, time and parameters (2, nx + 1 + np)."""
        times = [[self.problem.initial_time_box[0]], [self.problem.final_time_box[1]]]
        return np.hstack([self.problem.state_box, times, self.problem.parameter_box])

    def span(self, expression: Expr) -> np.ndarray:
        """Return an interval (2,) of an expression of x, t, p; infinite where it holds anything
        else.
        """
        symbols = casadi.vertcat(self.problem.x, time, self.problem.p)
        if casadi.symvar(casadi.substitute(expression, symbols, 0)):
            return np.array([-np.inf, np.inf])
        return enclosures(casadi.SX(expression), symbols, self.box)[:, 0]

    def inside(self, i: int, law: Expr) -> bool:
        """Tell whether a law of control i is bound to stay in the control's box."""
        low, high = self.span(law)
        return bool(self.problem.box[0, i] <= low and high <= self.problem.box[1, i])

    def same(self, a: Expr, b: Expr) -> bool:
        """Tell whether two laws have the same values."""
        if casadi.is_equal(casadi.SX(a), casadi.SX(b), 5):
            return True
        if any(casadi.depends_on(e, self.problem.costate) for e in (a, b)):
            return False  # where the costate is on neither's surface their values say nothing
        x, y = (v.ravel() for v in evaluator(self.problem, casadi.SX(a), casadi.SX(b))(self.at))
        ok = np.isfinite(x) & np.isfinite(y)
        return bool(ok.any() and (np.abs(x - y)[ok] <= _SAME * (1.0 + np.abs(x[ok]))).all())


@final
@dataclass(frozen=True, eq=False)
class _Law:
    """A law that control holds where the controls in `of` are in `modes`, whatever the others
    do.
    """

    of: tuple[int, ...]
    modes: Modes
    control: Expr

    def share(self, weights: Sequence[Sequence[Expr]], menu: _Menu) -> Expr:
        """Return 1 where the arc is in these modes, as a product of shares."""
        return _share(menu, weights, self.of, self.modes)


def _share(menu: _Menu, weights: Sequence[Sequence[Expr]], of: Sequence[int], modes: Modes) -> Expr:
    share = casadi.SX(1)
    for i, mode in zip(of, modes, strict=True):
        share *= weights[i][menu.modes[i].index(mode)]
    return share


def _laws(menu: _Menu, i: int) -> Iterator[_Law]:
    """Yield the laws of control i, each with as few other controls as decide on it."""
    for mode in menu.modes[i]:
        mine = [c for c in menu.combinations if c[i] == mode]
        control = {c: laws.arc_law(menu.problem, c).control[i] for c in mine}
        of = _deciding(menu, i, mine, control)
        met: dict[Modes, Expr] = {}
        for c in mine:
            met.setdefault(tuple(c[j] for j in of), control[c])
        for modes, law in met.items():
            yield _Law(of, modes, law)


def _deciding(
    menu: _Menu, i: int, mine: list[Modes], control: dict[Modes, Expr]
) -> tuple[int, ...]:
    """Return control i and the others on whose modes its law depends."""
    of = [i]
    for j in range(len(menu.modes)):
        groups: dict[Modes, list[Expr]] = {}
        for c in mine:
            groups.setdefault(tuple(m for k, m in enumerate(c) if k != j), []).append(control[c])
        if j != i and not all(
            menu.same(each[0], other) for each in groups.values() for other in each[1:]
        ):
            of.append(j)
    return tuple(of)


def _phase(menu: _Menu, k: int, *, collocated: bool, boxed: bool) -> Phase:
    problem, count = menu.problem, len(menu.modes)
    z = casadi.SX.sym(f"z{k}", sum(len(own) - 1 for own in menu.modes))
    weights, used = [], 0
    for own in menu.modes:
        mine = [z[used + m] for m in range(len(own) - 1)]
        weights.append((*mine, 1 - sum(mine) if mine else casadi.SX(1)))
        used += len(mine)
    control = column(
        casadi.sum1(column(law.share(weights, menu) * law.control for law in menu.laws[i]))
        for i in range(count)
    )
    carried, costates = _carried(menu, weights)
    entry = tuple(_entries(menu, weights)) + costates
    menu_of = {"modes": menu.modes, "weights": tuple(weights)}
    if collocated:
        choice = Choice(z=z, **menu_of, along=tuple(_held(menu, weights)), entry=entry)
        free = {
            "modes": (Mode("free"),) * count,
            "control": problem.u,
            "free": problem.u,
            "box": problem.box,
        }
        return Phase(**free, choice=choice, **carried)
    curved = [
        i
        for i in range(count)
        if boxed and not all(menu.inside(i, law.control) for law in menu.laws[i])
    ]
    along = tuple((control[i], float(problem.box[0, i]), float(problem.box[1, i])) for i in curved)
    choice = Choice(z=z, **menu_of, along=along, entry=entry)
    given = {
        "modes": menu.combinations[0],
        "control": control,
        "free": column(()),
        "box": np.zeros((2, 0)),
    }
    return Phase(**given, choice=choice, **carried)


def _held(menu: _Menu, weights: Sequence[Sequence[Expr]]) -> Iterator[Row]:
    """Yield rows that hold collocated controls to the laws of the chosen modes."""
    for i, own in enumerate(menu.laws):
        for law in own:
            low, high = menu.problem.box[:, i]
            span, off = menu.span(law.control), menu.problem.u[i] - law.control
            yield from _bound(off, (low - span[1], high - span[0]), law.share(weights, menu))


def _bound(value: Expr, span: tuple[float, float], share: Expr) -> Iterator[Row]:
    """Yield rows that make a value within a span vanish where a share is 1: big-M, or a product
    where none is known.
    """
    low, high = map(float, span)
    if not np.isfinite([low, high]).all():
        yield value * share, 0.0, 0.0
        return
    if low < 0:
        yield value - low * (1 - share), 0.0, np.inf
    if high > 0:
        yield value - high * (1 - share), -np.inf, 0.0


def _entries(menu: _Menu, weights: Sequence[Sequence[Expr]]) -> Iterator[Row]:
    """Yield rows that put the entry of a boundary arc onto its constraint, and its derivatives to
    zero.
    """
    for constraint in menu.problem.constraints:
        followers = [
            weights[i][m]
            for i, own in enumerate(menu.modes)
            for m, mode in enumerate(own)
            if mode.kind == "boundary" and mode.constraint == constraint.name
        ]
        for share in followers:
            for order, value in enumerate(laws.tower(menu.problem, constraint)[0]):
                low, high = menu.span(value)
                yield from _bound(value, (low, min(high, 0.0) if order == 0 else high), share)


def _carried(
    menu: _Menu, weights: Sequence[Sequence[Expr]]
) -> tuple[dict[str, Expr], tuple[Row, ...]]:
    """Return the costate with its rate, where some law needs it, and the rows that fix it at the
    arc's entry.
    """
    every = range(len(menu.modes))
    found = [(c, law) for c in menu.combinations if (law := laws.arc_law(menu.problem, c)).costate]
    if not found:
        return {}, ()
    rate = sum(_share(menu, weights, every, c) * law.costate_rate for c, law in found)
    rows = [
        (_share(menu, weights, every, c) * e, 0.0, 0.0)
        for c, law in found
        for e in law.costate_entry
    ]
    return {"carried": menu.problem.costate, "carried_rate": rate}, tuple(rows)


def _rules(menu: _Menu, choice: Choice) -> Iterator[Row]:
    """Yield rows in the binaries of one arc: one mode a control, none of the combinations without a
    law.
    """
    for own in choice.weights:
        if len(own) > 2:
            yield 1 - own[-1], -np.inf, 1.0
    for modes in product(*menu.modes):
        if modes not in menu.combinations:
            taken = [choice.weights[i][menu.modes[i].index(mode)] for i, mode in enumerate(modes)]
            yield casadi.sum1(column(taken)), -np.inf, len(taken) - 1.0


def _differ(menu: _Menu, before: Choice, after: Choice) -> Iterator[Row]:
    """Yield rows that forbid equal neighbours: they would be one arc, cut at any time."""
    for modes in menu.combinations if len(menu.combinations) > 1 else ():
        places = [menu.modes[i].index(mode) for i, mode in enumerate(modes)]
        taken = [each.weights[i][m] for each in (before, after) for i, m in enumerate(places)]
        yield casadi.sum1(column(taken)), -np.inf, len(taken) - 1.0

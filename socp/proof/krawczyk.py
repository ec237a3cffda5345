"""Krawczyk's test on the equations of a word: in a box of unknowns there is exactly one solution.

For F with derivative in DF(Z) over the box Z around y, and any regular Y, the set
K = y - Y F(y) + (I - Y DF(Z)) (Z - y) contains every zero of F in Z; where K lies in the interior
of Z there is one, and no other (Krawczyk, Computing 4, 1969; Moore, SIAM J. Numer. Anal. 14, 1977).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property
from typing import Any, final

import casadi

from socp.errors import SolveError
from socp.model import Expr, column
from socp.proof.balls import Ball, Compiled, Matrix, ball, balls_of, compiled, finite, flint
from socp.proof.chain import Chain
from socp.proof.flow import Motion, Stage, State, passage, shares
from socp.proof.linear import identity

# Of the precision: what a step may add to an enclosure. With 128 bits 1e-22, so that some hundred
# steps add less than 1e-19; the rest of the bits is for what the motion makes of it
_SMALL = 0.57
_FAR = 4.0  # times the step before: Newton that goes further goes anywhere
_NEWTON = 8  # steps: from ten digits two or three lead to all that the precision has
# Newton ends with a step below this: it squares what it leaves, down to rounding
_QUADRATIC = 1e-6
_ROUNDED = 24  # bits of the precision that a box is wide at least: rounding is a few
_AROUND = 4  # a box in units of the last Newton step: its image has to fit with room to spare
# Of the precision: how wide the box that is tried first is where its unknown moves most with what
# is left. With 128 bits 1e-14: more than what remainders come to on most ways, and little enough
# to blur no sign
_FIRST = 0.36
_BOXES = 3  # that are tried: the first, one that tells how wide it has to be, and that one


@final
@dataclass(frozen=True, eq=False)
class Run:
    """The equations over a box of unknowns: what they leave in its middle (m,), their derivative
    (m, m), the stages of every piece's motion, and z at the beginning and at every joint.
    """

    left: list[Ball]
    slope: Matrix
    stages: tuple[tuple[Stage, ...], ...]
    corners: tuple[list[Ball], ...]
    states: tuple[State, ...]


@final
@dataclass(frozen=True, eq=False)
class Shot:
    """The equations of a chain as functions of balls."""

    chain: Chain

    @cached_property
    def values(self) -> dict[Expr, Any]:
        """The problem's numbers as balls, by symbol."""
        self.chain.joints, self.chain.ends, self.chain.first  # noqa: B018 - they make numbers
        return {symbol: ball(each) for symbol, each in self.chain.system.numbers.values.items()}

    @cached_property
    def motions(self) -> list[Motion]:
        """The motion of every piece."""
        known: dict[Any, Motion] = {}
        found = []
        for piece in self.chain.pieces:
            key = (piece.loop.modes, tuple(piece.signs.values()))
            if key not in known:
                known[key] = Motion.of(piece.loop.field, self.chain.system.z, self.at(piece.signs))
            found.append(known[key])
        return found

    def at(self, signs: Mapping[Expr, int]) -> dict[Expr, Any]:
        """Return the numbers with signs of kinks beside them."""
        return {**self.values, **{s: flint().arb(sign) for s, sign in signs.items()}}

    @cached_property
    def _joints(self) -> list[tuple[Compiled, Compiled]]:
        z = self.chain.system.z
        found: list[tuple[Compiled, Compiled]] = []
        for piece, rows in zip(self.chain.pieces, self.chain.joints, strict=True):
            both = column(rows), casadi.vec(casadi.jacobian(column(rows), z).T)
            values = self.at(piece.signs)
            found.append((compiled(both[0], z, values), compiled(both[1], z, values)))
        return found

    @cached_property
    def _ends(self) -> tuple[Compiled, Compiled]:
        system, rows = self.chain.system, column(self.chain.ends)
        given = casadi.vertcat(system.z, system.start, self.chain.nu)
        both = rows, casadi.vec(casadi.jacobian(rows, given).T)
        values = self.at(self.chain.pieces[-1].signs)
        return compiled(both[0], given, values), compiled(both[1], given, values)

    def begin(self, y: Sequence[Ball]) -> list[Ball]:
        """Return z at the initial time."""
        chain, arb = self.chain, flint().arb
        count = chain.system.x.numel()
        free = dict(zip(chain.free, y[count : count + len(chain.free)], strict=True))
        exact = compiled(
            casadi.vertcat(*chain.first, chain.time0),
            column(()),
            {**self.values, **{chain.system.start[i]: value for i, value in free.items()}},
        )
        *x, t = [arb(0) if each is None else each for each in exact.call(())]
        return [*x, *y[:count], *[arb(0)] * chain.system.costs, t]

    def lengths(self, y: Sequence[Ball]) -> Sequence[Ball]:
        """Return the pieces' lengths among the unknowns."""
        first = self.chain.system.x.numel() + len(self.chain.free)
        return y[first : first + len(self.chain.pieces)]

    def shares(self, y: Sequence[Ball]) -> list[list[Fraction]]:
        """Return steps for every piece, from unknowns without radius."""
        z, found = [each.mid() for each in self.begin(y)], []
        for motion, length in zip(self.motions, self.lengths(y), strict=True):
            if not length > 0:
                raise SolveError("an arc has no length")
            its, z = shares(motion, z, length, 2.0 ** (-_SMALL * flint().ctx.prec))
            found.append(its)
        return found

    def run(self, y: Sequence[Ball], steps: list[list[Fraction]], *, rough: bool = False) -> Run:
        """Return the equations over a box of unknowns; of a rough run nothing is an enclosure."""
        module, count, begin = flint(), len(y), self.begin(y)
        middle = [each.mid() for each in y]
        point = self.begin(middle)
        first = self.chain.system.x.numel()
        by_begin = module.arb_mat(len(begin), count)
        for k in range(first):
            by_begin[first + k, k] = 1
        for k, i in enumerate(self.chain.free):
            by_begin[i, first + k] = 1
        state = State.of(begin, by_begin, point)
        left, rows, stages, states = [], [], [], list[State]()
        pieces = zip(self.motions, self.lengths(y), self._joints, steps, strict=True)
        for k, (motion, length, (held, slopes), its) in enumerate(pieces):
            left += balls_of(held.call(state.point))
            rows += _rows(slopes.call(state.box), state.derivative)
            state, its_stages = passage(motion, state, length, its, rough=rough)
            state = state.lengthened(motion, first + len(self.chain.free) + k)
            stages.append(its_stages)
            states.append(state)
        first_nu = count - self.chain.nu.numel()
        nu, at = y[first_nu:], [*state.point, *point, *middle[first_nu:]]
        given, by = [*state.box, *begin, *nu], module.arb_mat(2 * len(begin) + len(nu), count)
        end = state.derivative
        for j in range(count):
            for i in range(len(begin)):
                by[i, j], by[len(begin) + i, j] = end[i, j], by_begin[i, j]
        for k in range(len(nu)):
            by[2 * len(begin) + k, count - len(nu) + k] = 1
        left += balls_of(self._ends[0].call(at))
        rows += _rows(self._ends[1].call(given), by)
        slope = module.arb_mat(count, count, [each for row in rows for each in row])
        corners = begin, *(each.box for each in states)
        return Run(left, slope, tuple(stages), corners, tuple(states))


def _rows(slopes: Sequence[Any], by: Matrix) -> list[list[Ball]]:
    """Return derivatives by the unknowns of functions whose slopes by z are given row by row."""
    values, n = balls_of(slopes), by.nrows()
    if not values:
        return []
    found = flint().arb_mat(len(values) // n, n, values) * by
    return [[found[i, j] for j in range(by.ncols())] for i in range(found.nrows())]


@final
@dataclass(frozen=True, eq=False)
class Proved:
    """The unknowns of the one solution in a box, the radius of the box, the norm of
    I - Y DF in units of the box, and the motion over the box.
    """

    unknowns: list[Ball]
    radius: float
    contraction: float
    run: Run
    steps: list[list[Fraction]]


def newton(shot: Shot) -> tuple[list[Ball], Matrix, list[list[Fraction]]]:
    """Return unknowns without radius that nearly solve the equations, an approximate inverse of
    their derivative, and the steps; SolveError where there are none.
    """
    arb = flint().arb
    y = [arb(float(value)) for value in shot.chain.guess]
    if not finite(y):
        raise SolveError("the result has no costates")
    steps = shot.shares(y)
    size = math.inf
    for _ in range(_NEWTON):
        run = shot.run(y, steps, rough=True)
        inverse = _inverse(run.slope)
        moved = _moved(inverse, run.left)
        before, size = size, _largest(moved)
        y = [arb((value - change).mid()) for value, change in zip(y, moved, strict=True)]
        if size <= _QUADRATIC:
            return y, inverse, steps
        if not size < _FAR * before:
            break
    raise SolveError("Newton does not settle on the word's equations")


def tested(shot: Shot) -> Proved:
    """Show that the equations have exactly one solution in a box around what Newton finds;
    SolveError where the test fails.

    Where the first box does not contain its image, the next one is as wide as that tells; where the
    motion over it is not enclosed, a narrow one tells.
    """
    module = flint()
    y, inverse, steps = newton(shot)
    least = module.arb(2.0 ** (_ROUNDED - module.ctx.prec))
    reach = [sum((each.abs_upper() for each in row), module.arb(0)) for row in inverse.tolist()]
    radii = [2.0 ** (-_FIRST * module.ctx.prec) * each / max(reach) for each in reach]
    for attempt in range(_BOXES):
        box = [module.arb(value.mid(), radius) for value, radius in zip(y, radii, strict=True)]
        try:
            run = shot.run(box, steps)
        except SolveError:
            if attempt:
                raise
            radii = [least] * len(y)
            continue
        inverse = _inverse(run.slope)
        change = _moved(inverse, run.left)
        found = _proved(y, radii, change, inverse, run, steps)
        if found is not None:
            return found
        y = [module.arb((a - b).mid()) for a, b in zip(y, change, strict=True)]
        radii = [_AROUND * module.arb(each.rad()) + least for each in change]
    raise SolveError("Krawczyk's test: the image of the box is not inside it")


def _proved(
    y: Sequence[Ball],
    radii: Sequence[Ball],
    change: Sequence[Ball],
    inverse: Matrix,
    run: Run,
    steps: list[list[Fraction]],
) -> Proved | None:
    """Return what the run over a box around y shows, None where the image is not inside the box."""
    module, count = flint(), len(y)
    rest = identity(count) - inverse * run.slope
    spread = rest * module.arb_mat(count, 1, [module.arb(0, radius) for radius in radii])
    off = [spread[i, 0] - d for i, d in enumerate(change)]
    room = [module.arb(0, radius) for radius in radii]
    if not finite(off) or not all(a.contains_interior(b) for a, b in zip(room, off, strict=True)):
        return None
    sums = [
        sum((rest[i, j].abs_upper() * radii[j] for j in range(count)), module.arb(0)) / radii[i]
        for i in range(count)
    ]
    image = [value + d for value, d in zip(y, off, strict=True)]
    moved = module.arb_mat(count, 1, off)
    corners = [run.corners[0], *(state.near(moved) for state in run.states)]
    return Proved(
        image,
        max(map(float, radii)),
        max(map(float, sums)),
        replace(run, corners=tuple(corners)),
        steps,
    )


def _inverse(slope: Matrix) -> Matrix:
    try:
        found = slope.mid().inv()
    except ZeroDivisionError:
        raise SolveError("the derivative of the word's equations is singular") from None
    return found.mid()


def _moved(inverse: Matrix, left: Sequence[Ball]) -> list[Ball]:
    if not finite(left):
        raise SolveError("the word's equations have no finite value")
    moved = inverse * flint().arb_mat(len(left), 1, list(left))
    return [moved[i, 0] for i in range(len(left))]


def _largest(values: Sequence[Ball]) -> float:
    return max(float(each.abs_upper()) for each in values)

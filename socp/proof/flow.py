"""Enclosures of a motion and of its derivatives: Taylor's formula with its remainder over a set
that is shown to contain the motion.

A step from z0 over a time h: a set B with z0 + [0, h] f(B) inside B contains the motion on it
(Picard); then z(h) lies in the sum of c_k(z0) h^k for k < p plus c_p(B) h^p, c_k the Taylor
coefficients (Moore, Interval Analysis, 1966). The derivative by z0 solves V' = A V and is enclosed
alike, over I +- (exp(a h) - 1), a the norm of A over B with weights (Gronwall). A set of states
moves by the mean value theorem: its middle by Taylor's formula, what is around it by the
derivative.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, final

import casadi

from socp.errors import SolveError
from socp.model import Expr, once
from socp.proof.balls import Ball, Compiled, Matrix, coefficients, compiled, finite, flint
from socp.proof.linear import around_one, evolved, horner, identity

ORDER = 24  # Taylor coefficients of the motion: steps get longer with more, and dearer
SLOPES = 12  # of its derivatives, which only have to be right to some digits
_DIRECT = 6  # coefficients by Picard's iteration: a few are had sooner so
_ROUNDS = 12  # until a set contains its own image: what takes more takes shorter steps
_WIDER = 1.1
_GRID = 1 << 20  # shares of an arc's length: steps are whole multiples of one of these
# Steps of an arc, at some hundredths of a second each: more take too long; and after how many their
# number is foreseen
_MANY, _SEEN = 4000, 200
_FINEST = 1 << 24  # shares of it: what is not enclosed in such a step will not be in a shorter one
_LOOSER = 1.1  # steps that were too long for an enclosure get longer by this again
_HALF = 2  # a step that is not enclosed is made in so many


@final
@dataclass(frozen=True, eq=False)
class Motion:
    """A motion z' = f(z) in balls: f, and the entries of its Jacobian that are not zero, by row and
    column.
    """

    size: int
    rate: Compiled
    slopes: Compiled
    places: tuple[tuple[int, int], ...]

    @classmethod
    def of(cls, field: Expr, z: Expr, values: dict[Expr, Any]) -> "Motion":
        """Compile a field (nz, 1) of symbols z (nz, 1)."""
        jacobian = casadi.sparsify(casadi.jacobian(field, z))
        rows, columns = jacobian.sparsity().get_triplet()
        entries = casadi.vertcat(casadi.SX(0, 1), *jacobian.nonzeros())
        places = tuple(zip(rows, columns, strict=True))
        return cls(z.numel(), compiled(field, z, values), compiled(entries, z, values), places)

    def value(self, z: Sequence[Ball]) -> list[Ball]:
        """Return f at balls."""
        return [flint().arb(0) if each is None else each for each in self.rate.call(z)]

    def series(self, z: Sequence[Ball], order: int) -> list[Any]:
        """Return the Taylor series of the motion from z, up to an order.

        Picard's iteration gives one coefficient a round; Newton's on the equation z' = f(z) twice
        as many (Brent and Kung, J. ACM 25, 1978).
        """
        orders = [order]
        while orders[-1] > _DIRECT:
            orders.append((orders[-1] + 1) // 2)
        found = self._direct(z, orders[-1])
        for known, wanted in zip(orders[:0:-1], orders[-2::-1], strict=True):
            found = self._doubled(found, known, wanted)
        return found

    def _direct(self, z: Sequence[Ball], order: int) -> list[Any]:
        module = flint()
        module.ctx.cap = order + 1
        found = constant = [module.arb_series([each]) for each in z]
        for k in range(order):
            module.ctx.cap = k + 1
            rates = self.rate.call(found)
            module.ctx.cap = order + 1
            found = [
                start if rate is None else start + module.arb_series(rate).integral()
                for start, rate in zip(constant, rates, strict=True)
            ]
        return found

    def _doubled(self, series: list[Any], known: int, wanted: int) -> list[Any]:
        """Return the series up to an order of at most twice the known one: what is added, d,
        satisfies d' = A d + f(z) - z' up to there.
        """
        module, size = flint(), self.size
        slopes = self.matrices(series, wanted - known)
        module.ctx.cap = wanted + 1  # of series with fewer coefficients the rest is not zero
        known_part = [coefficients(each, known + 1) for each in series]
        exact = [module.arb_series(each) for each in known_part]
        rates = [coefficients(each, wanted) for each in self.rate.call(exact)]
        added: list[Matrix] = []
        for j in range(known, wanted):
            total = module.arb_mat(size, 1, [each[j] for each in rates])
            for i, before in enumerate(reversed(added)):
                total = total + slopes[i] * before
            added.append(total * (module.arb(1) / (j + 1)))
        return [
            module.arb_series([*each, *(d[i, 0] for d in added)])
            for i, each in enumerate(known_part)
        ]

    def matrices(self, series: Sequence[Any], order: int) -> list[Matrix]:
        """Return the Taylor coefficients of the Jacobian along a series of the motion."""
        module = flint()
        module.ctx.cap = order
        entries = [coefficients(each, order) for each in self.slopes.call(series)]
        found = []
        for k in range(order):
            matrix = module.arb_mat(self.size, self.size)
            for (row, column), values in zip(self.places, entries, strict=True):
                matrix[row, column] = values[k]
            found.append(matrix)
        return found


@final
@dataclass(frozen=True, eq=False)
class State:
    """Two sets of states middle + frame * spread, one for each column of the spread (n, 2): that of
    all unknowns in a box, and in it that of the unknowns in the middle; and the derivative frame *
    slopes of the states by the unknowns, in the whole box.

    The frame (n, n), without radius, is moved by the flow: so a spread is not enclosed anew in
    another box at every step, which would make it grow by the sum of what every state does to every
    other (the parallelepiped method; Moore, 1966). What is lost by a frame that is nearly singular
    is a matter of bits.
    """

    middle: list[Ball]
    frame: Matrix
    spread: Matrix
    slopes: Matrix

    @classmethod
    def of(cls, z: Sequence[Ball], slopes: Matrix, point: Sequence[Ball] = ()) -> "State":
        """Return the set of states that is a box z (n,), with their derivatives (n, m); in it, that
        of the unknowns in the middle, `point` (n,), which is z itself by default.
        """
        middle = [each.mid() for each in point or z]
        return cls(middle, identity(len(z)), _around(middle, z, point or z), slopes)

    @property
    def box(self) -> list[Ball]:
        """The smallest box around the set."""
        return self._box(0)

    @property
    def point(self) -> list[Ball]:
        """The smallest box around the set of the unknowns in the middle."""
        return self._box(1)

    def _box(self, column: int) -> list[Ball]:
        around = self.frame * self.spread
        return [each + around[i, column] for i, each in enumerate(self.middle)]

    def near(self, change: Matrix) -> list[Ball]:
        """Return a box around the states of unknowns that are off the middle by a change (m, 1)
        within the box of unknowns.
        """
        moved = self.derivative * change
        return [each + moved[i, 0] for i, each in enumerate(self.point)]

    @property
    def derivative(self) -> Matrix:
        """The derivative of the states by the unknowns (n, m)."""
        return self.frame * self.slopes

    def lengthened(self, motion: Motion, column: int) -> "State":
        """Return the set with the derivative by how long it has moved added to a column."""
        module, n = flint(), len(self.middle)
        own = self.frame.inv() * module.arb_mat(n, 1, motion.value(self.box))
        slopes = module.arb_mat(self.slopes)
        for i in range(n):
            slopes[i, column] += own[i, 0]
        return State(self.middle, self.frame, self.spread, slopes)


@final
@dataclass(frozen=True, eq=False)
class Stage:
    """The boxes that contain a motion where a step begins and during it, and how long it is; the
    Taylor series of the motion from there to `SLOPES`, and from all of it to `ORDER`.
    """

    motion: Motion
    start: list[Ball]
    during: list[Ball]
    h: Ball
    near: list[Any]
    wide: list[Any]

    @once
    def parts(self, count: int) -> list[list[Ball]]:
        """Return boxes that contain the motion during so many equal parts of the step."""
        near = [coefficients(each, ORDER) for each in self.motion.series(self.start, ORDER)]
        last = [coefficients(each, ORDER + 1) for each in self.wide]
        found, flint().ctx.cap = [], 1
        for k in range(count):
            t = (self.h * k / count).union(self.h * (k + 1) / count)
            found.append([horner([*a, b[ORDER]], t) for a, b in zip(near, last, strict=True)])
        return found


def step(motion: Motion, state: State, times: tuple[Ball, Ball]) -> tuple[State, Stage] | None:
    """Return the set that the motion leads to in a time, that of the box of unknowns and that of
    their middle, and what contains it meanwhile; None where no such box was found.
    """
    h = times[0]
    box = state.box
    during = _enclosure(motion, box, h)
    if during is None:
        return None
    wide = motion.series(during, ORDER)
    last = [coefficients(each, ORDER + 1)[ORDER] for each in wide]
    if not finite(last):
        return None
    near = [coefficients(each, ORDER) for each in motion.series(state.middle, ORDER)]
    ends = [[horner([*a, b], t) for a, b in zip(near, last, strict=True)] for t in times]
    begins = motion.series(box, SLOPES)
    moved = _slope(motion, begins, wide, h) * state.frame
    return _carried(state, ends, moved), Stage(motion, box, during, h, begins, wide)


def nearly(motion: Motion, state: State, times: tuple[Ball, Ball]) -> tuple[State, Stage]:
    """Return about where the motion leads, with its derivative; nothing is claimed of it."""
    h = times[1]
    near = motion.series(state.middle, ORDER)
    end = [horner(coefficients(each, ORDER), h).mid() for each in near]
    frame = horner(evolved(motion.matrices(near, SLOPES), state.frame, SLOPES - 1), h).mid()
    return State(end, frame, state.spread, state.slopes), Stage(
        motion, state.middle, end, h, near, near
    )


def _carried(state: State, ends: Sequence[list[Ball]], moved: Matrix) -> State:
    """Return a set with its middle where that of the unknowns' middle ends, and its frame carried
    to `moved`, which has a radius.
    """
    frame = moved.mid()
    inverse = frame.inv()
    off = inverse * (moved - frame)
    middle = [each.mid() for each in ends[1]]
    spread = state.spread + off * state.spread + inverse * _around(middle, *ends)
    return State(middle, frame, spread, state.slopes + off * state.slopes)


def _around(middle: Sequence[Ball], *boxes: Sequence[Ball]) -> Matrix:
    """Return what boxes differ from a middle by (n, k)."""
    rows = [
        [each - a for each in row] for a, row in zip(middle, zip(*boxes, strict=True), strict=True)
    ]
    return flint().arb_mat(rows)


def _enclosure(motion: Motion, z: list[Ball], h: Ball) -> list[Ball] | None:
    module = flint()
    module.ctx.cap = 1
    meanwhile = module.arb(0).union(h)
    found = [start + meanwhile * rate for start, rate in zip(z, motion.value(z), strict=True)]
    for _ in range(_ROUNDS):
        wider = [module.arb(each.mid(), each.rad() * _WIDER) for each in found]
        image = [s + meanwhile * rate for s, rate in zip(z, motion.value(wider), strict=True)]
        if not finite(image):
            return None
        if all(a.contains(b) for a, b in zip(wider, image, strict=True)):
            return image
        found = image
    return None


def _slope(motion: Motion, near: list[Any], wide: list[Any], h: Ball) -> Matrix:
    """Return the derivative of a step by where it begins."""
    one = identity(motion.size)
    over = motion.matrices(wide, SLOPES)
    around = around_one(over[0], h)
    parts = evolved(motion.matrices(near, SLOPES), one, SLOPES - 1)
    parts.append(evolved(over, around, SLOPES)[-1])
    return horner(parts, h)


def passage(
    motion: Motion, state: State, length: Ball, shares: Sequence[Fraction], *, rough: bool = False
) -> tuple[State, tuple[Stage, ...]]:
    """Return the set that the motion over an arc leads to in steps of given shares of its length,
    and the stages on its way; a rough one is no enclosure.
    """
    move = nearly if rough else step
    during: list[Stage] = []
    left = list(reversed(shares))
    while left:
        share = left.pop()
        both = (each * share.numerator / share.denominator for each in (length, length.mid()))
        made = move(motion, state, tuple(both))
        if made is not None and finite(made[0].box):
            state = made[0]
            during.append(made[1])
        elif share.denominator <= _FINEST:
            left += [share / _HALF] * _HALF
        else:
            raise SolveError("the motion could not be enclosed")
    return state, tuple(during)


def shares(
    motion: Motion, z: list[Ball], length: Ball, small: float
) -> tuple[list[Fraction], list[Ball]]:
    """Return shares of an arc's length, of sum 1, in whose steps every remainder is at most
    `small`, and where about they lead; SolveError where there are none.
    """
    done, size, most, found = 0, _GRID // 8, float(_GRID), []
    while done < _GRID:
        size = min(max(int(min(size, most)), 1), _GRID - done)
        made = _tried(motion, z, length * size / _GRID)
        if made is None:
            most = size / _HALF
        elif made[1] <= small:
            found.append(Fraction(size, _GRID))
            z, done, most = made[0], done + size, most * _LOOSER
            if len(found) >= _SEEN and (expected := len(found) * _GRID // done) > _MANY:
                raise SolveError(f"an arc would take some {expected} steps, at most {_MANY}")
        if size == 1 and (made is None or not made[1] <= small):
            raise SolveError("the motion could not be enclosed in any steps")
        if made is not None:
            size = int(size * min(0.9 * (small / max(made[1], 1e-300)) ** (1.0 / ORDER), 4.0))
    return found, z


def _tried(motion: Motion, z: list[Ball], h: Ball) -> tuple[list[Ball], float] | None:
    """Return where a step leads, without radius, and its remainder."""
    during = _enclosure(motion, z, h)
    if during is None:
        return None
    last = [coefficients(each, ORDER + 1)[ORDER] for each in motion.series(during, ORDER)]
    near = [coefficients(each, ORDER) for each in motion.series(z, ORDER)]
    end = [horner(each, h).mid() for each in near]
    if not finite(last) or not finite(end):
        return None
    return end, max(float((top * h**ORDER).abs_upper()) for top in last)

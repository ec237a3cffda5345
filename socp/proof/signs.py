"""The inequalities of Pontryagin's principle along a word, shown by enclosures.

A quantity whose enclosure over a step is positive is positive there. Near a joint at which it
vanishes by the word's equations, with its derivatives up to some order, that order's derivative
along the motion has one sign over the steps up to the joint, and so the quantity has (Taylor).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import final

import casadi

from socp.errors import SolveError
from socp.model import Expr, column
from socp.proof.balls import Ball, Compiled, balls_of, compiled, flint, positive
from socp.proof.chain import Chain, Piece, same
from socp.proof.flow import Stage
from socp.proof.hamilton import is_zero, slope_of_switching
from socp.proof.krawczyk import Proved, Shot

_FEW = (1, 4)  # parts of a step in which a derivative is looked at
_PARTS = (*_FEW, 32, 256)  # in which a quantity is: more are narrower
_ORDER = 4  # derivatives at a joint: a control leaves an arc of order 2 with the fourth


@final
@dataclass(frozen=True, eq=False)
class Sign:
    """A quantity that must not be negative on a piece, what that means, and its slope where that is
    known beforehand.
    """

    what: str
    quantity: Expr
    slope: Expr = None

    @property
    def tower(self) -> list[Expr]:
        """The quantity, and its slope where it is known beforehand."""
        first = [casadi.SX(self.quantity)]
        return first if self.slope is None else [*first, self.slope]


@final
@dataclass(frozen=True, eq=False)
class Signs:
    """The conditions of a word on what was proved of its equations."""

    shot: Shot
    proved: Proved

    @property
    def chain(self) -> Chain:
        """The word's equations."""
        return self.shot.chain

    def check(self) -> list[str]:
        """Show every condition; SolveError says which one was not. Returns what was shown."""
        shown: dict[str, None] = {}
        for what, value in self._ends():
            if not positive(value):
                raise SolveError(f"{what}: its enclosure {value.str(5)} is not positive")
            shown[what] = None
        for k, piece in enumerate(self.chain.pieces):
            for sign in self._conditions(k, piece):
                self._along(k, sign)
                shown[sign.what] = None
        return list(shown)

    def _conditions(self, k: int, piece: Piece) -> Iterator[Sign]:
        """Yield what has a sign on piece k."""
        system, its = self.chain.system, piece.loop
        followed = set(its.multipliers)
        for i, (mode, name) in enumerate(zip(its.modes, system.problem.control_names, strict=True)):
            if mode.kind in {"lower", "upper"}:
                side = 1 if mode.kind == "lower" else -1
                slope = side * slope_of_switching(system, its, i)
                yield Sign(f"switching function of {name}", side * system.switching[i], slope)
                continue
            yield Sign(f"{name} within its bounds", its.control[i] - system.bound(i, "lower"))
            yield Sign(f"{name} within its bounds", system.bound(i, "upper") - its.control[i])
        for name, c in system.constraints.items():
            if name not in followed:
                yield Sign(f"state constraint {name}", -c)
        yield from (self._multiplier(k, piece, name) for name in followed)
        yield Sign("law of an arc", its.regular * its.regular)
        count = its.convexity.shape[0]
        for size in range(1, count + 1):
            for rows in combinations(range(count), size):
                part = its.convexity[list(rows), list(rows)]
                yield Sign("Legendre-Clebsch condition", casadi.det(part) if size > 1 else part)
        for symbol, argument in system.numbers.kinks.items():
            yield Sign("side of a kink", piece.signs[symbol] * argument)

    def _multiplier(self, k: int, piece: Piece, name: str) -> Sign:
        """Return the sign of a multiplier mu: that of -A / M where A + M mu = 0.

        M has one sign on the piece: it divides the determinant that is shown not to vanish.
        """
        what = f"multiplier of {name}"
        if name not in piece.loop.pulls:
            return Sign(what, piece.loop.multipliers[name])
        right, slope = piece.loop.pulls[name]
        function = compiled(slope, self.chain.system.z, self.shot.at(piece.signs))
        (value,) = balls_of(function.call(self.proved.run.stages[k][0].start))
        if positive(value * value):
            return Sign(what, -right if positive(value) else right)
        return Sign(what, piece.loop.multipliers[name])

    def _ends(self) -> Iterator[tuple[str, Ball]]:
        """Yield what has to be positive at the ends of the horizon, and the lengths of arcs."""
        chain, system, corners = self.chain, self.chain.system, self.proved.run.corners
        for length in self.shot.lengths(self.proved.unknowns):
            yield "length of an arc", length
        found: list[tuple[str, Expr]] = []
        slopes = casadi.gradient(chain.lagrangian, system.x)
        starts = casadi.gradient(chain.lagrangian, system.start)
        count = system.x.numel()
        boxes = ((system.problem.end_box, "end"), (system.problem.start_box, "start"))
        for box, end in boxes:
            for i, name in enumerate(system.problem.state_names):
                low, high = box[:, i]
                if low == high:
                    continue
                held = i in chain.last if end == "end" else i not in chain.free
                value = (system.z if end == "end" else system.start)[i]
                outward = slopes[i] - system.costate[i]
                if end == "start":
                    outward = starts[i] + system.start[count + i]
                fixed_at = chain.last.get(i) if end == "end" else chain.first[i]
                found += self._limits(
                    f"{end} of {name}", (low, high), value, held and fixed_at, -outward
                )
        by_name = dict(chain.met)
        for k, (name, _) in enumerate(chain.met):
            if not by_name[name]:
                found.append((f"multiplier of {name}", chain.nu[k]))
        found += [(f"target {n}", -e) for n, e, _ in system.conditions if n not in by_name]
        low, high = system.problem.final_time_box
        if low != high:
            slope = chain.energy + casadi.gradient(chain.lagrangian, system.z[-1])
            found += self._limits("final time", (low, high), system.z[-1], chain.duration, -slope)
        found += self._independent()
        unknowns = self.proved.unknowns
        nu = unknowns[len(unknowns) - chain.nu.numel() :] if chain.nu.numel() else []
        given = casadi.vertcat(system.z, system.start, chain.nu)
        values = compiled(
            column(e for _, e in found), given, self.shot.at(chain.pieces[-1].signs)
        ).call([*corners[-1], *corners[0], *nu])
        yield from zip(
            (what for what, _ in found), (flint().arb(v or 0) for v in values), strict=True
        )

    def _independent(self) -> Iterator[tuple[str, Expr]]:
        """Yield that the end conditions left out follow from what vanishes on the last arc."""
        implied = self.chain.implied
        if implied:
            costate = self.chain.system.costate
            slopes = casadi.vertcat(*(casadi.jacobian(e, costate) for e, _ in implied))
            part = casadi.det(casadi.densify(slopes[:, [k for _, k in implied]]))
            yield "end conditions that follow from others", part * part

    def _limits(
        self, what: str, box: Sequence[float], value: Expr, held: Expr, outward: Expr
    ) -> Iterator[tuple[str, Expr]]:
        """Yield that a value lies inside its interval, or that it is pushed against the limit that
        it is held at by the multiplier `outward`, which is positive at the upper one.
        """
        numbers = self.chain.system.numbers
        if held is None or held is False:
            low, high = box
            if low > -float("inf"):
                yield what, value - numbers.of(low)
            if high < float("inf"):
                yield what, numbers.of(high) - value
            return
        upper = is_zero(held - numbers.of(box[1])) if box[1] < float("inf") else False
        yield f"multiplier of the {what}", outward if upper else -outward

    # -- along a piece

    def _along(self, k: int, sign: Sign) -> None:
        """Show that a quantity is not negative along piece k: by a derivative from where it
        vanishes on, and by itself in between.
        """
        piece, tower = self.chain.pieces[k], sign.tower
        first, final = self._order(k, piece, tower), self._order(k + 1, piece, tower)
        ranges = _Ranges(self.shot, piece, tower, self.proved.run.stages[k])
        count = len(ranges.stages)
        front, back = 0, count - 1  # the first and the last stage that no derivative shows alone
        while first and front < count and ranges.positive(front, first, 1):
            front += 1
        while final and back >= front and ranges.positive(back, final, (-1) ** final):
            back -= 1
        for j in range(front, back + 1):
            if not ranges.shown(j, first if j == front else 0, final if j == back else 0):
                raise SolveError(
                    f"{sign.what}: not shown on arc {piece.arc + 1}, {j / count:.0%} of its steps: "
                    f"its enclosure there is {ranges.told(j)}"
                )

    def _order(self, corner: int, piece: Piece, tower: list[Expr]) -> int:
        """Return how many derivatives of a quantity vanish at a corner, the first missing; its
        tower grows as they are needed.
        """
        for order in range(_ORDER + 1):
            if order == len(tower):
                tower.append(piece.loop.derivative(self.chain.system.z, tower[-1]))
            if not self._vanishes(corner, piece.sided(tower[order])):
                return order
        raise SolveError("a quantity that vanishes at a joint with all its derivatives")

    def _vanishes(self, corner: int, expression: Expr) -> bool:
        """Tell whether an expression vanishes at a corner by what holds there."""
        return (
            is_zero(expression)
            or self._by_ends(corner, expression)
            or any(same(expression, known) for known in self._known[corner])
        )

    def _by_ends(self, corner: int, expression: Expr) -> bool:
        chain = self.chain
        if corner == 0:
            return chain.settled(expression)
        if corner < len(chain.pieces):
            return False
        z, count = chain.system.z, chain.system.x.numel()
        put = {count + i: value for i, value in chain.transversality.items()}
        for table in (put, chain.last):
            places = column(z[i] for i in table), column(table.values())
            expression = casadi.substitute(expression, *places)
        return is_zero(expression)

    @cached_property
    def _known(self) -> list[list[Expr]]:
        """What vanishes at every corner by the word's equations."""
        chain = self.chain
        found: list[list[Expr]] = [[] for _ in range(len(chain.pieces) + 1)]
        for k, piece in enumerate(chain.pieces):
            for corner in (k, k + 1):
                found[corner] += [piece.sided(each) for each in piece.loop.vanishing]
            found[k] += [piece.sided(each) for each in chain.joints[k]]
        return found


@final
@dataclass(frozen=True, eq=False)
class _Ranges:
    """Enclosures of a quantity and of its derivatives along a piece, stage by stage."""

    shot: Shot
    piece: Piece
    tower: list[Expr]
    stages: Sequence[Stage]

    @cached_property
    def _function(self) -> Compiled:
        system = self.shot.chain.system
        return compiled(column(self.tower), system.z, self.shot.at(self.piece.signs))

    def _rows(self, j: int, count: int) -> list[list[Ball]]:
        """Return the enclosures in so many parts of a stage."""
        stage = self.stages[j]
        boxes = [stage.during] if count == 1 else stage.parts(count)
        return [balls_of(self._function.call(box)) for box in boxes]

    def positive(self, j: int, order: int, side: int) -> bool:
        """Tell whether side times a derivative is positive on a whole stage."""
        return any(
            all(positive(side * row[order]) for row in self._rows(j, count)) for count in _FEW
        )

    def shown(self, j: int, first: int, final: int) -> bool:
        """Tell whether the quantity is positive on a stage, in whose first parts the derivative of
        an order may say so, and in its last ones another; 0 where none does.
        """
        for count in _PARTS:
            rows = self._rows(j, count)
            while first and rows and positive(rows[0][first]):
                del rows[0]
            while final and rows and positive((-1) ** final * rows[-1][final]):
                del rows[-1]
            if all(positive(row[0]) for row in rows):
                return True
        return False

    def told(self, j: int) -> str:
        """Return the enclosure of the quantity on a stage as text."""
        return str(self._rows(j, 1)[0][0].str(5))

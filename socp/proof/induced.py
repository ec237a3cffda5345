"""The finite-dimensional problem that a word induces, to second order, in balls: the objective over
free initial states, lengths of arcs and what their laws carry, subject to the conditions at ends
and joints.

On an arc with X' = F(X) let P be lambda + sum of alpha_j grad c^(j) over the constraints c that it
follows, alpha_0' = mu, alpha_j' = -alpha_(j-1), alpha = 0 where the constraint is left. It solves
the adjoint equation of F, so that the Lagrangian is stationary; its second derivative along changes
Y, Y' = F_X Y, is the integral of Y' K_XX Y, K = L + P . F, and what ends and joints add.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, final

import casadi

from socp.errors import SolveError
from socp.model import Expr, column
from socp.proof.balls import Ball, Compiled, Matrix, balls_of, coefficients, compiled, flint
from socp.proof.chain import Chain, Piece, looks
from socp.proof.flow import SLOPES, Stage
from socp.proof.krawczyk import Proved, Shot
from socp.proof.linear import bent, horner, identity, orthogonal
from socp.proof.steering import Steered, steered


@final
@dataclass(frozen=True, eq=False)
class Part:
    """A piece with its motion, and its derivatives along the motion of z as functions of z and
    alpha: the multipliers mu, the entries of F_X (n, n) and of K_XX (n, n).
    """

    piece: Piece
    its: Steered
    shot: Shot
    alpha: dict[str, Expr]
    order: int

    @cached_property
    def symbols(self) -> Expr:
        """(z, alpha) (nz + na, 1)."""
        return casadi.vertcat(self.shot.chain.system.z, *self.alpha.values())

    @cached_property
    def multipliers(self) -> Compiled:
        """The multipliers mu of the constraints as a function of z."""
        found = column(self.piece.loop.multipliers[name] for name in self.alpha)
        return self._compiled(found, self.shot.chain.system.z)

    @cached_property
    def adjoint(self) -> Expr:
        """Symbols of P for the states (nx, 1); for eta it is zero, and for time it matters not."""
        return casadi.SX.sym("P", self.shot.chain.system.x.numel())

    @cached_property
    def energy(self) -> Expr:
        """K = L + P . F as an expression of X and P, without P's share of time."""
        count = self.adjoint.numel()
        return self.its.running + casadi.dot(self.adjoint, self.its.rate[:count])

    @cached_property
    def entries(self) -> tuple[Compiled, list[tuple[int, int]], int]:
        """The entries that are not zero, their places, those of K_XX below F_X, and n."""
        x = self.its.state
        form = casadi.hessian(self.energy, x)[0]
        both = casadi.sparsify(self._along(casadi.vertcat(casadi.jacobian(self.its.rate, x), form)))
        rows, columns = both.sparsity().get_triplet()
        found = casadi.vertcat(casadi.SX(0, 1), *both.nonzeros())
        return self._compiled(found, self.symbols), list(zip(rows, columns, strict=True)), x.numel()

    @cached_property
    def ends(self) -> Compiled:
        """F (n, 1) and K_X (n, 1) as a function of z and alpha."""
        both = casadi.vertcat(self.its.rate, casadi.gradient(self.energy, self.its.state))
        return self._compiled(self._along(both), self.symbols)

    def _along(self, expression: Expr) -> Expr:
        """Return an expression of X and P along the motion of z."""
        system, kept = self.shot.chain.system, casadi.SX(0)
        for name, alpha in self.alpha.items():
            kept += casadi.dot(alpha, column(self.piece.loop.kept[name]))
        eta = self.its.state[self.adjoint.numel() + 1 :]
        # eta first: its symbols are those of costates, and P is made of these
        found = casadi.substitute(expression, eta, self.its.begins)
        at = system.costate + casadi.gradient(kept, system.x)
        return casadi.substitute(found, self.adjoint, at)

    def _compiled(self, expression: Expr, given: Expr) -> Compiled:
        return compiled(expression, given, self.shot.at(self.piece.signs))

    def matrices(self, series: Sequence[Any]) -> tuple[list[Matrix], list[Matrix]]:
        """Return the Taylor coefficients of F_X and K_XX along series of z and alpha."""
        function, places, n = self.entries
        flint().ctx.cap = self.order
        values = [coefficients(each, self.order) for each in function.call(series)]
        found: tuple[list[Matrix], list[Matrix]] = [], []
        for k in range(self.order):
            both = flint().arb_mat(n, n), flint().arb_mat(n, n)
            for (row, at), its in zip(places, values, strict=True):
                both[row // n][row % n, at] = its[k]
            for each, matrix in zip(found, both, strict=True):
                each.append(matrix)
        return found


@final
@dataclass(frozen=True, eq=False)
class Step:
    """A step of a piece's motion: V (n, n) up to it is frame * slopes, the frame orthogonal but for
    rounding, so that what grows does not blur what does not (Lohner, 1988), and what it adds,
    `form` (n, n).
    """

    frame: Matrix
    slopes: Matrix
    form: Matrix


@final
@dataclass(frozen=True, eq=False)
class Way:
    """A piece's motion: alpha where it begins, its steps, V (n, n) of all of it, and F (n, 1) and
    K_X (n, 1) where it ends.
    """

    alpha: list[Ball]
    steps: list[Step]
    slope: Matrix
    rate: Matrix
    pull: Matrix


def way(part: Part, stages: Sequence[Stage], corner: Sequence[Ball], alpha: list[Ball]) -> Way:
    """Return a piece's motion from its stages, z at its end and alpha there."""
    module, n = flint(), part.its.state.numel()
    ends = balls_of(part.ends.call([*corner, *alpha]))
    made: list[tuple[Matrix, Matrix]] = []
    for stage in reversed(stages):
        near = stage.near if part.order <= SLOPES else stage.motion.series(stage.start, part.order)
        series = near, stage.wide
        alpha, carried = _carried(part, series, alpha, stage.h)
        (a, b), (c, d) = (part.matrices([*z, *e]) for z, e in zip(series, carried, strict=True))
        made.append(bent((a, c), (b, d), stage.h, part.order))
    frame = slopes = identity(n)
    steps = []
    for slope, form in reversed(made):
        steps.append(Step(frame, slopes, form))
        moved = slope * frame
        frame = orthogonal(moved)
        slopes = frame.inv() * moved * slopes
    rate, pull = (module.arb_mat(n, 1, each) for each in (ends[:n], ends[n:]))
    return Way(alpha, steps, frame * slopes, rate, pull)


def _carried(
    part: Part, series: Sequence[Sequence[Any]], alpha: list[Ball], h: Ball
) -> tuple[list[Ball], tuple[list[Any], list[Any]]]:
    """Return alpha where a step begins, and its Taylor series there and over all of the step, from
    series of z and alpha at its end.
    """
    module = flint()
    begins: list[Ball] = []
    found: tuple[list[Any], list[Any]] = [], []
    if not alpha:
        return begins, found
    module.ctx.cap = part.order
    rates = [[coefficients(e, part.order) for e in part.multipliers.call(its)] for its in series]
    for k, symbols in enumerate(part.alpha.values()):
        near, wide = (each[k] for each in rates)
        for _ in range(symbols.numel()):
            near, wide = ([c / (i + 1) for i, c in enumerate(each)] for each in (near, wide))
            change = horner([*near[:-1], wide[-1]], h) * h
            begins.append(alpha[len(begins)] - change)
            during = begins[-1] + module.arb(0).union(h) * wide[0]
            near, wide = [begins[-1], *near[:-1]], [during, *wide[:-1]]
            for of, each in zip(found, (near, wide), strict=True):
                of.append(module.arb_series(each))
            near, wide = ([-c for c in each] for each in (near, wide))
    return begins, found


@final
@dataclass(frozen=True, eq=False)
class Induced:
    """The problem that a word induces, at what was proved of its equations. The variables q are the
    initial states that are free, the lengths of the pieces, and what laws carry. Taylor's formula
    is used to an order.
    """

    shot: Shot
    proved: Proved
    order: int

    @property
    def chain(self) -> Chain:
        """The word's equations."""
        return self.shot.chain

    @cached_property
    def parts(self) -> list[Part]:
        """The pieces with their motions."""
        system, solution, known = self.chain.system, self.chain.solution, dict[int, Steered]()
        found = []
        for piece in self.chain.pieces:
            if piece.arc not in known:
                near = looks(system, solution.arcs[piece.arc])
                known[piece.arc] = steered(system, piece.loop, near)
            alpha = {
                name: casadi.SX.sym(f"alpha_{name}", len(tower))
                for name, tower in piece.loop.kept.items()
            }
            found.append(Part(piece, known[piece.arc], self.shot, alpha, self.order))
        return found

    @cached_property
    def variables(self) -> int:
        """How many variables there are."""
        return len(self.chain.free) + len(self.parts) + sum(map(len, self.carried))

    @cached_property
    def carried(self) -> list[range]:
        """The places of what is carried among the variables, of every piece that begins an arc."""
        place, found = len(self.chain.free) + len(self.parts), []
        for k, part in enumerate(self.parts):
            first = k == 0 or self.parts[k - 1].piece.arc != part.piece.arc
            count = part.its.begins.numel() if first else 0
            found.append(range(place, place + count))
            place += count
        return found

    @cached_property
    def ways(self) -> list[Way]:
        """The motions of the pieces."""
        found: list[Way] = []
        run, known = self.proved.run, dict[str, list[Ball]]()
        for k, part in reversed(list(enumerate(self.parts))):
            zeros = {name: [flint().arb(0)] * s.numel() for name, s in part.alpha.items()}
            alpha = [each for name, zero in zeros.items() for each in known.get(name, zero)]
            found.insert(0, way(part, run.stages[k], run.corners[k + 1], alpha))
            begins = iter(found[0].alpha)
            known = {name: [next(begins) for _ in zero] for name, zero in zeros.items()}
        return found

    @cached_property
    def changes(self) -> list[Matrix]:
        """The derivatives of X by the variables (n, nq) where every piece begins, and where the
        last one ends.
        """
        module, nx = flint(), self.chain.system.x.numel()
        now = module.arb_mat(nx + 1, self.variables)
        for j, i in enumerate(self.chain.free):
            now[i, j] = 1
        found = []
        for k, (its, new) in enumerate(zip(self.ways, self.carried, strict=True)):
            if k == 0 or self.parts[k - 1].piece.arc != self.parts[k].piece.arc:
                begin = _rows(now, 0, nx + 1)
                now = _stacked(begin, module.arb_mat(len(new), self.variables))
                for i, place in enumerate(new):
                    now[nx + 1 + i, place] = 1
            found.append(now)
            now = its.slope * now + its.rate * self._length(k)
        return [*found, _rows(now, 0, nx + 1)]

    def _length(self, k: int) -> Matrix:
        found = flint().arb_mat(1, self.variables)
        found[0, len(self.chain.free) + k] = 1
        return found

    @cached_property
    def ends(self) -> Matrix:
        """The derivatives of states and time at the end and at the start by the variables."""
        nx = self.chain.system.x.numel()
        return _stacked(self.changes[-1], _rows(self.changes[0], 0, nx + 1))

    @cached_property
    def rows(self) -> list[Matrix]:
        """The derivatives of the conditions by the variables (m, nq): where pieces begin, and at
        the ends.
        """
        found = [
            slopes * _rows(change, 0, slopes.ncols())
            for (slopes, _), change in zip(self._joints, self.changes, strict=False)
        ]
        return [*found, self._ends[0] * self.ends]

    def curvature(self, kernel: Matrix) -> Matrix:
        """Return the Hessian of the Lagrangian (k, k) on directions (nq, k)."""
        _, form = self._ends
        total = _form(form, self.ends * kernel)
        for k, (its, change) in enumerate(zip(self.ways, self.changes, strict=False)):
            begin, longer = change * kernel, self._length(k) * kernel
            _, form = self._joints[k]
            total += _form(form, _rows(begin, 0, form.nrows()))
            for step in its.steps:
                total += _form(step.form, step.frame * (step.slopes * begin))
            turned = (its.slope * begin).transpose() * its.pull * longer
            total += turned + turned.transpose()
            total += longer.transpose() * (its.pull.transpose() * its.rate) * longer
        return (total + total.transpose()) / 2

    @cached_property
    def _joints(self) -> list[tuple[Matrix, Matrix]]:
        """The slopes in states and time of what vanishes where every piece begins, and the Hessian
        that it adds.

        That of a kink has the multiplier zero, as P is continuous there: the costate is, and the
        slopes of what a constraint keeps are where that has no kink.
        """
        found, system, before = [], self.chain.system, set[str]()
        kinks = column(system.numbers.kinks)
        given = casadi.vertcat(system.x, system.z[-1])
        for k, part in enumerate(self.parts):
            tower = {n: column(part.piece.loop.kept[n]) for n in part.alpha if n not in before}
            rows = column([] if part.piece.joint is None else [part.piece.joint])
            rows = casadi.vertcat(*tower.values(), rows)
            towers = column(e for name in part.alpha for e in part.piece.loop.kept[name])
            if part.piece.joint is not None and casadi.depends_on(towers, kinks):
                raise SolveError("a kink in a constraint along an arc")
            weighted = casadi.SX(0)
            for name, each in tower.items():
                weighted -= casadi.dot(part.alpha[name], each)
            values = self.shot.at(part.piece.signs)
            at = [*self.proved.run.corners[k], *self.ways[k].alpha]
            found.append(_both(rows, weighted, (given, part.symbols), values, at))
            before = set(part.alpha)
        return found

    @cached_property
    def _ends(self) -> tuple[Matrix, Matrix]:
        """The slopes in states and time, at the end and at the start, of the conditions there, and
        the Hessian of their Lagrangian.
        """
        chain, system = self.chain, self.chain.system
        nx, run, nu = system.x.numel(), self.proved.run, chain.nu.numel()
        given = casadi.vertcat(system.x, system.z[-1], system.start[:nx], system.start[-1])
        every = casadi.vertcat(system.z, system.start, chain.nu)
        unknowns = self.proved.unknowns
        at = [*run.corners[-1], *run.corners[0], *unknowns[len(unknowns) - nu :]]
        by_name = {name: expression for name, expression, _ in system.conditions}
        holds = [system.z[i] - value for i, value in chain.last.items()]
        holds += [by_name[name] for name, _ in chain.met]
        if chain.duration is not None:
            holds.append(system.z[-1] - chain.duration)
        values = self.shot.at(chain.pieces[-1].signs)
        return _both(column(holds), chain.lagrangian, (given, every), values, at)


def _both(
    rows: Expr,
    weighted: Expr,
    symbols: tuple[Expr, Expr],
    values: dict[Expr, Any],
    at: Sequence[Ball],
) -> tuple[Matrix, Matrix]:
    """Return the Jacobian of rows and the Hessian of a function by the first symbols, at values of
    the second.
    """
    found = casadi.jacobian(rows, symbols[0]), casadi.hessian(weighted, symbols[0])[0]
    slopes, form = (
        flint().arb_mat(
            *each.shape, balls_of(compiled(casadi.vec(each.T), symbols[1], values).call(at))
        )
        for each in found
    )
    return slopes, form


def _form(matrix: Matrix, way: Matrix) -> Matrix:
    return way.transpose() * (matrix * way)


def _rows(matrix: Matrix, first: int, last: int) -> Matrix:
    rows, n = matrix.tolist()[first:last], matrix.ncols()
    return flint().arb_mat(len(rows), n, [each for row in rows for each in row])


def _stacked(above: Matrix, below: Matrix) -> Matrix:
    rows = [*above.tolist(), *below.tolist()]
    return flint().arb_mat(len(rows), above.ncols(), [each for row in rows for each in row])

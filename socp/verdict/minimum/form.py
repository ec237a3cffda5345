"""The second variation of a word with its singular controls free, as a matrix.

Unknowns are the initial time, the lengths, parameters and initial states of the word, the
primitive w of every singular control's variation, a polynomial on every piece of an interval, and
its values h where it ends. A switch between a bang and a singular arc is no unknown of its own:
moving it is a change of w up to higher order, and would make any form degenerate. Where one
control's w ends and another's goes on, no term of both is left: N B is symmetric.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np

from socp.model import TINY, Problem, numbers, parameters_of
from socp.transcription import Shooting
from socp.verdict.minimum.induced import WEAK, Induced
from socp.verdict.minimum.stages import gauss, halved, lowered, pieces, spread
from socp.verdict.minimum.variation import Quadratic, reference, singular_places

_NODES = 5  # Gauss points of a piece: the motion to order 10, and w of degree 4
HALVINGS = 2  # of every interval of the mesh
# Parts of an interval, and Gauss points of each of them; w has `_NODES` values on each
_PIECES = 2**HALVINGS, _NODES
# None of these is one of the pieces' points: they leave order 10 to the coefficients of squares of
# w of degree 4
_WHOLE = 1, 9
# Those of the second variation that pieces are made of
_INSIDE = ("A", "Q", "B1", "M", "R")
# Of the largest entries: a value of w with none larger neither costs nor moves anything
_IDLE = 1e-9
# Where y ends on the pieces of a phase (n, ny, c) and what it costs (n, c, c)
Moved = tuple[np.ndarray, np.ndarray]


@final
@dataclass(frozen=True, eq=False)
class Form:
    """The quadratic form along a known extremal; columns are scaled to norm 1: times by the
    horizon, w by the width of the control's box times the horizon. First come the variables of the
    word, then the values h, then w: phase by phase, control by control. Intervals with singular
    controls are taken by a rule, so many parts of so many Gauss points each; those without are as
    the word's conditions take them.
    """

    problem: Problem
    known: Induced
    quadratics: dict[int, Quadratic]

    @property
    def shooting(self) -> Shooting:
        """The shooting equations that it belongs to."""
        return self.known.conditions.shooting

    @cached_property
    def places(self) -> list[tuple[int, ...]]:
        """Of every phase the places of its singular controls."""
        return singular_places(self.shooting)

    @cached_property
    def ends(self) -> list[tuple[int, ...]]:
        """Of every phase the places of the controls whose w ends with it."""
        following = [*self.places[1:], ()]
        return [
            tuple(place for place in here if place not in there)
            for here, there in zip(self.places, following, strict=True)
        ]

    @cached_property
    def base(self) -> np.ndarray:
        """Sizes of the variables of the word: initial time, lengths, parameters, initial states."""
        first = 1 + len(self.places) + self.problem.p.numel()
        return self.known.conditions.size[: first + self.problem.x.numel()]

    @cached_property
    def values(self) -> list[np.ndarray]:
        """Of every phase the columns of its values h."""
        parts = np.cumsum([0, *map(len, self.ends)])
        return np.split(self.base.size + np.arange(parts[-1]), parts[1:-1])

    def _columns(self, parts: int) -> list[np.ndarray]:
        """Return of every phase the columns of its w (m, n, s), on n pieces, so many parts of an
        interval.
        """
        at, found = self._fixed, []
        for places, block in zip(self.places, self.shooting.blocks, strict=True):
            shape = len(places), len(block.equations) * parts, _NODES
            found.append(at + np.arange(np.prod(shape, dtype=int)).reshape(shape))
            at += found[-1].size
        return found

    @property
    def _fixed(self) -> int:
        """How many columns come before those of w."""
        return self.base.size + sum(map(len, self.ends))

    @cached_property
    def free(self) -> int:
        """How many columns are those of w."""
        return sum(each.size for each in self._columns(_PIECES[0]))

    @cached_property
    def along(self) -> dict[int, dict[str, np.ndarray]]:
        """By phase with singular controls the coefficients (n, s, rows, columns) on its n
        intervals: at both ends, and at the points of either rule between them.
        """
        p = parameters_of(self.problem, self.shooting.solution)
        points, found = np.concatenate([[0.0], spread(*_PIECES), spread(*_WHOLE), [1.0]]), {}
        for k, each in self.quadratics.items():
            at = each.at(reference(self.known, k, each, points), p, self.places[k])
            found[k] = {name: e.reshape(-1, points.size, *e.shape[1:]) for name, e in at.items()}
        return found

    def at_end(self, k: int, end: int) -> dict[str, np.ndarray]:
        """Return the coefficients where phase k begins, 0, or ends, -1."""
        return {name: each[end, end] for name, each in self.along[k].items()}

    @cached_property
    def _units(self) -> np.ndarray:
        """What w of every control (nu,) is measured in."""
        horizon = self.known.at[1 : 1 + len(self.places)].sum()
        return np.array(np.diff(self.problem.box, axis=0)[0] * horizon)

    def _laid(self, rule: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the form of the motion (k, k), the change of the shooting variables (n, k) and
        times that stay (j, k).
        """
        nx, count, columns = self.problem.x.numel(), len(self.places), self._columns(rule[0])
        width = self._fixed + sum(each.size for each in columns)
        form, changed = np.zeros((width, width)), np.zeros((self.known.at.size, width))
        inner = np.arange(1 + count + self.problem.p.numel())
        changed[inner, inner] = self.base[inner]
        y = np.zeros((nx + 2 + self.problem.p.numel(), width))
        y[:nx, inner.size : self.base.size] = np.diag(self.base[inner.size :])
        y[nx, 0] = self.base[0]
        y[nx + 2 :, 1 + count : inner.size] = np.diag(self.base[1 + count : inner.size])
        fixed, moved, stop = [], self._driven(rule) | self._swept, self._fixed
        for k, block in enumerate(self.shooting.blocks):
            y[nx + 1] = 0.0
            y[nx + 1, 1 + k] = self.base[1 + k] / self.known.at[1 + k]
            changed[block.variables[0, :nx]] = y[:nx]
            stop += columns[k].size
            y = self._through(y, form, moved[k], columns[k], stop)
            y = self._ended(k, y, form) if self.ends[k] else y
            changed[block.variables[-1, :nx]] = y[:nx]
            if k + 1 < count and self.places[k] != self.places[k + 1]:
                fixed.append(y[nx] / self.base[0])
        return form, changed, np.reshape(fixed, (len(fixed), width))

    def _through(
        self, y: np.ndarray, form: np.ndarray, moved: Moved, columns: np.ndarray, stop: int
    ) -> np.ndarray:
        """Carry changes y (ny, k) through a phase and add what it costs to the form; all columns
        from `stop` on are those of w in later phases.
        """
        (ends, costs), ny = moved, len(y)
        own = columns.transpose(1, 2, 0).reshape(len(ends), -1)
        entered = np.zeros((len(ends) + 1, ny, stop))
        entered[0] = y[:, :stop]
        for j, end in enumerate(ends):
            np.matmul(end[:, :ny], entered[j], out=entered[j + 1])
            entered[j + 1][:, own[j]] = end[:, ny:]
        before = entered[:-1].reshape(-1, stop)
        form[:stop, :stop] += before.T @ (costs[:, :ny, :ny] @ entered[:-1]).reshape(before.shape)
        if own.size:
            mixed = (costs[:, ny:, :ny] @ entered[:-1]).reshape(own.size, stop)
            mixed = mixed[own.ravel().argsort()]
            form[stop - own.size : stop, :stop] += mixed
            form[:stop, stop - own.size : stop] += mixed.T
            form[own[:, :, None], own[:, None]] += costs[:, ny:, ny:]
        y = np.zeros_like(y)
        y[:, :stop] = entered[-1]
        return y

    def _driven(self, rule: tuple[int, int]) -> dict[int, Moved]:
        """Return, by phase with singular controls, where y ends (n, ny, c) on its n pieces and what
        it costs (n, c, c), by y where they begin and the values of w: worked out for all phases of
        as many controls together.
        """
        (parts, nodes), found = rule, dict[int, Moved]()
        _, weights, matrix = gauss(nodes)
        begin = 1 if rule == _PIECES else 1 + spread(*_PIECES).size
        for m in {len(places) for places in self.places} - {0}:
            phases = [k for k, places in enumerate(self.places) if len(places) == m]
            each = [np.repeat(self._lengths(k) / parts, parts) for k in phases]
            steps, until = np.concatenate(each), np.cumsum([len(lengths) for lengths in each])[:-1]
            at = {}
            for name in _INSIDE:
                whole = np.concatenate([self.along[k][name] for k in phases])
                whole = whole[:, begin : begin + parts * nodes]
                at[name] = whole.reshape(steps.size, nodes, *whole.shape[2:])
            own = np.array([self._units[list(self.places[k])] for k in phases])
            units = np.repeat(own, [len(lengths) for lengths in each], axis=0)
            size = np.sqrt(self.base[0] / (steps[:, None] * weights))[:, :, None] * units[:, None]
            both = pieces(at, size, lowered(_NODES, nodes), (steps, weights, matrix))
            split = (np.split(whole, until) for whole in both)
            found |= dict(zip(phases, zip(*split, strict=True), strict=True))
        return found

    @cached_property
    def _swept(self) -> dict[int, Moved]:
        """The same of the phases without singular controls, on their n intervals, by y where they
        begin: what the word's own conditions are made of tells both.
        """
        nx, found = self.problem.x.numel(), dict[int, Moved]()
        sweeps = self.known.conditions.linearised(self.known.at).sweeps
        for k in (k for k, places in enumerate(self.places) if not places):
            sweep, lengths = sweeps[k], self._lengths(k)
            n, _, ny = sweep.slopes.shape
            by = np.ones((n, ny))
            by[:, nx + 1] = lengths  # r stretches them all
            ends = np.tile(np.eye(ny), (n, 1, 1))
            ends[:, :nx] = sweep.slopes[:, :nx] * by[:, None]
            ends[:, nx, nx + 1] = lengths
            bent = sweep.bent(self.known.held[self.shooting.blocks[k].equations].T)
            found[k] = ends, by[:, :, None] * bent * by[:, None]
        return found

    def _lengths(self, k: int) -> np.ndarray:
        """Return the lengths (n,) of the intervals of a phase."""
        return np.array(self.known.at[1 + k] * np.diff(self.shooting.blocks[k].shares))

    def _ended(self, k: int, y: np.ndarray, form: np.ndarray) -> np.ndarray:
        """Add what values h of w cost where they end, and put them into the states."""
        at, h, units = self.at_end(k, -1), self.values[k], self._units[list(self.ends[k])]
        which = [self.places[k].index(place) for place in self.ends[k]]
        mixed = units[:, None] * (at["N"][which] @ y)
        form[h] += mixed
        form[:, h] += mixed.T
        form[h[:, None], h] += units[:, None] * at["NB"][np.ix_(which, which)] * units
        y[:, h] = at["B"][:, which] * units
        return y

    @cached_property
    def _conditions(self) -> tuple[np.ndarray, np.ndarray]:
        """The slopes (r, n) of the conditions that hold, by the shooting variables, and the Hessian
        (n, n) of what they add to the form.
        """
        known, shooting, nx = self.known, self.shooting, self.problem.x.numel()
        slopes, others = known.slopes, np.ones(len(known.slopes), dtype=bool)
        others[shooting.chain[1]] = False
        for each in shooting.blocks:  # what is carried is none of the form's
            carried = each.variables[:, nx:].ravel()
            others &= ~(slopes[:, carried] != 0).any(axis=1)
        # of the equations that are none of the motion, those that are linear have no Hessian
        held = np.where(others, known.held, 0.0)[shooting.others]
        (at_ends,) = numbers(shooting.joined[1], known.at, held)
        size = np.abs(known.held)
        weak = size <= WEAK * size.max(initial=0.0)
        return slopes[others & ((shooting.signs == 0) | ~weak)], at_ends

    def _kept(self, rule: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        """Return the form (k, k) with what the ends add, and the conditions (r, k) on it."""
        (form, changed, fixed), (slopes, at_ends) = self._laid(rule), self._conditions
        bent = np.flatnonzero(at_ends.any(axis=1))
        rows = np.vstack([slopes @ changed, fixed])
        rows /= np.maximum(np.linalg.norm(rows, axis=1, keepdims=True), TINY)
        return form + changed[bent].T @ at_ends[np.ix_(bent, bent)] @ changed[bent], rows

    @cached_property
    def kept(self) -> tuple[np.ndarray, np.ndarray]:
        """The form (k, k) and the conditions (r, k) on its columns, by the pieces."""
        return self._kept(_PIECES)

    @cached_property
    def idle(self) -> list[int]:
        """The columns of values h that cost nothing and move no condition."""
        form, rows = self.kept
        h = np.concatenate([*self.values, []]).astype(int)
        costs = np.abs(form[h]).max(axis=1, initial=0.0)
        moves = np.abs(rows[:, h]).max(axis=0, initial=0.0)
        largest = np.abs(np.diag(form)).max(initial=TINY)
        found: list[int] = h[(costs <= _IDLE * largest) & (moves <= _IDLE)].tolist()
        return found

    @cached_property
    def refined(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The form and its conditions without what is idle: with w on whole intervals first, and
        then with one halving of all pieces after the other. Each is that of a subspace of the next.
        """
        found, first, values = (
            [_without(self.idle, *self.kept)],
            self._fixed - len(self.idle),
            halved(_NODES),
        )
        for _ in range(HALVINGS):
            form, rows = found[0]
            form = _coarser(_coarser(form, first, values).T, first, values)
            found.insert(0, (form, _coarser(rows, first, values)))
        return found

    @cached_property
    def again(self) -> tuple[np.ndarray, np.ndarray]:
        """The first of `refined` by the Gauss points of whole intervals: what sets them apart is
        what either quadrature leaves.
        """
        return _without(self.idle, *self._kept(_WHOLE))


def _without(
    columns: list[int], form: np.ndarray, rows: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return a form (k, k) and its conditions (r, k) without some of the columns."""
    if not columns:
        return form, rows
    left = np.delete(form, columns, axis=1)
    return np.delete(left, columns, axis=0), np.delete(rows, columns, axis=1)


def _coarser(rows: np.ndarray, first: int, values: np.ndarray) -> np.ndarray:
    """Return rows (r, k), whose columns are values of w from the `first` on, by fewer values (s,)
    of w on every piece, by which those of its part of them are `values` (c, s).
    """
    own = rows[:, first:].reshape(len(rows), -1, len(values)) @ values
    return np.hstack([rows[:, :first], own.reshape(len(rows), -1)])

"""Rivals of an extremal: short words of bangs that meet a problem's ends at a lower cost, found by
shooting from random lengths.

Direct solves from scattered guesses may all lead to one extremal while another, far better one has
a motion that no coarse grid follows. Shooting asks for no grid: a thousand words with random
lengths are simulated at once, those that come nearest to the ends at less than the extremal's cost
are corrected by Gauss-Newton steps in their lengths (Levenberg's damping), and what then meets the
ends is a control that is better. It is solved along its word, and the search goes on from it.
"""

from dataclasses import dataclass
from typing import final

import casadi
import numpy as np

from socp.errors import MethodError, SolveError
from socp.methods import Follower, guess_of, split
from socp.model import (
    Expr,
    Mode,
    Problem,
    Solution,
    Watch,
    Word,
    column,
    end_symbols,
    numbers,
    parameters_of,
    scales,
    silent,
    time,
)
from socp.process import seconds_left
from socp.search.conclusion import pursue
from socp.search.effort import Search, along_words
from socp.solvers import Backend

_ARCS = 4  # of a word, at most: three switches, of one control after the other
_SHOTS = 1024  # words with random lengths: two hundred of each of the most that one control has
_STEPS = 10  # of Runge and Kutta's method on an arc: a guess takes no digits
_ALIKE = 8  # shots of one word that are corrected
_CORRECTED = 64  # shots that are corrected
_MET = 1e-3  # of the median miss of random shots: as much is none
# Steps of Gauss and Newton, and what is still off by so many times that miss is left after them
_ROUNDS = (3, 0.6), (3, 0.4), (3, 0.4), (8, _MET)
_LED_ON = 0.5  # of a miss: three such steps leave less, but next to a least miss, which stays
_BETTER = 1e-2  # of the cost: more than what shots that meet the ends so nearly are wrong by
_WORDS = 3  # words solved, the best first
_TIMES = 3  # better and better ones in a row
_ITERATIONS = 100  # from a control that meets the ends it takes some ten


def outdo(
    problem: Problem,
    search: Search,
    points: list[Solution],
    watch: Watch = silent,
    backend: Backend | None = None,
) -> None:
    """Go on from rivals of the certified solution, and from those of what comes of them, while they
    lead to better ones; all join the points in hand.
    """
    for _ in range(_TIMES):
        best = search.best
        if best is None or not best.extremal:
            return
        found = rivals(problem, best, watch, backend)
        points += found
        if found:
            pursue(problem, search, points, watch)
        if search.best is best:
            return


def rivals(
    problem: Problem, best: Solution, watch: Watch = silent, backend: Backend | None = None
) -> list[Solution]:
    """Return solutions along words of bangs, of three switches at most, that are clearly better
    than an extremal; mostly there are none.
    """
    if not np.isfinite(problem.box).all() or seconds_left() <= 0.0:
        return []
    shooting = _Shooting.of(problem, best)
    with np.errstate(all="ignore"):  # some shots escape
        shots = shooting.met(shooting.drawn())
    solve = Follower(longer=False, backend=along_words(backend, _ITERATIONS))
    found: list[Solution] = []
    for row in shots[:_WORDS]:
        word, guess = shooting.guess(row)
        try:
            solution = solve(problem, word, guess, watch)
        except (MethodError, SolveError):
            continue
        if solution.stop.ok and solution.objective < shooting.goal:
            found.append(solution)
    return found


@final
@dataclass(frozen=True, eq=False)
class _Shots:
    """Words with lengths: levels (n, arcs, nu) of the controls, 0 or 1 of their box, and lengths
    (n, arcs), 0 beyond a word's end.
    """

    levels: np.ndarray
    lengths: np.ndarray

    def __getitem__(self, rows: np.ndarray) -> "_Shots":
        return _Shots(self.levels[rows], self.lengths[rows])

    @property
    def words(self) -> list[bytes]:
        """What tells words apart."""
        used = (self.lengths > 0.0)[:, :, None]
        return [row.tobytes() for row in np.where(used, self.levels, -1.0)]


@final
@dataclass(frozen=True, eq=False)
class _Shooting:
    """A problem as shots see it.

    arc: carries (x, cost, t, worst violation of state and path limits, u, h, p) over the steps of
    an arc, step over one of them; ends: the rows that have to be 0 at the end, each at its size,
    and the Mayer term; first (nx,) and p (np,): those of the extremal; times: initial and final
    time; fixed: the horizon is given; cost: the extremal's; goal: the cost that a rival has to stay
    below.
    """

    problem: Problem
    arc: casadi.Function
    step: casadi.Function
    ends: casadi.Function
    first: np.ndarray
    p: np.ndarray
    times: tuple[float, float]
    fixed: bool
    cost: float
    goal: float

    @classmethod
    def of(cls, problem: Problem, best: Solution) -> "_Shooting":
        """Lay out shots that start where an extremal does."""
        sizes = scales(problem, best)
        cost = float(best.objective)
        return cls(
            problem,
            *_arc(problem, sizes),
            _ends(problem, sizes),
            best.arcs[0].x[:, 0],
            np.array(parameters_of(problem, best), dtype=float),
            (best.initial_time, best.final_time),
            bool(np.ptp(problem.final_time_box) == 0.0),
            cost,
            cost - _BETTER * abs(cost),
        )

    def drawn(self) -> _Shots:
        """Return random words, one control switching at a time, with random lengths."""
        random, nu = np.random.default_rng(0), len(self.problem.control_names)
        rows = np.arange(_SHOTS)
        levels = np.empty((_SHOTS, _ARCS, nu))
        levels[:, 0] = random.integers(0, 2, (_SHOTS, nu))
        for k in range(1, _ARCS):
            levels[:, k] = levels[:, k - 1]
            switching = random.integers(0, nu, _SHOTS)
            levels[rows, k, switching] = 1.0 - levels[rows, k, switching]
        lengths = random.exponential(size=(_SHOTS, _ARCS))
        lengths[np.arange(_ARCS) >= random.integers(1, _ARCS + 1, _SHOTS)[:, None]] = 0.0
        horizon = np.full((_SHOTS, 1), self.times[1] - self.times[0])
        if not self.fixed:  # a rival in time is shorter
            horizon *= 2.0 ** random.uniform(-2.0, 0.0, (_SHOTS, 1))
        return _Shots(levels, horizon * lengths / lengths.sum(axis=1, keepdims=True))

    def met(self, shots: _Shots) -> list[_Shots]:
        """Return shots that meet the ends at less than the goal once corrected, one a word, the
        cheapest first.
        """
        off, cost = self.residuals(shots)
        finite = np.isfinite(off).all(axis=1)
        sizes = np.median(np.abs(off[finite]), axis=0) if finite.any() else np.ones(off.shape[1])
        weights = 1.0 / np.where(sizes > 0.0, sizes, 1.0)
        shots = shots[_nearest(off * weights, shots.words)]
        last = np.full(len(shots.lengths), np.inf)
        for rounds, far in _ROUNDS:
            if not last.size:
                return []
            shots, off, cost = self._corrected(shots, weights, rounds)
            miss = np.abs(off * weights).max(axis=1, initial=0.0)
            near = (miss <= far) & (miss <= np.maximum(_LED_ON * last, _MET))
            shots, cost, last = shots[near], cost[near], miss[near]
        order = np.argsort(cost)
        words = shots.words
        first = {words[k]: k for k in reversed(order)}
        return [shots[np.array([k])] for k in sorted(first.values(), key=lambda k: float(cost[k]))]

    def residuals(self, shots: _Shots) -> tuple[np.ndarray, np.ndarray]:
        """Return what shots miss (n, rows), the last rows by how much limits are passed and the
        goal is missed, and what they cost (n,).
        """
        return self._missed(self._flight(shots)[-1])

    def _flight(self, shots: _Shots) -> np.ndarray:
        """Return what shots carry at the end of every arc (arcs, rows, n)."""
        states = [self._state(len(shots.lengths))]
        for k in range(_ARCS):
            states.append(self._flown(states[-1], shots.levels[:, k], shots.lengths[:, k]))
        return np.array(states[1:])

    def _missed(self, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return what is missed and paid by shots that end with a state (rows, n)."""
        nx = self.first.size
        x, cost, t, worst = state[:nx], state[nx], state[nx + 1], state[nx + 2]
        if not t.size:
            return np.empty((0, self.ends.size1_out(0) + 2)), np.empty(0)
        rows, mayer = numbers(self.ends, x, self.first, self.p, self.times[0], t)
        cost = cost + mayer[0]
        excess = np.maximum(cost - self.goal, 0.0) / (abs(self.cost) or 1.0)
        off = np.vstack([rows, worst, excess])
        off[:, ~np.isfinite(state).all(axis=0)] = np.nan  # fmax passes over what is no number
        return off.T, cost

    def guess(self, shot: _Shots) -> tuple[Word, Solution]:
        """Return the word of a single shot, and its motion as a guess."""
        used = np.flatnonzero(shot.lengths[0] > 0.0)
        low, high = self.problem.box
        state, nx = self._state(1), self.first.size
        times, states, inputs = [state[nx + 1, 0]], [state[:nx, 0]], []
        for k in used:
            for _ in range(_STEPS):
                state = self._flown(state, shot.levels[:, k], shot.lengths[:, k] / _STEPS)
                times.append(state[nx + 1, 0])
                states.append(state[:nx, 0])
                inputs.append(low + (high - low) * shot.levels[0, k])
        inputs.append(inputs[-1])
        p = dict(zip(self.problem.parameter_names, self.p.tolist(), strict=True))
        motion = guess_of(
            self.problem, np.array(times), np.transpose(states), np.transpose(inputs), p
        )
        arcs = [tuple(Mode.parse("+" if up else "-") for up in shot.levels[0, k]) for k in used]
        word = Word(self.problem.control_names, tuple(arcs))
        return word, split(motion, shot.lengths[0, used].tolist())

    def _state(self, n: int) -> np.ndarray:
        nu = self.problem.box.shape[1]
        column = [*self.first, 0.0, self.times[0], 0.0, *np.zeros(nu + 1), *self.p]
        return np.tile(np.array(column)[:, None], n)

    def _flown(
        self, state: np.ndarray, levels: np.ndarray, lengths: np.ndarray, *, brief: bool = False
    ) -> np.ndarray:
        """Return what is carried over an arc, in a single step where it is brief."""
        low, high = self.problem.box
        nx, nu = self.first.size, low.size
        going = np.flatnonzero(lengths > 0.0)  # beyond a word's end nothing moves
        now = state[:, going]
        now[nx + 3 : nx + 3 + nu] = (low + (high - low) * levels[going]).T
        now[nx + 3 + nu] = lengths[going] / (1 if brief else _STEPS)
        state = state.copy()
        state[:, going] = numbers(self.step if brief else self.arc, now)[0]
        return state

    def _corrected(
        self, shots: _Shots, weights: np.ndarray, rounds: int
    ) -> tuple[_Shots, np.ndarray, np.ndarray]:
        """Return shots after some steps of Gauss and Newton in their lengths, which stay positive,
        with what they miss and cost; a fixed horizon is kept.
        """
        damping = np.full(len(shots.lengths), 1e-2)
        states = self._flight(shots)
        off, cost = self._missed(states[-1])
        slopes = np.zeros((*off.shape, _ARCS))
        moved = np.ones(len(damping), dtype=bool)
        for _ in range(rounds):
            if moved.any():  # elsewhere they are what they were
                slopes[moved] = self._slopes(shots[moved], states[:, :, moved], off[moved])
            weighted = slopes * weights[:, None]
            square = np.einsum("nra,nrb->nab", weighted, weighted)
            size = np.trace(square, axis1=1, axis2=2) + np.finfo(float).tiny
            square += (damping * size)[:, None, None] * np.eye(_ARCS)
            step = np.linalg.solve(
                np.nan_to_num(square) + np.finfo(float).tiny * np.eye(_ARCS),
                -np.nan_to_num(np.einsum("nra,nr->na", weighted, off * weights))[:, :, None],
            )[:, :, 0]
            tried = self._kept(shots, shots.lengths + step)
            flown = self._flight(tried)
            new, paid = self._missed(flown[-1])
            moved = _norm(new * weights) < _norm(off * weights)
            lengths = np.where(moved[:, None], tried.lengths, shots.lengths)
            shots, states = _Shots(shots.levels, lengths), np.where(moved, flown, states)
            off, cost = np.where(moved[:, None], new, off), np.where(moved, paid, cost)
            damping = np.where(moved, damping / 10.0, damping * 10.0)
        return shots, off, cost

    def _slopes(self, shots: _Shots, states: np.ndarray, off: np.ndarray) -> np.ndarray:
        """Return the slopes (n, rows, arcs) of what shots miss by their lengths, 0 by those that a
        word does not have: an arc goes on a little beyond its end, and those after it follow.
        """
        horizon, n = self.times[1] - self.times[0], len(off)
        levels, little = shots.levels.swapaxes(0, 1), 1e-6 * horizon
        going = np.where(shots.lengths.T > 0.0, little, 0.0)
        # those of all arcs side by side
        state = self._flown(
            np.hstack(list(states)), np.vstack(list(levels)), going.ravel(), brief=True
        )
        for k in range(1, _ARCS):
            lengths = np.tile(shots.lengths[:, k], k)
            state[:, : k * n] = self._flown(state[:, : k * n], np.tile(levels[k], (k, 1)), lengths)
        moved = self._missed(state)[0].reshape(_ARCS, n, -1)
        slopes = np.moveaxis((moved - off) / little, 0, 2)
        if self.fixed:  # as one arc grows all of them shrink
            slopes -= np.einsum("nra,na->nr", slopes, shots.lengths)[:, :, None] / horizon
        return np.where(shots.lengths[:, None] > 0.0, slopes, 0.0)

    def _kept(self, shots: _Shots, lengths: np.ndarray) -> _Shots:
        """Return shots with other lengths, no arc lost or taken back, a fixed horizon kept."""
        least = 1e-6 * (self.times[1] - self.times[0])
        kept = np.where(shots.lengths > 0.0, np.maximum(lengths, least), 0.0)
        if self.fixed:
            kept *= (self.times[1] - self.times[0]) / kept.sum(axis=1, keepdims=True)
        return _Shots(shots.levels, kept)


def _norm(off: np.ndarray) -> np.ndarray:
    return np.array(np.nan_to_num(np.linalg.norm(off, axis=1), nan=np.inf))


def _nearest(off: np.ndarray, words: list[bytes]) -> np.ndarray:
    """Return the rows of the shots that miss least, only a few of every word."""
    counts: dict[bytes, int] = {}
    chosen: list[int] = []
    size = _norm(off)
    for k in np.argsort(size):
        if not np.isfinite(size[k]) or len(chosen) == _CORRECTED:
            break
        counts[words[k]] = counts.get(words[k], 0) + 1
        if counts[words[k]] <= _ALIKE:
            chosen.append(int(k))
    return np.array(chosen, dtype=int)


def _arc(problem: Problem, sizes: np.ndarray) -> tuple[casadi.Function, casadi.Function]:
    """Return the steps of an arc and a single one: the motion by Runge and Kutta's method of order
    4, its controls held, as functions of what it carries.
    """
    x, u, p = problem.x, problem.u, problem.p
    cost, worst, h = (casadi.SX.sym(name) for name in ("cost", "worst", "h"))
    terms = casadi.vertcat(problem.rate, problem.lagrangian)
    both = casadi.Function("rate", [x, u, time, p], [terms])

    def rate(z: Expr, t: Expr) -> Expr:
        return both(z[:-1], u, t, p)

    z = casadi.vertcat(x, cost)
    one = rate(z, time)
    two = rate(z + h / 2.0 * one, time + h / 2.0)
    three = rate(z + h / 2.0 * two, time + h / 2.0)
    four = rate(z + h * three, time + h)
    z = z + h / 6.0 * (one + 2.0 * two + 2.0 * three + four)
    limits = casadi.Function("limits", [x, time, p], [_passed(problem, sizes)])
    worst_now = casadi.fmax(worst, limits(z[:-1], time + h, p))
    before = casadi.vertcat(x, cost, time, worst, u, h, p)
    step = casadi.Function("step", [before], [casadi.vertcat(z, time + h, worst_now, u, h, p)])
    return step.fold(_STEPS).expand(), step  # as one list of operations, which takes less time


def _passed(problem: Problem, sizes: np.ndarray) -> Expr:
    """Return by how much states and path constraints are past their limits, relative to their
    sizes; 0 inside.
    """
    rows = [casadi.SX(0)]
    for value, size, (low, high) in zip(
        casadi.vertsplit(problem.x), sizes, problem.state_box.T, strict=True
    ):
        rows += [(low - value) / size] if np.isfinite(low) else []
        rows += [(value - high) / size] if np.isfinite(high) else []
    for constraint in problem.constraints:
        slope = casadi.fabs(casadi.jacobian(constraint.expression, problem.x))
        rows.append(constraint.expression / (casadi.mtimes(slope, casadi.DM(sizes)) + 1e-300))
    return casadi.mmax(casadi.vertcat(*rows))


def _ends(problem: Problem, sizes: np.ndarray) -> casadi.Function:
    """Return the rows that vanish where the ends are met, and the Mayer term."""
    last = problem.x
    low, high = problem.end_box
    rows = []
    for k, size in enumerate(sizes):
        if low[k] == high[k]:
            rows.append((last[k] - low[k]) / size)
        elif np.isfinite([low[k], high[k]]).any():
            rows.append(casadi.fmax(casadi.fmax(low[k] - last[k], last[k] - high[k]), 0.0) / size)
    for condition in problem.conditions:
        value = condition.expression
        rows.append(value if condition.equation else casadi.fmax(value, 0.0))
    symbols = end_symbols(problem)
    return casadi.Function("ends", symbols, [column(rows), problem.mayer])
